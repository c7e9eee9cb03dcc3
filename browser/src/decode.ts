/** The decode loop of a network for one pan; the Python modules `runtime.network.decode` and `one_pan` have its text. */

import { govern, type Pan, panAt } from "./governor.js";
import { type Friction, slideAlong } from "./law.js";
import { type Motion, stopAfter } from "./rest.js";
import type { Limits } from "./stop.js";

/** What a network's two graphs are, whatever runs them. */
export interface Network<Memory> {
  readonly chunk: number;
  readonly commandAhead: number;
  /** Samples of the longest command that it was trained on. */
  readonly longest: number;
  encode(command: Float32Array, chunks: number): Promise<Memory>;
  decodeStep(observation: Float32Array, memory: Memory): Promise<{ u: Float32Array; memory: Memory }>;
}

export interface Planned extends Motion {
  /** (K * 3) what the network asked for, before the governor held it back (m/s^2). */
  readonly asked: Float64Array;
  /** (m * 3) what follows the last row (m/s^2). */
  readonly stop: Float64Array;
  /** Root of the mean squared distance between object and command (m). */
  readonly trackingRmse: number;
}

/** Chunks at the end of a window that are read and planned again with the next. */
const UNREAD = 7;

/**
 * Plan one command from rest.
 *
 * @param position (K * 2) where the object should be, relative to the pan (m), at 1 kHz; K at least 2
 */
export async function plan<Memory extends object>(
  network: Network<Memory>, position: Float64Array, friction: Friction, limits: Limits,
): Promise<Planned> {
  const { chunk, commandAhead } = network;
  const samples = position.length / 2, chunks = Math.ceil(samples / chunk);
  const velocity = gradient(position);
  const most = Math.max(UNREAD + 1, Math.floor(network.longest / chunk));
  const total = chunks * chunk;
  const motion = {
    u: new Float64Array(3 * total), asked: new Float64Array(3 * total), pan: new Float64Array(6 * (total + 1)), sliding: new Float64Array(4 * (total + 1)),
  };
  motion.sliding.set(position.slice(0, 2));
  let pan: Pan = panAt(new Array<number>(9).fill(0), limits);
  for (let first = 0; first < chunks; ) {
    const seen = Math.min(chunks, first + most);
    const last = seen === chunks ? chunks : seen - UNREAD;
    const origin = position.slice(2 * Math.min(first * chunk, samples - 1), 2 * Math.min(first * chunk, samples - 1) + 2);
    const ahead = rows(position, velocity, origin, first * chunk, (seen + commandAhead) * chunk);
    let memory: Memory = await network.encode(ahead.slice(0, 4 * (seen - first) * chunk), seen - first);
    for (let n = 0; n < last - first; n++) {
      const now = (first + n) * chunk;
      const observation = new Float32Array((8 + 4 * commandAhead) * chunk);
      for (let k = 0; k < chunk; k++) {
        const row = Math.max(0, now - chunk + 1 + k); // before the beginning it has been there
        const p = motion.pan.subarray(6 * row), s = motion.sliding.subarray(4 * row);
        observation.set([p[0]!, p[1]!, p[3]!, p[4]!], 8 * k);
        observation.set([s[0]! - origin[0]!, s[1]! - origin[1]!, s[2]!, s[3]!], 8 * k + 4);
      }
      for (let m = 0; m < commandAhead; m++) {
        const from = 4 * chunk * Math.min(n + m, seen - first + commandAhead - 1);
        observation.set(ahead.subarray(from, from + 4 * chunk), (8 + 4 * m) * chunk);
      }
      const step = await network.decodeStep(observation, memory);
      memory = step.memory;
      const asked = new Float64Array(3 * chunk);
      for (let k = 0; k < chunk; k++) asked.set([step.u[2 * k]!, step.u[2 * k + 1]!], 3 * k);
      if (!asked.every(Number.isFinite)) throw new Error(`the network gave no finite number in iteration ${n}`);
      const governed = govern(pan, asked);
      pan = governed.pan;
      motion.u.set(governed.u, 3 * now);
      motion.asked.set(asked, 3 * now);
      motion.pan.set(governed.states, 6 * (now + 1));
      motion.sliding.set(slideAlong(motion.sliding.slice(4 * now, 4 * now + 4), governed.u, friction), 4 * (now + 1));
    }
    first = last;
  }
  const mark: [number, number] = [position[2 * samples - 2]!, position[2 * samples - 1]!];
  const stop = stopAfter(motion, samples, pan, mark, friction);
  let squares = 0;
  for (let k = 0; k < samples; k++) {
    squares += (motion.sliding[4 * k]! - position[2 * k]!) ** 2 + (motion.sliding[4 * k + 1]! - position[2 * k + 1]!) ** 2;
  }
  return {
    u: motion.u.slice(0, 3 * samples), asked: motion.asked.slice(0, 3 * samples), pan: motion.pan.slice(0, 6 * (samples + 1)),
    sliding: motion.sliding.slice(0, 4 * (samples + 1)), stop, trackingRmse: Math.sqrt(squares / samples),
  };
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

/** Samples of a command as the network reads them, (n * 4); past its end it is held at rest. */
function rows(
  position: Float64Array, velocity: Float64Array, origin: Float64Array, first: number, last: number,
): Float32Array {
  const samples = position.length / 2, out = new Float32Array(4 * (last - first));
  for (let k = first; k < last; k++) {
    const row = Math.min(k, samples - 1), there = 4 * (k - first);
    out[there] = position[2 * row]! - origin[0]!;
    out[there + 1] = position[2 * row + 1]! - origin[1]!;
    if (k < samples) out.set([velocity[2 * k]!, velocity[2 * k + 1]!], there + 2);
  }
  return out;
}
