/** The page's planner where there is no server: a worker that is loaded once, and kept for when there is no network. */

import type { Chunk, Seen } from "./follow.js";
import type { LimitsAsked } from "./limits.js";
import type { Answer, Files, Model, Question, Wanted } from "./worker.js";

export type { Chunk, LimitsAsked, Seen, Wanted };

export interface Answered {
  readonly text: string;
  readonly plan: unknown;
  /** Milliseconds that it took. */
  readonly took: number;
}

type Positions = readonly (readonly [number, number])[];

/** One command in closed loop; see `follow.ts`. */
export interface Follower {
  /** Samples of a chunk: after so many, or fewer, the next is asked for. */
  readonly chunk: number;
  next(seen?: Seen): Promise<Chunk>;
  end(): void;
}

export interface LocalPlanner {
  readonly info: { readonly model: Model };
  /** Read a command file: positions [x, y] at 1 kHz (m), and what was made of it; see `command.ts`. */
  read(file: Blob): Promise<{ positions: [number, number][]; notes: readonly string[] }>;
  /** Plan positions at 1 kHz (m), relative to the pan's centre; what is not wanted otherwise is the model's own. */
  plan(positions: Positions, wanted?: Wanted): Promise<Answered>;
  /** Follow them, from where pan and object are whenever the next chunk is asked for. */
  follow(positions: Positions, wanted?: Wanted): Promise<Follower>;
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
  if (typeof DecompressionStream === "undefined") {
    throw new Error("This browser cannot plan by itself: it is older than 2023. A newer one can.");
  }
  let files: Files;
  try {
    files = await (await fetch("files.json")).json();
  } catch {
    throw new Error("The planner could not be loaded. Load the page again when there is a network.");
  }
  const worker = new Asking();
  let ready: Extract<Answer, { kind: "ready" }>;
  try {
    ready = await worker.ask("ready", { kind: "load", files }, ({ done, total }) =>
      report(`Loading the planner: ${(done * MB).toFixed(1)} of ${(total * MB).toFixed(1)} MB.`));
  } catch (error) {
    worker.end();
    throw new Error(`The planner could not be loaded: ${(error as Error).message}. Load the page again.`);
  }
  report("");
  if ("serviceWorker" in navigator) navigator.serviceWorker.register("sw.js").catch(() => undefined);
  const planned = async <T>(answer: Promise<T>): Promise<T> => {
    try {
      return await answer;
    } catch (error) {
      throw new Error(`This path could not be planned: ${(error as Error).message}. The path is kept.`);
    }
  };
  return {
    info: { model: ready.model },
    async read(file) {
      try {
        const { command } = await worker.ask("read", { kind: "read", file: new Uint8Array(await file.arrayBuffer()) });
        const { position, notes } = command;
        const row = (k: number): [number, number] => [position[2 * k]!, position[2 * k + 1]!];
        return { positions: Array.from({ length: position.length / 2 }, (_, k) => row(k)), notes };
      } catch (error) {
        throw new Error(`This file cannot be read: ${(error as Error).message}.`);
      }
    },
    async plan(positions, wanted = {}) {
      const position = Float64Array.from(positions.flat());
      const { text, took } = await planned(worker.ask("planned", { kind: "plan", position, wanted }));
      return { text, plan: JSON.parse(text), took };
    },
    async follow(positions, wanted = {}) {
      const position = Float64Array.from(positions.flat());
      const { following, chunk } = await planned(worker.ask("following", { kind: "follow", position, wanted }));
      return {
        chunk,
        next: async (seen = {}) => (await planned(worker.ask("next", { kind: "next", following, seen }))).chunk,
        end: () => void worker.ask("ended", { kind: "end", following }),
      };
    },
  };
}

type Progress = Extract<Answer, { kind: "progress" }>;

interface Waiting {
  told(answer: Answer): void;
  reject(error: Error): void;
}

/** The worker, and who waits for which of its answers. */
class Asking {
  readonly #worker = new Worker("worker.js", { type: "module" });
  readonly #waiting = new Map<number, Waiting>();
  #asked = 0;

  constructor() {
    this.#worker.onmessage = ({ data: { id, answer } }: MessageEvent<{ id: number; answer: Answer }>) => {
      this.#waiting.get(id)?.told(answer);
    };
    this.#worker.onerror = (event) => {
      for (const { reject } of this.#waiting.values()) reject(new Error(event.message || "it has ended"));
      this.#waiting.clear();
    };
  }

  /** Put a question, and wait for its answer of that kind. */
  ask<Kind extends Answer["kind"]>(
    kind: Kind, question: Question, report?: (progress: Progress) => void,
  ): Promise<Extract<Answer, { kind: Kind }>> {
    const id = ++this.#asked;
    return new Promise((resolve, reject) => {
      const told = (answer: Answer): void => {
        if (answer.kind === "progress") {
          report?.(answer);
          return;
        }
        this.#waiting.delete(id);
        if (answer.kind === kind) resolve(answer as Extract<Answer, { kind: Kind }>);
        else reject(new Error(answer.kind === "failed" ? answer.message : `it answered with ${answer.kind}`));
      };
      this.#waiting.set(id, { told, reject });
      this.#worker.postMessage({ id, question });
    });
  }

  end(): void {
    this.#worker.terminate();
  }
}
