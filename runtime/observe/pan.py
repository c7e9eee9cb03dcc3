"""Where the pan is, from what it was told and what its encoders say.

One rule holds: a reading is believed as far as the one before it agrees. Of three differences from what was commanded,
none, the last reading's and this one's, the middle one counts, in each coordinate. So one false reading, however large,
moves nothing. What is true moves the pan from the next reading on, at once if readings are seldom, and within SETTLING
if they are many, so that their noise is averaged.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from runtime.documents.checks import FloatArray

APART = 10
"""Samples between the two of many rows that are compared: a glitch is shorter."""

SETTLING = 0.02
"""Time (s) in which readings, however many, are believed."""

DISTANCE, SPEED = 0.01, 0.15
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


def agree(before: FloatArray, now: FloatArray, time: float, share: float = 1.0) -> Offset:
    """Compare a reading with the one before it.

    Args:
        before: (2d,) what of the last reading's difference was not believed: position (m), velocity (m/s).
        now: (2d,) this one's difference from the prediction.
        time: between the two (s).
        share: of what they agree on that is believed.
    """
    moved = along(before, time)
    believed = share * np.clip(0.0, np.minimum(moved, now), np.maximum(moved, now))
    return Offset(believed, now - believed)


def along(difference: FloatArray, time: float) -> FloatArray:
    """Return a difference of position (m) and velocity (m/s), (2d,), a time later (s)."""
    axes = len(difference) // 2
    moved = difference.copy()
    moved[:axes] += difference[axes:] * time
    return moved


def large(difference: FloatArray) -> bool:
    """Whether a difference (..., 2d) of position and velocity is more than noise and lag."""
    axes = difference.shape[-1] // 2
    size = np.abs(difference)
    return bool(size[..., :axes].max() > DISTANCE or size[..., axes:].max() > SPEED)
