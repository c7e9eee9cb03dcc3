/**
 * From the points of a pen to a command: where the object is to be, in metres on the pan, every millisecond.
 *
 * A hand trembles, turns on the spot and starts at full speed; an object that friction alone moves can do none of it.
 * So the path is smoothed along its length, shrunk about its middle until it fits the model's reach, and run along at
 * the chosen speed, slower in bends, from rest to rest. At its end it stays for a moment, in which the pan comes to
 * rest, too: else, after a fast path, it would be far out, and carry the object away. Points are [x, y] in metres, x to
 * the right, y up.
 *
 * The law of time is that of `runtime/commands/path.py`; a test holds the two together.
 */

export const DT = 0.001;  // s between the samples of a command
export const SENT_EVERY = 10;  // samples from one that is sent to the next: the server fills in with smooth curves

const TREMOR = 0.006;  // m along the path: standard deviation of the smoothing
const SPACING = 0.001;  // m between the points that the smoothing and the speeds are worked out on
const SHORTEST = 0.01;  // m: a shorter path is a slip of the hand
const BEND = 8 / 3;  // m/s^2 across the path: the speed in a bend of radius r is at most sqrt(BEND r)
const PULL = 2;  // m/s^2 along the path
const EASE = 30;  // samples over which an acceleration sets in
const REST = 200;  // samples at the end of a command

const distance = ([ax, ay], [bx, by]) => Math.hypot(ax - bx, ay - by);
const between = ([ax, ay], [bx, by], share) => [ax + (bx - ax) * share, ay + (by - ay) * share];
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

export const lengthOf = (points) =>
  points.reduce((sum, point, index) => sum + (index ? distance(point, points[index - 1]) : 0), 0);

/** The middle of the box around the points. */
const middleOf = (points) => [0, 1].map((axis) => {
  const values = points.map((point) => point[axis]);
  return (Math.min(...values) + Math.max(...values)) / 2;
});

/** The point moved straight towards the middle of the pan until it is within `reach` of it. */
export function keepWithin([x, y], reach) {
  const from = Math.hypot(x, y);
  return from > reach ? [x * reach / from, y * reach / from] : [x, y];
}

/** Evenly spaced points along a polyline, about `spacing` apart, both ends included. */
function resample(points, spacing) {
  const total = lengthOf(points);
  const pieces = Math.max(2, Math.round(total / spacing));
  const result = [];
  let index = 0, passed = 0, piece = distance(points[0], points[1]);
  for (let k = 0; k <= pieces; k++) {
    const wanted = total * k / pieces;
    while (index < points.length - 2 && passed + piece < wanted) {
      passed += piece;
      index += 1;
      piece = distance(points[index], points[index + 1]);
    }
    result.push(between(points[index], points[index + 1], piece > 0 ? clamp((wanted - passed) / piece, 0, 1) : 0));
  }
  return result;
}

/** Gaussian smoothing over `width` points; beyond an end the path is taken to go on point-symmetrically: ends stay. */
function smooth(points, width) {
  const half = Math.ceil(3 * width), last = points.length - 1;
  const weights = Array.from({ length: 2 * half + 1 }, (_, k) => Math.exp(-0.5 * ((k - half) / width) ** 2));
  const sum = weights.reduce((a, b) => a + b);
  const mirror = ([ex, ey], [x, y]) => [2 * ex - x, 2 * ey - y];
  const at = (k) => {
    if (k < 0) return mirror(points[0], points[Math.min(-k, last)]);
    return k > last ? mirror(points[last], points[Math.max(2 * last - k, 0)]) : points[k];
  };
  return points.map((_, k) => weights.reduce(([x, y], weight, j) => {
    const [px, py] = at(k + j - half);
    return [x + px * weight / sum, y + py * weight / sum];
  }, [0, 0]));
}

