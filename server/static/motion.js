/** A plan as it is played and plotted: columns on an even time line, and where on it a moment lies. */

const DRAWN = 6000;  // samples at most; of a longer plan every n-th is drawn, its figures are of all
const GRAVITY = 9.8;  // m/s^2, the law of friction's

const columns = (rows) => ({ x: rows.map((row) => row[0]), y: rows.map((row) => row[1]) });
export const lengths = ({ x, y }) => x.map((value, k) => Math.hypot(value, y[k]));
export const distances = (a, b) => a.x.map((value, k) => Math.hypot(value - b.x[k], a.y[k] - b.y[k]));

/** Runs of samples at which the object slides, [first, after the last]; at rest its speed is exactly 0. */
function slipPhases(velocity) {
  const phases = [];
  velocity.forEach(([x, y], k) => {
    if (x === 0 && y === 0) return;
    if (phases.at(-1)?.[1] === k) phases.at(-1)[1] = k + 1; else phases.push([k, k + 1]);
  });
  return phases;
}

/** The motion of a plan document: SI units; of the object relative to the pan, of the pan relative to its start. */
export function motionOf(plan) {
  const every = Math.ceil(plan.command.position.length / DRAWN);
  const drawn = (rows) => columns(every > 1 ? rows.filter((_, k) => k % every === 0) : rows);
  const step = plan.dt * every;
  const command = drawn(plan.command.position);
  return {
    step,
    end: (command.x.length - 1) * step,
    time: command.x.map((_, k) => k * step),
    command,
    object: drawn(plan.object.position),
    speed: lengths(drawn(plan.object.velocity)),
    pan: drawn(plan.pan.position),
    acceleration: drawn(plan.pan.acceleration),
    slip: slipPhases(plan.object.velocity).map((phase) => phase.map((k) => k * plan.dt)),
    breakaway: plan.friction.static * GRAVITY,
    hold: plan.friction.kinetic * GRAVITY,
    quality: plan.quality,
    reachLimit: plan.quality.limits.pan_reach,
  };
}

/** Where time t (s) lies: the last sample at or before it, the one after, and the share of the way between them. */
export function locate({ step, time }, t) {
  const k = Math.min(Math.max(Math.floor(t / step + 1e-9), 0), time.length - 1);
  const next = Math.min(k + 1, time.length - 1);
  return { k, next, share: next > k ? Math.max(t - time[k], 0) / step : 0 };
}

export const valueAt = (values, { k, next, share }) => values[k] + (values[next] - values[k]) * share;
export const pointAt = ({ x, y }, place) => [valueAt(x, place), valueAt(y, place)];
export const slidesAt = ({ slip }, t) => slip.some(([from, to]) => from <= t && t < to);
