/** Plots over time: each with a legend that reads the values at the play head, or under the pointer. */

import { element, number, svg, swatch } from "./dom.js";
import { addFigure, label, line, mark, px, scaled, setDrawing, ticks } from "./figure.js";
import { GRAVITY, distances, lengths, locate, range, valueAt } from "./motion.js";

const AREA = { left: 42, right: 32, top: 7, bottom: 118 };  // pixels; left, right and top are margins
const APART = 1e-5;  // m: a track whose pan differs by less moved as planned, and its pan is not plotted again

/**
 * What is plotted of a motion. A series' kind is its class, `area` fills down to 0, `silent` keeps it out of the
 * legend; rules are level lines; `zero` is for an axis that begins there, `slip` for phases that are shaded.
 */
function plotsOf(motion) {
  const { tracks } = motion;
  const lines = (valuesOf, area = false) =>
    [motion, ...tracks].map((each, index) => ({ ...each, values: valuesOf(each), area: area && index === 0 }));
  const along = (axis) => [
    { name: "command", values: scaled(motion.command[axis], 1e3), kind: "command" },
    ...lines(({ object }) => scaled(object[axis], 1e3))];
  const pan = (each, kind) => ["x", "y"].map((axis) =>
    ({ name: axis, values: scaled(each.pan[axis], 1e3), kind: axis === "x" ? kind : `${kind} dashed` }));
  const apart = tracks.filter((track) => range([distances(track.pan, motion.pan)])[1] > APART);
  const breaks = [{ value: motion.breakaway, words: "μg" }];
  if (motion.hold < motion.breakaway) breaks.push({ value: motion.hold, words: "μ′g" });
  const { acceleration, lifts, heightLimit } = motion;
  const level = {
    title: "Pan acceleration", unit: "m/s²", zero: true, slip: true, rules: breaks,
    series: [{ name: "magnitude", values: lengths(acceleration), kind: "pan" }],
  };
  // Of a pan that lifts, what friction holds changes with it: as it sinks, the object weighs less.
  const lifting = [
    {
      title: "Pan acceleration", unit: "m/s²", slip: true,
      series: [
        { name: "in the plane", values: lengths(acceleration), kind: "pan" },
        { name: "upwards", values: acceleration.z, kind: "pan dashed" },
        { name: "friction holds", values: acceleration.z.map((w) => motion.static * (GRAVITY + w)), kind: "command" },
      ],
    },
    {
      title: "Pan height", unit: "mm",
      rules: heightLimit ? [1, -1].map((sign) => ({ value: sign * heightLimit * 1e3, words: "limit" })) : [],
      series: [{ name: "z", values: scaled(motion.pan.z, 1e3), kind: "pan" }, ...apart.map((track) =>
        ({ name: track.name, values: scaled(track.pan.z, 1e3), kind: track.kind }))],
    },
  ];
  const plots = [
    ...(lifts ? lifting : [level]),
    { title: "Object x", unit: "mm, on the pan", series: along("x") },
    { title: "Object y", unit: "mm, on the pan", series: along("y") },
    {
      title: "Tracking error", unit: "mm", zero: true,
      rules: [{ value: motion.quality.tracking_rmse * 1e3, words: "RMS" }],
      series: lines(({ object }) => scaled(distances(object, motion.command), 1e3), true),
    },
    {
      title: "Object speed", unit: "m/s, on the pan", zero: true, slip: true, digits: 2,
      series: lines(({ speed }) => speed, true),
    },
    {
      title: "Pan position", unit: "mm, in the world",
      series: [...pan(motion, "pan"), ...apart.flatMap((track) => pan(track, track.kind))
        .map((each) => ({ ...each, silent: true }))],
    },
  ];
  return plots.map((plot) => ({ digits: 1, rules: [], ...plot }));
}

export class Plots {
  #plots = [];
  #left = [];  // that are still to be drawn

