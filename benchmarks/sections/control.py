"""What a controller that embeds the planner has to count on: deadlines, the governor's price, start, memory, sight."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import cycle, islice
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.harness.section import Measured, Section, Subject, at_least
from benchmarks.harness.tables import span, targets_table
from benchmarks.harness.targets import COUNT, MEGABYTES, MILLIMETRES, MILLISECONDS, PERCENT, SECONDS, Target, Verdict
from benchmarks.harness.timing import Spread, environment_with_runtime
from benchmarks.suite.families import SAMPLES, spline
from benchmarks.suite.sight import Place, Sight, measure_sight
from runtime.command import Command
from runtime.documents.options import option
from runtime.errors import InputError, SlideError
from runtime.network.decode import decode
from runtime.network.job import Job
from runtime.network.reach import with_reach
from runtime.network.reader import chunk_of, time_of
from runtime.physics.law import slide_one
from runtime.physics.pan import integrate_pan
from runtime.planner import Planner
from runtime.safety.governor import govern
from runtime.safety.pan import Pan
from runtime.start import Start

FIRST_PLAN = """
import sys
import numpy as np
from runtime import Planner
Planner(sys.argv[1]).plan(np.zeros((1200, 2)))
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""
"""What a process does up to its first plan; it prints its largest resident set (KiB), which is
asked of /proc: what getrusage says begins with the parent's."""


ROUNDING = 1e-9
"""What a reach may be over its limit by rounding (m)."""


@dataclass(frozen=True)
class ControlSettings:
    """How much is timed.

    Attributes:
        steps: of streams; 10,000 are enough for the 99.9th percentile to be that of ten of them.
        share_rounds: plans with and without the governor; both take the suite's spline commands in turn.
        start_rounds: processes that plan once.
        sight_commands: commands of the family spline that are followed by each kind of eyes.
        false_readings: streams with one false reading each.
        place: where commands are followed; on a simulated arm nobody pushes, and friction is one coefficient.
    """

    steps: int = 10_000
    share_rounds: int = 128
    start_rounds: int = 5
    sight_commands: int = option("Commands that are followed by each kind of eyes, up to 64.", 20, "N")
    false_readings: int = option("Streams with one false reading each.", 1000, "N")
    place: Place = option("Where commands are followed: in the law's world, or on a simulated arm.", Place.LAW)

    def __post_init__(self) -> None:
        at_least(1, sight_commands=self.sight_commands)
        at_least(0, false_readings=self.false_readings)
        if self.sight_commands > len(spline()):
            raise InputError(f"--sight-commands must be at most {len(spline())}, got {self.sight_commands}")


@dataclass(frozen=True)
class Control:
    """Everything this section measures.

    Attributes:
        step: time of a stream's step (s).
        governor_share: share of the planning time that the governor takes, median over rounds.
        first_plan: time from process start to the first plan and exit (s).
        memory: largest resident set of that process (bytes).
        sight: how well streams follow by what cameras and encoders tell.
    """

    step: Spread
    governor_share: float
    first_plan: Spread
    memory: float
    sight: Sight


FOLLOWED = {
    "states": "told states at 1 kHz",
    "camera_60": "60 Hz, 20 ms old",
    "camera_30": "30 Hz, 50 ms old",
    "camera_30_noise": "the same, 1 mm noise, 10 % lost",
    "object_late": "object 50 ms old, pan fresh",
    "delay_5": "arm 5 ms late",
    "delay_10": "arm 10 ms late",
    "delay_20": "arm 20 ms late",
    "delay_found": "arm 20 ms late, not told",
}
"""Ways of seeing and acting, in words."""

BOUNDS = {
    "states": (1.35e-3, 2.6e-3),
    "camera_60": (1.35e-3, 2.6e-3),
    "camera_30": (1.4e-3, 2.8e-3),
    "camera_30_noise": (1.7e-3, 3.2e-3),
    "object_late": (1.4e-3, None),
    "delay_5": (1.5e-3, None),
    "delay_10": (1.7e-3, None),
    "delay_20": (2.2e-3, None),
    "delay_found": (2.2e-3, None),
}
"""The mean and the worst error (m) that each should have."""


