/** A network for one pan run by onnxruntime-web on one thread. */

import * as ort from "onnxruntime-web/wasm";

import type { Network } from "./decode.js";

export interface Memory {
  readonly hidden: ort.Tensor;
  readonly cell: ort.Tensor;
}

/** What of a bundle's manifest a plan needs. */
export interface Manifest {
  readonly format: string;
  readonly layers: number;
  readonly units: number;
  readonly chunk?: number;
  readonly command_ahead?: number;
  readonly network?: { readonly kind: string; readonly chunk: number; readonly command_ahead: number };
  readonly trained_on: { readonly samples: readonly [number, number] };
}

/** Open a bundle: its manifest, and the bytes of its two graphs. */
export async function open(manifest: Manifest, encoder: Uint8Array, decoderStep: Uint8Array): Promise<Network<Memory>> {
  const known = manifest.format === "slide-bundle/1" || manifest.network?.kind === "one-pan";
  if (!known) throw new Error(`this page cannot plan with a bundle of format ${manifest.format}`);
  const chunk = manifest.network?.chunk ?? manifest.chunk ?? 0;
  const commandAhead = manifest.network?.command_ahead ?? manifest.command_ahead ?? 0;
  ort.env.wasm.numThreads = 1;
  const options: ort.InferenceSession.SessionOptions = { executionProviders: ["wasm"], graphOptimizationLevel: "all" };
  const [reading, stepping] = await Promise.all(
    [encoder, decoderStep].map((graph) => ort.InferenceSession.create(graph, options)),
  );
  return {
    chunk,
    commandAhead,
    longest: manifest.trained_on.samples[1],
    async encode(command, chunks) {
      const { hidden, cell } = await reading!.run({
        command: new ort.Tensor("float32", command, [1, chunks, 4 * chunk]),
      });
      return { hidden: hidden!, cell: cell! };
    },
    async decodeStep(observation, memory) {
      const out = await stepping!.run({
        observation: new ort.Tensor("float32", observation, [1, observation.length]),
        hidden: memory.hidden,
        cell: memory.cell,
      });
      return {
        u: out.pan_acceleration!.data as Float32Array,
        memory: { hidden: out.hidden_out!, cell: out.cell_out! },
      };
    },
  };
}
