"""What the pan must keep to, and the stop that proves it still can.

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
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple, Self

import numpy as np

from runtime.documents import FloatArray, fields, number
from runtime.errors import InputError
from runtime.friction import DT

UNITS = {"pan_reach": "m", "acceleration": "m/s^2", "jerk": "m/s^3"}
"""The limits' names and units."""

USABLE = (1e-6, 1e9)
"""Range of a finite limit, in its own unit: what is beyond is a slip of the unit, and its square no number to trust."""

LONGEST_RAMP = 10.0
"""Longest time (s) that a jerk limit may take to bring the acceleration to its limit: a stop would take longer still,
and no plan would come to see it."""


@dataclass(frozen=True)
class Limits:
    """What holds at every sample of a plan; all lengths are Euclidean.

    Attributes:
        pan_reach: largest distance of the pan from the centre of its reach (m).
        acceleration: largest pan acceleration (m/s^2).
        jerk: largest change of the pan acceleration from one sample to the next, over dt (m/s^3).

    Raises:
        InputError: a limit is no number, not greater than zero or outside USABLE; some are infinite and some are not;
            or the jerk is so small that the acceleration takes more than LONGEST_RAMP to come to its limit.
    """

    pan_reach: float = 0.2
    acceleration: float = 30.0
    jerk: float = 10_000.0

    def __post_init__(self) -> None:
        for name, unit in UNITS.items():
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
                raise InputError(f"limit {name} must be a number, got {value!r}")
            if not value > 0.0:
                raise InputError(f"limit {name} must be greater than 0 {unit}, got {value:g} {unit}")
            object.__setattr__(self, name, float(value))
        if len({math.isinf(value) for value in vars(self).values()}) > 1:
            # Whether the pan can stop inside a reach is no question without a bound on how hard it may brake.
            values = ", ".join(f"{name} {value:g}" for name, value in vars(self).items())
            raise InputError(f"limits contradict each other: all must be finite, or none: {values}")
        if not self.finite:
            return
        for name, unit in UNITS.items():
            value = getattr(self, name)
            if not USABLE[0] <= value <= USABLE[1]:
                low, high = USABLE
                raise InputError(f"limit {name} must be between {low:g} and {high:g} {unit}, got {value:g} {unit}")
        ramp = self.acceleration / self.jerk
        if ramp > LONGEST_RAMP:
            raise InputError(
                f"limits contradict each other: at a jerk of {self.jerk:g} m/s^3 the acceleration takes {ramp:.4g} s "
                f"to come to {self.acceleration:g} m/s^2, and no stop would be shorter; at most {LONGEST_RAMP:g} s are "
                "accepted"
            )

    @property
    def finite(self) -> bool:
        """Whether there is any limit at all."""
        return math.isfinite(self.pan_reach)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON document."""
        return asdict(self)

    @classmethod
    def from_dict(cls, document: object, where: str = "limits") -> Self:
        """Read the JSON document; `where` is its key.

        Raises:
            InputError: a key is missing or unknown, or a value is no limit.
        """
        parts: Mapping[str, Any] = fields(document, where, tuple(UNITS))
        return cls(**{name: number(parts[name], f"{where}.{name}") for name in UNITS})


NO_LIMITS = Limits(math.inf, math.inf, math.inf)
"""Leaves the network's accelerations as they are: to compare it with itself, not to move anything."""


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


def find_brake(state: PanState, limits: Limits, strength: float | None = None) -> Brake:
    """Return a stop within the limits on acceleration and jerk; whether it stays in reach is `stop_reach`'s business.

    Args:
        state: where the pan is, how fast, and its acceleration.
        limits: acceleration and jerk; finite.
        strength: largest braking acceleration (m/s^2), at most the limit; the limit if None.
    """
    strength = limits.acceleration if strength is None else min(strength, limits.acceleration)
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
