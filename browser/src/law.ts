/** The law of friction between the pan and the object on it; the Python module `runtime.physics.law` has its text. */

export const GRAVITY = 9.8;
export const DT = 0.001;

export interface Friction {
  readonly static: number;
  readonly kinetic: number;
}

/**
 * Slide one object along pan accelerations.
 *
 * @param state (4) position (m) and velocity (m/s) relative to the pan before the first sample
 * @param u (n * 3) pan accelerations, upwards last (m/s^2)
 * @returns (n * 4) states after each sample
 */
export function slideAlong(state: ArrayLike<number>, u: Float64Array, friction: Friction): Float64Array {
  const count = u.length / 3;
  const out = new Float64Array(4 * count);
  let [px, py, vx, vy] = [state[0]!, state[1]!, state[2]!, state[3]!];
  const half = 0.5 * DT * DT;
  for (let k = 0; k < count; k++) {
    const ux = u[3 * k]!, uy = u[3 * k + 1]!;
    const normal = GRAVITY + u[3 * k + 2]!;
    const holds = friction.static * normal, brakes = friction.kinetic * normal;
    const speed = Math.sqrt(vx * vx + vy * vy);
    let ax = 0, ay = 0, nextVx = 0, nextVy = 0;
    if (speed > 0) {
      ax = -ux - (brakes * vx) / speed;
      ay = -uy - (brakes * vy) / speed;
      nextVx = vx + ax * DT;
      nextVy = vy + ay * DT;
      if (nextVx * vx + nextVy * vy <= 0) {
        ax = -vx / DT;
        ay = -vy / DT;
        nextVx = 0;
        nextVy = 0;
      }
    } else {
      const push = Math.sqrt(ux * ux + uy * uy);
      if (push >= holds && push > 0) {
        ax = -ux + (holds * ux) / push;
        ay = -uy + (holds * uy) / push;
        nextVx = ax * DT;
        nextVy = ay * DT;
      }
    }
    px = px + vx * DT + ax * half;
    py = py + vy * DT + ay * half;
    vx = nextVx;
    vy = nextVy;
    out.set([px, py, vx, vy], 4 * k);
  }
  return out;
}

/** Where an object comes to rest (m), along pan accelerations and on while the pan is at rest. */
export function slideToRest(state: ArrayLike<number>, u: Float64Array, friction: Friction): [number, number] {
  const states = slideAlong(state, u, friction);
  const [x, y, vx, vy] = states.length ? states.slice(-4) : Float64Array.from(state);
  const speed = Math.hypot(vx!, vy!), brake = friction.kinetic * GRAVITY;
  if (!speed || brake <= 0) return [x!, y!];
  const way = speed / (2 * brake);
  return [x! + vx! * way, y! + vy! * way];
}

/**
 * Integrate the pan, a double integrator.
 *
 * @param state (6) position (m) and velocity (m/s) before the first sample
 * @returns (n * 6) states after each sample
 */
export function integratePan(state: ArrayLike<number>, u: Float64Array): Float64Array {
  const count = u.length / 3;
  const out = new Float64Array(6 * count);
  for (let axis = 0; axis < 3; axis++) {
    let sum = 0, moved = 0;
    for (let k = 0; k < count; k++) {
      const a = u[3 * k + axis]!;
      sum += a;
      const velocity = state[3 + axis]! + sum * DT;
      const before = velocity - a * DT;
      moved += before * DT + a * (0.5 * DT * DT);
      out[6 * k + axis] = state[axis]! + moved;
      out[6 * k + 3 + axis] = velocity;
    }
  }
  return out;
}
