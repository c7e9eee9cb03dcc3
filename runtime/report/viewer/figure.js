/** What plots are made of: figures, marks in SVG, and the round numbers along an axis. */

import { element, number, roundStep, svg } from "./dom.js";

export const px = (value) => value.toFixed(1);
export const scaled = (values, factor) => values.map((value) => value * factor);
export const line = (x, y) => `M${x.map((value, k) => `${px(value)} ${px(y[k])}`).join("L")}`;

/** A path of a kind, which is a class of viewer.css. */
export const mark = (kind, d) => `<path class="${kind}" d="${d}"/>`;
export const label = (x, y, anchor, content, kind = "") =>
  `<text class="${kind}" x="${px(x)}" y="${px(y)}" text-anchor="${anchor}">${content}</text>`;

/** Round numbers that divide [low, high] into at most `count` parts, and the decimals to write them with. */
export function ticks(low, high, count) {
  const step = roundStep((high - low) / count);
  const first = Math.ceil(low / step - 1e-9), last = Math.floor(high / step + 1e-9);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return Array.from({ length: last - first + 1 }, (_, index) => {
    const value = (first + index) * step;
    return { value, text: number(value, digits) };
  });
}

/** Add a figure with a heading to an element, and return the frame that its drawing goes into. */
export function addFigure(parent, { title, unit }, ...beside) {
  const frame = element("div", { className: "frame" });
  const heading = element("h2", {}, `${title} `, element("small", { textContent: unit }));
  parent.append(element("figure", { className: "plot" }, element("figcaption", {}, heading, ...beside), frame));
  return frame;
}

/** Put a drawing in a frame, in the place of the last one; its words come from here, not from a document. */
export function setDrawing(frame, width, height, words, parts) {
  const size = `width="${width}" height="${height}" viewBox="0 0 ${width} ${height}"`;
  frame.querySelector("svg")?.remove();
  frame.prepend(svg(`${size} role="img" aria-label="${words}"`, parts.join("")));
}
