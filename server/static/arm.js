/**
 * An arm that holds the pan: its joints from where the pan is, by Newton's method, as `runtime/arms/motion.py` has it.
 *
 * Frames are {position, rotation}: [x, y, z] in metres and three rows of a matrix, from the frame into the world. The
 * world is the arm's base, z up.
 */

const CONVERGED = 1e-7;  // m, rad: the error of the pan's pose that is left
const STEPS = 20;  // of Newton's method: a few are the rule, more where the pan has jumped
const LONGEST_STEP = 0.3;  // rad
const HOMING = 0.02;  // share of its way home that a joint too many goes each time

const AXES = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
const dot = (a, b) => a.reduce((sum, value, k) => sum + value * b[k], 0);
const cross = ([ax, ay, az], [bx, by, bz]) => [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
const columnOf = (matrix, k) => matrix.map((row) => row[k]);
const transposed = (matrix) => AXES.map((_, k) => columnOf(matrix, k));
const applied = (matrix, vector) => matrix.map((row) => dot(row, vector));
const product = (a, b) => a.map((row) => AXES.map((_, k) => dot(row, columnOf(b, k))));
const plus = (a, b) => a.map((value, k) => value + b[k]);
const minus = (a, b) => a.map((value, k) => value - b[k]);

/** A frame that is told in another one, told in the world. */
const within = ({ position, rotation }, inner) => ({
  position: plus(position, applied(rotation, inner.position)), rotation: product(rotation, inner.rotation),
});

/** The rotation about an axis of length 1 by an angle (rad). */
function about([x, y, z], angle) {
  const c = Math.cos(angle), s = Math.sin(angle), d = 1 - c;
  return [
    [c + x * x * d, x * y * d - z * s, x * z * d + y * s], [y * x * d + z * s, c + y * y * d, y * z * d - x * s],
    [z * x * d - y * s, z * y * d + x * s, c + z * z * d],
  ];
}

/** Roll, pitch and yaw about fixed axes x, y and z, in this order. */
const attitude = ([roll, pitch, yaw]) =>
  product(about(AXES[2], yaw), product(about(AXES[1], pitch), about(AXES[0], roll)));

const frameOf = ({ position = [0, 0, 0], rpy = [0, 0, 0] } = {}) => ({ position, rotation: attitude(rpy) });

/** Read the tables of an arm's description: of TOML what they use, whose values are those of JSON. */
export function parseArm(text) {
  const arm = { joint: [] };
  let table = arm;
  for (const line of text.split("\n").map((each) => each.trim())) {
    const [, list, single] = /^(?:\[\[(\w+)\]\]|\[(\w+)\])/.exec(line) ?? [];
    const [, name, value] = /^(\w+) = ("(?:[^"\\]|\\.)*"|\[[^\]]*\]|[^#]+)/.exec(line) ?? [];
    if (list) arm[list].push(table = {});
    else if (single) table = arm[single] = {};
    else if (name) table[name] = JSON.parse(value);
  }
  return arm;
}

/** Solve A x = b for a few unknowns, by elimination with pivots. */
function solved(matrix, right) {
  const rows = matrix.map((row, k) => [...row, right[k]]), count = rows.length;
  for (let k = 0; k < count; k++) {
    const pivot = rows.reduce((best, row, at) => at >= k && Math.abs(row[k]) > Math.abs(rows[best][k]) ? at : best, k);
    [rows[k], rows[pivot]] = [rows[pivot], rows[k]];
    for (let at = k + 1; at < count; at++) {
      const share = rows[at][k] / rows[k][k];
      for (let j = k; j <= count; j++) rows[at][j] -= share * rows[k][j];
    }
  }
  const found = Array(count).fill(0);
  for (let k = count - 1; k >= 0; k--) found[k] = (rows[k][count] - dot(rows[k].slice(0, count), found)) / rows[k][k];
  return found;
}

export class Arm {
  /** @param description  as `parseArm` reads it; its home holds the pan level */
  constructor({ title, home, joint, tip, mount }) {
    Object.assign(this, { title, home, joints: joint, angles: [...home] });
    this.frames = joint.map(frameOf);
    this.hand = within(frameOf(tip), frameOf(mount));
    this.weights = weightsOf(joint);
    this.place = this.pose(home).pan;
    const [x, y] = columnOf(this.place.rotation, 0), size = Math.hypot(x, y);  // level to the last digit
    this.place.rotation = [[x / size, -y / size, 0], [y / size, x / size, 0], [0, 0, 1]];
  }

  /** Where the joints are, and what they hold: frames of the `joints`, their axes in the world, and of the `pan`. */
  pose(angles) {
    let at = { position: [0, 0, 0], rotation: AXES };
    const joints = [], axes = [];
    this.joints.forEach(({ axis = AXES[2], sliding }, k) => {
      at = within(at, this.frames[k]);
      axes.push(applied(at.rotation, axis));
      at = sliding ? { ...at, position: plus(at.position, axes[k].map((part) => part * angles[k])) }
        : { ...at, rotation: product(at.rotation, about(axis, angles[k])) };
      joints.push(at);
    });
    return { joints, axes, tip: within(at, frameOf(this.tip)), pan: within(at, this.hand) };
  }

  /** Where a pan is in the world whose place in a plan is [x, y, z] (m). */
  inWorld(point) {
    return plus(this.place.position, applied(this.place.rotation, point));
  }

  /**
   * Move the joints so that the pan is at [x, y, z] of a plan (m), from where they are.
   *
   * @returns whether the arm reaches it
   */
  moveTo(point) {
    const target = this.inWorld(point), wanted = this.place.rotation;
    let angles = this.angles;
    for (let step = 0; step < STEPS; step++) {
      const { pan, joints, axes } = this.pose(angles), turn = product(wanted, transposed(pan.rotation));
      const error = [...minus(target, pan.position), (turn[2][1] - turn[1][2]) / 2, (turn[0][2] - turn[2][0]) / 2,
        (turn[1][0] - turn[0][1]) / 2];
      if (Math.max(...error.map(Math.abs)) < CONVERGED) {
        this.angles = angles;
        return true;
      }
      angles = this.#towards(angles, error, this.#jacobian(pan, joints, axes), step === 0 ? HOMING : 0);
    }
    return false;
  }

  /** The columns of the Jacobian, one a joint: how the pan moves and turns with it. */
  #jacobian(pan, joints, axes) {
    return this.joints.map(({ sliding }, k) => sliding ? [...axes[k], 0, 0, 0]
      : [...cross(axes[k], minus(pan.position, joints[k].position)), ...axes[k]]);
  }

  /** The joints after a step that takes away an error of the pan; those too many go a share of their way `home`. */
  #towards(angles, error, columns, home) {
    const square = error.map((_, i) => error.map((__, j) =>
      columns.reduce((sum, column, k) => sum + this.weights[k] * column[i] * column[j], 0)));
    const homing = angles.map((angle, k) => home * (this.home[k] - angle));
    const left = error.map((part, i) => part - columns.reduce((sum, column, k) => sum + column[i] * homing[k], 0));
    const pushes = solved(square, left);
    const step = columns.map((column, k) => homing[k] + this.weights[k] * dot(column, pushes));
    const share = Math.min(1, LONGEST_STEP / Math.max(...step.map(Math.abs), 1e-12));
    return angles.map((angle, k) => angle + share * step[k]);
  }
}

/** How much each joint takes of a motion: the square of the acceleration that it may make. */
function weightsOf(joints) {
  const most = Math.max(...joints.map(({ acceleration = 0 }) => acceleration));
  return joints.map(({ acceleration = most }) => most ? (acceleration / most) ** 2 : 1);
}
