"""What no command exceeds, whatever it was read from."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.errors import InputError
from runtime.physics.law import DT

MAX_DURATION = 600.0
"""Longest command (s). Nobody shakes a pan for ten minutes; a time column in milliseconds looks as if."""

MAX_SAMPLES = round(MAX_DURATION / DT) + 1

MAX_JUMP = 0.05
"""Largest distance from one 1 kHz sample to the next (m): 50 m/s, so it is a gap, another unit or a broken line."""

MAX_POSITION = 100.0
"""Largest coordinate (m): beyond it the unit is not metres, and digits of the motion begin to be lost."""

CLOCK_RESOLUTION = 1e-6
"""Times closer than this are the same time (s): what a time stamp of 1e9 s, or one of six decimals, can tell."""


def check_length(samples: int) -> None:
    """Check that there are enough positions.

    Raises:
        InputError: there are fewer than two.
    """
    if samples < 2:
        message = f"position has {samples} sample{'' if samples == 1 else 's'}, at least 2 are needed"
        raise InputError(message, "position")


def check_extent(position: FloatArray, place: Callable[[int], str] = lambda row: "") -> None:
    """Check that positions (n, 2) (m) are not out of all bounds.

    Args:
        position: the positions.
        place: what to say of a row besides its number.

    Raises:
        InputError: a coordinate is beyond MAX_POSITION; row and column are named.
    """
    for row, axis in np.argwhere(np.abs(position) > MAX_POSITION):
        raise InputError(
            f"position[{row}]{place(row)}, column {'xy'[axis]}: {position[row, axis]:g} m is beyond {MAX_POSITION:g} m "
            "(is it in metres?)",
            f"position[{row}][{axis}]",
        )
