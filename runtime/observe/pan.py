"""Where the pan is, from what it was told and what its encoders say.

One rule holds: a reading is believed as far as the one before it agrees. Of three differences from what was commanded,
none, the last reading's and this one's, the middle one counts, in each coordinate. So one false reading, however large,
moves nothing; what is true moves the pan by the next reading; and half of the noise is gone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from runtime.documents.checks import FloatArray

APART = 10
"""Samples between the two of many rows that are compared: a glitch is shorter."""

DISTANCE, SPEED = 0.005, 0.1
"""Difference (m, m/s) up to which a pan is where it was told to be, noise and lag included."""


class Offset(NamedTuple):
    """How a reading of the pan differs from what is believed.

    Attributes:
        believed: (2d,) what of the difference is believed: position (m), velocity (m/s).
        rest: (2d,) the rest of it.
    """

    believed: FloatArray
    rest: FloatArray

    @property
    def doubted(self) -> bool:
        """Whether the reading cannot be true as it is."""
        return large(self.rest)

    @property
    def moved(self) -> bool:
        """Whether the pan is believed to be elsewhere than it was told."""
        return large(self.believed)


def agree(before: FloatArray, now: FloatArray, time: float) -> Offset:
    """Compare a reading with the one before it.

    Args:
        before: (2d,) what of the last reading's difference was not believed: position (m), velocity (m/s).
        now: (2d,) this one's difference from the prediction.
        time: between the two (s).
    """
    axes = len(now) // 2
    moved = before.copy()
    moved[:axes] += before[axes:] * time
    believed = np.clip(0.0, np.minimum(moved, now), np.maximum(moved, now))
    return Offset(believed, now - believed)


def large(difference: FloatArray) -> bool:
    """Whether a difference (..., 2d) of position and velocity is more than noise and lag."""
    axes = difference.shape[-1] // 2
    size = np.abs(difference)
    return bool(size[..., :axes].max() > DISTANCE or size[..., axes:].max() > SPEED)
