/** The planner in a worker, so that the page stays responsive: it loads itself, and answers each question by its number. */

import { type Command, readCommand } from "./command.js";
import { plan, type Start } from "./decode.js";
import { documentOf } from "./document.js";
import { type Chunk, Following, type Seen } from "./follow.js";
import type { Friction } from "./law.js";
import { checkFriction, type LimitsAsked, limitsOf } from "./limits.js";
import { type Manifest, type Network, open } from "./network.js";

/** What the site says of its own files. */
export interface Files {
  readonly version: string;
  readonly sha256: string;
  /** Bytes of the files that the planner is loaded from, as they are sent. */
  readonly sizes: Readonly<Record<string, number>>;
}

/** What is asked for, as the page has it. */
export interface Wanted {
  readonly friction?: Friction;
  readonly limits?: LimitsAsked;
  readonly start?: Start;
}

export type Question =
  | { readonly kind: "load"; readonly files: Files }
  | { readonly kind: "read"; readonly file: Uint8Array }
  | { readonly kind: "plan"; readonly position: Float64Array; readonly wanted: Wanted }
  | { readonly kind: "follow"; readonly position: Float64Array; readonly wanted: Wanted }
  | { readonly kind: "next"; readonly following: number; readonly seen: Seen }
  | { readonly kind: "end"; readonly following: number };

export type Answer =
  | { readonly kind: "progress"; readonly done: number; readonly total: number }
  | { readonly kind: "ready"; readonly model: Model }
  | { readonly kind: "read"; readonly command: Command }
  | { readonly kind: "planned"; readonly text: string; readonly took: number }
  | { readonly kind: "following"; readonly following: number; readonly chunk: number }
  | { readonly kind: "next"; readonly chunk: Chunk }
  | { readonly kind: "ended" }
  | { readonly kind: "failed"; readonly message: string };

export type Model = Manifest & { readonly sha256: string };

let network: Network | undefined;
let sha256 = "";
let number = 0;
const followings = new Map<number, Following>();

async function load({ sizes, sha256: given }: Files, report: (answer: Answer) => void): Promise<Model> {
  const total = Object.values(sizes).reduce((sum, size) => sum + size, 0);
  let done = 0;
  const read = async (name: string): Promise<Uint8Array> => {
    const response = await fetch(name).catch(() => null);
    if (!response?.ok || !response.body) throw new Error(`${name} is not there${response ? ` (${response.status})` : ""}`);
    let size = 0;
    const counted = response.body.pipeThrough(new TransformStream<Uint8Array<ArrayBuffer>, Uint8Array<ArrayBuffer>>({
      transform(part, controller) {
        size += part.length;
        done += part.length;
        report({ kind: "progress", done, total });
        controller.enqueue(part);
      },
    }));
    const whole = name.endsWith(".packed") ? counted.pipeThrough(new DecompressionStream("gzip")) : counted;
    const buffer = await new Response(whole).arrayBuffer().catch(() => null);
    if (!buffer || size !== sizes[name]) throw new Error(`${name} did not come whole`);
    return new Uint8Array(buffer);
  };
  const names = ["model/manifest.json", "model/encoder.onnx.packed", "model/decoder_step.onnx.packed", "kernel.wasm"];
  const [manifest, encoder, decoderStep, kernel] = await Promise.all(names.map(read));
  const made: Manifest = JSON.parse(new TextDecoder().decode(manifest));
  network = await open(made, encoder!, decoderStep!, kernel!);
  sha256 = given;
  return { ...made, sha256 };
}

function loaded(): Network {
  if (!network) throw new Error("the planner is not loaded");
  return network;
}

function asked({ manifest }: Network, { friction = manifest.friction, limits, start }: Wanted) {
  return { friction: checkFriction(friction), limits: limitsOf(manifest, limits), ...(start && { start }) };
}

function answerTo(question: Exclude<Question, { kind: "load" }>): Answer {
  if (question.kind === "read") return { kind: "read", command: readCommand(question.file) };
  const own = loaded();
  if (question.kind === "plan") {
    const begin = performance.now(), { position } = question, all = asked(own, question.wanted);
    const text = JSON.stringify(documentOf(own.manifest, sha256, plan(own, position, all), position, all));
    return { kind: "planned", text, took: performance.now() - begin };
  }
  if (question.kind === "follow") {
    const following = new Following(own, question.position, asked(own, question.wanted));
    followings.set(++number, following);
    return { kind: "following", following: number, chunk: following.chunk };
  }
  if (question.kind === "end") {
    followings.delete(question.following);
    return { kind: "ended" };
  }
  const following = followings.get(question.following);
  if (!following) throw new Error("it has ended");
  return { kind: "next", chunk: following.next(question.seen) };
}

onmessage = async ({ data: { id, question } }: MessageEvent<{ id: number; question: Question }>): Promise<void> => {
  const answer = (given: Answer): void => postMessage({ id, answer: given });
  try {
    if (question.kind === "load") answer({ kind: "ready", model: await load(question.files, answer) });
    else answer(answerTo(question));
  } catch (error) {
    answer({ kind: "failed", message: error instanceof Error ? error.message : String(error) });
  }
};
