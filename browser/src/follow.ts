/**
 * One command in closed loop: the next accelerations whenever they are asked for, from where pan and object are then.
 *
 * It is the planner of a controller that knows both, as a simulation does. Past the end of the command the pan comes to
 * rest, and an object that lies off its mark is brought back to it. (`runtime.stream.Stream` is for robots: it judges what
 * it is told.)
 */

import { type Asked, lastRows, startAt } from "./decode.js";
import { canStop, govern, type Pan, panAt, panAtStart } from "./governor.js";
import { DT, type Friction, GRAVITY, integratePan, slideAlong } from "./law.js";
import type { Network } from "./network.js";
import { Reading } from "./reading.js";
import { kindestStop } from "./rest.js";
import { type Brake, brakeAccelerations, samplesLeft } from "./stop.js";
import { reachFor } from "./units.js";

/** What happened since the last chunk was given. */
export interface Seen {
  /** How many of its samples have been executed; all of them if absent. */
  readonly executed?: number;
  /** (n * 6) the last n states of the pan up to now, position (m) and velocity (m/s); as predicted if absent. */
  readonly pan?: ArrayLike<number>;
  /** (n * 4) the last n states of the object relative to the pan; as predicted if absent. */
  readonly object?: ArrayLike<number>;
}

export interface Chunk {
  /** (C * 3) accelerations within the limits (m/s^2). */
  readonly u: Float64Array;
  /** ((C + 1) * 6) and ((C + 1) * 4) the states that they are predicted to lead to, from those of now on. */
  readonly pan: Float64Array;
  readonly object: Float64Array;
  /** (m * 3) what brings the pan to rest after it, if nothing else follows (m/s^2). */
  readonly stop: Float64Array;
  /** Whether this is the stop past the command's end, or the rest after it. */
  readonly ends: boolean;
}

const TOLERANCE = 0.01;  // m that the object may lie off its mark past the command's end
const STILL = 0.05;  // m/s up to which it lies
const SAME = 1e-6;  // m, m/s: what another order of sums makes of a pan that went as it was told

export class Following {
  readonly #network: Network;
  readonly #asked: Asked;
  readonly #mark: readonly [number, number];
  #reading: Reading;
  /** Samples of what is being followed: the command, and then a move back to its end. */
  #samples: number;
  #pan: Float64Array;
  #object: Float64Array;
  #after: Pan;
  #last: Chunk | null = null;

  /** @throws Error as `plan` */
  constructor(network: Network, position: Float64Array, asked: Asked) {
    const { limits, start = startAt(position) } = asked;
    this.#network = network;
    this.#asked = asked;
    this.#after = panAtStart(start.pan, limits);
    this.#reading = this.#read(position);
    this.#samples = position.length / 2;
    this.#mark = [position.at(-2)!, position.at(-1)!];
    this.#pan = Float64Array.from(start.pan.slice(0, 6));
    this.#object = Float64Array.from(start.object);
  }

  /** Samples of a chunk, C: after so many, or fewer, the next is asked for. */
  get chunk(): number {
    return this.#reading.chunk;
  }

  /**
   * The next chunk, from where pan and object are. Where the pan cannot stop within its limits now, it is what is left
   * of the last one, and its stop.
   *
   * @throws RangeError if so many samples have not been given; Error if the pan was moved, and cannot stop from there
   */
  next(seen: Seen = {}): Chunk {
    let pan: Pan = this.#after;
    if (this.#last !== null) {
      const given = this.#last.u.length / 3, executed = seen.executed ?? given;
      if (!(Number.isInteger(executed) && executed >= 1 && executed <= given)) {
        throw new RangeError(`executed must be a whole number from 1 to ${given}, got ${executed}`);
      }
      const there = this.#take(this.#last, executed, seen);
      if (there === null) return this.#keepOn(this.#last, executed);
      pan = there;
    }
    if (this.#reading.now < this.#samples) return this.#ask(pan);
    return this.#bringBack() ? this.#ask(pan) : this.#end(pan);
  }

  #read(position: Float64Array): Reading {
    const { limits, friction } = this.#asked, { constants } = this.#network;
    const reachUsed = reachFor(constants, position, limits);
    return new Reading(this.#network, { position, friction, limits, reachUsed });
  }

  /** Take what happened since a chunk was given: the pan now, null if it cannot stop within its limits. */
  #take(last: Chunk, executed: number, seen: Seen): Pan | null {
    const predicted = last.pan.slice(6, 6 * (executed + 1)), pan = withLast(predicted, seen.pan);
    const moved = pan.slice(-6).some((value, n) => Math.abs(value - predicted.at(n - 6)!) > SAME);
    let there: Pan | null = this.#after;
    if (moved || executed < last.u.length / 3) {
      const state = [...(moved ? pan : predicted).slice(-6), ...last.u.slice(3 * executed - 3, 3 * executed)];
      there = panAt(state, this.#asked.limits);
      if (!canStop(there)) there = null;
      if (moved && there === null) throw new Error("the pan cannot come to rest within its limits from where it is");
    }
    const object = withLast(last.object.slice(4, 4 * (executed + 1)), seen.object);
    this.#pan = joined(this.#pan, moved ? pan : predicted, 6 * (this.chunk + 1));
    this.#object = joined(this.#object, object, 4 * (this.chunk + 1));
    this.#reading.after(executed);
    return there;
  }

  #ask(pan: Pan): Chunk {
    const { chunk } = this.#reading, rows = this.#pan.length / 6 - 1;
    const asked = this.#reading.look(
      lastRows(this.#pan, 6, rows, chunk), lastRows(this.#object, 4, rows, chunk), pan.state.slice(6),
    );
    const governed = govern(pan, asked);
    return this.#give(governed.u, governed.pan.brake, false);
  }

