/**
 * The network in 8-bit integers, step by step as its two graphs have it.
 *
 * The Python module `export.integer_graphs` makes the graphs and says why they are so. Where a number is rounded to one
 * of 8 bits, another one in its last digit may become the next: so each step here is rounded as onnxruntime does it.
 */

import { Heap, type Kernel, Matrix } from "./heap.js";
import type { Friction } from "./law.js";
import { type Tensor, tensorsOf } from "./onnx.js";
import { type Constants, roundHalfToEven } from "./units.js";

/** What of a bundle's manifest a plan needs. */
export interface Manifest {
  readonly format: string;
  readonly name: string;
  readonly precision: string;
  readonly layers: number;
  readonly units: number;
  readonly network: Constants;
  readonly friction: Friction;
  readonly limits: Readonly<Record<string, number | null>>;
  readonly sizes: { readonly pan_radius: number; readonly object_radius: number };
  readonly trained_on: Readonly<Record<string, readonly [number, number]>>;
}

/** State of the decoder between two questions: hidden and cell, each (layers * units). */
export interface Memory {
  readonly hidden: Float32Array;
  readonly cell: Float32Array;
}

const { fround } = Math;

/** Open a bundle: its manifest, the bytes of its two graphs, and those of the kernel. */
export async function open(
  manifest: Manifest, encoder: Uint8Array, decoderStep: Uint8Array, kernel: Uint8Array,
): Promise<Network> {
  const { format, precision } = manifest;
  if (format !== "slide-bundle/2" || precision !== "int8") {
    throw new Error(`this page plans with slide-bundle/2 in int8, and ${manifest.name} is ${format} in ${precision}`);
  }
  const { instance } = await WebAssembly.instantiate(kernel as BufferSource, {});
  const heap = new Heap(instance.exports as unknown as Kernel);
  const reading = new Encoder(heap, manifest, tensorsOf(encoder));
  return new Network(manifest, reading, new Decoder(heap, manifest, tensorsOf(decoderStep)));
}

export class Network {
  readonly constants: Constants;

  constructor(readonly manifest: Manifest, readonly encoder: Encoder, readonly decoder: Decoder) {
    this.constants = manifest.network;
  }

  /** Read a command, rows of equal length; the decoder starts from the state that this leaves. */
  encode(window: Float32Array, chunks: number): Memory {
    return this.encoder.read(window, chunks);
  }

  /** The next accelerations, (CHUNK * 3) in the network's units. */
  decodeStep(observation: Float32Array, memory: Memory): { answer: Float32Array; memory: Memory } {
    return this.decoder.step(observation, memory);
  }
}

type Tensors = ReadonlyMap<string, Tensor>;

function named(tensors: Tensors, name: string): Tensor {
  const tensor = tensors.get(name);
  if (!tensor) throw new Error(`the network's file has no ${name}`);
  return tensor;
}

const scalar = (tensors: Tensors, name: string): number => named(tensors, name).data[0]!;

/** The LSTM that reads, onnxruntime's DynamicQuantizeLSTM: it rounds by the range of what it is given. */
class Encoder {
  readonly #perRange: Float32Array;
  readonly #cellsBefore: Float32Array;
  readonly #layers: ReadingLayer[];
  readonly #units: number;

  constructor(heap: Heap, { layers, units }: Manifest, tensors: Tensors) {
    this.#perRange = named(tensors, "per_range").data as Float32Array;
    this.#cellsBefore = named(tensors, "cells").data as Float32Array;
    this.#layers = Array.from({ length: layers }, (_, layer) => new ReadingLayer(heap, tensors, `lstm${layer}`));
    this.#units = units;
  }

