"""What moved: accelerations of the pan, with the states of pan and object that they lead to."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from runtime.documents.checks import FloatArray


class Decoded(NamedTuple):
    """What B commands of n chunks became; rows as in `runtime.plan`, and past the end of a command.

    Attributes:
        acceleration: (B, nC, 2) of the pan (m/s^2).
        asked: (B, nC, 2) what the network asked for (m/s^2).
        pan: (B, nC + 1, 4) pan position (m) and velocity (m/s).
        sliding: (B, nC + 1, 4) object position (m) and velocity (m/s), relative to the pan.
    """

    acceleration: FloatArray
    asked: FloatArray
    pan: FloatArray
    sliding: FloatArray

    def one(self, index: int) -> Decoded:
        """Return what one command became, without the axis B."""
        return Decoded(*(part[index] for part in self))


def tracking_error(object_position: FloatArray, command_position: FloatArray) -> tuple[float, float]:
    """Return the root mean square and the largest distance (m) between object and command, each (K, 2) (m)."""
    error = _lengths(object_position - command_position)
    return float(np.sqrt(np.mean(error * error))), float(error.max())


def _lengths(vectors: FloatArray) -> FloatArray:
    """Return the Euclidean lengths (...) of (..., 2) vectors."""
    return np.hypot(vectors[..., 0], vectors[..., 1])