  /** @param parent  the element to plot in; @param player  whose time is shown, and moved by the pointer */
  constructor(parent, player) {
    this.parent = parent;
    this.player = player;
  }

  /** Take a motion, to be drawn plot by plot; or null, for none. */
  load(motion) {
    this.motion = motion;
    this.parent.replaceChildren();
    this.#plots = [];
    this.#left = motion ? plotsOf(motion) : [];
  }

  /** Draw the next plot; return whether more are left. */
  drawNext() {
    if (this.#left.length) {
      this.#plots.push(this.#add(this.#left.shift()));
      this.#draw(this.#plots.at(-1));
    }
    return this.#left.length > 0;
  }

  resize() {
    this.#plots.forEach((plot) => this.#draw(plot));
  }

  show(now, at) {
    const place = locate(this.motion, at), { end } = this.motion;  // of a plan; what is played beside it may be longer
    for (const { head, pointer, across, readings, digits } of this.#plots) {
      head.style.transform = `translateX(${across(Math.min(now, end))}px)`;
      pointer.hidden = this.player.hover === null;
      pointer.style.transform = `translateX(${across(Math.min(at, end))}px)`;
      pointer.dataset.time = `${this.player.seconds(at)} s`;
      for (const { reading, values } of readings) reading.textContent = number(valueAt(values, place), digits);
    }
  }

  #add(plot) {
    const legend = element("div", { className: "legend number" });
    if (plot.slip) {
      const band = svg('viewBox="0 0 20 8" aria-hidden="true"', mark("band", "M0-2h20v12H0z"));
      legend.append(element("span", {}, band, "slides"));
    }
    const readings = plot.series.filter(({ silent }) => !silent).map(({ name, kind, values }) => {
      const reading = element("b");
      legend.append(element("span", {}, swatch(kind), name, reading));
      return { reading, values };
    });
    const frame = addFigure(this.parent, plot, legend);
    const head = element("div", { className: "head" });
    const pointer = element("div", { className: "pointer", hidden: true });
    frame.append(head, pointer);
    let [low, high] = range([
      plot.rules.map((rule) => rule.value), plot.zero ? [0] : [], ...plot.series.map(({ values }) => values)]);
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
      parts.push(mark("band", `M${px(across(from))} ${top}V${bottom}H${px(across(Math.min(to, motion.end)))}V${top}z`));
    }
    for (const { value, text } of ticks(plot.low, plot.high, 4)) {
      parts.push(mark(Math.abs(value) < 1e-9 ? "zero" : "grid", level(value)));
      parts.push(label(left - 7, down(value) + 4, "end", text));
    }
    const parted = Math.max(2, Math.min(6, (right - left) / 70));
    for (const { value, text } of ticks(0, Math.max(motion.end, motion.dt), parted)) {
      parts.push(mark("grid", `M${px(across(value))} ${top}V${bottom}`));
      parts.push(label(across(value), bottom + 17, "middle", text));
    }
    parts.push(label(right + 4, bottom + 17, "start", "s"));
    for (const { value, words } of plot.rules) {
      parts.push(mark("rule", level(value)), label(right + 4, down(value) + 4, "start", words, "label"));
    }
    const x = motion.time.map(across);
    for (const { values, kind, area } of [...plot.series].reverse()) {  // the first lies on top
      const d = line(x, values.map(down));
      if (area) parts.push(mark(`fill ${kind}`, `${d}V${px(down(0))}H${left}z`));
      parts.push(mark(`curve ${kind}`, d));
    }
    const shown = plot.series.find(({ kind }) => kind !== "command");
    const [least, most] = range([shown.values]).map((value) => number(value, plot.digits));
    const words = `${plot.title} over time, from ${least} to ${most} ${plot.unit}`;
    setDrawing(plot.frame, width, bottom + 22, words, parts);
    const upright = { top: `${top}px`, height: `${bottom - top}px` };
    for (const { style } of [plot.head, plot.pointer]) Object.assign(style, upright);
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
