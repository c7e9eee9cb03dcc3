/** What is drawn, and how it is wanted: kept in the address after #, undone and done again. */

import { lengthOf } from "./path.js";

const GRAIN = 0.0004;  // m: what a point may lie beside the line between its neighbours, to be left out of a link
const UNIT = 1e-4;  // m: of the numbers in a link
const MOST_POINTS = 600, MOST_STEPS = 100;

/** The points that a drawing needs (Douglas and Peucker's method), all within GRAIN of the line through the others. */
function thinned(points) {
  if (points.length < 3) return points;
  const kept = new Set([0, points.length - 1]), pieces = [[0, points.length - 1]];
  while (pieces.length) {
    const [from, to] = pieces.pop(), [ax, ay] = points[from], [bx, by] = points[to];
    const length = Math.hypot(bx - ax, by - ay);
    let farthest = GRAIN, at = -1;
    for (let k = from + 1; k < to; k++) {
      const [x, y] = points[k];
      const across = Math.abs((bx - ax) * (y - ay) - (by - ay) * (x - ax));
      const aside = length ? across / length : Math.hypot(x - ax, y - ay);
      if (aside > farthest) [farthest, at] = [aside, k];
    }
    if (at < 0) continue;
    kept.add(at);
    pieces.push([from, at], [at, to]);
  }
  return points.filter((_, k) => kept.has(k));
}

/** A drawing, and what is asked of it by name, as the text after # of a link. */
export function encode({ points, ...asked }) {
  const bytes = new Uint8Array(Int16Array.from(thinned(points).flat(), (value) => Math.round(value / UNIT)).buffer);
  const text = btoa(String.fromCharCode(...bytes)).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
  return new URLSearchParams({ ...asked, d: text }).toString();
}

/** The same from a link, or null where it holds no drawing: anybody may have written it. */
export function decode(text) {
  try {
    const values = new URLSearchParams(text), data = atob(values.get("d").replaceAll("-", "+").replaceAll("_", "/"));
    const numbers = new Int16Array(Uint8Array.from(data, (letter) => letter.charCodeAt(0)).buffer);
    const points = Array.from({ length: numbers.length / 2 }, (_, k) => [numbers[2 * k], numbers[2 * k + 1]])
      .map((point) => point.map((value) => value * UNIT));
    if (points.length < 2 || points.length > MOST_POINTS || !(lengthOf(points) < 10)) return null;
    const asked = { limits: values.get("limits") };
    for (const name of ["speed", "static", "kinetic"]) {
      const value = Number(values.get(name));
      if (value > 0) asked[name] = value;
    }
    return { points, ...asked };
  } catch {
    return null;
  }
}

/** Drawings one after the other. */
export class History {
  #steps = [];
  #at = -1;

  /** Take a drawing as the newest; what was undone before is gone. */
  add(points) {
    this.#steps = [...this.#steps.slice(0, this.#at + 1), points].slice(-MOST_STEPS);
    this.#at = this.#steps.length - 1;
  }
  get canUndo() { return this.#at > 0; }
  get canRedo() { return this.#at < this.#steps.length - 1; }
  undo() { return this.#steps[this.canUndo ? --this.#at : this.#at]; }
  redo() { return this.#steps[this.canRedo ? ++this.#at : this.#at]; }
}
