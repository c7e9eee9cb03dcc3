/** A command followed in closed loop: this page is pan and object, by the law of friction, and a planner steers. */

import { shake, slide } from "./law.js";

const AFTER = 2;  // s past the end of the command: time to push the object off its mark and see it come back
const STIFFNESS = 1600, DAMPING = 80;  // 1/s^2, 1/s: of the spring between a pointer and the object
const HARDEST = 40;  // m/s^2: what a pointer gives the object at most
const SHOVE = 20, SHOVE_SAMPLES = 25;  // m/s^2, and for how long: what the button gives it
const MIDDLE = 0.02;  // m: nearer to the middle of the pan than this, it is pushed along y
const NOTHING = [0, 0, 0];

const filled = (count, [x, y, z = 0]) => {
  const [xs, ys, zs] = [x, y, z].map((value) => Array(count).fill(value));
  return { x: xs, y: ys, z: zs };
};
const write = (columns, k, [x, y, z = 0]) => { [columns.x[k], columns.y[k], columns.z[k]] = [x, y, z]; };

/** A motion that is made while it is played: `goOn` makes more of it. */
export class Loop {
  #planned;
  #positions;
  #options;
  #openStream;
  #changed;
  #stream = null;
  #queue = [];  // the pan's accelerations that are still to come (m/s^2)
  #stop = [];  // and the stop after them
  #told = { pan: [], object: [] };  // states since the last question
  #asking = false;
  #shoves = 0;  // samples that the object is still being pushed
  #round = 0;

  /** Gives where on the pan a pointer is that pulls the object, [x, y] (m), or null. */
  pointer = () => null;
  /** Why nobody steers; "" while somebody does. */
  lost = "";

  /**
   * @param planned  the motion of the plan of it
   * @param positions  [[x, y], ...] every millisecond (m)
   * @param options  {friction, limits} as a server is told them
   * @param open  makes a stream (`Stream`, `OwnStream`) of what opens a server's
   * @param changed  () when `lost` has changed
   */
  constructor(planned, positions, options, open, changed) {
    this.#planned = planned;
    this.#positions = positions.map((point) => point.map((value) => Math.round(value * 1e7) / 1e7));
    this.#options = options;
    this.#openStream = open;
    this.#changed = changed;
    this.#begin();
  }

  /** Seconds of it that are made. */
  get made() {
    return this.count * this.dt;
  }

  /** How far the object is from where it should be (m). */
  get error() {
    const [x, y] = this.#markAt(this.count);
    return Math.hypot(x - this.state.object[0], y - this.state.object[1]);
  }

  /** Push the object, towards the middle of the pan. */
  shove() {
    this.#shoves = SHOVE_SAMPLES;
  }

  /**
   * Go on until time t (s), as far as it is known how the pan moves.
   *
   * @returns the time that it came to; 0 where it has begun again, `rest` (s) after its end
   */
  goOn(t, rest) {
    this.pulled = this.pointer();
    while (this.count < this.last && this.made + this.dt <= t + 1e-9) {
      if (!this.#queue.length) {
        if (!this.lost) {
          this.#ask();
          break;
        }
        this.#queue.push(NOTHING);  // after its stop the pan rests
      }
      this.#advance(this.#queue.shift());
    }
    if (this.count < this.last) return Math.min(t, this.made);
    if (t <= this.made + rest) return t;
    this.#begin();
    return 0;
  }

  close() {
    this.#round += 1;
    this.#stream?.close();
    this.#stream = null;
  }

