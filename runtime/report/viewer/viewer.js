/** A plan looked at: the pan from above, the player, the plots and the quality, kept together. */

import { $, element, mm, swatch } from "./dom.js";
import { Paths } from "./paths.js";
import { Player } from "./player.js";
import { Plots } from "./plots.js";
import { showQuality } from "./quality.js";
import { Stage } from "./stage.js";

export const calm = () => matchMedia("(prefers-reduced-motion: reduce)").matches;

const atOnce = (work) => { while (work()); };

/** Draws into the elements #stage, #chip, #transport, #verdict, #plots and, where there is one, #paths. */
export class Viewer {
  /**
   * @param beside  more controls, beside the player's
   * @param idle  () draws the stage while no motion is loaded
   * @param onShow  (t) after a moment of the motion was shown
   * @param later  (work) when plots are drawn: calls `work`, which draws one, until it returns false
   */
  constructor({ beside = [], idle = () => {}, onShow = () => {}, later = atOnce } = {}) {
    this.stage = new Stage($("stage"));
    this.player = new Player($("transport"), beside, () => this.show());
    this.plots = new Plots($("plots"), this.player);
    this.paths = $("paths") && new Paths($("paths"));
    Object.assign(this, { idle, onShow, later });
    addEventListener("resize", () => this.layOut());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.layOut());
  }

  get plays() {
    return this.player.motion !== null;
  }

  /** Take a motion, or null, and show its beginning; `beside` the plan of it, whose plots and quality stay. */
  load(motion, { beside = false } = {}) {
    this.player.load(motion);
    if (motion) {
      this.stage.load(motion);
      this.#fillLegend(motion);
    }
    if (!beside) this.plots.load(motion);
    if (!beside && motion) {
      this.paths?.load(motion);
      showQuality($("verdict"), motion);
    }
    this.layOut();
    if (!beside && motion) this.later(() => this.#drawNext());
  }

  /** Draw what plots are still to be drawn. */
  drawAll() {
    atOnce(() => this.#drawNext());
  }

  /** Play; or show a moment in the middle, to those who want no motion. */
  begin() {
    if (calm()) this.player.seek(this.player.motion.end * 0.6); else this.player.play(true);
  }

  show() {
    const { motion, t } = this.player, now = Math.min(t, motion.end);
    this.stage.drawMotion(now, $("still").checked);
    this.#showPlots();
    this.onShow(now);
  }

  /** Fit everything to the window and to its colours. */
  layOut() {
    this.stage.resize();
    if (!this.plays) return this.idle();
    for (const part of [this.player, this.plots, this.paths]) part?.resize();
    this.player.show();
  }

  #drawNext() {
    const more = this.plots.drawNext();
    if (this.plays) this.#showPlots();
    return more;
  }

  #showPlots() {
    const { motion, t, hover } = this.player, now = Math.min(t, motion.end);
    for (const plots of [this.plots, this.paths]) plots?.show(now, hover ?? now);
  }

  #fillLegend({ tracks, reachLimit, lifts }) {
    const entries = [["command", "command"], ["object", "object’s path"]];
    for (const { kind, name } of tracks) entries.push([kind, name]);
    entries.push(["pan", "pan centre’s path"]);
    if (reachLimit) entries.push(["pan dotted", `its limit, ${mm(reachLimit)} mm`]);
    $("stage-legend").replaceChildren(
      ...entries.map(([kind, name]) => element("span", {}, swatch(kind), name)),
      ...(lifts ? [element("span", { textContent: "size and shadow: the pan’s height" })] : []),
      element("span", { textContent: lifts
        ? "dial: the pan’s acceleration in the plane, its ring what friction holds"
        : "dial: the pan’s acceleration, its ring at μg" }));
  }
}
