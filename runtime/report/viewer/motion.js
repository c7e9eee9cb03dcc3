/** A plan as it is played and plotted: columns along its time line, and where on it a moment lies. SI units. */

export const GRAVITY = 9.8;  // m/s^2, the law of friction's
export const RADIUS = { pan: 0.18, object: 0.03 };  // m, where neither a plan nor a server says otherwise
const ROUNDING = 1e-6;  // m: a report's numbers are rounded
const EYE = 0.8;  // m above the middle at least, from where a pan that lifts is seen
const DRAWN = 6000;  // samples at most; of a longer plan every n-th is drawn, its figures are of all

/** Columns of rows; z, which is upwards, is of the pan alone. */
const columns = (rows) => ({
  x: rows.map((row) => row[0]), y: rows.map((row) => row[1]), z: rows.map((row) => row[2] ?? 0),
});
/** Lengths in the plane, which is all that there is of the object and of a level pan. */
export const lengths = ({ x, y }) => x.map((value, k) => Math.hypot(value, y[k]));
export const distances = (a, b) =>
  a.x.map((value, k) => Math.hypot(value - b.x[k], a.y[k] - b.y[k], a.z[k] - b.z[k]));

/** Lowest and highest of the values; a loop, because a call takes no 100,000 arguments. */
export function range(lists) {
  let low = Infinity, high = -Infinity;
  for (const values of lists) {
    for (const value of values) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  return [low, high];
}

/** Runs of samples at which the object slides, [first, after the last]; at rest its speed is exactly 0. */
function slipPhases(velocity) {
  const phases = [];
  velocity.forEach(([x, y], k) => {
    if (x === 0 && y === 0) return;
    if (phases.at(-1)?.[1] === k) phases.at(-1)[1] = k + 1; else phases.push([k, k + 1]);
  });
  return phases;
}

/**
 * The motion of a plan document; of the object relative to the pan, of the pan relative to its start.
 *
 * A report's document has been thinned, so that it brings with it what can no longer be told from its rows: `time` of
 * each (s) and the `slip` phases (s); and it may have `tracks`, other motions on the same time line:
 * {name, object: {position, velocity}, pan: {position}}.
 */
export function motionOf(plan) {
  const last = plan.command.position.length - 1, every = Math.max(1, Math.ceil(last / (DRAWN - 1)));
  const thinned = (rows) => rows.filter((_, k) => k % every === 0 || k === last);
  const drawn = (rows) => columns(thinned(rows));
  const moving = ({ name, object, pan }, kind) => ({
    name, kind, object: drawn(object.position), speed: lengths(drawn(object.velocity)), pan: drawn(pan.position),
  });
  const planned = moving({ ...plan, name: "object" }, "object");
  const tracks = (plan.tracks ?? []).map((track, index) => moving(track, `track-${index % 4 + 1}`));
  const command = drawn(plan.command.position);
  const time = thinned(plan.time ?? plan.command.position.map((_, k) => k * plan.dt));
  const slip = plan.slip ?? slipPhases(plan.object.velocity).map((phase) => phase.map((k) => k * plan.dt));
  return {
    ...planned,
    tracks,
    command,
    time,
    slip,
    dt: plan.dt,
    end: time.at(-1),
    rests: slip.map(([, to]) => to).filter((t) => t <= time.at(-1)).map((t) => locate({ time }, t).k),
    acceleration: drawn(plan.pan.acceleration),
    lifts: (plan.quality.height_max ?? 0) > 0,
    eye: Math.max(EYE, 4 * (plan.quality.height_max ?? 0)),
    heightLimit: plan.quality.limits.height,
    static: plan.friction.static,
    breakaway: plan.friction.static * GRAVITY,
    hold: plan.friction.kinetic * GRAVITY,
    quality: plan.quality,
    reachLimit: plan.quality.limits.pan_reach,
    radius: plan.sizes ? { pan: plan.sizes.pan_radius, object: plan.sizes.object_radius } : RADIUS,
    stop: (plan.stop?.acceleration.length ?? 0) * plan.dt,
    farthest: range([command, planned.object, ...tracks.map((track) => track.object)].map(lengths))[1],
    reach: range([planned, ...tracks].map(({ pan }) => lengths(pan)))[1],
  };
}

/** Where time t (s) lies: the last sample at or before it, the one after, and the share of the way between them. */
export function locate({ time }, t) {
  let k = 0, high = time.length - 1;
  while (k < high) {
    const middle = (k + high + 1) >> 1;
    if (time[middle] <= t + 1e-9) k = middle; else high = middle - 1;
  }
  const next = Math.min(k + 1, time.length - 1);
  return { k, next, share: next > k ? Math.max(t - time[k], 0) / (time[next] - time[k]) : 0 };
}

export const valueAt = (values, { k, next, share }) => values[k] + (values[next] - values[k]) * share;
export const pointAt = ({ x, y }, place) => [valueAt(x, place), valueAt(y, place)];

/** What the object does at time t (s): "sticks", "slides", or "off the pan", its edge being over the rim. */
export function stateAt(motion, t) {
  const { pan, object } = motion.radius;
  if (Math.hypot(...pointAt(motion.object, locate(motion, t))) > pan - object + ROUNDING) return "off the pan";
  return motion.slip.some(([from, to]) => from <= t && t < to) ? "slides" : "sticks";
}
