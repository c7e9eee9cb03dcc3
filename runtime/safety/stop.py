"""A stop within the limits: what proves that the pan can still come to rest.

The pan is the double integrator of Eq. 3 with a bounded reach, acceleration and jerk; in discrete time, over a sample
of `dt`, the jerk is the change of the acceleration from one sample to the next. A stop (`Brake`) has three phases,
all in samples: the acceleration goes from what it was to `w` in equal steps, stays there, and goes to zero in equal
steps. `w` is what makes the velocity end at zero: with n, h and m samples in the phases, a before and velocity v,

    v/dt + a (n - 1)/2 + w ((n + m)/2 + h) = 0

so that for given n, h, m the stop is linear in (v, a) and no equation is solved by iteration. Along each phase the
position is a polynomial of degree three in the sample's index, which lies in the convex hull of its Bézier points:
if those are inside the disc, all of the stop is, and checking it costs the same however long it takes.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Self

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.physics.law import DT, GRAVITY


class PanState(NamedTuple):
    """The pan between two samples: position (m), velocity (m/s), and the acceleration of the sample before (m/s^2)."""

    x: float
    y: float
    vx: float
    vy: float
    ux: float
    uy: float


class Brake(NamedTuple):
    """A stop: from the acceleration (ux, uy) to (wx, wy) in `ramp_in` samples, `hold`, to zero in `ramp_out` (m/s^2).

    `done` samples of it have been executed already.
    """

    ux: float
    uy: float
    wx: float
    wy: float
    ramp_in: int
    hold: int
    ramp_out: int
    done: int = 0

    @property
    def samples(self) -> int:
        """Number of samples that are left until the pan rests; the last one's acceleration is zero."""
        return max(0, self.ramp_in + self.hold + self.ramp_out - self.done)

    def turned(self, turn: FloatArray) -> Self:
        """Return the stop with its accelerations times a (2, 2) matrix, as rows."""
        (ux, uy), (wx, wy) = (np.array([(self.ux, self.uy), (self.wx, self.wy)]) @ turn).tolist()
        return self._replace(ux=ux, uy=uy, wx=wx, wy=wy)

    def accelerations(self, count: int) -> FloatArray:
        """Return the next `count` accelerations (count, 2) (m/s^2), zeros after the stop."""
        k = np.arange(self.done + 1, self.done + 1 + count)
        after = k - (self.ramp_in + self.hold)
        rising = np.minimum(k / self.ramp_in, 1.0)
        falling = np.clip(1.0 - after / self.ramp_out, 0.0, 1.0)
        start, held = (1.0 - rising)[:, None], (rising * falling)[:, None]
        return start * (self.ux, self.uy) + held * (self.wx, self.wy)


RESTING = Brake(0.0, 0.0, 0.0, 0.0, 1, 0, 1)
"""The stop of what rests."""


SHORT_RAMP = 0.01
"""Time (s) from no acceleration to the limit up to which a stop uses all of the limit, whatever it needs."""


def strongest(state: PanState, limits: Limits) -> float:
    """Return the largest braking acceleration of the quickest stop (m/s^2).

    It is the limit, unless the way to the limit and back takes so long that the pan would stand still before: then it
    is the peak of the stop that goes up and at once down again, so that a looser limit makes no stop longer.
    """
    if limits.acceleration <= limits.jerk * SHORT_RAMP:
        return limits.acceleration
    speed, push = math.hypot(state.vx, state.vy), math.hypot(state.ux, state.uy)
    peak = math.sqrt(limits.jerk * speed + 0.5 * push * push)
    return min(limits.acceleration, max(peak, limits.jerk * DT))


def find_brake(state: PanState, limits: Limits, strength: float | None = None) -> Brake:
    """Return a stop within the limits on acceleration and jerk; whether it stays in reach is `stop_reach`'s business.

    Args:
        state: where the pan is, how fast, and its acceleration.
        limits: acceleration and jerk; finite.
        strength: largest braking acceleration (m/s^2), at most the limit; that of the quickest stop if None.
    """
    strength = strongest(state, limits) if strength is None else min(strength, limits.acceleration)
    step = limits.jerk * DT
    ramp_out = math.ceil(strength / step)
    # From any acceleration to any braking one: long enough whatever comes out.
    ramp_in = max(1, math.ceil((math.hypot(state.ux, state.uy) + strength) / step))
    brake = _brake(state, ramp_in, ramp_out, strength)
    shorter = max(1, math.ceil(math.hypot(brake.wx - state.ux, brake.wy - state.uy) / step))
    if shorter < ramp_in:
        quicker = _brake(state, shorter, ramp_out, strength)
        if math.hypot(quicker.wx - state.ux, quicker.wy - state.uy) <= step * shorter:
            return quicker
    return brake


