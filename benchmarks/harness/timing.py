"""Timing on a machine that is never quite idle: interleaved rounds, medians and percentiles, one thread."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

import runtime
from runtime.documents.checks import FloatArray
from runtime.errors import extra


@dataclass(frozen=True)
class Spread:
    """Repeated measurements of one figure, in its own unit.

    Attributes:
        median: half of them are below.
        p10, p90, p99, p999: 10 %, 90 %, 99 % and 99.9 % of them are below, interpolated where there are few.
        count: number of measurements.
    """

    median: float
    p10: float
    p90: float
    p99: float
    p999: float
    count: int

    @classmethod
    def of(cls, values: FloatArray) -> Self:
        """Sum up the measurements (n,)."""
        median, p10, p90, p99, p999 = np.percentile(values, [50.0, 10.0, 90.0, 99.0, 99.9]).tolist()
        return cls(median, p10, p90, p99, p999, len(values))


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


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Run torch on one thread: more would wait for each other at small tensors, and count as time.

    Raises:
        MissingExtraError: torch is not installed.
    """
    with extra("train"):
        import torch
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    with suppress(RuntimeError):  # can be set once, before the first of them starts; then nothing here uses them
        torch.set_num_interop_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def environment_with_runtime() -> dict[str, str]:
    """Return this process's environment for another one that imports the same `runtime`, wherever it starts."""
    root = Path(runtime.__file__).resolve().parent.parent
    paths = [str(root), os.environ.get("PYTHONPATH", "")]
    return os.environ | {"PYTHONPATH": os.pathsep.join(path for path in paths if path)}
