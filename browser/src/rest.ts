/** How a motion ends; the Python module `runtime.safety.rest` says how the stop is chosen. */

import type { Pan } from "./governor.js";
import { type Friction, slideToRest } from "./law.js";
import {
  type Brake, brakeAccelerations, findBrake, gentleStrength, type Limits, type PanState, samplesLeft, stopExtent,
  strongest, within,
} from "./stop.js";

const STRONGER = 1.4;
const MOST_STRONGER = 30;
const KEPT = 5e-4;
const LONGEST_STOP = 0.6;

export interface Motion {
  /** (n * 3) accelerations of the pan (m/s^2). */
  readonly u: Float64Array;
  /** ((n + 1) * 6) its states before and after each sample. */
  readonly pan: Float64Array;
  /** ((n + 1) * 4) the object's, relative to the pan. */
  readonly sliding: Float64Array;
}

/** The stop that follows the first samples of a motion, (m * 3) (m/s^2). */
export function stopAfter(
  motion: Motion, samples: number, ahead: Pan, mark: readonly [number, number], friction: Friction,
): Float64Array {
  const count = motion.u.length / 3;
  for (let k = samples; k <= count; k++) {
    const state = [...motion.pan.slice(6 * k, 6 * k + 6), ...motion.u.slice(3 * k - 3, 3 * k)];
    const brake = kindestStop(state, motion.sliding.slice(4 * k, 4 * k + 4), mark, ahead.limits, friction);
    if (brake) return joined(motion.u.slice(3 * samples, 3 * k), brakeAccelerations(brake, samplesLeft(brake)));
  }
  const left = Math.max(1, samplesLeft(ahead.brake));
  return joined(motion.u.slice(3 * samples), brakeAccelerations(ahead.brake, left));
}

function joined(a: Float64Array, b: Float64Array): Float64Array {
  const out = new Float64Array(a.length + b.length);
  out.set(a);
  out.set(b, a.length);
  return out;
}

export function kindestStop(
  state: PanState, sliding: Float64Array, mark: readonly [number, number], limits: Limits, friction: Friction,
): Brake | undefined {
  let best: Brake | undefined, least = Infinity;
  const good = Math.hypot(sliding[0]! - mark[0], sliding[1]! - mark[1]) + KEPT;
  for (const strength of strengths(state, limits, friction)) {
    const brake = findBrake(state, limits, strength);
    if (!within(stopExtent(state, brake), limits)) continue;
    const [x, y] = slideToRest(sliding, brakeAccelerations(brake, samplesLeft(brake)), friction);
    const left = Math.hypot(x - mark[0], y - mark[1]);
    if (left <= good) return brake;
    if (left < least - KEPT) [best, least] = [brake, left];
  }
  return best;
}

function strengths(state: PanState, limits: Limits, friction: Friction): number[] {
  const most = strongest(state, limits);
  const least = Math.min(most, Math.hypot(state[3]!, state[4]!, state[5]!) / LONGEST_STOP);
  const holding = gentleStrength(friction.kinetic, limits), carrying = gentleStrength(friction.static, limits);
  const first = Math.min(Math.max(carrying, least), most);
  const last = Math.min(most, first * MOST_STRONGER);
  const steps = Math.ceil(Math.log(last / first) / Math.log(STRONGER));
  const more = Array.from({ length: 1 + steps }, (_, n) => (n ? first * (last / first) ** (n / steps) : first));
  const found = new Set([holding, ...more, most].map((strength) => Math.min(Math.max(strength, least), most)));
  return [...found].filter((strength) => strength > 0).sort((a, b) => a - b);
}
