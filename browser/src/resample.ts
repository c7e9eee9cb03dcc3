/** From waypoints to 1 kHz; the Python module `runtime.commands.resample` says how, and why. */

const LONG = 0.075;  // s
const SPARSE_SHARE = 0.25;
const OVERSHOOT = 0.9e-3;  // m
const ROUNDING = 1.5e-3;  // m
const RAMP_ACCELERATION = 6;  // m/s^2

type Values = readonly number[];

/** One coordinate of everything: times of waypoints, where it is, and how fast. */
interface Curve {
  readonly t: Values;
  readonly y: Values;
  readonly slope: Values;
}

/**
 * Where the command is at given times.
 *
 * @param t increasing times of the waypoints (s), two or more
 * @param position their [x, y] (m)
 * @param at times within those of the waypoints (s)
 * @returns (m * 2) positions (m)
 */
export function resample(t: Values, position: readonly (readonly [number, number])[], at: Values): Float64Array {
  const h = differences(t), long = h.map((each) => each > LONG);
  const axes = [0, 1].map((axis) => position.map((each) => each[axis as 0 | 1]));
  const secants = axes.map((y) => differences(y).map((each, k) => each / h[k]!));
  const slopes = axes.map((y, axis) => slopesOf(t, h, y, secants[axis]!, long));
  const factor = straightness(h, secants, slopes, long);
  const ramps = rampsOf(h, secants);
  const out = new Float64Array(2 * at.length);
  for (const [axis, y] of axes.entries()) {
    const slope = withinBox(h, y, slopes[axis]!.map((each, k) => each * factor[k]!));
    const curve = withRamps({ t, y, slope }, long, ramps);
    for (const [n, value] of hermite(curve, at).entries()) out[2 * n + axis] = value;
  }
  return out;
}

/** How far a command, (m * 2), leaves the straight lines between its waypoints (m). */
export function deviation(
  t: Values, position: readonly (readonly [number, number])[], at: Values, command: Float64Array,
): number {
  let most = 0, piece = 0;
  for (const [n, time] of at.entries()) {
    while (piece < t.length - 2 && t[piece + 1]! <= time) piece++;
    const [x, y] = position[piece]!, [toX, toY] = position[piece + 1]!;
    const cx = toX - x, cy = toY - y, dx = command[2 * n]! - x, dy = command[2 * n + 1]! - y;
    const square = cx * cx + cy * cy;
    const share = Math.min(1, Math.max(0, (dx * cx + dy * cy) / (square > 0 ? square : 1)));
    most = Math.max(most, Math.hypot(dx - share * cx, dy - share * cy));
  }
  return most;
}

const differences = (values: Values): number[] => values.slice(1).map((value, k) => value - values[k]!);

function slopesOf(t: Values, h: Values, y: Values, secant: Values, long: readonly boolean[]): number[] {
  const slope = limited(splineSlopes(t, h, secant), secant), means = harmonicMeans(h, secant);
  for (let k = 0; k < y.length; k++) if (long[k - 1] || long[k]) slope[k] = means[k]!;
  const inLong = h.reduce((sum, each) => (each > LONG ? sum + each : sum), 0);
  if (inLong >= SPARSE_SHARE * (t.at(-1)! - t[0]!)) slope[0] = slope[slope.length - 1] = 0;
  return slope;
}

/** Slopes of the not-a-knot cubic spline at its knots. */
function splineSlopes(t: Values, h: Values, secant: Values): number[] {
  const n = t.length;
  if (n === 2) return [secant[0]!, secant[0]!];
  if (n === 3) {
    const bend = (secant[1]! - secant[0]!) / (t[2]! - t[0]!);
    return [secant[0]! - h[0]! * bend, secant[0]! + h[0]! * bend, secant[1]! + h[1]! * bend];
  }
  const first = t[2]! - t[0]!, last = t[n - 1]! - t[n - 3]!;
  const [h0, h1, before, end] = [h[0]!, h[1]!, h[n - 3]!, h[n - 2]!];
  const below = [0, ...h.slice(1), last], above = [first, ...h.slice(0, -1)];
  const diagonal = [h1, ...h.slice(1).map((each, k) => 2 * (h[k]! + each)), before];
  const found = [
    ((h0 + 2 * first) * h1 * secant[0]! + h0 ** 2 * secant[1]!) / first,
    ...h.slice(1).map((each, k) => 3 * (each * secant[k]! + h[k]! * secant[k + 1]!)),
    (end ** 2 * secant[n - 3]! + (2 * last + end) * before * secant[n - 2]!) / last,
  ];
  for (let row = 1; row < n; row++) {
    const factor = below[row]! / diagonal[row - 1]!;
    diagonal[row] = diagonal[row]! - factor * above[row - 1]!;
    found[row] = found[row]! - factor * found[row - 1]!;
  }
  found[n - 1] = found[n - 1]! / diagonal[n - 1]!;
  for (let row = n - 2; row >= 0; row--) found[row] = (found[row]! - above[row]! * found[row + 1]!) / diagonal[row]!;
  return found;
}

/** Slopes limited by the secants around: monotone between monotone data, within the secants where these turn. */
function limited(slope: Values, secant: Values): number[] {
  return slope.map((value, k) => {
    const around = [k - 2, k - 1, k, k + 1].map((each) => secant[each] ?? 0);
    const lowest = Math.min(...around), highest = Math.max(...around);
    if (lowest < 0 && highest > 0) return clip(value, lowest, highest);
    const before = secant[Math.max(0, k - 1)]!, after = secant[Math.min(secant.length - 1, k)]!;
    return clip(value, 3 * Math.min(Math.max(before, after), 0), 3 * Math.max(Math.min(before, after), 0));
  });
}

