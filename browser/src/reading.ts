/** The network reading a command: what it is shown in its units and time. `runtime.network.general` has its text. */

import type { Friction } from "./law.js";
import type { Memory, Network } from "./network.js";
import type { Limits } from "./stop.js";
import { chunkOf, conditionsOf, type Units, unitsOf } from "./units.js";

/** What is to be planned. */
export interface Job {
  /** (K * 2) where the object should be, relative to the pan (m), at 1 kHz; K at least 2. */
  readonly position: Float64Array;
  readonly friction: Friction;
  readonly limits: Limits;
  /** Share of its reach that the network is told. */
  readonly reachUsed: number;
}

/** Numbers of a row of states: the pan's position and velocity in space, the object's in the plane. */
const STATE = 10;

/** Positions and velocities of a command. */
const ROW = 4;

/** A command as far as it has been read; the samples count from its beginning. */
export class Reading {
  /** Milliseconds of an answer. */
  readonly chunk: number;
  now: number;
  readonly #network: Network;
  readonly #units: Units;
  readonly #samples: number;
  readonly #command: Float64Array;
  readonly #conditions: Float32Array;
  readonly #seen: Instants;
  readonly #ahead: Instants;
  readonly #answer: Float64Array;
  #elapsed = 1;
  #nextRead: number;
  #memory: Memory;

  constructor(network: Network, job: Job, now = 0) {
    const { constants } = network;
    const units = unitsOf(constants, job.limits, job.reachUsed), { step } = units;
    const last = constants.seen_rows.at(-1)!;
    this.#network = network;
    this.#units = units;
    this.chunk = chunkOf(constants, step);
    this.now = now;
    this.#samples = job.position.length / 2;
    this.#command = inUnits(job.position, units, Math.floor(LOOKS_AHEAD * constants.chunk * step) + 2);
    this.#conditions = conditionsOf(constants, job.limits, job.friction, units);
    const seen = constants.seen_rows.map((row) => Math.max(this.chunk - 1 + step * (row - last), 0));
    this.#seen = instants(seen, this.chunk);
    this.#ahead = instants(constants.ahead_rows.map((row) => step * row));
    this.#answer = milliseconds(constants.chunk, step, this.chunk);
    this.#nextRead = this.#readAfter(now);
    this.#memory = this.#read(now);
  }

