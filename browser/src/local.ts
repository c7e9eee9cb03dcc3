/** The page's planner where there is no server: a worker that is loaded once, and kept for when there is no network. */

import type { Friction } from "./law.js";
import type { Answer, Files, Model, Question } from "./worker.js";

export interface Answered {
  readonly text: string;
  readonly plan: unknown;
  readonly took: number;
}

export interface LocalPlanner {
  readonly info: { readonly model: Model };
  plan(positions: readonly (readonly [number, number])[], friction: Friction): Promise<Answered>;
}

const MB = 1e-6;

/**
 * Load the planner.
 *
 * @param report is told how far it is, in words to be shown
 * @throws Error, in words to be shown, where it cannot be loaded
 */
export async function start(report: (line: string) => void): Promise<LocalPlanner> {
  if (typeof WebAssembly === "undefined") {
    throw new Error("This browser cannot plan by itself: it has no WebAssembly. A newer one can.");
  }
  let files: Files;
  try {
    files = await (await fetch("files.json")).json();
  } catch {
    throw new Error("The planner could not be loaded. Load the page again when there is a network.");
  }
  const worker = new Worker("worker.js", { type: "module" });
  const put = (question: Question, told: (answer: Answer) => boolean): Promise<Answer> =>
    new Promise((resolve, reject) => {
      worker.onerror = (event) => reject(new Error(event.message || "it has ended"));
      worker.onmessage = ({ data }: MessageEvent<Answer>) => {
        if (data.kind === "failed") reject(new Error(data.message));
        else if (told(data)) resolve(data);
      };
      worker.postMessage(question);
    });
  let before: Promise<unknown> = Promise.resolve();
  /** Put one question after the other: an answer does not say which it belongs to. */
  const ask: typeof put = (question, told) => {
    const answered = before.then(() => put(question, told));
    before = answered.catch(() => undefined);
    return answered;
  };
  let ready: Answer;
  try {
    ready = await ask({ kind: "load", files }, (answer) => {
      if (answer.kind === "progress") {
        report(`Loading the planner: ${(answer.done * MB).toFixed(1)} of ${(answer.total * MB).toFixed(1)} MB.`);
      }
      return answer.kind === "ready";
    });
  } catch (error) {
    worker.terminate();
    throw new Error(`The planner could not be loaded: ${(error as Error).message}. Load the page again.`);
  }
  report("");
  if ("serviceWorker" in navigator) navigator.serviceWorker.register("sw.js").catch(() => undefined);
  return {
    info: { model: (ready as Extract<Answer, { kind: "ready" }>).model },
    async plan(positions, friction) {
      let answer: Answer;
      try {
        const position = Float64Array.from(positions.flat());
        answer = await ask({ kind: "plan", position, friction }, (each) => each.kind === "planned");
      } catch (error) {
        throw new Error(`This path could not be planned: ${(error as Error).message}. The path is kept.`);
      }
      const { text, took } = answer as Extract<Answer, { kind: "planned" }>;
      return { text, plan: JSON.parse(text), took };
    },
  };
}
