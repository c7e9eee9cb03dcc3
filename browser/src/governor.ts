/** The governor of one pan; the Python module `runtime.safety.governor` has its steps. */

import { DT, integratePan } from "./law.js";
import {
  type Brake, brakeAccelerations, findBrake, LARGEST_SINK, type Limits, type PanState, samplesLeft, stopExtent, within,
} from "./stop.js";

export interface Pan {
  readonly state: PanState;
  readonly brake: Brake;
  readonly limits: Limits;
}

export interface Governed {
  /** (C * 3) accelerations within the limits (m/s^2). */
  readonly u: Float64Array;
  /** (C * 6) pan states after each sample. */
  readonly states: Float64Array;
  readonly pan: Pan;
}

export const panAt = (state: PanState, limits: Limits): Pan => ({ state, brake: findBrake(state, limits), limits });

/**
 * The pan at its start, with a stop from there.
 *
 * @throws Error where there is none
 */
export function panAtStart(state: PanState, limits: Limits): Pan {
  const pan = panAt(state, limits);
  const level = limits.height !== 0 || (state[2] === 0 && state[5] === 0 && state[8] === 0);
  const kept = Math.hypot(...state.slice(6)) <= limits.acceleration && state[8]! >= -LARGEST_SINK;
  if (!(level && kept && canStop(pan))) {
    throw new Error("the pan cannot come to rest within its limits from where it is");
  }
  return pan;
}

export const canStop = (pan: Pan): boolean => within(stopExtent(pan.state, pan.brake), pan.limits);

const BISECTIONS = 6;
const DETOURS = [5, 10, 20, 40];

/** Let a pan do what is asked for, (C * 3) (m/s^2), as far as its limits allow. */
export function govern(pan: Pan, asked: Float64Array): Governed {
  const { limits } = pan;
  const level = limits.height === 0 ? asked.map((value, index) => (index % 3 === 2 ? 0 : value)) : asked;
  const u = follow(pan.state.slice(6), level, limits);
  const states = integratePan(pan.state.slice(0, 6), u);
  const ahead = panAt(stateAfter(states, u), limits);
  const keeps = farthest(states) <= limits.pan_reach && inSpace(states, limits) && canStop(ahead);
  return keeps ? { u, states, pan: ahead } : holdBack(pan, u, states);
}

const farthest = (states: Float64Array): number => Math.sqrt(mostSquare(states, 0, 2));

function mostSquare(states: Float64Array, first: number, axes: number): number {
  let most = 0;
  for (let row = 0; row < states.length; row += 6) {
    let square = 0;
    for (let axis = 0; axis < axes; axis++) square += states[row + first + axis]! ** 2;
    most = Math.max(most, square);
  }
  return most;
}

const inSpace = (states: Float64Array, limits: Limits): boolean =>
  (limits.height === 0 || Math.sqrt(mostSquare(states, 2, 1)) <= limits.height) &&
  (limits.speed === Infinity || mostSquare(states, 3, 3) <= limits.speed * limits.speed);

const stateAfter = (states: Float64Array, u: Float64Array): PanState => [...states.slice(-6), ...u.slice(-3)];

/** Shorten accelerations to the limit and to LARGEST_SINK, and follow them no faster than the jerk allows. */
export function follow(last: readonly number[], asked: Float64Array, limits: Limits): Float64Array {
  const bound = limits.acceleration, step = limits.jerk * DT;
  let u: Float64Array | undefined;
  let [hx, hy, hz] = [last[0]!, last[1]!, last[2]!];
  for (let k = 0; k < asked.length; k += 3) {
    let [x, y, z] = [asked[k]!, asked[k + 1]!, asked[k + 2]!];
    const square = x * x + y * y + z * z;
    const wx = x - hx, wy = y - hy, wz = z - hz;
    if (square <= bound * bound && wx * wx + wy * wy + wz * wz <= step * step && z >= -LARGEST_SINK) {
      [hx, hy, hz] = [x, y, z];
      continue;
    }
    u ??= asked.slice();
    const size = Math.sqrt(square);
    if (size > bound) [x, y, z] = [(x * bound) / size, (y * bound) / size, (z * bound) / size];
    if (z < -LARGEST_SINK) z = -LARGEST_SINK;
    const dx = x - hx, dy = y - hy, dz = z - hz;
    const change = Math.sqrt(dx * dx + dy * dy + dz * dz);
    if (change > step) {
      [hx, hy, hz] = [hx + (dx * step) / change, hy + (dy * step) / change, hz + (dz * step) / change];
    } else {
      [hx, hy, hz] = [x, y, z];
    }
    u.set([hx, hy, hz], k);
  }
  return u ?? asked;
}

