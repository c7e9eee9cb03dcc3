/** The weights of an ONNX graph by name: what is kept in it besides is known to whoever reads them. */

export interface Tensor {
  readonly dims: readonly number[];
  readonly data: Int8Array | Float32Array;
}

const GRAPH = 7, INITIALIZER = 5;  // fields of ModelProto and GraphProto
const DIMS = 1, TYPE = 2, NAME = 8, RAW = 9;  // of TensorProto
const FLOAT = 1, INT8 = 3;

/**
 * Read a serialized graph.
 *
 * @throws Error if it is none
 */
export function tensorsOf(model: Uint8Array): Map<string, Tensor> {
  const tensors = new Map<string, Tensor>();
  for (const graph of fields(model)) {
    if (graph.field !== GRAPH || !graph.bytes) continue;
    for (const { field, bytes } of fields(graph.bytes)) {
      if (field !== INITIALIZER || !bytes) continue;
      const { name, type, dims, raw } = tensorOf(bytes);
      if (type === INT8) tensors.set(name, { dims, data: new Int8Array(raw.buffer) });
      else if (type === FLOAT) tensors.set(name, { dims, data: new Float32Array(raw.buffer) });
    }
  }
  if (!tensors.size) throw new Error("the network's file is none");
  return tensors;
}

function tensorOf(message: Uint8Array): { name: string; type: number; dims: number[]; raw: Uint8Array<ArrayBuffer> } {
  const found = { name: "", type: 0, dims: [] as number[], raw: new Uint8Array() };
  for (const { field, value, bytes } of fields(message)) {
    if (field === DIMS) found.dims.push(...(bytes ? numbers(bytes) : [value]));
    else if (field === TYPE) found.type = value;
    else if (field === NAME && bytes) found.name = new TextDecoder().decode(bytes);
    else if (field === RAW && bytes) found.raw = bytes.slice();
  }
  return found;
}

interface Field {
  readonly field: number;
  readonly value: number;
  readonly bytes: Uint8Array | null;
}

function* fields(message: Uint8Array): Generator<Field> {
  const at = { place: 0 };
  while (at.place < message.length) {
    const key = number(message, at), field = Math.floor(key / 8), kind = key % 8;
    if (kind === 0) {
      yield { field, value: number(message, at), bytes: null };
      continue;
    }
    const size = kind === 2 ? number(message, at) : kind === 5 ? 4 : kind === 1 ? 8 : NaN;
    if (!(at.place + size <= message.length)) throw new Error("the network's file is broken");
    yield { field, value: 0, bytes: message.subarray(at.place, at.place + size) };
    at.place += size;
  }
}

function numbers(message: Uint8Array): number[] {
  const found: number[] = [], at = { place: 0 };
  while (at.place < message.length) found.push(number(message, at));
  return found;
}

function number(message: Uint8Array, at: { place: number }): number {
  let value = 0, worth = 1;
  for (;;) {
    const byte = message[at.place++];
    if (byte === undefined) throw new Error("the network's file is broken");
    value += (byte & 0x7f) * worth;
    if (byte < 0x80) return value;
    worth *= 0x80;
  }
}
