/** The planner in a worker, so that the page stays responsive: it loads itself, and answers one plan after the other. */

import * as ort from "onnxruntime-web/wasm";

import { assess, type Sizes } from "./assess.js";
import { type Network, plan } from "./decode.js";
import { DT, type Friction } from "./law.js";
import { type Manifest, type Memory, open } from "./onnx.js";
import type { Limits } from "./stop.js";

/** What the site says of its own files. */
export interface Files {
  readonly version: string;
  readonly sha256: string;
  readonly sizes: Readonly<Record<string, number>>;
}

export type Question =
  | { readonly kind: "load"; readonly files: Files }
  | { readonly kind: "plan"; readonly position: Float64Array; readonly friction: Friction };

export type Answer =
  | { readonly kind: "progress"; readonly done: number; readonly total: number }
  | { readonly kind: "ready"; readonly model: Model }
  | { readonly kind: "planned"; readonly text: string; readonly took: number }
  | { readonly kind: "failed"; readonly message: string };

export type Model = Manifest & {
  readonly name: string;
  readonly sha256: string;
  readonly friction: Friction;
  readonly limits: Readonly<Record<string, number | null>>;
  readonly sizes: Sizes;
  readonly trained_on: Readonly<Record<string, readonly [number, number]>>;
};

const DEFAULT_SIZES: Sizes = { pan_radius: 0.18, object_radius: 0.03 };

let network: Network<Memory> | undefined;
let model: Model | undefined;

const answer = (message: Answer): void => postMessage(message);

async function load(files: Files): Promise<void> {
  const names = Object.keys(files.sizes);
  const total = Object.values(files.sizes).reduce((sum, size) => sum + size, 0);
  let done = 0;
  const read = async (name: string): Promise<Uint8Array> => {
    const response = await fetch(name);
    if (!response.ok || !response.body) throw new Error(`${name} is not there (${response.status})`);
    const parts: Uint8Array[] = [];
    const reader = response.body.getReader();
    for (let part = await reader.read(); !part.done; part = await reader.read()) {
      parts.push(part.value);
      done += part.value.length;
      answer({ kind: "progress", done, total });
    }
    const whole = new Uint8Array(await new Blob(parts as BlobPart[]).arrayBuffer());
    if (whole.length !== files.sizes[name]) throw new Error(`${name} did not come whole`);
    return whole;
  };
  const loaded = Object.fromEntries(await Promise.all(names.map(async (name) => [name, await read(name)] as const)));
  const manifest = JSON.parse(new TextDecoder().decode(loaded["model/manifest.json"]));
  ort.env.wasm.wasmBinary = loaded["onnxruntime.wasm"]!;
  network = await open(manifest, loaded["model/encoder.onnx"]!, loaded["model/decoder_step.onnx"]!);
  model = { sizes: DEFAULT_SIZES, ...manifest, sha256: files.sha256 } as Model;
  answer({ kind: "ready", model });
}

async function planned(position: Float64Array, friction: Friction): Promise<void> {
  if (!network || !model) throw new Error("it is not loaded");
  const begin = performance.now();
  const given = model.limits;
  const limits: Limits = {
    reach: given.pan_reach!, height: given.height ?? 0, speed: given.speed ?? Infinity,
    acceleration: given.acceleration!, jerk: given.jerk!,
  };
  const made = await plan(network, position, friction, limits);
  const samples = position.length / 2;
  const rows = (values: Float64Array, width: number, first: number, axes: number, count: number): number[][] =>
    Array.from({ length: count }, (_, k) => [...values.slice(width * k + first, width * k + first + axes)]);
  const document = {
    format: "slide-plan/2", dt: DT, model: { name: model.name, sha256: model.sha256 }, friction,
    command: { position: rows(position, 2, 0, 2, samples) },
    pan: {
      acceleration: rows(made.u, 3, 0, 3, samples), velocity: rows(made.pan, 6, 3, 3, samples),
      position: rows(made.pan, 6, 0, 3, samples),
    },
    stop: { acceleration: rows(made.stop, 3, 0, 3, made.stop.length / 3) },
    object: { velocity: rows(made.sliding, 4, 2, 2, samples), position: rows(made.sliding, 4, 0, 2, samples) },
    sizes: model.sizes,
    quality: assess(made, position, friction, limits, model.sizes, model.trained_on),
  };
  answer({ kind: "planned", text: JSON.stringify(document), took: performance.now() - begin });
}

onmessage = async ({ data }: MessageEvent<Question>): Promise<void> => {
  try {
    await (data.kind === "load" ? load(data.files) : planned(data.position, data.friction));
  } catch (error) {
    answer({ kind: "failed", message: error instanceof Error ? error.message : String(error) });
  }
};
