/** The kernel's memory, and matrices of 8-bit weights in it; `kernel/kernel.ts` says what is done with them. */

import type { Tensor } from "./onnx.js";

export interface Kernel {
  readonly memory: WebAssembly.Memory;
  multiply(weights: number, x: number, out: number, inputs: number, outputs: number, rows: number): void;
  quantize(x: number, n: number, step: number, zero: number, out: number): void;
  scaled(totals: number, scale: number, out: number, n: number, first: boolean): void;
  add(x: number, out: number, n: number): void;
  step(gates: number, cell: number, hidden: number, units: number): void;
  bend(x: number, n: number): void;
}

const PAGE = 65_536;
const ALIGNED = 16;

export class Heap {
  #end = 1024;

  constructor(readonly kernel: Kernel) {}

  /** So many bytes, zeros; they are never given back. */
  reserve(bytes: number): number {
    const place = this.#end;
    this.#end = Math.ceil((place + bytes) / ALIGNED) * ALIGNED;
    const lacking = this.#end - this.kernel.memory.buffer.byteLength;
    if (lacking > 0) this.kernel.memory.grow(Math.ceil(lacking / PAGE));
    return place;
  }

  floats(place: number, count: number): Float32Array {
    return new Float32Array(this.kernel.memory.buffer, place, count);
  }

  keep(values: ArrayLike<number>): number {
    const place = this.reserve(4 * values.length);
    this.floats(place, values.length).set(values);
    return place;
  }
}

const ROUND = 8;  // what the kernel multiplies at once

/** Weights (outputs, inputs) for `multiply`, from (inputs, outputs) in the file; and room for what they multiply. */
export class Matrix {
  readonly inputs: number;
  readonly outputs: number;
  readonly #weights: number;
  readonly #totals: number;
  /** Where its inputs are put, two rows of 16 bits. */
  readonly x: number;

  constructor(readonly heap: Heap, { dims, data }: Tensor) {
    const [inputs, outputs] = dims.slice(-2) as [number, number];
    this.inputs = Math.ceil(inputs / ROUND) * ROUND;
    this.outputs = outputs;
    this.#weights = heap.reserve(this.inputs * outputs);
    this.x = heap.reserve(2 * 2 * this.inputs);
    this.#totals = heap.reserve(2 * 4 * outputs);
    const weights = new Int8Array(heap.kernel.memory.buffer, this.#weights, this.inputs * outputs);
    for (let k = 0; k < inputs; k++) {
      for (let o = 0; o < outputs; o++) weights[o * this.inputs + k] = data[k * outputs + o]!;
    }
  }

  /** Multiply one row of `x`, or two; where the totals of each row are. */
  multiply(rows: 1 | 2): [number, number] {
    this.heap.kernel.multiply(this.#weights, this.x, this.#totals, this.inputs, this.outputs, rows);
    return [this.#totals, this.#totals + 4 * this.outputs];
  }
}