def followed(name: str) -> tuple[Target, ...]:
    """Return the targets of a way of seeing: its mean and its worst error."""
    what, (mean, worst) = FOLLOWED[name], BOUNDS[name]
    return (
        Target(f"sight.{name}.mean", f"{what}, mean", MILLIMETRES, "<=", mean),
        Target(f"sight.{name}.worst", f"{what}, worst", MILLIMETRES, "" if worst is None else "<=", worst),
    )


TARGETS = (
    Target("step.median", "stream step, median", MILLISECONDS, "<=", 0.35e-3),
    Target("step.p99", "stream step, 99 %", MILLISECONDS, "<=", 1e-3),
    Target("step.p999", "stream step, 99.9 %", MILLISECONDS),
    Target("governor_share", "governor's share of planning", PERCENT, "<=", 0.15),
    Target("first_plan.median", "process start to first plan", SECONDS, "<=", 0.5),
    Target("memory", "memory of it", MEGABYTES, "<=", 110e6),
    *(target for name in FOLLOWED for target in followed(name)),
    Target("sight.pan_reach", "pan reach in all of these", MILLIMETRES, "<=", 0.2 + ROUNDING),
    Target("sight.slippery.later", "0.4/0.4 for 1.0/0.5, from 0.6 s on", MILLIMETRES, "<=", 1.7e-3),
    Target("sight.law.sticky.later", "0.7/0.5 for 1.0/0.5, from 0.6 s on", MILLIMETRES, "<=", 1.7e-3),
    Target("sight.law.pushed.positions", "push corrected, positions at 1 kHz", MILLISECONDS, "<=", 0.13),
    Target("sight.law.pushed.camera_30", "push corrected, 30 Hz", MILLISECONDS, "<=", 0.22),
    Target("sight.law.pushed.median", "push corrected, at 1 kHz, median command", MILLISECONDS),
    Target("sight.law.found.kinetic_median", "kinetic friction found, median error", PERCENT, "<=", 0.01),
    Target("sight.law.found.kinetic_worst", "kinetic friction found, worst error", PERCENT, "<=", 0.04),
    Target("sight.law.found.kinetic_share", "kinetic friction in its interval", PERCENT),
    Target("sight.law.found.static_share", "static friction in its interval", PERCENT, ">=", 0.95),
    Target("sight.law.outside", "one false reading, pan outside", COUNT, "<=", 0),
    Target("sight.law.p99", "frame, encoders and step, 99 %", MILLISECONDS, "<=", 0.5e-3),
)


def measure_control(subject: Subject, settings: ControlSettings) -> Measured:
    """Measure what a controller waits for, and what it holds.

    Raises:
        SlideError: the process that plans once failed.
    """
    planner = subject.planner
    first_plan, memory = _first_plan(subject.folder, settings.start_rounds)
    steps, share = _step_times(planner, settings.steps), _governor_share(planner, settings.share_rounds)
    sight = measure_sight(planner, settings.sight_commands, settings.false_readings, settings.place)
    return Measured(Control(steps, share, first_plan, memory, sight))


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
    """Return the share of a plan's time that the governor takes, of the median command."""
    manifest, shares = planner.bundle.manifest, []
    for position in islice(cycle(spline().positions), rounds):
        begin = time.perf_counter()
        planner.plan(position)
        whole = time.perf_counter() - begin
        job = with_reach(Job(Command(position), manifest.friction, manifest.limits, Start()))
        motion, _ = decode(planner.bundle, [job])
        pans: Sequence[Pan] = [Pan.at_start(job.start, job.limits)]
        chunk = chunk_of(time_of(job.limits, job.reach_used))
        asked = np.split(motion.asked, range(chunk, motion.asked.shape[1], chunk), axis=1)
        begin = time.perf_counter()
        for each in asked:
            _, _, pans = govern(pans, each)
        shares.append((time.perf_counter() - begin) / whole)
    return float(np.median(shares))


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
    for name in FOLLOWED:
        figures = getattr(control.sight, name)
        between = f"{MILLIMETRES.text(figures.median)}, {MILLIMETRES.text(figures.p90)}"
        details[f"sight.{name}.mean"] = [("  median, 90 %", between)]
    return targets_table(f"In a controller, one thread, {control.step.count:,} steps", verdicts, details)


SECTION = Section(
    "control",
    "a controller's figures: stream steps, the governor's share, start, memory, sight",
    ControlSettings(),
    measure_control,
    TARGETS,
    control_tables,
    timed=True,
)
