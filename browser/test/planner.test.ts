/** The planner in the browser does what the runtime in Python does; test/record.py has written what that is. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

import { assess, govern, type Limits, open, panAt, plan, slideAlong } from "../src/index.js";

const root = process.env.SLIDE_ROOT ?? "..";
const recorded = JSON.parse(readFileSync(process.env.SLIDE_RECORDED ?? "out/recorded.json", "utf8"));
const AT_REST: number[] = new Array(9).fill(0);
const flat = (rows: number[][]): Float64Array => Float64Array.from(rows.flat());
const limitsOf = (name: string): Limits => {
  const { pan_reach, height, speed, acceleration, jerk } = recorded.limits[name];
  return { reach: pan_reach, height, speed: speed ?? Infinity, acceleration, jerk };
};
const farthest = (a: Float64Array, b: Float64Array): number => {
  assert.equal(a.length, b.length);
  return a.reduce((most, value, index) => Math.max(most, Math.abs(value - b[index]!)), 0);
};

test("the law is that of Python", () => {
  for (const { state, u, friction, states } of recorded.law) {
    const found = slideAlong(state, flat(u), { static: friction[0], kinetic: friction[1] });
    assert.ok(farthest(found, flat(states)) < 1e-12);
  }
});

test("the governor does what Python's does, against whatever is asked for", () => {
  for (const { limits, kind, chunks } of recorded.governed) {
    let pan = panAt(AT_REST, limitsOf(limits));
    for (const { asked, u } of chunks) {
      const governed = govern(pan, flat(asked));
      pan = governed.pan;
      assert.ok(farthest(governed.u, flat(u)) < 1e-7, `${limits} ${kind}`);
    }
  }
});

const STEP = 1e-9;  // share of a limit that rounding may pass it by
const CLOSE = 1e-5;  // m: what float32 in another order of sums becomes, until a branch parts

test("plans are those of Python, with the same quality, and keep every limit", async () => {
  const folder = `${root}/runtime/models/fp32`;
  const read = (name: string): Uint8Array => new Uint8Array(readFileSync(`${folder}/${name}`));
  const manifest = JSON.parse(readFileSync(`${folder}/manifest.json`, "utf8"));
  const network = await open(manifest, read("encoder.onnx"), read("decoder_step.onnx"));
  let parted = 0, time = 0;
  for (const each of recorded.plans) {
    const limits = limitsOf(each.limits), position = flat(each.position);
    const friction = { static: each.friction[0], kinetic: each.friction[1] };
    const begin = performance.now();
    const found = await plan(network, position, friction, limits);
    time += performance.now() - begin;
    const samples = each.position.length;
    const within = (vector: Float64Array, limit: number): boolean => Math.hypot(...vector) <= limit * (1 + STEP);
    for (let k = 0; k < samples; k++) {
      const u = found.u.slice(3 * k, 3 * k + 3), p = found.pan.slice(6 * k, 6 * k + 6);
      const before = k ? found.u.slice(3 * k - 3, 3 * k) : new Float64Array(3);
      assert.ok(within(u, limits.acceleration) && within(u.map((value, axis) => value - before[axis]!), limits.jerk * 1e-3));
      assert.ok(within(p.slice(0, 2), limits.reach) && within(p.slice(3), limits.speed) && within(p.slice(2, 3), limits.height));
    }
    const moved = (rows: Float64Array, width: number, axes: number): Float64Array =>
      rows.filter((_, n) => n % width < axes).slice(0, axes * samples);
    const apart = Math.max(
      farthest(moved(found.sliding, 4, 2), flat(each.object)), farthest(moved(found.pan, 6, 3), flat(each.pan)),
    );
    if (apart > CLOSE) {
      console.log(each.limits, samples, apart, found.trackingRmse, each.quality.tracking_rmse);
      parted += 1;
      continue;
    }
    const sizes = { pan_radius: 0.18, object_radius: 0.03 };
    const quality: any = assess(found, position, friction, limits, sizes, manifest.trained_on);
    const { quality: python } = each;
    assert.equal(quality.status, python.status);
    for (const name of ["tracking_rmse", "tracking_max", "pan_reach", "speed_max", "friction_off_rmse", "rest_error"]) {
      assert.ok(Math.abs(quality[name] - python[name]) < 10 * CLOSE, `${name}: ${quality[name]} and ${python[name]}`);
    }
    assert.ok(Math.abs(quality.sliding_share - python.sliding_share) <= 3 / samples);
    assert.equal(quality.notes.length, python.notes.length);
    assert.equal(found.stop.length / 3, each.stop.length);
  }
  console.log(`${recorded.plans.length} plans, ${parted} parted, ${(time / recorded.plans.length).toFixed(1)} ms each`);
  assert.ok(parted <= recorded.plans.length / 10);
});
