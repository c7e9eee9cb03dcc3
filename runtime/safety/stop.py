"""A stop within the limits: what proves that the pan can still come to rest.

The pan is the double integrator of Eq. 3, in space, with a bounded reach, height, speed, acceleration and jerk; in
discrete time, over a sample of `dt`, the jerk is the change of the acceleration from one sample to the next. A stop
(`Brake`) has three phases, all in samples: the acceleration goes from what it was to `w` in equal steps, stays there,
and goes to zero in equal steps. `w` is what makes the velocity end at zero: with n, h and m samples in the phases, a
before and velocity v,

    v/dt + a (n - 1)/2 + w ((n + m)/2 + h) = 0

so that for given n, h, m the stop is linear in (v, a) and no equation is solved by iteration. A longer h makes w
smaller, until it keeps the limit on the acceleration, and does not sink faster than any pan may; a and w keep them, and
so does all that lies between them. Along each phase the position is a polynomial of degree three in the sample's index,
and the velocity one of degree two. Each lies in the convex hull of its Bézier points: if those are inside the disc,
between the heights, or in the ball of speeds, all of the stop is, and checking it costs the same however long it takes.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Self

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.limits import LARGEST_SINK, Limits
from runtime.physics.law import DT, GRAVITY

Triple = tuple[float, float, float]
Moving = tuple[float, float, float, float, float, float]
"""Position (m) and velocity (m/s)."""

NOTHING: Triple = (0.0, 0.0, 0.0)


class PanState(NamedTuple):
    """The pan between two samples: position (m), velocity (m/s), and the acceleration of the sample before (m/s^2)."""

    x: float
    y: float
    z: float
    vx: float
    vy: float
    vz: float
    ux: float
    uy: float
    uz: float


class Brake(NamedTuple):
    """A stop: from the acceleration u to w (m/s^2) in `ramp_in` samples, `hold`, to zero in `ramp_out`.

    `done` samples of it have been executed already.
    """

    u: Triple
    w: Triple
    ramp_in: int
    hold: int
    ramp_out: int
    done: int = 0

    @property
    def samples(self) -> int:
        """Number of samples that are left until the pan rests; the last one's acceleration is zero."""
        return max(0, self.ramp_in + self.hold + self.ramp_out - self.done)

    def turned(self, turn: FloatArray) -> Self:
        """Return the stop with its accelerations in the plane times a (2, 2) matrix, as rows."""
        (ux, uy), (wx, wy) = (np.array([self.u[:2], self.w[:2]]) @ turn).tolist()
        return self._replace(u=(ux, uy, self.u[2]), w=(wx, wy, self.w[2]))

    def accelerations(self, count: int) -> FloatArray:
        """Return the next `count` accelerations (count, 3) (m/s^2), zeros after the stop."""
        k = np.arange(self.done + 1, self.done + 1 + count)
        after = k - (self.ramp_in + self.hold)
        rising = np.minimum(k / self.ramp_in, 1.0)
        falling = np.clip(1.0 - after / self.ramp_out, 0.0, 1.0)
        start, held = (1.0 - rising)[:, None], (rising * falling)[:, None]
        return start * self.u + held * self.w


RESTING = Brake(NOTHING, NOTHING, 1, 0, 1)
"""The stop of what rests."""


class Extent(NamedTuple):
    """What a pan does not pass on its way: a distance in the plane and one up or down (m), and a speed (m/s)."""

    reach: float
    height: float
    speed: float

    def within(self, limits: Limits) -> bool:
        """Whether the limits on these are kept."""
        return self.reach <= limits.pan_reach and self.height <= limits.height and self.speed <= limits.speed


SHORT_RAMP = 0.01
"""Time (s) from no acceleration to the limit up to which a stop uses all of the limit, whatever it needs."""


def size(x: float, y: float, z: float) -> float:
    """Return the length of a vector: by the same operations compiled and not, which `math.hypot` would not be."""
    return math.sqrt(x * x + y * y + z * z)


