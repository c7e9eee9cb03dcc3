"""Timing on a machine that is never quite idle: interleaved rounds, medians and percentiles."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from runtime.documents.checks import FloatArray


@dataclass(frozen=True)
class Spread:
    """Repeated measurements of one figure, in its own unit.

    Attributes:
        median: half of them are below.
        p10: a tenth of them are below.
        p90: nine tenths of them are below.
        count: number of measurements.
    """

    median: float
    p10: float
    p90: float
    count: int

    @classmethod
    def of(cls, values: FloatArray) -> Self:
        """Sum up the measurements (n,)."""
        p10, median, p90 = np.percentile(values, [10, 50, 90]).tolist()
        return cls(median, p10, p90, len(values))


def interleave(actions: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, FloatArray]:
    """Time actions in turn, A B A B, so that whatever else the machine does hits all of them alike.

    Args:
        actions: what to time, by name; each is run once before it counts, which warms it up.
        rounds: number of times each is timed.

    Returns:
        (rounds,) durations (s), by name.
    """
    for action in actions.values():
        action()
    durations = {name: np.empty(rounds) for name in actions}
    for index in range(rounds):
        for name, action in actions.items():
            begin = time.perf_counter()
            action()
            durations[name][index] = time.perf_counter() - begin
    return durations
