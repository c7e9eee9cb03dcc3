"""What a controller that embeds the planner has to count on: deadlines, the governor's price, start and memory."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.harness.section import Measured, Section, Subject
from benchmarks.harness.tables import span, targets_table
from benchmarks.harness.targets import MEGABYTES, MILLISECONDS, PERCENT, SECONDS, Target, Verdict
from benchmarks.harness.timing import Spread, environment_with_runtime, interleave
from benchmarks.suite.families import SAMPLES, spline
from runtime.errors import SlideError
from runtime.limits import NO_LIMITS
from runtime.physics.law import slide_one
from runtime.physics.pan import integrate_pan
from runtime.planner import Planner

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
class ControlSettings:
    """How much is timed.

    Attributes:
        steps: of streams; 10,000 are enough for the 99.9th percentile to be that of ten of them.
        share_rounds: plans with and without the governor; both take the suite's spline commands in turn.
        start_rounds: processes that plan once.
    """

    steps: int = 10_000
    share_rounds: int = 128
    start_rounds: int = 5


@dataclass(frozen=True)
class Control:
    """Everything this section measures.

    Attributes:
        step: time of a stream's step (s).
        governor_share: share of the planning time that the governor takes, median over rounds.
        first_plan: time from process start to the first plan and exit (s).
        memory: largest resident set of that process (bytes).
    """

    step: Spread
    governor_share: float
    first_plan: Spread
    memory: float


TARGETS = (
    Target("step.median", "stream step, median", MILLISECONDS, "<=", 0.35e-3),
    Target("step.p99", "stream step, 99 %", MILLISECONDS, "<=", 1e-3),
    Target("step.p999", "stream step, 99.9 %", MILLISECONDS),
    Target("governor_share", "governor's share of planning", PERCENT, "<=", 0.15),
    Target("first_plan.median", "process start to first plan", SECONDS, "<=", 0.5),
    Target("memory", "memory of it", MEGABYTES, "<=", 110e6),
)


def measure_control(subject: Subject, settings: ControlSettings) -> Measured:
    """Measure what a controller waits for, and what it holds.

    Raises:
        SlideError: the process that plans once failed.
    """
    planner = subject.planner
    first_plan, memory = _first_plan(subject.folder, settings.start_rounds)
    steps, share = _step_times(planner, settings.steps), _governor_share(planner, settings.share_rounds)
    return Measured(Control(steps, share, first_plan, memory))


def _step_times(planner: Planner, count: int) -> Spread:
    """Time stream steps in closed loop with the law, command after command."""
    durations = np.empty(count)
    steps = _steps(planner)
    for index in range(count):
        durations[index] = next(steps)
    return Spread.of(durations)


def _steps(planner: Planner) -> Iterator[float]:
    """Follow the spline commands one after the other, and yield the time of each step (s)."""
    manifest = planner.bundle.manifest
    for position in cycle(spline().positions):
        stream = planner.stream(position)
        pan = np.zeros((stream.chunk, 6))
        sliding = np.tile([*position[0], 0.0, 0.0], (stream.chunk, 1))
        for _ in range(SAMPLES // stream.chunk):
            begin = time.perf_counter()
            u = stream.step(pan, sliding)
            yield time.perf_counter() - begin
            pan, sliding = integrate_pan(pan[-1], u), slide_one(sliding[-1], u, manifest.friction)


def _governor_share(planner: Planner, rounds: int) -> float:
    """Plan with and without limits in turn; the pairs are of the same command."""
    free, governed = cycle(spline().positions), cycle(spline().positions)
    actions = {
        "free": lambda: planner.plan(next(free), limits=NO_LIMITS),
        "governed": lambda: planner.plan(next(governed)),
    }
    durations = interleave(actions, rounds)
    return float(np.median(1.0 - durations["free"] / durations["governed"]))


def _first_plan(model: Path, rounds: int) -> tuple[Spread, float]:
    """Start a process that plans once: its time (s), and its largest resident set (bytes).

    Raises:
        SlideError: it failed.
    """
    environment = environment_with_runtime()
    arguments = [sys.executable, "-c", FIRST_PLAN, str(model)]
    durations, memory = [], 0.0
    for _ in range(rounds + 1):  # the first one fills the disc cache and does not count
        begin = time.perf_counter()
        done = subprocess.run(arguments, env=environment, capture_output=True, text=True, check=False)
        durations.append(time.perf_counter() - begin)
        if done.returncode:
            raise SlideError(f"a process that plans once failed: {done.stderr.strip()}")
        memory = float(done.stdout) * 1024.0
    return Spread.of(np.array(durations[1:])), memory


def control_tables(control: Control, verdicts: Sequence[Verdict]) -> list[Table]:
    """Return what a controller has to count on, beside its targets."""
    details = {"first_plan.median": [span(control.first_plan, SECONDS)]}
    return targets_table(f"In a controller, one thread, {control.step.count:,} steps", verdicts, details)


SECTION = Section(
    "control",
    "a controller's figures: stream steps, the governor's share, start and memory",
    ControlSettings(),
    measure_control,
    TARGETS,
    control_tables,
    timed=True,
)