  #keepOn(last: Chunk, executed: number): Chunk {
    const { brake } = this.#after, done = brake.done + Math.min(executed, samplesLeft(brake));
    const u = joined(last.u.slice(3 * executed), brakeAccelerations(brake, executed), Infinity);
    return this.#give(u, { ...brake, done }, last.ends);
  }

  /** Whether an object that lies off its mark is to be brought there, which is then what is followed. */
  #bringBack(): boolean {
    const [x, y, vx, vy] = this.#object.slice(-4) as unknown as [number, number, number, number];
    const lies = Math.hypot(vx, vy) <= STILL && samplesLeft(this.#after.brake) === 0;
    if (!lies || Math.hypot(x - this.#mark[0], y - this.#mark[1]) <= TOLERANCE) return false;
    const move = comeBack([x, y], this.#mark, this.#asked.friction);
    this.#reading = this.#read(move);
    this.#samples = move.length / 2;
    return true;
  }

  #end(pan: Pan): Chunk {
    const { friction, limits } = this.#asked;
    if (pan.brake.done > 0 && samplesLeft(pan.brake) === 0) {
      return this.#give(new Float64Array(3 * this.chunk), pan.brake, true);
    }
    const brake: Brake = kindestStop(pan.state, this.#object.slice(-4), this.#mark, limits, friction) ?? pan.brake;
    const u = brakeAccelerations(brake, Math.max(1, samplesLeft(brake)));
    return this.#give(u, { ...brake, done: brake.done + samplesLeft(brake) }, true);
  }

  /** @param brake the stop after it */
  #give(u: Float64Array, brake: Brake, ends: boolean): Chunk {
    const from = this.#pan.slice(-6), lay = this.#object.slice(-4);
    const pan = joined(from, integratePan(from, u), Infinity);
    const object = joined(lay, slideAlong(lay, u, this.#asked.friction), Infinity);
    this.#after = { state: [...pan.slice(-6), ...u.slice(-3)], brake, limits: this.#asked.limits };
    this.#last = { u, pan, object, ends, stop: brakeAccelerations(brake, samplesLeft(brake)) };
    return this.#last;
  }
}

const SHARE = 0.7;  // of what kinetic friction can accelerate an object by
const SPEED = 0.6;  // m/s
const DURATIONS = [0.3, 2] as const;  // s
const PEAK_ACCELERATION = 10 / Math.sqrt(3), PEAK_SPEED = 15 / 8;

/** A minimum-jerk move of the object, (K * 2) (m): the Python module `runtime.commands.come_back`. */
function comeBack(from: readonly [number, number], to: readonly [number, number], friction: Friction): Float64Array {
  const distance = Math.hypot(to[0] - from[0], to[1] - from[1]), most = SHARE * friction.kinetic * GRAVITY;
  const needed = Math.max((PEAK_SPEED * distance) / SPEED, Math.sqrt((PEAK_ACCELERATION * distance) / most));
  const samples = Math.ceil(Math.min(Math.max(needed, DURATIONS[0]), DURATIONS[1]) / DT);
  return Float64Array.from({ length: 2 * samples }, (_, n) => {
    const x = (n >> 1) / (samples - 1), axis = (n & 1) as 0 | 1;
    return from[axis] + x ** 3 * (10 - 15 * x + 6 * x * x) * (to[axis] - from[axis]);
  });
}

/** The last numbers, at most `most`, of two arrays one after the other. */
function joined(a: Float64Array, b: Float64Array, most: number): Float64Array {
  const out = new Float64Array(a.length + b.length);
  out.set(a);
  out.set(b, a.length);
  return out.length > most ? out.slice(-most) : out;
}

/** Rows with the last of them as they were seen. */
function withLast(rows: Float64Array, seen?: ArrayLike<number>): Float64Array {
  if (seen === undefined) return rows;
  const last = Float64Array.from(seen).slice(-rows.length), out = rows.slice();
  out.set(last, rows.length - last.length);
  return out;
}
