/** Time: the clock that a motion is played by, and its controls. What is shown follows from its state alone. */

import { $, element, number } from "./dom.js";
import { slidesAt } from "./motion.js";

const RATES = { "1×": 1, "¼×": 0.25, "⅒×": 0.1 };
const REST = 0.7;  // s on the clock at the end, before it starts over

export class Player {
  #last = 0;

  /** @param show  () after every change of `t`, `hover` or what is looked at */
  constructor(show) {
    Object.assign(this, { motion: null, t: 0, hover: null, playing: false, rate: 0.25, onShow: show });
    for (const [label, rate] of Object.entries(RATES)) {
      const input = element("input", { type: "radio", name: "rate", checked: rate === this.rate });
      input.setAttribute("aria-label", rate === 1 ? "real time" : `${rate} times real time`);
      input.addEventListener("change", () => { this.rate = rate; });
      $("rates").append(element("label", {}, input, element("span", { textContent: label })));
    }
    $("play").addEventListener("click", () => this.play(!this.playing));
    $("scrub").addEventListener("input", () => this.seek($("scrub").valueAsNumber));
    $("still").addEventListener("change", () => this.show());
    addEventListener("keydown", (event) => this.#followKey(event));
  }

  /** Take a motion, or null, from its beginning. */
  load(motion) {
    this.play(false);
    Object.assign(this, { motion, t: 0, hover: null });
    if (!motion) return;
    Object.assign($("scrub"), { max: motion.end, step: motion.step });
    $("end").textContent = `${this.seconds(motion.end)} s`;
    this.#drawPhases();
    this.show();
  }

  seconds(t) {
    return number(t, this.motion.end < 10 ? 3 : 2);
  }

  show() {
    if (!this.motion) return;
    const t = Math.min(this.t, this.motion.end);
    const state = slidesAt(this.motion, t) ? "slides" : "sticks";
    $("chip").textContent = state;
    $("chip").className = `chip ${state}`;
    $("scrub").value = t;
    $("scrub").setAttribute("aria-valuetext", `${this.seconds(t)} seconds, the object ${state}`);
    $("now").textContent = this.seconds(t);
    this.onShow();
  }

  play(playing) {
    if (playing && !this.playing && this.motion) {
      if (this.t >= this.motion.end) this.t = 0;
      this.#last = performance.now();
      requestAnimationFrame((now) => this.#tick(now));
    }
    this.playing = playing;
    $("play").setAttribute("aria-label", playing ? "Pause" : "Play");
    $("play").classList.toggle("playing", playing);
  }

  seek(t) {
    this.play(false);
    this.t = Math.min(Math.max(t, 0), this.motion.end);
    this.show();
  }

  #tick(now) {
    if (!this.playing) return;
    this.t += Math.max(now - this.#last, 0) / 1e3 * this.rate;
    this.#last = now;
    if (this.t > this.motion.end + REST * this.rate) this.t = 0;
    this.show();
    requestAnimationFrame((next) => this.#tick(next));
  }

  /** When the object sticks and when it slides, behind the slider. */
  #drawPhases() {
    const canvas = $("phases"), context = canvas.getContext("2d");
    const style = getComputedStyle(document.documentElement);
    canvas.width = 600;
    const across = (t) => this.motion.end > 0 ? Math.min(t / this.motion.end, 1) * canvas.width : 0;
    context.fillStyle = style.getPropertyValue("--pan");
    context.fillRect(0, 0, canvas.width, 1);
    context.fillStyle = style.getPropertyValue("--object");
    for (const [from, to] of this.motion.slip) context.fillRect(across(from), 0, across(to) - across(from), 1);
  }

  recolor() {
    if (this.motion) this.#drawPhases();
  }

  #followKey(event) {
    if (!this.motion || event.ctrlKey || event.metaKey || event.altKey) return;
    const step = event.shiftKey ? 0.1 : 0.01;  // s
    const action = {
      " ": () => this.play(!this.playing),
      ArrowLeft: () => this.seek(Math.min(this.t, this.motion.end) - step),
      ArrowRight: () => this.seek(this.t + step),
    }[event.key];
    const control = event.target.closest("button, input, summary, pre");  // has its own use for space and arrows
    if (!action || (control && control.id !== "scrub")) return;
    event.preventDefault();
    action();
  }
}