/** The largest speed (m/s) at each of the evenly spaced points: from rest to rest, slower in bends. */
function speedsAlong(points, top) {
  const step = lengthOf(points) / (points.length - 1);
  const longest = Math.max(...points.slice(1).map((point, k) => distance(points[k], point)));
  top *= step / longest;  // the others are shorter where the path turns on the spot
  const speeds = points.map((point, k) => {
    if (k === 0 || k === points.length - 1) return 0;
    const [before, after] = [points[k - 1], points[k + 1]];
    const bend = Math.hypot(before[0] - 2 * point[0] + after[0], before[1] - 2 * point[1] + after[1]) / step ** 2;
    return Math.min(top, Math.sqrt(BEND / Math.max(bend, 1e-9)));
  });
  const reachable = (from) => Math.sqrt(from ** 2 + 2 * PULL * step);
  for (let k = 1; k < speeds.length; k++) speeds[k] = Math.min(speeds[k], reachable(speeds[k - 1]));
  for (let k = speeds.length - 2; k >= 0; k--) speeds[k] = Math.min(speeds[k], reachable(speeds[k + 1]));
  return { speeds, step };
}

/** The positions at every millisecond, running along the points at these speeds (m/s). */
function runAlong(points, { speeds, step }) {
  const times = [0];
  for (let k = 1; k < points.length; k++) times.push(times[k - 1] + 2 * step / (speeds[k - 1] + speeds[k]));
  const samples = Math.ceil(times.at(-1) / DT);
  const positions = [];
  let k = 0;
  for (let n = 0; n <= samples; n++) {
    const t = Math.min(n * DT, times.at(-1));
    while (k < times.length - 2 && times[k + 1] <= t) k += 1;
    const since = t - times[k], pull = (speeds[k + 1] - speeds[k]) / (times[k + 1] - times[k]);
    positions.push(between(points[k], points[k + 1], clamp((speeds[k] + pull * since / 2) * since / step, 0, 1)));
  }
  return positions;
}

/** A moving average over time, the object at rest before the first and after the last position. */
function ease(positions, width) {
  const rest = (point) => Array(width).fill(point);
  const held = [...rest(positions[0]), ...positions, ...rest(positions.at(-1))];
  const sum = [0, 0], result = [];
  held.forEach(([x, y], n) => {
    sum[0] += x;
    sum[1] += y;
    if (n >= width) {
      sum[0] -= held[n - width][0];
      sum[1] -= held[n - width][1];
    }
    if (n >= width - 1) result.push([sum[0] / width, sum[1] / width]);
  });
  return result;
}

/**
 * Make a command of a drawn path.
 *
 * @param points  [[x, y], ...] as drawn (m)
 * @param speed  highest speed along the path (m/s)
 * @param reach  farthest that a command may go from its start (m)
 * @returns null if the path is too short to be meant; otherwise {positions, length, rest, shrunk}: positions every
 *   millisecond, a whole number of SENT_EVERY steps; the length of the path (m); the samples at its end that stay
 *   there; the factor that made it fit
 */
export function commandAlong(points, { speed, reach }) {
  if (points.length < 2 || lengthOf(points) < SHORTEST) return null;
  let path = smooth(resample(points, SPACING), TREMOR / SPACING);
  const farthest = Math.max(...path.map((point) => distance(point, path[0])));
  const shrunk = Math.min(1, reach * 0.999 / farthest);  // a hair inside: the server's curves may swing out a little
  const middle = middleOf(path);
  path = resample(path.map((point) => between(middle, point, shrunk)), SPACING);
  let positions = ease(ease(runAlong(path, speedsAlong(path, speed)), EASE), EASE);
  const missing = (SENT_EVERY - (positions.length - 1) % SENT_EVERY) % SENT_EVERY;
  positions = positions.concat(Array(missing + REST).fill(positions.at(-1)));
  return { positions, length: lengthOf(path), rest: REST, shrunk };
}

/** The command as the body of a request carries it: every tenth sample, to the micrometre. */
export function commandDocument(positions) {
  const rounded = (value) => Math.round(value * 1e6) / 1e6 + 0;  // + 0: no negative zero
  const position = positions.filter((_, k) => k % SENT_EVERY === 0).map((point) => point.map(rounded));
  return { dt: SENT_EVERY * DT, position };
}
