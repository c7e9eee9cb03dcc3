/** Asking for plans: one that is there at once, then the best that the server has time for. */

import { requestPlan } from "./api.js";
import { moved } from "./frames.js";
import { DT } from "./path.js";
import { mm, number } from "./viewer/dom.js";
import { motionOf } from "./viewer/motion.js";

const CANDIDATES = 8, REFINE_MS = 100;  // asked for, where the server allows as much
const TOLERANCE = 0.005;  // m: an object that strays farther (RMS) follows badly, whatever else is right
const CHUNK = 0.1;  // s

export class Planning {
  own = Promise.resolve(null);  // the page's own planner; null where a server plans
  #stopping = null;
  #most = { max_candidates: 16, max_refine_ms: 0, max_chunks: 320 };

  /** Take what the server allows. */
  mayAsk(settings) {
    Object.assign(this.#most, settings);
  }

  get busy() {
    return this.#stopping !== null;
  }

  /** Give up what is being asked. */
  stop() {
    this.#stopping?.abort();
    this.#stopping = null;
  }

  /**
   * Ask for a plan, and for a better one; what was asked before is given up.
   *
   * @param request  what a server is asked
   * @param positions  of the command, every millisecond (m)
   * @yields {body, text, plan, motion, took, better}: `body` is what a server was asked, or null; `took` the
   *   milliseconds since; `better` the quality of the plan before, or null
   * @throws as `requestPlan`, if there is no plan at all
   */
  ask(request, positions, token) {
    this.stop();
    const stopping = this.#stopping = new AbortController();
    return this.#answers(request, positions, token, stopping);
  }

  async *#answers(request, positions, token, stopping) {
    const ask = async (more) => {
      const body = JSON.stringify({ ...request, ...more });
      const answer = await requestPlan(body, token, stopping.signal);
      return { ...answer, body, motion: motionOf(answer.plan) };
    };
    try {
      const own = await this.own;
      if (own) {
        const answer = await own.plan(positions, { friction: request.friction, limits: request.limits });
        if (!stopping.signal.aborted) yield { ...answer, body: null, motion: motionOf(answer.plan), better: null };
        return;
      }
      const first = await ask({ candidates: 1 });  // at once, however bad
      yield { ...first, better: null };
      await moved();
      if (stopping.signal.aborted) return;
      const second = await this.#best(ask, first.motion);
      if (second) yield { ...second, better: first.motion.quality };
    } finally {
      if (this.#stopping === stopping) this.#stopping = null;
    }
  }

  /** The best plan there is time for, judged by its error too; null where the server is too busy for it. */
  async #best(ask, motion) {
    const { max_candidates, max_refine_ms, max_chunks } = this.#most;
    const chunks = Math.ceil(((motion.end / DT) + 1) * DT / CHUNK);
    const candidates = Math.min(CANDIDATES, max_candidates, Math.floor(max_chunks / chunks));
    const refine = Math.min(REFINE_MS, max_refine_ms);
    const more = { tolerance: TOLERANCE, ...(candidates > 1 && { candidates }) };
    for (const refined of refine > 0 ? [{ refine_ms: refine }, {}] : [{}]) {
      try {
        return await ask({ ...more, ...refined });
      } catch (error) {
        if (error.status === 422 && refined.refine_ms) this.#most.max_refine_ms = 0;  // it cannot, and says so
        else if (![429, 503, 504].includes(error.status)) throw error;
      }
    }
    return null;
  }
}

/** What is said of a plan: the time it took, and what it is better in than the one `before` it, if there was one. */
export function toldOf(took, quality, before) {
  const after = `${number(took, 0)} ms`;
  for (const [name, words] of [["friction_off_rmse", "with friction 10 % off"], ["tracking_rmse", "the error"]]) {
    if (before && quality[name] < before[name]) {
      return `Planned, and made better in ${after}: ${words} ${mm(quality[name])} mm in place of ${mm(before[name])}.`;
    }
  }
  return `Planned in ${after}.`;
}
