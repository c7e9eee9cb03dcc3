/** A stop within the limits; the Python module `runtime.safety.stop` says why it has this form. */

import { DT, GRAVITY, type Friction } from "./law.js";

/** What holds at every sample; no limit on the speed is infinite. */
export interface Limits {
  readonly pan_reach: number;
  readonly height: number;
  readonly speed: number;
  readonly acceleration: number;
  readonly jerk: number;
}

/** Largest acceleration downwards of any pan (m/s^2): it leaves a fifth of the object's weight. */
export const LARGEST_SINK = (1 - 0.2) * GRAVITY;

/** Position (m), velocity (m/s), and acceleration of the sample before (m/s^2): x, y, z of each. */
export type PanState = readonly number[];

export interface Brake {
  readonly u: readonly number[];
  readonly w: readonly number[];
  readonly rampIn: number;
  readonly hold: number;
  readonly rampOut: number;
  readonly done: number;
}

export const RESTING: Brake = { u: [0, 0, 0], w: [0, 0, 0], rampIn: 1, hold: 0, rampOut: 1, done: 0 };

export const samplesLeft = (brake: Brake): number =>
  Math.max(0, brake.rampIn + brake.hold + brake.rampOut - brake.done);

/** The next accelerations of a stop, (count * 3) (m/s^2), zeros after it. */
export function brakeAccelerations(brake: Brake, count: number): Float64Array {
  const out = new Float64Array(3 * count);
  for (let row = 0; row < count; row++) {
    const k = brake.done + 1 + row;
    const after = k - (brake.rampIn + brake.hold);
    const rising = Math.min(k / brake.rampIn, 1);
    const falling = Math.min(Math.max(1 - after / brake.rampOut, 0), 1);
    for (let axis = 0; axis < 3; axis++) {
      out[3 * row + axis] = (1 - rising) * brake.u[axis]! + rising * falling * brake.w[axis]!;
    }
  }
  return out;
}

const SHORT_RAMP = 0.01;

export function strongest(state: PanState, limits: Limits): number {
  if (limits.acceleration <= limits.jerk * SHORT_RAMP) return limits.acceleration;
  const speed = length(state, 3), push = length(state, 6);
  const peak = Math.sqrt(limits.jerk * speed + 0.5 * push * push);
  return Math.min(limits.acceleration, Math.max(peak, limits.jerk * DT));
}

const length = (state: PanState, first: number): number =>
  Math.hypot(state[first]!, state[first + 1]!, state[first + 2]!);

export function findBrake(state: PanState, limits: Limits, asked?: number): Brake {
  const strength = asked === undefined ? strongest(state, limits) : Math.min(asked, limits.acceleration);
  const step = limits.jerk * DT;
  const rampOut = Math.ceil(strength / step);
  const rampIn = Math.max(1, Math.ceil((length(state, 6) + strength) / step));
  const brake = brakeWith(state, rampIn, rampOut, strength);
  const shorter = Math.max(1, Math.ceil(distance(brake.w, brake.u) / step));
  if (shorter < rampIn) {
    const quicker = brakeWith(state, shorter, rampOut, strength);
    if (distance(quicker.w, quicker.u) <= step * shorter) return quicker;
  }
  return brake;
}

const distance = (a: readonly number[], b: readonly number[]): number =>
  Math.hypot(a[0]! - b[0]!, a[1]! - b[1]!, a[2]! - b[2]!);

function brakeWith(state: PanState, rampIn: number, rampOut: number, strength: number): Brake {
  const before = 0.5 * (rampIn - 1);
  const q = [0, 1, 2].map((axis) => state[3 + axis]! / DT + before * state[6 + axis]!);
  const ramps = 0.5 * (rampIn + rampOut);
  const needed = Math.max(Math.hypot(q[0]!, q[1]!, q[2]!) / strength, q[2]! / LARGEST_SINK);
  const hold = Math.max(0, Math.ceil(needed - ramps));
  const weight = ramps + hold;
  return { u: state.slice(6, 9), w: q.map((each) => -each / weight), rampIn, hold, rampOut, done: 0 };
}

export interface Extent {
  readonly reach: number;
  readonly height: number;
  readonly speed: number;
}

export const within = (extent: Extent, limits: Limits): boolean =>
  extent.reach <= limits.pan_reach && extent.height <= limits.height && extent.speed <= limits.speed;

/** How far and how fast a pan comes at most on its stop, by the convex hulls of its three phases. */
export function stopExtent(state: PanState, brake: Brake): Extent {
  const most = {
    reach: state[0]! ** 2 + state[1]! ** 2,
    height: Math.abs(state[2]!),
    speed: state[3]! ** 2 + state[4]! ** 2 + state[5]! ** 2,
  };
  let moved = phase(state, brake.u, brake.w, brake.rampIn, most);
  if (brake.hold) moved = phase(moved, brake.w, brake.w, brake.hold, most);
  phase(moved, brake.w, [0, 0, 0], brake.rampOut, most);
  return { reach: Math.sqrt(most.reach), height: most.height, speed: Math.sqrt(most.speed) };
}

function phase(
  state: PanState, u: readonly number[], w: readonly number[], count: number,
  most: { reach: number; height: number; speed: number },
): PanState {
  const t = count * DT;
  const a = 0.5 * t * t;
  const b = (DT * DT * count * (2 * count * count + 3 * count + 1)) / 12;
  const third = t / 3, c = DT / 12;
  const d = (DT * (6 * count * count + 6 * count + 1)) / 12;
  const e = 0.5 * t * (count + 1), half = 0.5 * t;
  const end: number[] = [], velocity: number[] = [], first: number[] = [], last: number[] = [], middle: number[] = [];
  for (let axis = 0; axis < 3; axis++) {
    const p = state[axis]!, v = state[3 + axis]!, from = u[axis]!;
    const s = (w[axis]! - from) / count;
    end.push(p + v * t + from * a + s * b);
    first.push(p + third * (v + c * s));
    last.push(end[axis]! - third * (v + from * t + s * d));
    middle.push(v + half * (from + 0.5 * s));
    velocity.push(v + from * t + s * e);
  }
  for (const point of [first, last, end]) {
    most.reach = Math.max(most.reach, point[0]! * point[0]! + point[1]! * point[1]!);
    most.height = Math.max(most.height, Math.abs(point[2]!));
  }
  for (const each of [middle, velocity]) {
    most.speed = Math.max(most.speed, each[0]! * each[0]! + each[1]! * each[1]! + each[2]! * each[2]!);
  }
  return [...end, ...velocity];
}

const GENTLE = 0.9;

export function gentleStrength(coefficient: number, limits: Limits): number {
  const taken = GENTLE * coefficient;
  return limits.height === 0 ? taken * GRAVITY : (taken * GRAVITY) / (1 + taken);
}

export type { Friction };
