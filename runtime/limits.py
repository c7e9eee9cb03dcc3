"""What the pan must keep to."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from runtime.documents.parameters import Parameters
from runtime.errors import InputError

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
class Limits(Parameters):
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


NO_LIMITS = Limits(math.inf, math.inf, math.inf)
"""Leaves the network's accelerations as they are: to compare it with itself, not to move anything."""