def _brake(state: PanState, ramp_in: int, ramp_out: int, strength: float) -> Brake:
    """Return the shortest stop with these ramps whose braking acceleration is at most `strength`."""
    qx = state.vx / DT + 0.5 * (ramp_in - 1) * state.ux
    qy = state.vy / DT + 0.5 * (ramp_in - 1) * state.uy
    ramps = 0.5 * (ramp_in + ramp_out)
    hold = max(0, math.ceil(math.hypot(qx, qy) / strength - ramps))
    weight = ramps + hold
    return Brake(state.ux, state.uy, -qx / weight, -qy / weight, ramp_in, hold, ramp_out)


def stop_reach(state: PanState, brake: Brake) -> float:
    """Return a distance from the centre that the pan does not pass on its way to rest (m), by the convex hull.

    Args:
        state: where the pan is before the stop's first sample.
        brake: the stop, nothing of it done yet.
    """
    x, y, vx, vy = state[:4]
    ux, uy, wx, wy, ramp_in, hold, ramp_out, _ = brake
    largest = x * x + y * y
    sx, sy = (wx - ux) / ramp_in, (wy - uy) / ramp_in
    x, y, vx, vy, largest = _phase(x, y, vx, vy, ux, uy, sx, sy, ramp_in, largest)
    if hold:
        x, y, vx, vy, largest = _phase(x, y, vx, vy, wx, wy, 0.0, 0.0, hold, largest)
    sx, sy = -wx / ramp_out, -wy / ramp_out
    largest = _phase(x, y, vx, vy, wx, wy, sx, sy, ramp_out, largest)[4]
    return math.sqrt(largest)


def _phase(
    x: float,
    y: float,
    vx: float,
    vy: float,
    ux: float,
    uy: float,
    sx: float,
    sy: float,
    count: int,
    largest: float,
) -> tuple[float, float, float, float, float]:
    """Move the pan along the accelerations u + j s, j = 1..count, in closed form.

    The position after k of them is p + v t + u t^2/2 + s dt^2 (2 k^3 + 3 k^2 + k)/12, t = k dt: a cubic, whose inner
    Bézier points are a third of its slope away from its ends.

    Args:
        x, y, vx, vy: position (m) and velocity (m/s) before.
        ux, uy: acceleration before (m/s^2).
        sx, sy: what the acceleration changes by from sample to sample (m/s^2).
        count: number of samples, at least 1.
        largest: square of the largest distance so far (m^2).

    Returns:
        Position and velocity after, and `largest` with the end and the inner Bézier points taken in.
    """
    t = count * DT
    a = 0.5 * t * t
    b = DT * DT * count * (2.0 * count * count + 3.0 * count + 1.0) / 12.0
    end_x = x + vx * t + ux * a + sx * b
    end_y = y + vy * t + uy * a + sy * b
    third = t / 3.0
    c = DT / 12.0
    first_x = x + third * (vx + c * sx)
    first_y = y + third * (vy + c * sy)
    d = DT * (6.0 * count * count + 6.0 * count + 1.0) / 12.0
    last_x = end_x - third * (vx + ux * t + sx * d)
    last_y = end_y - third * (vy + uy * t + sy * d)
    e = 0.5 * t * (count + 1.0)
    largest = max(
        largest,
        first_x * first_x + first_y * first_y,
        last_x * last_x + last_y * last_y,
        end_x * end_x + end_y * end_y,
    )
    return end_x, end_y, vx + ux * t + sx * e, vy + uy * t + sy * e, largest


GENTLE = 0.9
"""Share of the static friction mu g that a gentle stop takes: a resting object stays at rest, with some to spare."""

STRENGTHS = 5
"""Stops tried from a gentle one to the strongest."""


def gentle_stop(state: PanState, limits: Limits, friction: Friction) -> Brake | None:
    """Return the gentlest of a few stops in reach, from GENTLE mu g to the strongest; None if none is."""
    most = strongest(state, limits)
    gentlest = min(GENTLE * friction.static * GRAVITY, most)
    for strength in np.linspace(gentlest, most, STRENGTHS).tolist():
        if strength > 0.0:
            brake = find_brake(state, limits, strength)
            if stop_reach(state, brake) <= limits.pan_reach:
                return brake
    return None
