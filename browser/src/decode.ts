/** The decode loop; the Python module `runtime.network.decode` has its text. */

import { govern, type Pan, panAtStart } from "./governor.js";
import { type Friction, slideAlong } from "./law.js";
import type { Network } from "./network.js";
import { Reading } from "./reading.js";
import { type Motion, stopAfter } from "./rest.js";
import type { Limits, PanState } from "./stop.js";
import { reachFor } from "./units.js";

/** Where pan and object are before the first sample. */
export interface Start {
  readonly pan: PanState;
  /** (4) position and velocity relative to the pan (m, m/s). */
  readonly object: ArrayLike<number>;
}

export interface Asked {
  readonly friction: Friction;
  readonly limits: Limits;
  /** At rest, the pan in the middle and the object on its mark, if absent. */
  readonly start?: Start;
}

export interface Planned extends Motion {
  /** (K * 3) what the network asked for, before the governor held it back (m/s^2). */
  readonly asked: Float64Array;
  /** (m * 3) what follows the last row (m/s^2). */
  readonly stop: Float64Array;
}

const AT_REST: PanState = new Array<number>(9).fill(0);

export const startAt = ([x, y]: Float64Array): Start => ({ pan: AT_REST, object: [x!, y!, 0, 0] });

/**
 * Plan one command.
 *
 * @param position (K * 2) where the object should be, relative to the pan (m), at 1 kHz; K at least 2
 * @throws Error where the pan cannot come to rest within its limits from the start
 */
export function plan(network: Network, position: Float64Array, given: Asked): Planned {
  const { friction, limits, start = startAt(position) } = given;
  const samples = position.length / 2;
  const reachUsed = reachFor(network.constants, position, limits);
  const reading = new Reading(network, { position, friction, limits, reachUsed });
  const { chunk } = reading, total = Math.ceil(samples / chunk) * chunk;
  const u = new Float64Array(3 * total), asked = new Float64Array(3 * total);
  const states = new Float64Array(6 * (total + 1)), sliding = new Float64Array(4 * (total + 1));
  states.set(start.pan.slice(0, 6));
  sliding.set(Array.from(start.object));
  let pan: Pan = panAtStart(start.pan, limits);
  while (reading.now < samples) {
    const { now } = reading;
    const seen = [lastRows(states, 6, now, chunk), lastRows(sliding, 4, now, chunk)] as const;
    const chunkAsked = reading.look(...seen, pan.state.slice(6));
    const governed = govern(pan, chunkAsked);
    pan = governed.pan;
    u.set(governed.u, 3 * now);
    asked.set(chunkAsked, 3 * now);
    states.set(governed.states, 6 * (now + 1));
    sliding.set(slideAlong(sliding.slice(4 * now, 4 * now + 4), governed.u, friction), 4 * (now + 1));
    reading.after(chunk);
  }
  const mark: [number, number] = [position[2 * samples - 2]!, position[2 * samples - 1]!];
  const stop = stopAfter({ u, pan: states, sliding }, samples, pan, mark, friction);
  return {
    u: u.slice(0, 3 * samples), asked: asked.slice(0, 3 * samples), pan: states.slice(0, 6 * (samples + 1)),
    sliding: sliding.slice(0, 4 * (samples + 1)), stop,
  };
}

/** The last `count` rows up to row `now`; before the first row, it has been there. */
export function lastRows(rows: Float64Array, width: number, now: number, count: number): Float64Array {
  const out = new Float64Array(width * count);
  for (let k = 0; k < count; k++) {
    const row = Math.max(0, now - count + 1 + k);
    out.set(rows.subarray(width * row, width * (row + 1)), width * k);
  }
  return out;
}