  read(window: Float32Array, chunks: number): Memory {
    const width = this.#perRange.length, units = this.#units;
    let rows: Float32Array[] = Array.from({ length: chunks }, (_, row) => Float32Array.from({ length: width + 2 }, (_, k) => {
      if (k >= width) return k === width ? 1 : -1;  // so that the range is [-1, 1]
      return Math.min(1, Math.max(-1, fround(window[row * width + k]! * this.#perRange[k]!)));
    }));
    const hidden = new Float32Array(this.#layers.length * units), cell = hidden.slice();
    for (const [n, layer] of this.#layers.entries()) {
      const read = layer.read(rows, this.#cellsBefore);
      rows = read.rows;
      hidden.set(rows.at(-1)!.subarray(0, units), n * units);
      cell.set(read.cell.subarray(0, units), n * units);
    }
    return { hidden, cell };
  }
}

class ReadingLayer {
  readonly #heap: Heap;
  readonly #input: Matrix;
  readonly #memory: Matrix;
  readonly #inputScale: Float32Array;
  readonly #memoryScale: Float32Array;
  readonly #bias: number;
  readonly #floats: number;
  readonly #scale: number;
  readonly #gates: number;
  readonly #cell: number;
  readonly #hidden: number;
  readonly #units: number;

  constructor(heap: Heap, tensors: Tensors, name: string) {
    this.#heap = heap;
    this.#input = new Matrix(heap, named(tensors, `${name}.W`));
    this.#memory = new Matrix(heap, named(tensors, `${name}.R`));
    this.#inputScale = named(tensors, `${name}.W_scale`).data as Float32Array;
    this.#memoryScale = named(tensors, `${name}.R_scale`).data as Float32Array;
    const { outputs } = this.#input, bias = named(tensors, `${name}.B`).data;
    this.#units = outputs / 4;
    this.#bias = heap.keep(Float32Array.from({ length: outputs }, (_, o) => bias[o]! + bias[outputs + o]!));
    this.#floats = heap.reserve(4 * Math.max(this.#input.inputs, this.#units));
    this.#scale = heap.reserve(4 * outputs);
    this.#gates = heap.reserve(4 * outputs);
    this.#cell = heap.reserve(4 * this.#units);
    this.#hidden = heap.reserve(4 * this.#units);
  }

  read(rows: readonly Float32Array[], cellsBefore: Float32Array): { rows: Float32Array[]; cell: Float32Array } {
    const heap = this.#heap, units = this.#units;
    heap.floats(this.#cell, units).set(cellsBefore);
    const range = rangeOf(rows);
    let hidden = new Float32Array(units);
    const read = rows.map((row) => {
      this.#multiply(this.#input, this.#inputScale, row, range, true);
      this.#multiply(this.#memory, this.#memoryScale, hidden, rangeOf([hidden]), false);
      heap.kernel.add(this.#bias, this.#gates, 4 * units);
      heap.kernel.step(this.#gates, this.#cell, this.#hidden, units);
      hidden = heap.floats(this.#hidden, units).slice();
      return hidden;
    });
    return { rows: read, cell: heap.floats(this.#cell, units).slice() };
  }

  #multiply(matrix: Matrix, weightScale: Float32Array, values: Float32Array, range: Range, first: boolean): void {
    const { kernel } = this.#heap;
    this.#heap.floats(this.#floats, values.length).set(values);
    kernel.quantize(this.#floats, values.length, range.step, range.zero, matrix.x);
    this.#heap.floats(this.#scale, matrix.outputs).set(weightScale.map((each) => range.step * each));
    kernel.scaled(matrix.multiply(1)[0], this.#scale, this.#gates, matrix.outputs, first);
  }
}

interface Range {
  readonly step: number;
  readonly zero: number;
}

/** How onnxruntime rounds values to 8 bits: by the smallest and the largest. */
function rangeOf(rows: readonly Float32Array[]): Range {
  let low = 0, high = 0;
  for (const row of rows) {
    for (const value of row) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  const step = high === low ? 1 : fround(fround(high - low) / 255);
  return { step, zero: roundHalfToEven(Math.min(255, Math.max(0, fround(0 - fround(low / step))))) };
}

const MIDDLE = 128;  // zero among the 8-bit numbers of the decoder

/** One matrix of the decoder with what its outputs are worth. */
class Linear {
  readonly #heap: Heap;
  readonly #matrices: { matrix: Matrix; scales: number[] }[];
  readonly #bias: number;
  readonly outputs: number;

  /** @param names of the matrix and of its two digits where it has them, each with its scales */
  constructor(heap: Heap, tensors: Tensors, names: readonly { weight: string; scales: readonly string[] }[], bias: string | null) {
    this.#heap = heap;
    this.#matrices = names.map(({ weight, scales }) => ({
      matrix: new Matrix(heap, named(tensors, weight)),
      scales: scales.map((scale) => heap.keep(named(tensors, scale).data)),
    }));
    this.outputs = this.#matrices[0]!.matrix.outputs;
    this.#bias = bias === null ? 0 : heap.keep(named(tensors, bias).data);
  }

  static plain(heap: Heap, tensors: Tensors, name: string): Linear {
    return new Linear(heap, tensors, [{ weight: `${name}.weight`, scales: [`${name}.scale`] }], `${name}.bias`);
  }

  /** Of weights of so many digits and of inputs of two. */
  static precise(heap: Heap, tensors: Tensors, name: string, bias: string | null): Linear {
    const names = [];
    for (let digit = 0; tensors.has(`${name}_${digit}.weight`); digit++) {
      const scales = ["high", "low"].map((part) => `${name}_${digit}_${part}.scale`);
      names.push({ weight: `${name}_${digit}.weight`, scales });
    }
    return new Linear(heap, tensors, names, bias);
  }

  /** Round values (n float32) in steps, from the k-th input on. */
  put(values: number, n: number, step: number, k = 0, row: 0 | 1 = 0): void {
    for (const { matrix } of this.#matrices) {
      this.#heap.kernel.quantize(values, n, step, MIDDLE, matrix.x + 2 * (row * matrix.inputs + k));
    }
  }

  /** Round values (n float32) to two digits; they are left changed. */
  putPrecise(values: number, n: number, step: number, fine: number): void {
    this.put(values, n, step);
    const { matrix } = this.#matrices[0]!;
    const high = new Int16Array(this.#heap.kernel.memory.buffer, matrix.x, n), rest = this.#heap.floats(values, n);
    for (let k = 0; k < n; k++) rest[k] = rest[k]! - fround(high[k]! * step);
    this.put(values, n, fine, 0, 1);
  }

  /** Fill `out` (outputs float32) with the product and the bias. */
  multiply(out: number): void {
    const { kernel } = this.#heap;
    let first = true;
    for (const { matrix, scales } of this.#matrices) {
      const totals = matrix.multiply(scales.length as 1 | 2);
      for (const [row, scale] of scales.entries()) {
        kernel.scaled(totals[row]!, scale, out, this.outputs, first);
        first = false;
      }
    }
    if (this.#bias) kernel.add(this.#bias, out, this.outputs);
  }
}

/** One question: what is seen, through the LSTM's layers, a layer of tanh and the output. */
class Decoder {
  readonly #heap: Heap;
  readonly #numbers: Record<"step" | "fine_step" | "falling" | "square_floor" | "limit" | "sharpness" | "steep", number>;
  readonly #perRange: Float32Array;
  readonly #seen: Linear;
  readonly #remembered: Linear;
  readonly #layers: Linear[];
  readonly #feedforward: Linear;
  readonly #output: Linear;
  readonly #observation: number;
  readonly #gates: number;
  readonly #more: number;
  readonly #hidden: number;
  readonly #cell: number;
  readonly #out: number;
  readonly #units: number;
  readonly #conditions: number;

  constructor(heap: Heap, { layers, units, network }: Manifest, tensors: Tensors) {
    this.#heap = heap;
    const number = (name: string): number => scalar(tensors, name);
    this.#numbers = {
      step: number("step"), fine_step: number("fine_step"), falling: number("falling"), limit: number("limit"),
      square_floor: number("square_floor"), sharpness: number("sharpness"), steep: number("steep"),
    };
    this.#perRange = named(tensors, "per_range").data as Float32Array;
    this.#seen = Linear.precise(heap, tensors, "seen", null);
    this.#remembered = Linear.plain(heap, tensors, "remembered");
    this.#layers = Array.from({ length: layers - 1 }, (_, n) => Linear.plain(heap, tensors, `lstm${n + 1}`));
    this.#feedforward = Linear.plain(heap, tensors, "feedforward");
    this.#output = Linear.precise(heap, tensors, "output", "output.bias");
    this.#observation = heap.reserve(4 * this.#perRange.length);
    this.#gates = heap.reserve(4 * 4 * units);
    this.#more = heap.reserve(4 * 4 * units);
    this.#hidden = heap.reserve(4 * layers * units);
    this.#cell = heap.reserve(4 * layers * units);
    this.#out = heap.reserve(4 * Math.max(this.#feedforward.outputs, this.#output.outputs));
    this.#units = units;
    this.#conditions = network.conditions;
  }

  step(observation: Float32Array, memory: Memory): { answer: Float32Array; memory: Memory } {
    const { kernel } = this.#heap, { step, fine_step: fine } = this.#numbers, units = this.#units;
    const width = this.#perRange.length, count = memory.hidden.length;
    const hidden = this.#heap.floats(this.#hidden, count), cell = this.#heap.floats(this.#cell, count);
    hidden.set(memory.hidden);
    cell.set(memory.cell);
    const scaled = this.#heap.floats(this.#observation, width);
    for (let k = 0; k < width; k++) scaled[k] = observation[k]! * this.#perRange[k]!;
    this.#seen.putPrecise(this.#observation, width, step, fine);
    this.#seen.multiply(this.#gates);
    this.#remembered.put(this.#hidden, units, step);
    this.#remembered.multiply(this.#more);
    kernel.add(this.#more, this.#gates, 4 * units);
    kernel.step(this.#gates, this.#cell, this.#hidden, units);
    for (const [n, layer] of this.#layers.entries()) {
      const below = this.#hidden + 4 * n * units, own = below + 4 * units;
      layer.put(below, units, step);
      layer.put(own, units, step, units);
      layer.multiply(this.#gates);
      kernel.step(this.#gates, this.#cell + 4 * (n + 1) * units, own, units);
    }
    this.#feedforward.put(this.#hidden + 4 * (count - units), units, step);
    this.#feedforward.multiply(this.#out);
    kernel.bend(this.#out, this.#feedforward.outputs);
    this.#output.putPrecise(this.#out, this.#feedforward.outputs, step, fine);
    this.#output.multiply(this.#out);
    const raw = this.#heap.floats(this.#out, this.#output.outputs);
    const [gravity, lift] = observation.subarray(width - this.#conditions - 1) as unknown as [number, number];
    return { answer: this.#inSpace(raw, gravity, lift), memory: { hidden: hidden.slice(), cell: cell.slice() } };
  }

  /** Accelerations within the limit, and above what would drop the object: `add_answer_in_space` in Python. */
  #inSpace(raw: Float32Array, logGravity: number, lift: number): Float32Array {
    const { falling, square_floor: least, limit, sharpness, steep } = this.#numbers;
    const samples = raw.length / 3, answer = new Float32Array(raw.length);
    const floor = fround(fround(Math.exp(logGravity)) * falling), lifts = Math.min(1, Math.max(0, fround(lift * steep)));
    const relative = new Float32Array(samples), saturated = this.#heap.floats(this.#gates, samples);
    for (let k = 0; k < samples; k++) {
      const x = raw[k]!, y = raw[samples + k]!, z = fround(raw[2 * samples + k]! * lift);
      const square = fround(fround(fround(x * x) + fround(y * y)) + fround(z * z));
      relative[k] = fround(Math.sqrt(fround(square + least))) / limit;
    }
    saturated.set(relative);
    this.#heap.kernel.bend(this.#gates, samples);
    for (let k = 0; k < samples; k++) {
      const share = fround(saturated[k]! / relative[k]!), z = fround(fround(raw[2 * samples + k]! * lift) * share);
      const t = fround(fround(z + floor) * sharpness);
      const soft = fround(Math.max(0, t) + fround(Math.log(fround(fround(Math.exp(-Math.abs(t))) + 1))));
      answer.set([raw[k]! * share, raw[samples + k]! * share, fround(fround(soft / sharpness) - floor) * lifts], 3 * k);
    }
    return answer;
  }
}
