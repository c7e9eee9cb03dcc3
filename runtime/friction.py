"""Friction coefficients; the law they stand in is `runtime.physics.law`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from runtime.documents.parameters import Parameters
from runtime.errors import InputError

MAX_COEFFICIENT = 10.0
"""Largest friction coefficient accepted: rubber on rubber stays under 2; beyond 10 it is a slip of the pen."""


@dataclass(frozen=True)
class Friction(Parameters):
    """Coulomb friction between pan and object.

    Attributes:
        static: coefficient mu at rest, dimensionless.
        kinetic: coefficient mu' while sliding, dimensionless, at most `static`.

    Raises:
        InputError: a coefficient is not finite, negative, above 10, or kinetic exceeds static.
    """

    static: float = 1.0
    kinetic: float = 0.5

    def __post_init__(self) -> None:
        for name in ("static", "kinetic"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
                raise InputError(f"friction {name} must be a number, got {value!r}", name)
            if not math.isfinite(value):
                raise InputError(f"friction {name} must be finite, got {value}", name)
            if not 0.0 <= value <= MAX_COEFFICIENT:
                raise InputError(f"friction {name} must be between 0 and {MAX_COEFFICIENT:g}, got {value:g}", name)
            object.__setattr__(self, name, float(value))
        if self.kinetic > self.static:
            raise InputError(f"kinetic friction {self.kinetic:g} must not exceed static friction {self.static:g}")

    def corners(self, share: float) -> tuple[Self, ...]:
        """Return this friction with both coefficients lower and higher by a share, in all four ways.

        The kinetic one stays at most the static one, and both at most MAX_COEFFICIENT.
        """
        low, high = 1.0 - share, 1.0 + share
        return tuple(
            type(self)(static, min(self.kinetic * kinetic, static))
            for static in (min(self.static * each, MAX_COEFFICIENT) for each in (low, high))
            for kinetic in (low, high)
        )
