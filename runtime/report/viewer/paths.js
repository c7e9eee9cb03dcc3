/** Plots of paths from above, equal scales: a dot follows the planned one in time. */

import { element } from "./dom.js";
import { addFigure, label, line, mark, px, scaled, setDrawing, ticks } from "./figure.js";
import { locate, pointAt, range } from "./motion.js";

const MARGIN = { left: 42, right: 4, top: 4 };  // pixels, margins

const millimetres = (path, kind) => ({ x: scaled(path.x, 1e3), y: scaled(path.y, 1e3), kind });

/** What is plotted of a motion: paths, the one that the dot follows, and a ring (mm) or null. */
function pathsOf(motion) {
  const { tracks, radius, reachLimit } = motion;
  const [pan, object] = ["pan", "object"].map((what) => [
    millimetres(motion[what], what), ...tracks.map((track) => millimetres(track[what], track.kind))]);
  const rim = motion.farthest > radius.pan ? radius.pan * 1e3 : null;
  return [
    {
      title: "Object", unit: "mm, on the pan", paths: [millimetres(motion.command, "command"), ...object],
      followed: object[0], ring: rim, words: "rim",
    },
    {
      title: "Pan", unit: "mm, in the world", paths: pan,
      followed: pan[0], ring: reachLimit ? reachLimit * 1e3 : null, words: "limit",
    },
  ];
}

export class Paths {
  #plots = [];

  /** @param parent  the element to plot in */
  constructor(parent) {
    this.parent = parent;
  }

  load(motion) {
    this.motion = motion;
    this.parent.replaceChildren();
    this.#plots = pathsOf(motion).map((plot) => this.#add(plot));
  }

  resize() {
    this.#plots.forEach((plot) => this.#draw(plot));
  }

  show(now, at) {
    const place = locate(this.motion, at);
    for (const { dot, followed, across, down } of this.#plots) {
      const [x, y] = pointAt(followed, place);
      dot.style.transform = `translate(${across(x)}px, ${down(y)}px)`;
    }
  }

  #add(plot) {
    const frame = addFigure(this.parent, plot);
    const dot = element("div", { className: `dot ${plot.followed.kind}` });
    frame.append(dot);
    const ring = plot.ring ? [-plot.ring, plot.ring] : [];
    const [x, y] = ["x", "y"].map((axis) => range([...plot.paths.map((path) => path[axis]), ring]));
    const half = Math.max(x[1] - x[0], y[1] - y[0], 1) / 2 * 1.1;
    return { ...plot, frame, dot, half, x: (x[0] + x[1]) / 2, y: (y[0] + y[1]) / 2 };
  }

  #draw(plot) {
    const { x, y, half, ring } = plot, { left, top } = MARGIN;
    const width = plot.frame.clientWidth, size = width - left - MARGIN.right, scale = size / (2 * half);
    const across = (value) => left + (value - x + half) * scale;
    const down = (value) => top + (y + half - value) * scale;
    const parts = [];
    for (const { value, text } of ticks(x - half, x + half, 4)) {
      parts.push(mark("grid", `M${px(across(value))} ${top}v${size}`));
      parts.push(label(across(value), top + size + 15, "middle", text));
    }
    for (const { value, text } of ticks(y - half, y + half, 4)) {
      parts.push(mark("grid", `M${left} ${px(down(value))}h${size}`));
      parts.push(label(left - 6, down(value) + 4, "end", text));
    }
    if (ring) {
      parts.push(`<circle class="rule" cx="${px(across(0))}" cy="${px(down(0))}" r="${px(ring * scale)}"/>`);
      parts.push(label(across(0), down(-ring) - 7, "middle", `${plot.words} ${Math.round(ring)} mm`, "label"));
    }
    for (const path of [...plot.paths].reverse()) {
      parts.push(mark(`curve ${path.kind}`, line(path.x.map(across), path.y.map(down))));
    }
    setDrawing(plot.frame, width, top + size + 20, `${plot.title}, path seen from above, in mm`, parts);
    Object.assign(plot, { across, down });
  }
}