  /**
   * Ask for the next chunk.
   *
   * @param pan (C * 6) the last C states of the pan, relative to the centre of its reach (m, m/s)
   * @param sliding (C * 4) those of the object, relative to the pan
   * @param last (3) the pan's acceleration over the sample before (m/s^2)
   * @returns (C * 3) accelerations (m/s^2)
   * @throws Error where the network gives no finite number
   */
  look(pan: Float64Array, sliding: Float64Array, last: ArrayLike<number>): Float64Array {
    if (this.#nextRead <= this.now && this.now < this.#samples) {
      this.#memory = this.#read(this.now);
      this.#nextRead = this.#readAfter(this.now);
    }
    const { length, velocity, acceleration } = this.#units;
    const ahead = atInstants(this.#command, ROW, this.#ahead, Math.min(this.now, this.#samples));
    const [x, y] = [ahead[0]!, ahead[1]!];
    for (let n = 0; n < ahead.length; n += ROW) ahead.set([ahead[n]! - x, ahead[n + 1]! - y], n);
    const states = new Float64Array(STATE * this.chunk);
    for (let k = 0; k < this.chunk; k++) {
      states.set(pan.subarray(6 * k, 6 * k + 6), STATE * k);
      states.set(sliding.subarray(4 * k, 4 * k + 4), STATE * k + 6);
    }
    const seen = atInstants(states, STATE, this.#seen, 0);
    const scale = [length, length, length, velocity, velocity, velocity, length, length, velocity, velocity].map((each) => 1 / each);
    for (let n = 0; n < seen.length; n++) seen[n] = seen[n]! * scale[n % STATE]!;
    for (let n = 6; n < seen.length; n += STATE) seen.set([seen[n]! - x, seen[n + 1]! - y], n);
    const before = Float64Array.from(last, (each) => each / acceleration);
    const elapsed = Math.min(1, this.#elapsed);
    const observation = Float32Array.of(...seen, ...before, ...ahead, ...this.#conditions, elapsed);
    const { answer, memory } = this.#network.decodeStep(observation, this.#memory);
    this.#memory = memory;
    this.#elapsed = 0;
    return this.#inMilliseconds(before, answer);
  }

  /** Go on after so many samples of the answer have been executed. */
  after(samples: number): void {
    this.now += samples;
    this.#elapsed += samples / this.#units.step / this.#network.constants.chunk;
  }

  #inMilliseconds(before: Float64Array, answer: Float32Array): Float64Array {
    const { chunk } = this.#network.constants, u = new Float64Array(3 * this.chunk);
    for (let k = 0; k < this.chunk; k++) {
      const shares = this.#answer.subarray((chunk + 1) * k, (chunk + 1) * (k + 1));
      for (let axis = 0; axis < 3; axis++) {
        let sum = shares[0]! * before[axis]!;
        for (let n = 0; n < chunk; n++) sum += shares[n + 1]! * answer[3 * n + axis]!;
        u[3 * k + axis] = sum * this.#units.acceleration;
      }
    }
    if (!u.every(Number.isFinite)) throw new Error(`the network gave no finite number at sample ${this.now}`);
    return u;
  }

  #read(now: number): Memory {
    const { encoder_chunk: chunk, encoder_rows: rows, window } = this.#network.constants;
    const { step } = this.#units;
    const left = Math.ceil((this.#samples - now) / (chunk * step));
    const chunks = Math.max(1, Math.min(window, left));
    const times = Array.from({ length: chunks }, (_, n) => rows.map((row) => step * (chunk * n + row))).flat();
    const command = atInstants(this.#command, ROW, instants(times), Math.min(now, this.#samples));
    const [x, y] = [command[0]!, command[1]!];
    for (let n = 0; n < command.length; n += ROW) command.set([command[n]! - x, command[n + 1]! - y], n);
    const wide = ROW * rows.length, width = wide + this.#conditions.length;
    const read = new Float32Array(chunks * width);
    for (let n = 0; n < chunks; n++) {
      read.set(command.subarray(wide * n, wide * (n + 1)), width * n);
      read.set(this.#conditions, width * n + wide);
    }
    return this.#network.encode(read, chunks);
  }

  #readAfter(now: number): number {
    const { encoder_chunk: chunk, window, unread } = this.#network.constants, { step } = this.#units;
    if (this.#samples - now <= window * chunk * step) return this.#samples;
    return now + Math.floor((window - unread) * chunk * step);
  }
}

const LOOKS_AHEAD = 4;  // chunks

/** Rows (x, y, vx, vy) of a command, and as much rest behind its end as the network looks ahead. */
function inUnits(position: Float64Array, units: Units, more: number): Float64Array {
  const samples = position.length / 2, velocity = gradient(position);
  const out = new Float64Array(ROW * (samples + more));
  const perLength = 1 / units.length, perVelocity = 1 / units.velocity;
  for (let k = 0; k < samples + more; k++) {
    const row = Math.min(k, samples - 1);
    out.set([position[2 * row]! * perLength, position[2 * row + 1]! * perLength], ROW * k);
    if (k < samples) out.set([velocity[2 * k]! * perVelocity, velocity[2 * k + 1]! * perVelocity], ROW * k + 2);
  }
  return out;
}

/** Central differences, one-sided at the ends: what a command's velocity is to the network. */
export function gradient(position: Float64Array): Float64Array {
  const count = position.length / 2, out = new Float64Array(position.length);
  for (let k = 0; k < count; k++) {
    const before = Math.max(0, k - 1), after = Math.min(count - 1, k + 1);
    for (let axis = 0; axis < 2; axis++) {
      out[2 * k + axis] = (position[2 * after + axis]! - position[2 * before + axis]!) / ((after - before) * 1e-3);
    }
  }
  return out;
}

/** Instants between milliseconds: the row before each, and how far it is on the way to the next. */
type Instants = readonly { readonly before: number; readonly share: number }[];

function instants(times: readonly number[], rows = Infinity): Instants {
  return times.map((time) => {
    const before = Math.min(Math.floor(time), rows - 2);
    return { before, share: time - before };
  });
}

/** Rows at instants after row `now`, by straight lines; past the last row, that one. */
function atInstants(rows: Float64Array, width: number, at: Instants, now: number): Float64Array {
  const out = new Float64Array(width * at.length);
  for (const [n, { before, share }] of at.entries()) {
    const from = width * (now + before);
    for (let k = 0; k < width; k++) {
      const first = rows[from + k]!;
      out[width * n + k] = first + (rows[from + width + k]! - first) * share;
    }
  }
  return out;
}

/** (count * (chunk + 1)) shares of the millisecond before a chunk, and of its samples, in each of its milliseconds. */
function milliseconds(chunk: number, step: number, count: number): Float64Array {
  const shares = new Float64Array(count * (chunk + 1));
  for (let k = 0; k < count; k++) {
    const row = shares.subarray(k * (chunk + 1), (k + 1) * (chunk + 1));
    if (step >= 1) {
      // On the line through the middle of the millisecond before and the middles of the samples.
      const middle = (n: number): number => (n === 0 ? -0.5 : step * (n - 0.5));
      let before = 0;
      while (before < chunk - 1 && middle(before + 1) <= k + 0.5) before++;
      const share = Math.min(1, (k + 0.5 - middle(before)) / (middle(before + 1) - middle(before)));
      row[before] = 1 - share;
      row[before + 1] = share;
      continue;
    }
    let sum = 0;
    for (let n = 0; n < chunk; n++) {
      row[n + 1] = Math.max(0, Math.min(k + 1, step * (n + 1)) - Math.max(k, step * n));
      sum += row[n + 1]!;
    }
    row[chunk] = row[chunk]! + 1 - sum; // beyond the chunk's end, its last acceleration is held
  }
  return shares;
}
