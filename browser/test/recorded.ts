/** What test/record.py has written of the Python runtime, and what of it tests need. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";

import { type Limits, type Network, open } from "../src/index.js";

export const recorded = JSON.parse(readFileSync(process.env.SLIDE_RECORDED ?? "out/recorded.json", "utf8"));

export const AT_REST: readonly number[] = new Array(9).fill(0);

export const flat = (rows: number[][]): Float64Array => Float64Array.from(rows.flat());

export const limitsOf = (name: string): Limits => {
  const limits = recorded.limits[name];
  return { ...limits, speed: limits.speed ?? Infinity };
};

export const frictionOf = ([holds, brakes]: [number, number]) => ({ static: holds, kinetic: brakes });

export function farthest(a: ArrayLike<number>, b: ArrayLike<number>): number {
  assert.equal(a.length, b.length);
  let most = 0;
  for (let n = 0; n < a.length; n++) most = Math.max(most, Math.abs(a[n]! - b[n]!));
  return most;
}

/** The first columns of rows of so many numbers. */
export const columns = (rows: Float64Array, width: number, axes: number, count: number): Float64Array =>
  rows.filter((_, n) => n % width < axes).slice(0, axes * count);

/** The bundle that was recorded. */
export async function network(): Promise<Network> {
  const read = (name: string): Uint8Array => new Uint8Array(readFileSync(`${recorded.bundle}/${name}`));
  const manifest = JSON.parse(new TextDecoder().decode(read("manifest.json")));
  return open(manifest, read("encoder.onnx"), read("decoder_step.onnx"), new Uint8Array(readFileSync("out/kernel.wasm")));
}

const STEP = 1e-9;  // share of a limit that rounding may pass it by

/** Check that samples of a pan keep every limit: the accelerations, (n * 3), after `before`, and the states, (n * 6). */
export function checkLimits(u: Float64Array, states: Float64Array, before: ArrayLike<number>, limits: Limits): void {
  const within = (vector: ArrayLike<number>, limit: number): boolean =>
    Math.hypot(...Array.from(vector)) <= limit * (1 + STEP) + 1e-15;
  let last = Float64Array.from(before);
  for (let k = 0; k < u.length / 3; k++) {
    const now = u.slice(3 * k, 3 * k + 3), at = states.slice(6 * k, 6 * k + 6);
    assert.ok(within(now, limits.acceleration) && within(now.map((value, n) => value - last[n]!), limits.jerk * 1e-3));
    assert.ok(now[2]! >= -0.8 * 9.8 * (1 + STEP));
    assert.ok(within(at.slice(0, 2), limits.pan_reach) && within(at.slice(3), limits.speed) && within(at.slice(2, 3), limits.height));
    last = now;
  }
}