const clip = (value: number, low: number, high: number): number => Math.min(Math.max(value, low), high);

/** PCHIP's slopes: weighted harmonic means of the secants around, 0 where their signs differ. */
function harmonicMeans(h: Values, secant: Values): number[] {
  const inner = secant.slice(1).map((after, k) => {
    const before = secant[k]!, first = 2 * h[k + 1]! + h[k]!, second = h[k + 1]! + 2 * h[k]!;
    return before * after > 0 ? (first + second) / (first / before + second / after) : 0;
  });
  return [secant[0]!, ...inner, secant.at(-1)!];
}

function rampsOf(h: Values, [x, y]: readonly Values[]): number[] {
  return h.map((each, k) => clip((1.5 * Math.hypot(x![k]!, y![k]!)) / RAMP_ACCELERATION, each / 100, each / 3));
}

/** What each slope is multiplied by, so that no long interval is left by more than ROUNDING. */
function straightness(
  h: Values, secants: readonly Values[], slopes: readonly Values[], long: readonly boolean[],
): number[] {
  const [x, y] = secants as [Values, Values], [u, v] = slopes as [Values, Values], ramps = rampsOf(h, secants);
  const factor = u.map(() => 1);
  for (const end of [0, 1]) {
    for (let k = 0; k < h.length; k++) {
      const speed = Math.hypot(x[k]!, y[k]!);
      const across = Math.abs(x[k]! * v[k + end]! - y[k]! * u[k + end]!) / (speed > 0 ? speed : 1);
      const aside = 0.5 * ramps[k]! * across;
      if (long[k] && aside > ROUNDING) factor[k + end] = Math.min(factor[k + end]!, ROUNDING / aside);
    }
  }
  return factor;
}

/** Shrink slopes until the cubics leave the box around all waypoints by OVERSHOOT at most. */
function withinBox(h: Values, y: Values, given: Values): number[] {
  const slope = [...given];
  const lowest = y.reduce((a, b) => Math.min(a, b)), highest = y.reduce((a, b) => Math.max(a, b));
  const near = h.flatMap((each, k) => {
    const swing = each * (Math.abs(slope[k]!) + Math.abs(slope[k + 1]!)) * (4 / 27);
    const out = Math.max(y[k]!, y[k + 1]!) + swing > highest + OVERSHOOT ||
      Math.min(y[k]!, y[k + 1]!) - swing < lowest - OVERSHOOT;
    return out ? [k] : [];
  });
  for (;;) {
    const scale = new Map<number, number>();
    for (const k of near) {
      const piece = [h[k]!, y[k]!, y[k + 1]!, slope[k]!, slope[k + 1]!] as const;
      const outside = Math.max(...crests(...piece).map((share) => {
        const value = cubic(share, ...piece);
        return Math.max(lowest - value, value - highest);
      }));
      if (outside <= OVERSHOOT) continue;
      for (const end of [k, k + 1]) scale.set(end, Math.min(scale.get(end) ?? 1, (0.99 * OVERSHOOT) / outside));
    }
    if (!scale.size) return slope;
    for (const [k, factor] of scale) slope[k] = slope[k]! * factor;
  }
}

/** The two shares at which a cubic turns, 0 or 1 where it does not turn between. */
function crests(h: number, first: number, last: number, begin: number, end: number): number[] {
  const chord = last - first, from = h * begin, to = h * end;
  const a = 3 * (from + to - 2 * chord), b = 2 * (3 * chord - 2 * from - to), c = from;
  const side = Math.sqrt(Math.max(b * b - 4 * a * c, 0));
  const root = -0.5 * (b + (b < 0 || Object.is(b, -0) ? -side : side));
  return [root / a, c / root].map((share) => (Number.isNaN(share) ? 0 : clip(share, 0, 1)));
}

/** Part each long interval in three: two ramps of constant acceleration, and a steady speed between them. */
function withRamps({ t, y, slope }: Curve, long: readonly boolean[], ramps: Values): Curve {
  const out = { t: [] as number[], y: [] as number[], slope: [] as number[] };
  const put = (time: number, value: number, speed: number): void => {
    out.t.push(time);
    out.y.push(value);
    out.slope.push(speed);
  };
  for (let k = 0; k < t.length; k++) {
    put(t[k]!, y[k]!, slope[k]!);
    if (!long[k]) continue;
    const h = t[k + 1]! - t[k]!, ramp = ramps[k]!, begin = slope[k]!, end = slope[k + 1]!;
    const steady = (y[k + 1]! - y[k]! - 0.5 * ramp * (begin + end)) / (h - ramp);
    put(t[k]! + ramp, y[k]! + 0.5 * ramp * (begin + steady), steady);
    put(t[k + 1]! - ramp, y[k + 1]! - 0.5 * ramp * (end + steady), steady);
  }
  return out;
}

function hermite({ t, y, slope }: Curve, at: Values): number[] {
  let k = 0;
  return at.map((time) => {
    while (k < t.length - 2 && t[k + 1]! <= time) k++;
    const h = t[k + 1]! - t[k]!;
    return cubic((time - t[k]!) / h, h, y[k]!, y[k + 1]!, slope[k]!, slope[k + 1]!);
  });
}

function cubic(share: number, h: number, first: number, last: number, begin: number, end: number): number {
  const rest = 1 - share;
  return first + share * share * (3 - 2 * share) * (last - first) + h * share * rest * (rest * begin - share * end);
}
