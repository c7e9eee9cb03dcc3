/** The controls beside the pan: speed, friction and limits that are asked for, and the pans and arms that have them. */

import { ARMS, PANS } from "./examples.js";
import { $, element, mm, number } from "./viewer/dom.js";

const FRICTION = ["static", "kinetic"];
const LIMITS = ["pan_reach", "height", "top_speed", "acceleration", "jerk"];
const SLIDERS = ["speed", ...FRICTION, ...LIMITS];
const TRAINED_ON = { top_speed: "pan_speed" };  // what a model calls it, where that differs
const OWN = -1;  // value of a choice that stands for none of its sets

const TEXT = {
  speed: (value) => `${number(value, 2)} m/s`,
  static: (value) => number(value, 2),
  kinetic: (value) => number(value, 2),
  pan_reach: (value) => `${mm(value)} mm`,
  height: (value) => value ? `${mm(value)} mm` : "level",
  top_speed: (value) => isNone(value) ? "none" : `${number(value, 1)} m/s`,
  acceleration: (value) => `${number(value, 0)} m/s²`,
  jerk: (value) => `${number(value, 0)} m/s³`,
};

const valueOf = (id) => $(id).valueAsNumber;
/** The highest place of the slider for the speed limit is that there is none. */
const isNone = (speed) => speed >= Number($("top_speed").max);
const close = (a, b) => a === b || (a !== null && b !== null && Math.abs(a - b) <= 1e-6 * Math.abs(b));
const alike = (a, b) => Object.keys(b).every((name) => close(a[name], b[name]));

export class Controls {
  #standard = ARMS[0].limits;  // of the model: they need not be asked for

  /** @param change  () after every change by hand */
  constructor(change) {
    this.#offer("pan", PANS, (set) => this.#take({ static: set.static, kinetic: set.kinetic }));
    this.#offer("arm", ARMS, ({ limits: { speed, ...others } }) =>
      this.#take({ ...others, top_speed: speed ?? Number($("top_speed").max) }));
    for (const id of ["pan", "arm"]) $(id).addEventListener("input", change);
    for (const id of SLIDERS) {
      $(id).addEventListener("input", () => {  // friction at rest is never less than while sliding
        if (id === "static" && valueOf("kinetic") > valueOf("static")) $("kinetic").value = valueOf("static");
        if (id === "kinetic" && valueOf("static") < valueOf("kinetic")) $("static").value = valueOf("kinetic");
        change();
      });
    }
  }

  get speed() {
    return valueOf("speed");
  }

  get friction() {
    return { static: valueOf("static"), kinetic: valueOf("kinetic") };
  }

  get limits() {
    const { top_speed: speed, ...others } = Object.fromEntries(LIMITS.map((id) => [id, valueOf(id)]));
    return { ...others, speed: isNone(speed) ? null : speed };
  }

  /** Whether the limits are others than the model's own. */
  get limited() {
    return !alike(this.limits, this.#standard);
  }

  /** The arm whose limits they are, or undefined. */
  get arm() {
    return ARMS[$("arm").value]?.arm;
  }

  /** Take what a model was trained on, the ranges of the sliders, and its limits. */
  takeFrom({ trained_on: known = {}, limits }) {
    for (const id of SLIDERS) {
      const [low, high] = known[TRAINED_ON[id] ?? id] ?? [];
      if (high === undefined) continue;
      const step = Number($(id).step);
      if (id !== "speed") $(id).min = Math.ceil(low / step - 1e-9) * step;
      $(id).max = Math.floor(high / step + 1e-9) * step + (id === "top_speed" ? step : 0);
    }
    PANS.forEach((pan, index) => {  // only those that the model knows
      const known = FRICTION.every((id) => pan[id] >= Number($(id).min) && pan[id] <= Number($(id).max));
      $("pan").options[index + 1].disabled = $("pan").options[index + 1].hidden = !known;
    });
    if (limits) this.#standard = { ...this.#standard, ...limits };
    this.show();
  }

  /** What a link keeps of them, and the same from a link. */
  get kept() {
    const { speed, friction, limits } = this;
    const list = Object.values(limits).map((each) => each ?? "").join();
    return { speed, ...friction, ...(this.limited && { limits: list }) };
  }
  restore({ limits, ...asked }) {
    const values = limits?.split(",");
    const [pan_reach, height, acceleration, jerk, top_speed] = values?.length === LIMITS.length ? values : [];
    this.#take({ ...asked, pan_reach, height, acceleration, jerk, top_speed: top_speed === "" ? Infinity : top_speed });
    if (valueOf("kinetic") > valueOf("static")) $("kinetic").value = valueOf("static");
  }

  /** Write beside each what it stands at. */
  show() {
    for (const id of SLIDERS) {
      $(`${id}-value`).textContent = TEXT[id](valueOf(id));
      $(id).setAttribute("aria-valuetext", TEXT[id](valueOf(id)));
    }
    const pan = PANS.findIndex((each) => alike(this.friction, { static: each.static, kinetic: each.kinetic }));
    const arm = ARMS.findIndex((each) => alike(this.limits, each.limits));
    $("pan").value = pan;
    $("arm").value = arm;
    $("limits-now").textContent = arm < 0 ? "as set below" : ARMS[arm].name;
  }

  #take(values) {
    for (const [id, value] of Object.entries(values)) {
      if (!SLIDERS.includes(id) || value === undefined || Number.isNaN(Number(value))) continue;
      $(id).value = Math.min(Number(value), Number($(id).max));
    }
  }

  #offer(id, sets, take) {
    $(id).append(element("option", { value: OWN, textContent: "as set below" }),
      ...sets.map(({ name }, index) => element("option", { value: index, textContent: name })));
    $(id).addEventListener("input", () => sets[$(id).value] && take(sets[$(id).value]));
  }
}
