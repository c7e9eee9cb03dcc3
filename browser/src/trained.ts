/** What a plan asks of the network, beside what it was trained on: `runtime.assess.training_range` in Python. */

import type { Start } from "./decode.js";
import { distances, g, largest, lengths, words } from "./figures.js";
import { DT, type Friction, GRAVITY } from "./law.js";
import type { Manifest } from "./network.js";
import type { Limits } from "./stop.js";
import { roundHalfToEven, unitsOf } from "./units.js";

const SPAN = 20;  // samples of the network's time over which a velocity is averaged
const ROUNDING = 1e-9;

/** What is asked for in one respect: how much, in which unit, and what the manifest's range is to be multiplied by. */
type Demand = readonly [value: number, unit?: string, scale?: number];

/** A line for each thing that is outside the range trained on; long commands are read by windows. */
export function outside(
  manifest: Manifest, position: Float64Array, friction: Friction, limits: Limits, start?: Start,
): string[] {
  const { trained_on: trained } = manifest;
  const all = demands(manifest, position, friction, limits, start);
  return Object.entries(all).flatMap(([name, [value, unit = "", scale = 1]]) => {
    const [low, high] = (trained[name] ?? [-Infinity, Infinity]).map((end) => scale * end) as [number, number];
    if ((low <= value && value <= high * (1 + ROUNDING)) || (name === "samples" && value > high)) return [];
    const of = unit && ` ${unit}`;
    return [`${words(name)} ${g(value, 4)}${of} is outside the range trained on, ${g(low, 4)} to ${g(high, 4)}${of}`];
  });
}

function demands(
  { network, trained_on: trained }: Manifest, position: Float64Array, friction: Friction, limits: Limits, start?: Start,
): Record<string, Demand> {
  const units = unitsOf(network, limits, 1), { velocity: speedUnit } = units;
  const span = Math.max(1, roundHalfToEven(SPAN * units.step));
  const velocity = meanVelocity(position, span), turns = velocity.subarray(2 * span).map((value, n) => value - velocity[n]!);
  const weight = GRAVITY / units.acceleration / network.acceleration;
  const push = (friction.static * weight) / (limits.height === 0 ? 1 : Math.hypot(1, friction.static));
  return {
    static: [friction.static],
    kinetic: [friction.kinetic],
    push: [push, "of the acceleration limit"],
    pan_reach: [limits.pan_reach, "m"],
    height: [limits.height, "m"],
    pan_speed: [Math.min(limits.speed, trained.pan_speed?.[1] ?? Infinity), "m/s"],
    acceleration: [limits.acceleration, "m/s^2"],
    jerk: [limits.jerk, "m/s^3"],
    reach: [largest(distances(position, position.map((_, n) => position[n & 1]!))), "m", limits.pan_reach],
    speed: [largest(lengths(velocity, 2, 0, 2, velocity.length / 2)), "m/s", speedUnit],
    start_speed: [Math.hypot(...(start?.pan.slice(3, 6) ?? [0])), "m/s", speedUnit],
    corner: [largest(lengths(turns, 2, 0, 2, turns.length / 2)), "m/s", speedUnit],
    samples: [position.length / 2, "", units.step],
  };
}

/** ((K + span) * 2) mean velocity over `span` samples (m/s), from each; the object rests before the command begins. */
function meanVelocity(position: Float64Array, span: number): Float64Array {
  const at = (row: number, axis: number): number => position[2 * Math.max(0, row - 2 * span) + axis]!;
  const rows = position.length / 2 + span;
  return Float64Array.from({ length: 2 * rows }, (_, n) =>
    (at((n >> 1) + span, n & 1) - at(n >> 1, n & 1)) / (span * DT));
}
