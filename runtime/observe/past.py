"""What the pan was told: its accelerations, sample by sample, as far back as a late reading may reach."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.physics.law import DT

KEPT = 600
"""Samples that are kept at least: a reading that is older is of no use."""


class Past(NamedTuple):
    """The last accelerations up to sample `end`; samples are counted from the beginning.

    Attributes:
        u: (n, d) pan acceleration (m/s^2); row n - 1 acts from sample `end` - 1 to `end`.
        velocity: (n, d) pan velocity (m/s) by these alone, after each.
        end: number of samples since the beginning.
        kept: most samples that are kept.
    """

    u: FloatArray
    velocity: FloatArray
    end: int
    kept: int = KEPT

    @classmethod
    def still(cls, u: FloatArray, velocity: FloatArray, kept: int = KEPT) -> Self:
        """Return what was before the beginning: the pan at one acceleration and one velocity, each (d,)."""
        return cls(np.tile(u, (kept, 1)), np.tile(velocity, (kept, 1)), 0, kept)

    @property
    def begin(self) -> int:
        """The first sample that is known."""
        return self.end - len(self.u)

    def then(self, u: FloatArray) -> Self:
        """Return it with (m, d) accelerations more."""
        velocity = self.velocity[-1] + np.cumsum(u, axis=0) * DT
        u, velocity = np.concatenate([self.u, u]), np.concatenate([self.velocity, velocity])
        return self._replace(u=u[-self.kept :], velocity=velocity[-self.kept :], end=self.end + len(u) - len(self.u))

    def until(self, end: int) -> Self:
        """Return it as it was at an earlier sample."""
        left = len(self.u) - (self.end - end)
        return self._replace(u=self.u[:left], velocity=self.velocity[:left], end=end)

    def between(self, first: int, last: int) -> FloatArray:
        """Return (last - first, d) accelerations from one sample to another, both known."""
        return self.u[first - self.begin : last - self.begin]
