/**
 * The law of friction, as in `runtime/physics/law.py`: the object on a pan that is shaken, a sample at a time.
 *
 * A test holds the two together.
 */

import { GRAVITY } from "./viewer/motion.js";

/**
 * The object after a sample.
 *
 * @param state  [x, y, vx, vy] relative to the pan (m, m/s)
 * @param acceleration  of the pan, [x, y] or [x, y, z] (m/s^2)
 */
export function slide([x, y, vx, vy], [ux, uy, uz = 0], friction, dt) {
  const hold = friction.static * (GRAVITY + uz), drag = friction.kinetic * (GRAVITY + uz);
  const speed = Math.hypot(vx, vy), push = Math.hypot(ux, uy);
  let ax = 0, ay = 0;
  if (speed > 0) {
    [ax, ay] = [-ux - drag * vx / speed, -uy - drag * vy / speed];
  } else if (push >= hold && push > 0) {
    [ax, ay] = [-ux + hold * ux / push, -uy + hold * uy / push];
  }
  let wx = vx + ax * dt, wy = vy + ay * dt;
  if (speed > 0 && wx * vx + wy * vy <= 0) [ax, ay, wx, wy] = [-vx / dt, -vy / dt, 0, 0];
  return [x + vx * dt + ax * dt * dt / 2, y + vy * dt + ay * dt * dt / 2, wx, wy];
}

/** The pan after a sample: its position and velocity, and its acceleration, each [x, y] or [x, y, z]. */
export const shake = ({ position, velocity }, acceleration, dt) => ({
  position: position.map((value, k) => value + velocity[k] * dt + acceleration[k] * dt * dt / 2),
  velocity: velocity.map((value, k) => value + acceleration[k] * dt),
});
