/** Plots over time, as SVG: each with a legend that reads the values at the play head, or under the pointer. */

import { element, number, svg, swatch } from "./dom.js";
import { distances, lengths, locate, valueAt } from "./motion.js";

const AREA = { left: 42, right: 32, top: 7, bottom: 118 };  // pixels; left, right and top are margins

const px = (value) => value.toFixed(1);
const scaled = (values, factor) => values.map((value) => value * factor);
const polyline = (x, y) => `M${x.map((value, k) => `${px(value)} ${px(y[k])}`).join("L")}`;
const path = (kind, d) => `<path class="${kind}" d="${d}"/>`;
const text = (x, y, anchor, content, kind = "") =>
  `<text class="${kind}" x="${px(x)}" y="${px(y)}" text-anchor="${anchor}">${content}</text>`;

/** Lowest and highest of the values; a loop, because a call takes no 100,000 arguments. */
function range(lists) {
  let low = Infinity, high = -Infinity;
  for (const values of lists) {
    for (const value of values) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  return [low, high];
}

/** Round numbers that divide [low, high] into at most `count` parts, and the decimals to write them with. */
function ticks(low, high, count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((candidate) => candidate >= rough * 0.999);
  const first = Math.ceil(low / step - 1e-9), last = Math.floor(high / step + 1e-9);
  const values = Array.from({ length: last - first + 1 }, (_, index) => (first + index) * step);
  return { values, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

/** What is plotted of a motion; a series' kind is its class, `area` fills down to 0; rules are level lines. */
function plotsOf(motion) {
  const wanted = (axis) => ({ name: "command", values: scaled(motion.command[axis], 1e3), kind: "command" });
  const object = (axis) => ({ name: "object", values: scaled(motion.object[axis], 1e3), kind: "object" });
  const pan = (axis) => ({ name: axis, values: scaled(motion.pan[axis], 1e3), kind: axis === "x" ? "pan" : "pan dashed" });
  const error = scaled(distances(motion.object, motion.command), 1e3);
  const rules = [{ value: motion.breakaway, label: "μg" }];
  if (motion.hold < motion.breakaway) rules.push({ value: motion.hold, label: "μ′g" });
  return [
    {
      title: "Pan acceleration", unit: "m/s²", zero: true, slip: true, digits: 1, rules,
      series: [{ name: "magnitude", values: lengths(motion.acceleration), kind: "pan" }],
    },
    { title: "Object x", unit: "mm, on the pan", digits: 1, rules: [], series: [wanted("x"), object("x")] },
    { title: "Object y", unit: "mm, on the pan", digits: 1, rules: [], series: [wanted("y"), object("y")] },
    {
      title: "Tracking error", unit: "mm", zero: true, digits: 1,
      rules: [{ value: motion.quality.tracking_rmse * 1e3, label: "RMS" }],
      series: [{ name: "distance", values: error, kind: "object", area: true }],
    },
    {
      title: "Object speed", unit: "m/s, on the pan", zero: true, slip: true, digits: 2, rules: [],
      series: [{ name: "object", values: motion.speed, kind: "object", area: true }],
    },
    { title: "Pan position", unit: "mm, in the world", digits: 1, rules: [], series: [pan("x"), pan("y")] },
  ];
}

export class Plots {
  #plots = [];

  /** @param parent  the element to plot in; @param player  whose time is shown, and moved by the pointer */
  constructor(parent, player) {
    this.parent = parent;
    this.player = player;
  }

  load(motion) {
    this.motion = motion;
    this.parent.replaceChildren();
    this.#plots = plotsOf(motion).map((plot) => this.#add(plot));
    this.resize();
  }

  resize() {
    if (this.motion) this.#plots.forEach((plot) => this.#draw(plot));
  }

  show() {
    const { t, hover } = this.player;
    const now = Math.min(t, this.motion.end), at = hover ?? now;
    const place = locate(this.motion, at);
    for (const { head, pointer, across, readings, digits } of this.#plots) {
      head.style.transform = `translateX(${across(now)}px)`;
      pointer.hidden = hover === null;
      pointer.style.transform = `translateX(${across(at)}px)`;
      pointer.dataset.time = `${this.player.seconds(at)} s`;
      for (const { reading, values } of readings) reading.textContent = number(valueAt(values, place), digits);
    }
  }

  #add(plot) {
    const legend = element("div", { className: "legend number" });
    if (plot.slip) {
      const band = svg('viewBox="0 0 20 8" aria-hidden="true"', path("band", "M0-2h20v12H0z"));
      legend.append(element("span", {}, band, "slides"));
    }
    const readings = plot.series.map(({ name, kind, values }) => {
      const reading = element("b");
      legend.append(element("span", {}, swatch(kind), name, reading));
      return { reading, values };
    });
    const frame = element("div", { className: "frame" });
    const head = element("div", { className: "head" });
    const pointer = element("div", { className: "pointer", hidden: true });
    frame.append(head, pointer);
    const heading = element("h2", {}, `${plot.title} `, element("small", { textContent: plot.unit }));
    this.parent.append(
      element("figure", { className: "plot" }, element("figcaption", {}, heading, legend), frame));
    let [low, high] = range([
      plot.rules.map((rule) => rule.value), plot.zero ? [0] : [], ...plot.series.map((line) => line.values)]);
    if (high - low < 1e-6) high = low + 1;  // a flat line needs an axis, too
    const air = (high - low) * 0.07;
    const ready = { ...plot, frame, head, pointer, readings, low: plot.zero ? low : low - air, high: high + air };
    this.#followPointer(ready);
    return ready;
  }

  #draw(plot) {
    const { motion } = this, { left, top, bottom } = AREA;
    const width = plot.frame.clientWidth, right = width - AREA.right;
    const across = (t) => left + (motion.end > 0 ? t / motion.end : 0) * (right - left);
    const down = (value) => bottom - (value - plot.low) / (plot.high - plot.low) * (bottom - top);
    const level = (value) => `M${left} ${px(down(value))}H${right}`;
    const parts = [];
    for (const [from, to] of plot.slip ? motion.slip : []) {
      parts.push(path("band", `M${px(across(from))} ${top}V${bottom}H${px(across(Math.min(to, motion.end)))}V${top}z`));
    }
    const { values, digits } = ticks(plot.low, plot.high, 4);
    for (const value of values) {
      parts.push(path(Math.abs(value) < 1e-9 ? "zero" : "grid", level(value)));
      parts.push(text(left - 7, down(value) + 4, "end", number(value, digits)));
    }
    const times = ticks(0, Math.max(motion.end, motion.step), Math.max(2, Math.min(6, (right - left) / 70)));
    for (const t of times.values) {
      parts.push(path("grid", `M${px(across(t))} ${top}V${bottom}`));
      parts.push(text(across(t), bottom + 17, "middle", number(t, times.digits)));
    }
    parts.push(text(right + 4, bottom + 17, "start", "s"));
    for (const { value, label } of plot.rules) {
      parts.push(path("rule", level(value)), text(right + 4, down(value) + 4, "start", label, "label"));
    }
    const x = motion.time.map(across);
    for (const line of [...plot.series].reverse()) {  // the first lies on top
      const d = polyline(x, line.values.map(down));
      if (line.area) parts.push(path(`fill ${line.kind}`, `${d}V${px(down(0))}H${left}z`));
      parts.push(path(`curve ${line.kind}`, d));
    }
    const height = bottom + 22;
    const [least, most] = range([plot.series.at(-1).values]).map((value) => number(value, plot.digits));
    const label = `${plot.title} over time, from ${least} to ${most} ${plot.unit}`;
    plot.frame.querySelector("svg")?.remove();
    plot.frame.prepend(svg(
      `width="${width}" height="${height}" viewBox="0 0 ${width} ${height}" role="img" aria-label="${label}"`,
      parts.join("")));
    for (const line of [plot.head, plot.pointer]) Object.assign(line.style, { top: `${top}px`, height: `${bottom - top}px` });
    const timeAt = (at) => Math.min(Math.max((at - left) / (right - left), 0), 1) * motion.end;
    Object.assign(plot, { across, timeAt });
  }

  #followPointer(plot) {
    const { player } = this;
    const timeAt = (event) => plot.timeAt(event.clientX - plot.frame.getBoundingClientRect().left);
    const hover = (t) => {
      player.hover = t;
      if (!player.playing) player.show();
    };
    plot.frame.addEventListener("pointerdown", (event) => {
      plot.frame.setPointerCapture(event.pointerId);
      player.hover = null;
      player.seek(timeAt(event));
    });
    plot.frame.addEventListener("pointermove", (event) => {
      if (event.buttons) player.seek(timeAt(event)); else hover(timeAt(event));
    });
    plot.frame.addEventListener("pointerleave", () => hover(null));
  }
}