def strongest(state: PanState, acceleration: float, jerk: float) -> float:
    """Return the largest braking acceleration (m/s^2) of the quickest stop within these limits.

    It is the limit, unless the way to the limit and back takes so long that the pan would stand still before: then it
    is the peak of the stop that goes up and at once down again, so that a looser limit makes no stop longer.
    """
    if acceleration <= jerk * SHORT_RAMP:
        return acceleration
    speed, push = size(state.vx, state.vy, state.vz), size(state.ux, state.uy, state.uz)
    peak = math.sqrt(jerk * speed + 0.5 * push * push)
    return min(acceleration, max(peak, jerk * DT))


def find_brake(state: PanState, limits: Limits, strength: float | None = None) -> Brake:
    """Return a stop within the limits on acceleration and jerk; `stop_extent` says where it leads.

    Args:
        state: where the pan is, how fast, and its acceleration.
        limits: acceleration and jerk; finite.
        strength: largest braking acceleration (m/s^2), at most the limit; that of the quickest stop if None.
    """
    if strength is None:
        strength = strongest(state, limits.acceleration, limits.jerk)
    return quickest(state, limits.jerk * DT, min(strength, limits.acceleration))


def quickest(state: PanState, step: float, strength: float) -> Brake:
    """Return the quickest stop with braking accelerations of at most `strength`, which change by `step` a sample."""
    ramp_out = math.ceil(strength / step)
    # From any acceleration to any braking one: long enough whatever comes out.
    ramp_in = max(1, math.ceil((size(state.ux, state.uy, state.uz) + strength) / step))
    brake = with_ramps(state, ramp_in, ramp_out, strength)
    shorter = max(1, math.ceil(change(brake) / step))
    if shorter < ramp_in:
        quicker = with_ramps(state, shorter, ramp_out, strength)
        if change(quicker) <= step * shorter:
            return quicker
    return brake


def change(brake: Brake) -> float:
    """Return how far a stop's acceleration goes in its first phase (m/s^2)."""
    u, w = brake.u, brake.w
    return size(w[0] - u[0], w[1] - u[1], w[2] - u[2])


def with_ramps(state: PanState, ramp_in: int, ramp_out: int, strength: float) -> Brake:
    """Return the shortest stop with these ramps whose braking acceleration is at most `strength`, and sinks as it may.

    A pan that comes down fast is braked upwards, with all of the limit; one that goes up, by LARGEST_SINK at most.
    """
    before = 0.5 * (ramp_in - 1)
    qx = state.vx / DT + before * state.ux
    qy = state.vy / DT + before * state.uy
    qz = state.vz / DT + before * state.uz
    ramps = 0.5 * (ramp_in + ramp_out)
    needed = max(size(qx, qy, qz) / strength, qz / LARGEST_SINK)
    hold = max(0, math.ceil(needed - ramps))
    weight = ramps + hold
    before_it, held = (state.ux, state.uy, state.uz), (-qx / weight, -qy / weight, -qz / weight)
    return Brake(before_it, held, ramp_in, hold, ramp_out, 0)


def stop_extent(state: PanState, brake: Brake) -> Extent:
    """Return how far and how fast a pan comes at most on its way to rest, by the convex hulls.

    Args:
        state: where the pan is before the stop's first sample.
        brake: the stop, nothing of it done yet.
    """
    reach, height, speed = squared_extent(state, brake)
    return Extent(math.sqrt(reach), height, math.sqrt(speed))


def squared_extent(state: PanState, brake: Brake) -> Triple:
    """Return `stop_extent` with the squares of distance (m^2) and speed (m^2/s^2)."""
    x, y, z, vx, vy, vz = state.x, state.y, state.z, state.vx, state.vy, state.vz
    begin = x * x + y * y, abs(z), vx * vx + vy * vy + vz * vz
    moved, extent = phase((x, y, z, vx, vy, vz), brake.u, brake.w, brake.ramp_in, begin)
    if brake.hold > 0:
        moved, extent = phase(moved, brake.w, brake.w, brake.hold, extent)
    return phase(moved, brake.w, (0.0, 0.0, 0.0), brake.ramp_out, extent)[1]


