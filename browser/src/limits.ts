/** Limits and friction as they are asked for: those of the model, or of an arm, and what is to be another. */

import type { Friction } from "./law.js";
import type { Manifest } from "./network.js";
import type { Limits } from "./stop.js";

/** What is missing is that of the named ones, or of the model. No limit on the speed is null. */
export interface LimitsAsked {
  readonly name?: string;
  readonly pan_reach?: number;
  readonly height?: number;
  readonly speed?: number | null;
  readonly acceleration?: number;
  readonly jerk?: number;
}

/** `runtime.limits.NAMED`; what is missing is a default. */
const NAMED: Readonly<Record<string, Omit<LimitsAsked, "name">>> = {
  default: {},
  panda: { height: 0.1, speed: 1.7, acceleration: 13, jerk: 6_500 },
  fr3: { height: 0.1, speed: 3, acceleration: 9, jerk: 4_500 },
};

const UNITS = { pan_reach: "m", height: "m", speed: "m/s", acceleration: "m/s^2", jerk: "m/s^3" } as const;
const USABLE = [1e-6, 1e9] as const;
const FARTHEST_REACH = 100;  // m
const LONGEST_RAMP = 10;  // s
const MOST_FRICTION = 10;

/**
 * Read limits.
 *
 * @throws Error, in words to be shown
 */
export function limitsOf(manifest: Manifest, { name, ...given }: LimitsAsked = {}): Limits {
  const named = name === undefined ? {} : NAMED[name];
  if (!named) throw new Error(`there are no limits named ${name}: known are ${Object.keys(NAMED).join(", ")}`);
  const usual = { height: 0, speed: null, ...manifest.limits };
  const all: Record<string, number | null | undefined> = { ...usual, ...named, ...given };
  for (const [each, unit] of Object.entries(UNITS)) {
    const value = all[each];
    if (each === "speed" && (value === null || value === Infinity)) continue;
    if (each === "height" && value === 0) continue;
    if (typeof value !== "number" || !(value >= USABLE[0] && value <= USABLE[1])) {
      throw new Error(`limit ${each} must be between ${USABLE[0]} and ${USABLE[1]} ${unit}, got ${value} ${unit}`);
    }
    if (unit === "m" && value > FARTHEST_REACH) {
      throw new Error(`limit ${each} must be at most ${FARTHEST_REACH} m, got ${value} m: is it in millimetres?`);
    }
  }
  const limits = { ...all, speed: all.speed ?? Infinity } as unknown as Limits;
  const ramp = limits.acceleration / limits.jerk;
  if (ramp > LONGEST_RAMP) {
    throw new Error(`limits contradict each other: at a jerk of ${limits.jerk} m/s^3 the acceleration takes ` +
      `${ramp.toPrecision(4)} s to come to ${limits.acceleration} m/s^2; at most ${LONGEST_RAMP} s are accepted`);
  }
  const { pan_reach, height, speed, acceleration, jerk } = limits;
  return { pan_reach, height, speed, acceleration, jerk };
}

/** @throws Error, in words to be shown, for coefficients that are none */
export function checkFriction(friction: Friction): Friction {
  for (const [name, value] of [["static", friction.static], ["kinetic", friction.kinetic]] as const) {
    if (!(value > 0 && value <= MOST_FRICTION)) {
      throw new Error(`friction ${name} must be greater than 0 and at most ${MOST_FRICTION}, got ${value}`);
    }
  }
  if (friction.kinetic > friction.static) {
    throw new Error(`kinetic friction ${friction.kinetic} must not exceed static friction ${friction.static}`);
  }
  return friction;
}
