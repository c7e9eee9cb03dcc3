/** What is to be said of a plan: the Python module `runtime.assess` has the rules. */

import type { Asked, Planned } from "./decode.js";
import { distances, g, largest, lengths, rootMeanSquare, words } from "./figures.js";
import { DT, type Friction, GRAVITY, slideAlong, slideToRest } from "./law.js";
import type { Manifest } from "./network.js";
import { LARGEST_SINK, type Limits } from "./stop.js";
import { outside } from "./trained.js";

export interface Sizes {
  readonly pan_radius: number;
  readonly object_radius: number;
}

const ROUNDING = 1e-6;
const CHANGED = 1e-3;
const FEW = 0.05;
const STILL_SHARE = 0.5;
const STILL_FLOOR = 1e-3;
const POOR_RMSE = 0.01;
const RIM_ROUNDING = 1e-9;
const FRICTION_OFF = 0.1;
const MOST_FRICTION = 10;

const UNITS: Readonly<Record<string, string>> = {
  pan_reach: "m", height: "m", speed: "m/s", acceleration: "m/s^2", jerk: "m/s^3",
};

/** The quality of a plan, as its document has it. */
export function assess(
  manifest: Manifest, planned: Planned, position: Float64Array, { friction, limits, start }: Asked, sizes: Sizes,
): Record<string, unknown> {
  const samples = position.length / 2;
  const { u, pan, sliding } = planned;
  const object = Float64Array.from({ length: 2 * samples }, (_, n) => sliding[4 * (n >> 1) + (n & 1)]!);
  const errors = distances(object, position);
  const rmse = rootMeanSquare(errors);
  const step = u.map((value, n) => value - (n < 3 ? start?.pan[6 + n] ?? 0 : u[n - 3]!));
  const along: Record<string, Float64Array> = {
    pan_reach: lengths(pan, 6, 0, 2, samples), height: lengths(pan, 6, 2, 1, samples),
    speed: lengths(pan, 6, 3, 3, samples), acceleration: lengths(u, 3, 0, 3, samples),
    jerk: lengths(step, 3, 0, 3, samples).map((each) => each / DT),
  };
  const most = Object.fromEntries(Object.entries(along).map(([name, values]) => [name, largest(values)]));
  const held: Record<string, number | null> = {
    pan_reach: limits.pan_reach, height: limits.height, speed: limits.speed === Infinity ? null : limits.speed,
    acceleration: limits.acceleration, jerk: limits.jerk,
  };
  const changes = lengths(u.map((value, n) => value - planned.asked[n]!), 3, 0, 3, samples);
  const changed = [...changes].filter((each) => each > CHANGED);
  const mean = changed.length ? changed.reduce((sum, each) => sum + each, 0) / changed.length : 0;
  const strongest = changed.reduce((a, b) => Math.max(a, b), 0);
  const still = rootMeanSquare(distances(onStillPan(sliding.slice(0, 4), samples, friction), position));
  const mark = position.slice(-2);
  const [x, y] = slideToRest(sliding.slice(-4), planned.stop, friction);
  const rest = Math.hypot(x - mark[0]!, y - mark[1]!);
  const room = sizes.pan_radius - sizes.object_radius;
  const offPan = { command: overRim(position, room), object: overRim(object, room) };
  const said = changed.length
    ? [`the governor changed ${changed.length === 1 ? "1 sample" : `${changed.length} samples`} ` +
      `(${((100 * changed.length) / samples).toFixed(1)}%), by ${g(mean, 3)} m/s^2 on average, ${g(strongest, 3)} at most`]
    : [];
  const many = changed.length > FEW * samples;
  const notes: [string, string[]][] = [
    ["limit_exceeded", Object.entries(held).flatMap(([name, limit]) =>
      limit !== null && most[name]! > limit * (1 + ROUNDING)
        ? [`${words(name)} ${g(most[name]!, 4)} ${UNITS[name]} exceeds the limit of ${g(limit)} ${UNITS[name]}`] : [])
      .concat(dropped(u))],
    ["off_pan", Object.entries(offPan).flatMap(([name, found]) => found
      ? [`${name === "command" ? "the command leaves the pan" : "the object would leave the pan"} at sample ` +
        `${found.first} (t = ${(found.first * DT).toFixed(3)} s), by ${g(found.farthest, 4)} m at most: an object of ` +
        `radius ${g(sizes.object_radius)} m has ${g(room, 4)} m to each side in a pan of radius ${g(sizes.pan_radius)} m` +
          (found.first === 0 ? ". Is it relative to the pan's centre? If not: --origin first" : "")] : [])],
    ["cannot_slide", still > 0 ? cannotSlide(friction, limits) : []],
    ["poor", [
      ...(rmse > STILL_SHARE * still && rmse > STILL_FLOOR
        ? [`tracking RMSE ${g(rmse, 4)} m is more than half of the ${g(still, 4)} m that a pan which never moves would have`]
        : []),
      ...(rmse > POOR_RMSE ? [`tracking RMSE ${g(rmse, 4)} m is above ${POOR_RMSE} m`] : []),
    ]],
    ["beyond_training_range", outside(manifest, position, friction, limits, start)],
    ["limited", many ? said : []],
    ["governed", many ? [] : said],
  ];
  const left = rest > POOR_RMSE
    ? [`after the stop the object rests ${g(rest, 4)} m from the command's end: let the command rest there for its ` +
      "last 0.2 s, and the object stays"] : [];
  return {
    tracking_rmse: rmse, tracking_max: largest(errors), pan_reach: most.pan_reach, height_max: most.height,
    speed_max: most.speed, acceleration_max: most.acceleration, jerk_max: most.jerk,
    sliding_share: lengths(sliding, 4, 2, 2, samples).filter((each) => each !== 0).length / samples,
    limits: held,
    margins: Object.fromEntries(Object.entries(held).map(([name, limit]) =>
      [name, limit === null ? null : limit - most[name]!])),
    worst: Object.fromEntries(Object.entries(along).map(([name, values]) => [name, values.indexOf(most[name]!)])),
    governed: { samples: changed.length, mean, largest: strongest },
    friction: null,
    friction_off_rmse: frictionOff(planned, position, friction),
    rest_error: rest, command_off_pan: offPan.command, object_off_pan: offPan.object,
    status: notes.find(([, lines]) => lines.length)?.[0] ?? "ok",
    notes: [...notes.flatMap(([, lines]) => lines), ...left],
  };
}

