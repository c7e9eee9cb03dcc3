/** Time: the clock that a motion is played by, and its controls. What is shown follows from its state alone. */

import { $, element, number } from "./dom.js";
import { stateAt } from "./motion.js";

const RATES = { "1×": 1, "¼×": 0.25, "⅒×": 0.1 };
const REST = 0.7;  // s on the clock at the end, before it starts over
const MARKUP = `
  <div class="row">
    <button class="play" id="play" type="button" aria-label="Play">
      <svg viewBox="0 0 18 18" aria-hidden="true">
        <path class="wedge" d="M4.5 2.2v13.6L16 9z"/><path class="bars" d="M3.5 2.5h4v13h-4zm7 0h4v13h-4z"/>
      </svg>
    </button>
    <div class="scrub">
      <canvas class="phases" id="phases" height="1" aria-hidden="true"></canvas>
      <input id="scrub" type="range" min="0" aria-label="Time">
    </div>
    <span class="clock number"><b id="now"></b> / <span id="end"></span></span>
  </div>
  <div class="row" id="how-to-play">
    <div class="choice" role="radiogroup" aria-label="Playing speed" id="rates"></div>
    <label class="toggle"><input type="checkbox" id="still">Hold the pan still</label>
  </div>
  <div class="legend" id="stage-legend"></div>`;

export class Player {
  #last = 0;

  /** @param parent  of the controls; @param beside  more of them; @param show  () after every change of the state */
  constructor(parent, beside, show) {
    Object.assign(this, { motion: null, t: 0, hover: null, playing: false, rate: 0.25, onShow: show });
    parent.innerHTML = MARKUP;
    $("how-to-play").append(...beside);
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
    Object.assign($("scrub"), { max: motion.end, step: motion.dt });
    $("end").textContent = `${this.seconds(motion.end)} s`;
  }

  seconds(t) {
    return number(t, this.motion.end < 10 ? 3 : 2);
  }

  show() {
    if (!this.motion) return;
    const t = Math.min(this.t, this.motion.end);
    const state = stateAt(this.motion, t);
    $("chip").textContent = state;
    $("chip").className = `chip ${state.split(" ")[0]}`;
    $("scrub").value = t;
    $("scrub").setAttribute("aria-valuetext", `${this.seconds(t)} seconds, the object ${state}`);
    $("now").textContent = this.seconds(t);
    if (this.motion.goOn) this.resize();
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
    this.t = Math.min(Math.max(t, 0), this.motion.made ?? this.motion.end);
    this.show();
  }

  #tick(now) {
    if (!this.playing) return;
    this.t = this.#after(this.t + Math.max(now - this.#last, 0) / 1e3 * this.rate);
    this.#last = now;
    this.show();
    requestAnimationFrame((next) => this.#tick(next));
  }

  /** What the clock shows where it would show t: a motion may be made while it is played, and each starts over. */
  #after(t) {
    const rest = REST * this.rate;
    if (this.motion.goOn) return this.motion.goOn(t, rest);
    return t > this.motion.end + rest ? 0 : t;
  }

  /** When the object sticks and when it slides, behind the slider. */
  resize() {
    const canvas = $("phases"), context = canvas.getContext("2d");
    const style = getComputedStyle(document.documentElement);
    canvas.width = 600;
    const across = (t) => this.motion.end > 0 ? Math.min(t / this.motion.end, 1) * canvas.width : 0;
    context.fillStyle = style.getPropertyValue("--pan");
    context.fillRect(0, 0, canvas.width, 1);
    context.fillStyle = style.getPropertyValue("--object");
    for (const [from, to] of this.motion.slip) context.fillRect(across(from), 0, across(to) - across(from), 1);
  }

  #followKey(event) {
    if (!this.motion || event.ctrlKey || event.metaKey || event.altKey) return;
    const step = event.shiftKey ? 0.1 : 0.01;  // s
    const action = {
      " ": () => this.play(!this.playing),
      ArrowLeft: () => this.seek(Math.min(this.t, this.motion.end) - step),
      ArrowRight: () => this.seek(this.t + step),
      p: () => $("still").click(),
    }[event.key];
    // These have a use of their own for space and arrows, and those one writes in for letters, too.
    const own = event.key === "p" ? "[type=password], [type=text]" : "button, input:not(#scrub), summary, pre";
    if (!action || event.target.closest(own)) return;
    event.preventDefault();
    action();
  }
}
