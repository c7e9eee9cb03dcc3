/** The closed loop on the page: the switch, the button that pushes, and the pointer that pulls the object. */

import { Loop } from "./loop.js";
import { $, element, mm } from "./viewer/dom.js";

export class Closing {
  #loop = null;
  #switch = element("input", { type: "checkbox", id: "closed" });
  #push = element("button", { id: "push", type: "button", className: "plain", textContent: "Push it", hidden: true });
  #open = null;
  #pointer = null;  // the last event of one that pulls

  /** What goes beside the controls of the player. */
  parts = [element("label", { className: "toggle", hidden: true }, this.#switch, "Closed loop"), this.#push];

  /**
   * @param stage  the Stage whose pointer pulls
   * @param begin  () => {motion, positions, options} of what is played, or null
   * @param take  (loop, or null) plays that in the place of what is played, or the plan again
   * @param play  () goes on playing
   * @param say  (line) tells what is wrong
   */
  listen(stage, { begin, take, play, say }) {
    const { canvas } = stage;
    this.#switch.addEventListener("change", () => {
      const from = this.#switch.checked ? begin() : null;
      this.leave();
      if (from) this.#loop = new Loop(from.motion, from.positions, from.options, this.#open, () => say(this.#words()));
      this.#switch.checked = from !== null;
      take(this.#loop);
    });
    this.#push.addEventListener("click", () => {
      this.#loop.shove();
      play();
    });
    canvas.addEventListener("pointerdown", (event) => {
      if (!this.#loop || event.button !== 0) return;
      event.preventDefault();
      canvas.setPointerCapture(event.pointerId);
      this.#pointer = event;
      play();
      this.#loop.pointer = () => this.#pointer && stage.toMetres(this.#pointer);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (this.#pointer) this.#pointer = event;
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { this.#pointer = null; });
  }

  /** Whether a loop is closed. */
  get closed() {
    return this.#loop !== null;
  }

  /** Offer it, if there is who steers: `open` makes a stream of what opens one; null if there is nobody. */
  offer(open) {
    this.#open = open;
    this.parts[0].hidden = open === null;
  }

  leave() {
    this.#loop?.close();
    this.#loop = this.#pointer = null;
    this.#switch.checked = false;
    this.show();
  }

  /** What is shown on the pan and beside it, for the moment that is played. */
  show() {
    const hint = $("hint");
    this.#push.hidden = !this.#loop;
    hint.classList.toggle("told", this.closed);
    if (!this.#loop) return;
    hint.hidden = false;
    hint.textContent = this.#loop.lost ? "Nobody steers the pan" : `Push the object: ${mm(this.#loop.error)} mm off`;
  }

  #words() {
    return this.#loop?.lost ? `Nobody steers the pan, which comes to rest. ${this.#loop.lost}` : "";
  }
}