/** Tracking RMSE (m) open loop under friction that is 10 % off, the worst of four ways. */
function frictionOff(planned: Planned, position: Float64Array, friction: Friction): number {
  const u = planned.u.slice(0, -3);
  let worst = 0;
  for (const off of [1 - FRICTION_OFF, 1 + FRICTION_OFF]) {
    const holds = Math.min(off * friction.static, MOST_FRICTION);
    for (const other of [1 - FRICTION_OFF, 1 + FRICTION_OFF]) {
      const kinetic = Math.min(other * friction.kinetic, holds);
      const states = slideAlong(planned.sliding.slice(0, 4), u, { static: holds, kinetic });
      const object = Float64Array.from(position, (_, n) =>
        n < 2 ? planned.sliding[n]! : states[4 * ((n >> 1) - 1) + (n & 1)]!);
      worst = Math.max(worst, rootMeanSquare(distances(object, position)));
    }
  }
  return worst;
}

function cannotSlide(friction: Friction, limits: Limits): string[] {
  const needed = friction.static * GRAVITY;
  if (limits.acceleration > needed) return [];
  if (limits.height !== 0) {
    const sink = Math.min((limits.acceleration * friction.static) / Math.hypot(1, friction.static), LARGEST_SINK);
    const push = Math.sqrt(limits.acceleration ** 2 - sink ** 2), holds = friction.static * (GRAVITY - sink);
    if (push > holds) return [];
    return [`the object cannot slide: within ${g(limits.acceleration)} m/s^2 the pan may push by ${g(push, 4)} m/s^2 ` +
      `while it sinks, and static friction ${g(friction.static)} holds the object up to ${g(holds, 4)} m/s^2 then`];
  }
  return [`the object cannot slide: the pan may accelerate by ${g(limits.acceleration)} m/s^2, and static friction ` +
    `${g(friction.static)} holds the object up to ${g(needed, 4)} m/s^2`];
}

function dropped(u: Float64Array): string[] {
  const sink = -u.reduce((least, value, n) => (n % 3 === 2 ? Math.min(least, value) : least), Infinity);
  if (sink <= LARGEST_SINK * (1 + ROUNDING)) return [];
  return [`the pan accelerates downwards by ${g(sink, 4)} m/s^2, and the object keeps its hold up to ` +
    `${g(LARGEST_SINK)} m/s^2`];
}

/** Where an object would be (K * 2) (m) if the pan never moved. */
function onStillPan(start: Float64Array, samples: number, friction: Friction): Float64Array {
  const states = slideAlong(start, new Float64Array(3 * (samples - 1)), friction);
  return Float64Array.from({ length: 2 * samples }, (_, n) =>
    n < 2 ? start[n]! : states[4 * ((n >> 1) - 1) + (n & 1)]!);
}

function overRim(position: Float64Array, room: number): { first: number; farthest: number } | null {
  const over = lengths(position, 2, 0, 2, position.length / 2).map((each) => each - room);
  const first = over.findIndex((each) => each > RIM_ROUNDING);
  return first < 0 ? null : { first, farthest: largest(over) };
}
