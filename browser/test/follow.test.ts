/** Closed loop: asked again after any number of samples, from wherever pan and object are. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { Following, type Limits, plan } from "../src/index.js";
import { checkLimits, columns, farthest, limitsOf, network } from "./recorded.js";

const FRICTION = { static: 1, kinetic: 0.5 };
const SAMPLES = 1200;
const EIGHT = Float64Array.from({ length: 2 * SAMPLES }, (_, n) => {
  const angle = (2 * Math.PI * (n >> 1)) / SAMPLES;
  return n % 2 ? 0.03 * Math.sin(2 * angle) : 0.04 * (1 - Math.cos(angle));
});

interface Walk {
  readonly u: number[];
  readonly pan: number[];
  readonly object: number[];
  readonly chunks: number;
}

/** Follow the eight to its end, `executed` samples at a time, the object pushed once. */
async function walk(limits: Limits, executed: () => number, push = 0): Promise<Walk> {
  const following = new Following(await network(), EIGHT, { friction: FRICTION, limits });
  const found: Walk & { chunks: number } = { u: [], pan: [], object: [], chunks: 0 };
  let given = following.next();
  while (!given.ends) {
    const count = Math.min(executed(), given.u.length / 3);
    found.u.push(...given.u.slice(0, 3 * count));
    found.pan.push(...given.pan.slice(6, 6 * (count + 1)));
    const object = given.object.slice(4, 4 * (count + 1));
    if (++found.chunks === 6) object.set([object.at(-4)! + push], object.length - 4);
    found.object.push(...object);
    given = following.next({ executed: count, object: object.slice(-4) });
  }
  found.u.push(...given.u);
  found.pan.push(...given.pan.slice(6));
  return found;
}

const errorOf = (object: readonly number[], from: number): number => {
  let squares = 0, count = 0;
  for (let k = from; k < SAMPLES - 1; k++, count++) {
    squares += (object[4 * k]! - EIGHT[2 * k + 2]!) ** 2 + (object[4 * k + 1]! - EIGHT[2 * k + 3]!) ** 2;
  }
  return Math.sqrt(squares / count);
};

test("asked after whole chunks it is the plan", async () => {
  const limits = limitsOf("default");
  const { u, object } = await walk(limits, () => Infinity);
  const planned = plan(await network(), EIGHT, { friction: FRICTION, limits });
  assert.ok(farthest(u.slice(0, 3 * SAMPLES), planned.u) < 1e-9);
  assert.ok(farthest(columns(Float64Array.from(object), 4, 2, SAMPLES), columns(planned.sliding.slice(4), 4, 2, SAMPLES)) < 1e-9);
});

test("asked whenever, from wherever the object was pushed to, it keeps the limits and comes back", async () => {
  for (const name of ["default", "lifting", "panda", "tight"]) {
    for (const executed of [() => 20, () => 1 + Math.floor(60 * Math.random())]) {
      const { u, pan, object } = await walk(limitsOf(name), executed, 0.015);
      checkLimits(Float64Array.from(u), Float64Array.from(pan), [0, 0, 0], limitsOf(name));
      assert.ok(pan.slice(-3).every((value) => Math.abs(value) < 1e-9), "the pan rests at the end");
      if (name !== "tight") assert.ok(errorOf(object, SAMPLES - 300) < 0.01);
    }
  }
});

test("after its end it gives rest", async () => {
  const following = new Following(await network(), EIGHT.slice(0, 400), { friction: FRICTION, limits: limitsOf("panda") });
  let given = following.next();
  while (!given.ends) given = following.next();
  given = following.next();
  assert.ok(given.ends && given.u.every((value) => value === 0));
});

test("an object that lies off its mark at the end is brought back to it", async () => {
  const command = EIGHT.slice(0, 400), mark = command.slice(-2);
  const following = new Following(await network(), command, { friction: FRICTION, limits: limitsOf("default") });
  let given = following.next();
  for (let n = 0; n < 60; n++) {
    given = following.next({ object: n === 20 ? [mark[0]! + 0.03, mark[1]!, 0, 0] : given.object.slice(-4) });
  }
  assert.ok(given.ends && Math.hypot(given.object.at(-4)! - mark[0]!, given.object.at(-3)! - mark[1]!) < 0.01);
});

test("a pan that is told where it went by is one that went as it was told; one that cannot stop is refused", async () => {
  const following = new Following(await network(), EIGHT, { friction: FRICTION, limits: limitsOf("default") });
  const given = following.next();
  const told = given.pan.slice(-6).map((value) => value + 1e-12);
  assert.ok(following.next({ pan: told }).u.length > 0);
  assert.throws(() => following.next({ pan: [0.3, 0, 0, 2, 0, 0] }), /cannot come to rest/);
});

test("more samples than were given are refused", async () => {
  const following = new Following(await network(), EIGHT, { friction: FRICTION, limits: limitsOf("default") });
  following.next();
  for (const executed of [0, 1.5, following.chunk + 1]) assert.throws(() => following.next({ executed }), RangeError);
});
