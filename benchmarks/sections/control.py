"""What a controller that embeds the planner has to count on: deadlines, the governor's price, start and memory."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import Self

import numpy as np

import runtime
from benchmarks.harness.timing import Spread, interleave
from benchmarks.suite.families import SAMPLES, spline
from runtime.documents.checks import FloatArray
from runtime.errors import SlideError
from runtime.limits import NO_LIMITS
from runtime.network.bundle import bundle_path
from runtime.physics.law import rollout
from runtime.physics.pan import integrate_pan
from runtime.planner import DEFAULT_BUNDLE, Planner

STEPS = 10_000
"""Stream steps timed: enough for the 99.9th percentile to be that of ten of them."""

SHARE_ROUNDS = 128
"""Plans timed with and without the governor; both take the suite's spline commands in turn."""

START_ROUNDS = 5

FIRST_PLAN = """
import sys
import numpy as np
from runtime import Planner
Planner(sys.argv[1]).plan(np.zeros((1200, 2)))
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""
"""What a process does up to its first plan; it prints its largest resident set (KiB), which is
asked of /proc: what getrusage says begins with the parent's."""


@dataclass(frozen=True)
class Percentiles:
    """Durations (s): half, 99 % and 99.9 % of `count` are below."""

    p50: float
    p99: float
    p999: float
    count: int

    @classmethod
    def of(cls, values: FloatArray) -> Self:
        """Sum up durations (n,)."""
        p50, p99, p999 = np.percentile(values, [50.0, 99.0, 99.9]).tolist()
        return cls(p50, p99, p999, len(values))


@dataclass(frozen=True)
class Control:
    """Everything this section measures.

    Attributes:
        step: time of a stream's step (s).
        governor_share: share of the planning time that the governor takes, median over rounds.
        first_plan: time from process start to the first plan and exit (s).
        memory: largest resident set of that process (bytes).
    """

    step: Percentiles
    governor_share: float
    first_plan: Spread
    memory: float


def measure(planner: Planner, model: Path | None) -> Control:
    """Measure one bundle.

    Raises:
        SlideError: the process that plans once failed.
    """
    first_plan, memory = _first_plan(model, START_ROUNDS)
    return Control(_step_times(planner, STEPS), _governor_share(planner, SHARE_ROUNDS), first_plan, memory)


def _step_times(planner: Planner, count: int) -> Percentiles:
    """Time stream steps in closed loop with the law, command after command."""
    durations = np.empty(count)
    steps = _steps(planner)
    for index in range(count):
        durations[index] = next(steps)
    return Percentiles.of(durations)


def _steps(planner: Planner) -> Iterator[float]:
    """Follow the spline commands one after the other, and yield the time of each step (s)."""
    manifest = planner.bundle.manifest
    for position in cycle(spline().positions):
        stream = planner.stream(position)
        pan = np.zeros((manifest.chunk, 4))
        sliding = np.tile([*position[0], 0.0, 0.0], (manifest.chunk, 1))
        for _ in range(SAMPLES // manifest.chunk):
            begin = time.perf_counter()
            u = stream.step(pan, sliding)
            yield time.perf_counter() - begin
            pan, sliding = integrate_pan(pan[-1], u), rollout(sliding[-1], u, manifest.friction)


def _governor_share(planner: Planner, rounds: int) -> float:
    """Plan with and without limits in turn; the pairs are of the same command."""
    free, governed = cycle(spline().positions), cycle(spline().positions)
    actions = {
        "free": lambda: planner.plan(next(free), limits=NO_LIMITS),
        "governed": lambda: planner.plan(next(governed)),
    }
    durations = interleave(actions, rounds)
    return float(np.median(1.0 - durations["free"] / durations["governed"]))


def _first_plan(model: Path | None, rounds: int) -> tuple[Spread, float]:
    """Start a process that plans once: its time (s), and its largest resident set (bytes).

    Raises:
        SlideError: it failed.
    """
    root = Path(runtime.__file__).resolve().parent.parent
    paths = [str(root), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in paths if path)}
    arguments = [sys.executable, "-c", FIRST_PLAN, str(bundle_path(model or DEFAULT_BUNDLE).resolve())]
    durations, memory = [], 0.0
    for _ in range(rounds + 1):  # the first one fills the disc cache and does not count
        begin = time.perf_counter()
        done = subprocess.run(arguments, env=environment, capture_output=True, text=True, check=False)
        durations.append(time.perf_counter() - begin)
        if done.returncode:
            raise SlideError(f"a process that plans once failed: {done.stderr.strip()}")
        memory = float(done.stdout) * 1024.0
    return Spread.of(np.array(durations[1:])), memory