  #markAt(k) {
    return this.#positions[Math.min(k, this.#positions.length - 1)];
  }

  #begin() {
    this.close();
    const [x, y] = this.#positions[0], { dt } = this.#planned;
    const last = this.#positions.length - 1 + Math.round(AFTER / dt), count = last + 1;
    Object.assign(this, this.#planned, {
      count: 0,
      last,
      end: last * dt,
      time: Array.from({ length: count }, (_, k) => k * dt),
      command: filled(count, [0, 0]),
      object: filled(count, [x, y]),
      pan: filled(count, NOTHING),
      acceleration: filled(count, NOTHING),
      slip: [],
      rests: [],
      state: { object: [x, y, 0, 0], pan: { position: NOTHING, velocity: NOTHING }, acceleration: NOTHING },
    });
    for (let k = 0; k < count; k++) write(this.command, k, this.#markAt(k));
    Object.assign(this, { lost: "", pulled: null });
    this.#queue = [];
    this.#stop = [];
    this.#told = { pan: [], object: [] };
    this.#asking = false;
    this.#shoves = 0;
    this.#changed();
  }

  /** One sample: the pan shakes the object, and somebody may push it. */
  #advance(acceleration) {
    const { object, pan } = this.state, [px, py] = this.#push(object), [ux, uy, uz] = acceleration;
    const next = slide(object, [ux - px, uy - py, uz], this.#options.friction, this.dt);
    this.state = { object: next, pan: shake(pan, acceleration, this.dt), acceleration };
    write(this.acceleration, this.count, acceleration);
    this.count += 1;
    write(this.acceleration, this.count, acceleration);
    write(this.object, this.count, next);
    write(this.pan, this.count, this.state.pan.position);
    this.#told.pan.push([...this.state.pan.position, ...this.state.pan.velocity]);
    this.#told.object.push(next);
    const slides = next[2] !== 0 || next[3] !== 0, before = this.slip.at(-1);
    if (slides && before?.[1] === this.made) before[1] = this.made + this.dt;
    else if (slides) this.slip.push([this.made, this.made + this.dt]);
    else if (object[2] !== 0 || object[3] !== 0) this.rests.push(this.count);
    if (Math.hypot(next[0], next[1]) > this.radius.pan - this.radius.object) {  // there the law ends
      Object.assign(this, { last: this.count, end: this.made });
    }
  }

  /** What pushes the object (m/s^2): a spring to the pointer, or the button. */
  #push([x, y, vx, vy]) {
    if (this.pulled) {
      const pull = [STIFFNESS * (this.pulled[0] - x) - DAMPING * vx, STIFFNESS * (this.pulled[1] - y) - DAMPING * vy];
      const share = Math.min(1, HARDEST / Math.max(Math.hypot(...pull), 1e-9));
      return pull.map((part) => part * share);
    }
    if (this.#shoves === 0) return [0, 0];
    this.#shoves -= 1;
    const from = Math.hypot(x, y);
    return from > MIDDLE ? [-SHOVE * x / from, -SHOVE * y / from] : [0, SHOVE];
  }

  /** Ask for the chunk that follows; where the server has hung up, of another stream that begins here. */
  async #ask() {
    if (this.#asking) return;
    this.#asking = true;
    const round = this.#round;
    try {
      if (!this.#stream || this.#stream.ended) await this.#open();
      const { pan, object } = this.#told;
      this.#told = { pan: [], object: [] };
      const { acceleration, brake } = await this.#stream.step(pan, object);
      if (round !== this.#round) return;
      this.#queue = acceleration;
      this.#stop = brake;
    } catch (error) {
      if (round !== this.#round) return;
      this.#queue = this.#stop;
      this.lost = error.message;
      this.#changed();
    } finally {
      if (round === this.#round) this.#asking = false;
    }
  }

  async #open() {
    const begun = this.count > 0, { object, pan, acceleration } = this.state;
    const left = this.#positions.slice(Math.min(this.count, this.#positions.length - 2));
    this.#told = { pan: [], object: [] };
    this.#stream = this.#openStream({
      ...this.#options,
      command: { dt: this.dt, position: left },
      ...(begun && {
        start: {
          pan_position: pan.position, pan_velocity: pan.velocity, pan_acceleration: acceleration,
          object_position: object.slice(0, 2), object_velocity: object.slice(2),
        },
      }),
    });
    await this.#stream.opened;
  }
}