def phase(state: Moving, u: Triple, w: Triple, count: int, extent: Triple) -> tuple[Moving, Triple]:
    """Move the pan along accelerations that go from u to w in even steps, j = 1..count, in closed form.

    With the step s = (w - u)/count, the velocity after k of them is v + u t + s dt (k^2 + k)/2, t = k dt: a parabola,
    whose inner Bézier point is half of its slope away from its beginning. The position is
    p + v t + u t^2/2 + s dt^2 (2 k^3 + 3 k^2 + k)/12: a cubic, whose inner Bézier points are a third of its slope away
    from its ends.

    Args:
        state: position (m) and velocity (m/s) before, x, y, z of each.
        u: acceleration before (m/s^2).
        w: the last (m/s^2).
        count: number of samples, at least 1.
        extent: so far, as `squared_extent` gives it.

    Returns:
        Position and velocity after, and `extent` with the ends and the inner Bézier points taken in.
    """
    x, y, z, vx, vy, vz = state
    ux, uy, uz = u
    sx, sy, sz = (w[0] - ux) / count, (w[1] - uy) / count, (w[2] - uz) / count
    t = count * DT
    a = 0.5 * t * t
    b = DT * DT * count * (2.0 * count * count + 3.0 * count + 1.0) / 12.0
    end_x = x + vx * t + ux * a + sx * b
    end_y = y + vy * t + uy * a + sy * b
    end_z = z + vz * t + uz * a + sz * b
    third = t / 3.0
    c = DT / 12.0
    first_x = x + third * (vx + c * sx)
    first_y = y + third * (vy + c * sy)
    first_z = z + third * (vz + c * sz)
    d = DT * (6.0 * count * count + 6.0 * count + 1.0) / 12.0
    last_x = end_x - third * (vx + ux * t + sx * d)
    last_y = end_y - third * (vy + uy * t + sy * d)
    last_z = end_z - third * (vz + uz * t + sz * d)
    e = 0.5 * t * (count + 1.0)
    half = 0.5 * t
    middle_x = vx + half * (ux + 0.5 * sx)
    middle_y = vy + half * (uy + 0.5 * sy)
    middle_z = vz + half * (uz + 0.5 * sz)
    end_vx, end_vy, end_vz = vx + ux * t + sx * e, vy + uy * t + sy * e, vz + uz * t + sz * e
    reach, height, speed = extent
    reach = max(
        reach,
        first_x * first_x + first_y * first_y,
        last_x * last_x + last_y * last_y,
        end_x * end_x + end_y * end_y,
    )
    height = max(height, abs(first_z), abs(last_z), abs(end_z))
    speed = max(
        speed,
        middle_x * middle_x + middle_y * middle_y + middle_z * middle_z,
        end_vx * end_vx + end_vy * end_vy + end_vz * end_vz,
    )
    return (end_x, end_y, end_z, end_vx, end_vy, end_vz), (reach, height, speed)


GENTLE = 0.9
"""Share of the friction that a gentle stop takes: a resting object stays at rest, with some to spare."""

STRENGTHS = 5
"""Stops tried from a gentle one to the strongest."""


def gentle_strength(coefficient: float, limits: Limits) -> float:
    """Return the largest braking acceleration w (m/s^2) that takes GENTLE of the friction, whatever its direction.

    A level pan's is GENTLE mu g. A pan that lifts may brake downwards, and the object presses less on it: then
    w = GENTLE mu (g - w). Accelerations that hold the object are a convex set, so a stop that goes from one of them to
    another, and to zero, holds it throughout.
    """
    taken = GENTLE * coefficient
    return taken * GRAVITY if limits.level else taken * GRAVITY / (1.0 + taken)


def gentle_stop(state: PanState, limits: Limits, friction: Friction) -> Brake | None:
    """Return the gentlest of a few stops within the limits, from GENTLE of the friction to the strongest, or None."""
    most = strongest(state, limits.acceleration, limits.jerk)
    gentlest = min(gentle_strength(friction.static, limits), most)
    for strength in np.linspace(gentlest, most, STRENGTHS).tolist():
        if strength > 0.0:
            brake = find_brake(state, limits, strength)
            if stop_extent(state, brake).within(limits):
                return brake
    return None
