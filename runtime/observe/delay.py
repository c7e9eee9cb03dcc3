"""How late the arm executes what it is told, from what its encoders say."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.observe.past import Past
from runtime.physics.law import DT

LONGEST = 100
"""Longest delay that is looked for (samples)."""

SPACING = 10
"""Samples between two readings that count."""

MEMORY = 150.0
"""Readings after which the oldest ones count a third: 1.5 s."""

ENOUGH = 20
"""Readings that are needed before a delay is told."""

CLEAR = 4.0
"""How many times worse than the best delay the mean one must explain the readings: a pan that rests tells nothing."""

SMALLEST = 1e-4
"""Mean square of the speed (m^2/s^2) above which the pan has moved enough to tell."""


class DelaySearch(NamedTuple):
    """How well each delay, from none to LONGEST samples, explains the readings so far; a value.

    Attributes:
        readings: their number, older ones counting less.
        first: (LONGEST + 1, d) sum of the differences between measured and commanded velocity (m/s), for each delay.
        second: (LONGEST + 1,) sum of their squares.
        speeds: sum of the squares of the commanded velocity (m^2/s^2).
        last: sample of the last reading that counted.
    """

    readings: float
    first: FloatArray
    second: FloatArray
    speeds: float
    last: int

    @classmethod
    def begin(cls, axes: int) -> Self:
        """Return what is known before the first reading."""
        return cls(0.0, np.zeros((LONGEST + 1, axes)), np.zeros(LONGEST + 1), 0.0, -SPACING)

    def see(self, at: int, velocity: FloatArray, past: Past) -> Self:
        """Take in a pan velocity (d,) that was measured at a sample (m/s)."""
        newest = at - past.begin
        if at - self.last < SPACING or not LONGEST < newest <= len(past.u):
            return self
        commanded = past.velocity[newest - 1 - LONGEST : newest][::-1]
        apart = velocity - commanded
        kept = 1.0 - 1.0 / MEMORY
        return type(self)(
            kept * self.readings + 1.0,
            kept * self.first + apart,
            kept * self.second + (apart * apart).sum(axis=1),
            kept * self.speeds + float(commanded[0] @ commanded[0]),
            at,
        )

    def again(self) -> Self:
        """Return it for samples that are counted from another beginning."""
        return self._replace(last=-SPACING)

    @property
    def delay(self) -> float | None:
        """The delay that explains the readings best (s); None while they tell too little.

        A constant difference of the velocities is no delay, and does not count.
        """
        if self.readings < ENOUGH or self.speeds < SMALLEST * self.readings:
            return None
        left = self.second - (self.first * self.first).sum(axis=1) / self.readings
        best = int(left.argmin())
        if left.mean() < CLEAR * left[best]:
            return None
        if not 0 < best < LONGEST:
            return best * DT
        before, at, after = left[best - 1 : best + 2].tolist()
        bend = before - 2.0 * at + after
        return (best + (0.5 * (before - after) / bend if bend > 0.0 else 0.0)) * DT
