/** The network's own units, and what it is told; the Python modules `runtime.network.units` and `reach` say why. */

import { type Friction, GRAVITY } from "./law.js";
import type { Limits } from "./stop.js";

/** What all networks have in common, as a manifest repeats it; lengths and times in the network's units. */
export interface Constants {
  readonly chunk: number;
  readonly encoder_chunk: number;
  readonly encoder_rows: readonly number[];
  readonly seen_rows: readonly number[];
  readonly ahead_rows: readonly number[];
  readonly window: number;
  readonly unread: number;
  readonly reach: number;
  readonly acceleration: number;
  readonly least_jerk: number;
  readonly largest_jerk: number;
  readonly largest_height: number;
  readonly largest_speed: number;
  readonly full_lift: number;
  readonly least_friction: number;
  readonly conditions: number;
}

/** Factors from the network's units to SI. */
export interface Units {
  readonly length: number;
  readonly velocity: number;
  readonly acceleration: number;
  readonly jerk: number;
  /** How long a sample of the network's time lasts (ms). */
  readonly step: number;
}

const MOST_REACH = 0.4;  // m that a pan is told to have
const MOST_ACCELERATION = 40;  // m/s^2

/** Units of a pan that is told this share of its reach. */
export function unitsOf(constants: Constants, limits: Limits, reachUsed: number): Units {
  const reach = Math.min(reachUsed * limits.pan_reach, MOST_REACH);
  const acceleration = Math.min(limits.acceleration, MOST_ACCELERATION);
  const length = reach / constants.reach;
  const natural = Math.sqrt(constants.reach / constants.acceleration);
  const usable = ((limits.jerk * constants.acceleration * Math.sqrt(reach)) / (natural * constants.least_jerk)) ** (2 / 3);
  const time = Math.sqrt(reach / Math.min(acceleration, usable)) / natural;
  return { length, velocity: length / time, acceleration: length / time ** 2, jerk: length / time ** 3, step: time };
}

const USUAL_GRAVITY = 15;

/** What the network is told of limits and friction, each number of the order of one. */
export function conditionsOf(constants: Constants, limits: Limits, friction: Friction, units: Units): Float32Array {
  const gravity = GRAVITY / units.acceleration, weight = gravity / constants.acceleration;
  const height = Math.min(limits.height / units.length, constants.largest_height);
  const jerk = Math.min(limits.jerk / units.jerk, constants.largest_jerk);
  const speed = Math.min(limits.speed / units.velocity, constants.largest_speed);
  const [holds, brakes] = [friction.static, friction.kinetic].map((mu) => Math.max(mu, constants.least_friction));
  return Float32Array.of(
    Math.log(gravity / USUAL_GRAVITY), Math.min(1, height / constants.full_lift), height / 0.1,
    Math.log(jerk / 5_000) / 1.5, speed / 2 - 1, 1, Math.log(holds! / 0.4), Math.log(brakes! / 0.3),
    2 * holds! * weight - 1, 2 * brakes! * weight - 0.6,
  );
}

/** Milliseconds of an answer. */
export const chunkOf = (constants: Constants, step: number): number =>
  Math.max(2, roundHalfToEven(constants.chunk * step));

export function roundHalfToEven(value: number): number {
  const below = Math.floor(value), rest = value - below;
  return rest > 0.5 || (rest === 0.5 && below % 2 === 1) ? below + 1 : below;
}

const SPAN = 50;  // samples over which a command's speed is averaged
const PER_SPEED = { level: 8, lifting: 4 };  // share of the reach for each unit of speed
const SHARES = [1, 0.7, 0.5, 0.35, 0.25] as const;

/** The share of the reach that suits a command, (K * 2) (m): less for a slow one, which is then planned finer. */
export function reachFor(constants: Constants, position: Float64Array, limits: Limits): number {
  let fastest = 0;
  for (let n = 0; n < position.length; n += 2) {
    const before = Math.max(0, n - 2 * SPAN);
    fastest = Math.max(fastest, Math.hypot(position[n]! - position[before]!, position[n + 1]! - position[before + 1]!));
  }
  const speed = fastest / (SPAN * 0.001) / unitsOf(constants, limits, 1).velocity;
  const wanted = Math.max(PER_SPEED[limits.height === 0 ? "level" : "lifting"] * speed, SHARES.at(-1)!);
  const away = (share: number): number => Math.abs(Math.log(share / wanted));
  return SHARES.reduce((best: number, share) => (away(share) < away(best) ? share : best), SHARES[0]);
}
