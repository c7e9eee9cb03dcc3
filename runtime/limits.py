"""What the pan must keep to."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from typing import Any, ClassVar, Self

import numpy as np

from runtime.documents.parameters import Parameters
from runtime.errors import InputError
from runtime.physics.law import GRAVITY

UNITS = {"pan_reach": "m", "height": "m", "speed": "m/s", "acceleration": "m/s^2", "jerk": "m/s^3"}
"""The limits' names and units."""

WEIGHT_KEPT = 0.2
"""Share of its weight that presses the object on the pan at least, whatever the pan does."""

LARGEST_SINK = (1.0 - WEIGHT_KEPT) * GRAVITY
"""Largest acceleration downwards of any pan (m/s^2), which leaves WEIGHT_KEPT of the object's weight."""

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

    No pan accelerates downwards by more than LARGEST_SINK: the object would lose its hold. That is no parameter.

    Attributes:
        pan_reach: largest distance of the pan from the centre of its reach, in the plane (m).
        height: largest distance of the pan above and below the centre of its reach (m); 0 for a level pan.
        speed: largest speed of the pan in space (m/s); infinite if there is no such limit, null in JSON.
        acceleration: largest pan acceleration in space (m/s^2).
        jerk: largest change of the pan acceleration in space from one sample to the next, over dt (m/s^3).

    Raises:
        InputError: a limit is no number, not greater than zero (the height: less than zero), outside USABLE, or a reach
            or height beyond FARTHEST_REACH; some but the speed are infinite and some are not;
            or the jerk is so small that the acceleration takes more than LONGEST_RAMP to come to its limit.
    """

    OPTIONAL: ClassVar = ("height", "speed")

    pan_reach: float = 0.2
    _: KW_ONLY
    height: float = 0.0
    speed: float = math.inf
    acceleration: float = 30.0
    jerk: float = 10_000.0

    def __post_init__(self) -> None:
        for name, unit in UNITS.items():
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
                raise InputError(f"limit {name} must be a number, got {value!r}", name)
            if name == "height" and not value >= 0.0:
                raise InputError(f"limit height must be at least 0 m, which is a level pan, got {value:g} m", name)
            if name != "height" and not value > 0.0:
                raise InputError(f"limit {name} must be greater than 0 {unit}, got {value:g} {unit}", name)
            object.__setattr__(self, name, float(value))
        if len({math.isinf(value) for name, value in vars(self).items() if name != "speed"}) > 1:
            # Whether the pan can stop inside a reach is no question without a bound on how hard it may brake.
            values = ", ".join(f"{name} {value:g}" for name, value in vars(self).items())
            raise InputError(f"limits contradict each other: all but the speed must be finite, or none: {values}")
        if not self.finite:
            return
        for name in ("pan_reach", "height"):
            value = getattr(self, name)
            if value > FARTHEST_REACH:
                raise InputError(
                    f"limit {name} must be at most {FARTHEST_REACH:g} m, got {value:g} m: is it in millimetres? "
                    f"Then give {value / 1e3:g} m",
                    name,
                )
        for name, unit in UNITS.items():
            value = getattr(self, name)
            absent = (name == "height" and value == 0.0) or (name == "speed" and math.isinf(value))
            if not absent and not USABLE[0] <= value <= USABLE[1]:
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

    @property
    def level(self) -> bool:
        """Whether the pan stays in its plane."""
        return self.height == 0.0

    @classmethod
    def named(cls, name: str) -> Self:
        """Return the limits of an arm that people own, or `default`.

        Raises:
            InputError: there are none of that name.
        """
        if name not in NAMED:
            raise InputError(f"there are no limits named {name!r}: known are {', '.join(NAMED)}", "limits")
        return cls(**NAMED[name])

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON document; no limit on the speed is null."""
        return {name: None if math.isinf(value) else value for name, value in super().to_dict().items()}

    @classmethod
    def from_dict(cls, document: object, where: str | None = None) -> Self:
        """Read the JSON document; see `Parameters.from_dict`.

        The height and the speed may be absent, as they are in older documents: a level pan, no limit on its speed.
        """
        if isinstance(document, Mapping) and document.get("speed", 0.0) is None:
            document = {name: value for name, value in document.items() if name != "speed"}
        return super().from_dict(document, where)


NAMED: Mapping[str, Mapping[str, float]] = {
    "default": {},
    "panda": {"height": 0.1, "speed": 1.7, "acceleration": 13.0, "jerk": 6_500.0},
    "fr3": {"height": 0.1, "speed": 3.0, "acceleration": 9.0, "jerk": 4_500.0},
}
"""Limits by name: the defaults, and the published ones of Franka's Panda and FR3 with a pan that lifts."""

NO_LIMITS = Limits(math.inf, height=math.inf, acceleration=math.inf, jerk=math.inf)
"""Leaves the network's accelerations as they are: to compare it with itself, not to move anything."""
