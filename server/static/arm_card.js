/** The card with the arm in three dimensions: nothing of it is loaded until it is opened. */

import { ARMS } from "./examples.js";
import { $, element } from "./viewer/dom.js";

const NAMES = new Map(ARMS.filter(({ arm }) => arm).map(({ arm, name }) => [arm, name.split(",")[0]]));
const FIRST = "ur5e";

export class ArmCard {
  #view = null;
  #ready = false;
  #chosen = false;  // by hand: then the limits choose no longer
  #shown = [null, 0];

  constructor() {
    $("robot").append(...[...NAMES].map(([value, textContent]) => element("option", { value, textContent })));
    $("robot").value = FIRST;
    $("arm-card").addEventListener("toggle", () => this.#open());
    $("robot").addEventListener("input", () => {
      this.#chosen = true;
      this.#take();
    });
    addEventListener("resize", () => this.#isOpen && this.#ready && this.#view.resize());
  }

  /** Take the arm whose limits are planned with, if there is one, and none was chosen. */
  suggest(arm) {
    if (this.#chosen || !arm || $("robot").value === arm) return;
    $("robot").value = arm;
    this.#ready = false;
    this.#take();
  }

  /** The moment t (s) of a motion; the pan at rest if that is null. */
  show(motion, t) {
    this.#shown = [motion, t];
    if (!this.#isOpen || !this.#ready) return;
    const reaches = this.#view.show(motion, t);
    this.#tell(reaches ? "" : "The arm does not reach this place: a plan within a smaller reach it could follow.");
  }

  get #isOpen() {
    return $("arm-card").open;
  }

  #tell(words) {
    $("arm-note").textContent = words;
    $("arm-note").hidden = !words;
  }

  async #open() {
    if (!this.#isOpen) return;
    if (!this.#ready) {
      await this.#take();
      return;
    }
    this.#view.resize();
    this.show(...this.#shown);
  }

  /** Load what draws, if that is not done, and the arm that is chosen. */
  async #take() {
    if (!this.#isOpen) return;
    this.#ready = false;
    this.#tell("Loading…");
    try {
      const { ArmView } = await import("./arm_view.js");
      this.#view ??= new ArmView($("arm-stage"));
      const name = $("robot").value;
      await this.#view.take(name);
      if (name !== $("robot").value) return void await this.#take();  // another was chosen meanwhile
      this.#ready = true;
      $("arm-card").dataset.shows = name;
      this.show(...this.#shown);
    } catch (error) {
      const lost = error instanceof TypeError;  // of a module that does not come
      this.#tell(lost ? "The arm cannot be loaded: the server may have been stopped." : error.message);
    }
  }
}