function holdBack(pan: Pan, u: Float64Array, states: Float64Array): Governed {
  const { limits } = pan;
  const count = u.length / 3, start = pan.state.slice(0, 6);
  const stop = brakeAccelerations(pan.brake, count);
  const stopStates = integratePan(start, stop);
  let largest = shareWithin(stopStates, states, limits);
  let share = largest, smallest = 0;
  let brake: Brake | undefined;
  const end = stateAfter(states, u), stopEnd = stateAfter(stopStates, stop);
  for (let n = 0; n <= BISECTIONS; n++) {
    const ahead = panAt(stopEnd.map((value, index) => value + share * (end[index]! - value)), limits);
    if (canStop(ahead)) {
      smallest = share;
      brake = ahead.brake;
      if (share === largest) break;
    } else {
      largest = share;
    }
    share = 0.5 * (smallest + largest);
  }
  if (brake === undefined) {
    const done = pan.brake.done + Math.min(count, samplesLeft(pan.brake));
    const after = { state: stateAfter(stopStates, stop), brake: { ...pan.brake, done }, limits };
    return nearest(pan, u, { u: stop, states: stopStates, pan: after });
  }
  const held = stop.map((value, index) => value + smallest * (u[index]! - value));
  const heldStates = integratePan(start, held);
  return nearest(pan, u, { u: held, states: heldStates, pan: { state: stateAfter(heldStates, held), brake, limits } });
}

function nearest(pan: Pan, u: Float64Array, held: Governed): Governed {
  const { limits } = pan;
  const far = difference(held.u, u);
  for (const samples of DETOURS) {
    if (samples >= u.length / 3) break;
    const path = u.slice();
    path.set(brakeAccelerations(pan.brake, samples));
    const detour = follow(pan.state.slice(6), path, limits);
    if (!(difference(detour, u) < far)) break;
    const states = integratePan(pan.state.slice(0, 6), detour);
    if (!(mostSquare(states, 0, 2) <= limits.pan_reach * limits.pan_reach && inSpace(states, limits))) continue;
    const after = panAt(stateAfter(states, detour), limits);
    if (canStop(after)) return { u: detour, states, pan: after };
  }
  return held;
}

function difference(a: Float64Array, b: Float64Array): number {
  let sum = 0;
  for (let index = 0; index < a.length; index++) sum += (a[index]! - b[index]!) ** 2;
  return sum;
}

function shareWithin(stop: Float64Array, there: Float64Array, limits: Limits): number {
  let share = shareInBall(stop, there, 0, 2, limits.pan_reach);
  if (limits.height !== 0) share = Math.min(share, shareInBall(stop, there, 2, 1, limits.height));
  if (limits.speed !== Infinity) share = Math.min(share, shareInBall(stop, there, 3, 3, limits.speed));
  return share;
}

function shareInBall(stop: Float64Array, there: Float64Array, first: number, axes: number, radius: number): number {
  let smallest = 1;
  for (let row = 0; row < stop.length; row += 6) {
    let a = 0, b = 0, c = 0;
    for (let axis = first; axis < first + axes; axis++) {
      const p = stop[row + axis]!, d = there[row + axis]! - p;
      a += d * d;
      b += p * d;
      c += p * p;
    }
    if (a > 0) smallest = Math.min(smallest, (Math.sqrt(b * b - a * Math.min(c - radius * radius, 0)) - b) / a);
  }
  return Math.max(0, smallest);
}
