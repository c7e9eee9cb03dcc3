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
from typing import Any, Self

import numpy as np

from runtime.documents.checks import fields, number
from runtime.errors import InputError, within

UNITS = {"pan_reach": "m", "acceleration": "m/s^2", "jerk": "m/s^3"}
"""The limits' names and units."""

USABLE = (1e-6, 1e9)
"""Range of a finite limit, in its own unit: what is beyond is a slip of the unit, and its square no number to trust."""

FARTHEST_REACH = 100.0
"""Largest reach (m): what is beyond is millimetres."""

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
        InputError: a limit is no number, not greater than zero, outside USABLE, or a reach beyond
            FARTHEST_REACH; some are infinite and some are not;
            or the jerk is so small that the acceleration takes more than LONGEST_RAMP to come to its limit.
    """

    pan_reach: float = 0.2
    acceleration: float = 30.0
    jerk: float = 10_000.0

    def __post_init__(self) -> None:
        for name, unit in UNITS.items():
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
                raise InputError(f"limit {name} must be a number, got {value!r}", name)
            if not value > 0.0:
                raise InputError(f"limit {name} must be greater than 0 {unit}, got {value:g} {unit}", name)
            object.__setattr__(self, name, float(value))
        if len({math.isinf(value) for value in vars(self).values()}) > 1:
            # Whether the pan can stop inside a reach is no question without a bound on how hard it may brake.
            values = ", ".join(f"{name} {value:g}" for name, value in vars(self).items())
            raise InputError(f"limits contradict each other: all must be finite, or none: {values}")
        if not self.finite:
            return
        if self.pan_reach > FARTHEST_REACH:
            raise InputError(
                f"limit pan_reach must be at most {FARTHEST_REACH:g} m, got {self.pan_reach:g} m: is it in "
                f"millimetres? Then give {self.pan_reach / 1e3:g} m",
                "pan_reach",
            )
        for name, unit in UNITS.items():
            value = getattr(self, name)
            if not USABLE[0] <= value <= USABLE[1]:
                low, high = USABLE
                message = f"limit {name} must be between {low:g} and {high:g} {unit}, got {value:g} {unit}"
                raise InputError(message, name)
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
        values = {name: number(parts[name], f"{where}.{name}") for name in UNITS}
        with within(where):
            return cls(**values)


NO_LIMITS = Limits(math.inf, math.inf, math.inf)
"""Leaves the network's accelerations as they are: to compare it with itself, not to move anything."""
