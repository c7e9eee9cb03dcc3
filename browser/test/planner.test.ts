/** The planner in the browser does what the runtime in Python does. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { assess, govern, integratePan, limitsOf as readLimits, panAt, plan, slideAlong } from "../src/index.js";
import { brakeAccelerations, samplesLeft } from "../src/stop.js";
import { AT_REST, checkLimits, columns, farthest, flat, frictionOf, limitsOf, network, recorded } from "./recorded.js";

const SAME = 1e-9;  // m, m/s, m/s^2: rounding of float64 in another order of sums
const CLOSE = 1e-5;  // m, m/s^2: rounding of float32, until a branch parts
const FEW = 0.05;  // share of plans whose branches may part
const SEQUENCES = Number(process.env.SLIDE_BROWSER_SEQUENCES ?? 300);

test("the law is that of Python", () => {
  for (const { state, u, friction, states } of recorded.law) {
    assert.ok(farthest(slideAlong(state, flat(u), frictionOf(friction)), flat(states)) < SAME);
  }
});

test("the governor does what Python's does, and keeps the limits, against whatever is asked for", () => {
  for (const { limits: name, kind, chunks } of recorded.governed) {
    const limits = limitsOf(name);
    let pan = panAt(AT_REST, limits);
    for (const { asked, u, states } of chunks) {
      const governed = govern(pan, flat(asked));
      checkLimits(governed.u, governed.states, pan.state.slice(6), limits);
      assert.ok(farthest(governed.u, flat(u)) < SAME && farthest(governed.states, flat(states)) < SAME, `${name} ${kind}`);
      pan = governed.pan;
    }
  }
});

test("whatever is asked for, the limits hold, also on the stop from the end of each chunk", () => {
  let seed = 1;
  const random = (): number => {  // the same ones each time
    seed = (seed * 48_271) % 2_147_483_647;
    return seed / 2_147_483_647;
  };
  const way = (): number[] => [0, 1, 2].map(() => 2 * random() - 1);
  for (let sequence = 0; sequence < SEQUENCES; sequence++) {
    const names = Object.keys(recorded.limits), limits = limitsOf(names[sequence % names.length]!);
    const count = 2 + Math.floor(150 * random()), kind = Math.floor(5 * random()), push = way();
    let pan = panAt(AT_REST, limits);
    for (let chunk = 0; chunk < 6; chunk++) {
      const size = limits.acceleration * (kind === 4 ? 100 : 2), at = pan.state;
      const asked = Float64Array.from({ length: 3 * count }, (_, n) => {
        const axis = n % 3;
        if (kind === 0) return size * (2 * random() - 1);
        if (kind === 1) return size * push[axis]!;
        if (kind === 2) return size * push[axis]! * (chunk % 2 ? 1 : -1);
        return size * (at[axis]! + 0.1 * at[3 + axis]! + 1e-3 * push[axis]!) / limits.pan_reach;  // always outwards
      });
      const governed = govern(pan, asked);
      checkLimits(governed.u, governed.states, pan.state.slice(6), limits);
      pan = governed.pan;
      const stop = brakeAccelerations(pan.brake, Math.max(1, samplesLeft(pan.brake)));
      const states = integratePan(pan.state.slice(0, 6), stop);
      checkLimits(stop, states, pan.state.slice(6), limits);
      assert.ok(states.slice(-3).every((value) => Math.abs(value) < SAME), "the pan rests after its stop");
    }
  }
});

test("the network gives what onnxruntime gives", async () => {
  const own = await network();
  for (const { window, questions, unit } of recorded.network) {
    let memory = own.encode(Float32Array.from(window.flat()), window.length);
    for (const { observation, answer } of questions) {
      const given = own.decodeStep(Float32Array.from(observation), memory);
      memory = given.memory;
      assert.ok(farthest(given.answer, answer.flat()) * unit < CLOSE);
    }
  }
});

test("named limits are those of Python", async () => {
  const { manifest } = await network();
  for (const name of ["default", "panda", "fr3"]) assert.deepEqual(readLimits(manifest, { name }), limitsOf(name));
});

test("plans are those of Python, with the same quality, and keep every limit", async () => {
  const own = await network(), { manifest } = own;
  let parted = 0;
  for (const each of recorded.plans) {
    const limits = limitsOf(each.limits), position = flat(each.position), samples = each.position.length;
    const asked = { friction: frictionOf(each.friction), limits, start: { pan: each.start[0], object: each.start[1] } };
    const found = plan(own, position, asked);
    checkLimits(found.u, found.pan.slice(6), AT_REST.slice(6), limits);
    checkLimits(found.stop, integratePan(found.pan.slice(-6), found.stop), found.u.slice(-3), limits);
    const apart = Math.max(
      farthest(columns(found.sliding, 4, 2, samples), flat(each.object)),
      farthest(columns(found.pan, 6, 3, samples), flat(each.pan)),
    );
    if (apart > CLOSE) {
      console.log(`${each.limits}, ${samples} samples: parted by ${apart} m`);
      parted += 1;
      continue;
    }
    assert.ok(farthest(found.u, flat(each.u)) < CLOSE);
    const quality: any = assess(manifest, found, position, asked, manifest.sizes);
    const { quality: python } = each;
    assert.equal(quality.status, python.status);
    assert.deepEqual(Object.keys(quality).sort(), Object.keys(python).sort());
    for (const name of ["tracking_rmse", "tracking_max", "pan_reach", "height_max", "speed_max", "rest_error"]) {
      assert.ok(Math.abs(quality[name] - python[name]) < CLOSE, `${name}: ${quality[name]} and ${python[name]}`);
    }
    assert.ok(Math.abs(quality.friction_off_rmse - python.friction_off_rmse) < 10 * CLOSE);
    assert.ok(Math.abs(quality.sliding_share - python.sliding_share) <= 3 / samples);
    assert.deepEqual(quality.notes.map(wordsOf), python.notes.map(wordsOf));
    assert.ok(farthest(found.stop, flat(each.stop)) < 10 * CLOSE);
  }
  console.log(`${recorded.plans.length} plans, ${parted} parted`);
  assert.ok(parted <= FEW * recorded.plans.length);
});

const wordsOf = (note: string): string => note.replaceAll(/[0-9.]+(e-?[0-9]+)?/g, "#");
