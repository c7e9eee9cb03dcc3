"""How fast the runtime plans, on one thread: the network beside torch eager, the law alone, the whole program."""

from __future__ import annotations

import csv
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.harness.section import Measured, Section, Subject
from benchmarks.harness.tables import span, targets_table
from benchmarks.harness.targets import MILLISECONDS, SAMPLES_PER_SECOND, SECONDS, TIMES, Target, Verdict
from benchmarks.harness.timing import Spread, environment_with_runtime, interleave, one_torch_thread
from benchmarks.suite.families import NOMINAL, SAMPLES, shapes, spline
from runtime.cli.console import BAD_INPUT
from runtime.cli.plan import PAPER_SAMPLES_PER_SECOND
from runtime.compilation import compile_law
from runtime.documents.checks import FloatArray
from runtime.errors import MissingExtraError, SlideError, extra
from runtime.network.bundle import Bundle
from runtime.network.reader import chunk_samples
from runtime.network.units import OBSERVED, READ
from runtime.physics.law import slide_batch, slide_one
from runtime.planner import Planner

LAW_SAMPLES = 300
"""Samples of a trajectory by which the law alone is timed."""

SLIDE_PLAN = "from runtime.cli.plan import plan_main; plan_main()"
"""What the installed script `slide-plan` runs."""


@dataclass(frozen=True)
class SpeedSettings:
    """How much is timed.

    Attributes:
        single_rounds: single plans; at least 30 for a percentile to mean something.
        batch: commands that are planned at once.
        batch_rounds: times that this is done.
        law_rounds: of the law alone.
        law_batches: numbers of trajectories at which the batched law is timed against the scalar one in a loop.
        process_rounds: runs of `slide-plan`.
        large_rounds: single plans of the large network.
        large_units: its LSTM units per layer; 1024 are the paper's.
    """

    single_rounds: int = 60
    batch: int = 64
    batch_rounds: int = 10
    law_rounds: int = 7
    law_batches: tuple[int, ...] = (8, 16, 24, 32, 48, 64, 96, 128)
    process_rounds: int = 5
    large_rounds: int = 12
    large_units: int = 1024


@dataclass(frozen=True)
class PlanningSpeed:
    """How fast commands are planned.

    Attributes:
        commands: commands planned at once.
        samples: samples in a command, K.
        samples_per_second: of the runtime, per round.
        torch_samples_per_second: of torch eager; None if it was not measured.
        ratio_to_torch: of the two, median of the ratios round by round; None if torch was not measured.
    """

    commands: int
    samples: int
    samples_per_second: Spread
    torch_samples_per_second: Spread | None
    ratio_to_torch: float | None


@dataclass(frozen=True)
class NetworkSpeed:
    """How fast the network alone is, a command at a time, without the law, the governor and the judging.

    Attributes:
        step: average time of a plan's decoder steps (s).
        step_ratio_to_torch: torch eager's over it, median of the ratios round by round.
        ratio_to_torch: the same of all of the network's work for a plan, the encoder included.
    """

    step: Spread
    step_ratio_to_torch: float
    ratio_to_torch: float


@dataclass(frozen=True)
class LawSpeed:
    """How fast the law of friction is, without a network.

    Attributes:
        samples: samples in a trajectory.
        trajectories: most that are rolled out at once.
        scalar: time of a trajectory by the scalar law (s).
        batched: time of a trajectory by the batched law with so many of them (s).
        crossover: smallest number of trajectories at which the batched law wins; None if it never does.
    """

    samples: int
    trajectories: int
    scalar: float
    batched: float
    crossover: int | None


@dataclass(frozen=True)
class Speed:
    """Everything this section measures.

    Attributes:
        single, batch: of the bundle, one command at a time and as many as the settings say.
        compiled: `single` with the law run by numba, on both sides; None if numba is not installed.
        network: the network's part of `single`; None if torch is not installed.
        large: single plans of a network of the paper's size, 8-bit; None if torch is not installed.
        law: of the law of friction alone.
        slide_plan: the time from process start to written file (s).
    """

    single: PlanningSpeed
    compiled: PlanningSpeed | None
    batch: PlanningSpeed
    network: NetworkSpeed | None
    large: PlanningSpeed | None
    law: LawSpeed
    slide_plan: Spread


TARGETS = (
    Target("single.samples_per_second.median", "single plan", SAMPLES_PER_SECOND, ">=", 150e3),
    Target("single.ratio_to_torch", "single plan over torch eager", TIMES, ">=", 5.0),
    Target("compiled.samples_per_second.median", "single plan, numba's law", SAMPLES_PER_SECOND, ">=", 150e3),
    Target("compiled.ratio_to_torch", "numba's law over torch eager", TIMES, ">=", 5.0),
    Target("batch.samples_per_second.median", "batch of 64", SAMPLES_PER_SECOND, ">=", 500e3),
    Target("batch.ratio_to_torch", "batch of 64 over torch eager", TIMES),
    Target("large.samples_per_second.median", "2 x 1024 units int8", SAMPLES_PER_SECOND, ">=", 57e3),
    Target("large.ratio_to_torch", "2 x 1024 units over torch eager", TIMES, ">=", 5.5),
    Target("network.step.median", "decoder step", MILLISECONDS),
    Target("network.step_ratio_to_torch", "decoder step over torch eager", TIMES),
    Target("network.ratio_to_torch", "encoder and steps over torch eager", TIMES),
    Target("law.scalar", "law of 300 samples, scalar", MILLISECONDS),
    Target("law.batched", "law of 300 samples, batched", MILLISECONDS),
    Target("slide_plan.median", "slide-plan, start to file", SECONDS, "<=", 1.5),
)


def measure_speed(subject: Subject, settings: SpeedSettings) -> Measured:
    """Measure the speed of one bundle, beside torch eager where torch is installed.

    Raises:
        SlideError: `slide-plan` failed.
    """
    try:
        with extra("train"):
            from benchmarks.peers.torch_eager import EagerPlanner
    except MissingExtraError as error:
        return Measured(_speed(subject, None, settings), [f"torch eager is left out: {error}"])
    with one_torch_thread():
        return Measured(_speed(subject, EagerPlanner(subject.folder), settings))


def _speed(subject: Subject, eager: Planner | None, settings: SpeedSettings) -> Speed:
    planner, rounds = subject.planner, settings.single_rounds
    return Speed(
        single=planning_speed(planner, eager, 1, rounds),
        compiled=compiled_speed(planner, eager, rounds),
        batch=planning_speed(planner, eager, settings.batch, settings.batch_rounds),
        network=None if eager is None else network_speed(planner, eager, rounds),
        large=None if eager is None else large_speed(settings.large_units, settings.large_rounds),
        law=law_speed(settings.law_batches, settings.law_rounds),
        slide_plan=process_time(subject.folder, settings.process_rounds),
    )


def planning_speed(planner: Planner, eager: Planner | None, commands: int, rounds: int) -> PlanningSpeed:
    """Plan spline commands, `commands` at a time, with the runtime and with torch eager in turn."""
    planners = {"ours": planner} if eager is None else {"ours": planner, "torch": eager}
    durations = interleave({name: _action(each, commands) for name, each in planners.items()}, rounds)
    rates = {name: Spread.of(commands * SAMPLES / duration) for name, duration in durations.items()}
    ratio = None if eager is None else float(np.median(durations["torch"] / durations["ours"]))
    return PlanningSpeed(commands, SAMPLES, rates["ours"], rates.get("torch"), ratio)


def compiled_speed(planner: Planner, eager: Planner | None, rounds: int) -> PlanningSpeed | None:
    """Plan as `single` does, with the law run by numba."""
    try:
        return planning_speed(planner, eager, 1, rounds) if compile_law() else None
    finally:
        compile_law(False)


def network_speed(planner: Planner, eager: Planner, rounds: int) -> NetworkSpeed:
    """Run the graphs as a plan does, the encoder once and then step after step, with both engines in turn."""
    rng, steps = np.random.default_rng(0), -(-SAMPLES // chunk_samples(planner.bundle.manifest.limits))
    command = rng.uniform(-0.1, 0.1, (1, steps // 2, READ)).astype(np.float32)
    observation = rng.uniform(-0.1, 0.1, (1, OBSERVED)).astype(np.float32)

    def encode(bundle: Bundle) -> Callable[[], object]:
        return lambda: bundle.encode(command)

    def decode(bundle: Bundle) -> Callable[[], object]:
        def run() -> None:
            state = begin
            for _ in range(steps):
                _, state = bundle.decode_step(observation, state)

        begin = bundle.encode(command)
        return run

    bundles = {"ours": planner.bundle, "torch": eager.bundle}
    encoding = interleave({name: encode(bundle) for name, bundle in bundles.items()}, rounds)
    decoding = interleave({name: decode(bundle) for name, bundle in bundles.items()}, rounds)
    whole = {name: encoding[name] + decoding[name] for name in bundles}
    return NetworkSpeed(
        Spread.of(decoding["ours"] / steps),
        float(np.median(decoding["torch"] / decoding["ours"])),
        float(np.median(whole["torch"] / whole["ours"])),
    )


def large_speed(units: int, rounds: int) -> PlanningSpeed:
    """Plan with a network of two layers of `units`, 8-bit, and the same size on torch eager, in turn."""
    from benchmarks.peers.large import write_large
    from benchmarks.peers.torch_eager import EagerPlanner

    with tempfile.TemporaryDirectory() as folder:
        bundle = write_large(Path(folder), units)
        return planning_speed(Planner(bundle), EagerPlanner(bundle), 1, rounds)


def _action(planner: Planner, commands: int) -> Callable[[], object]:
    """Return what one round does: the next spline command planned, or the first ones at once."""
    positions = spline().positions
    if commands > 1:
        return lambda: planner.plan_batch(positions[:commands])
    one_by_one = cycle(positions)
    return lambda: planner.plan(next(one_by_one), candidates=1)


def law_speed(batches: Sequence[int], rounds: int) -> LawSpeed:
    """Time the scalar and the batched law on trajectories that stick and slide."""
    rng = np.random.default_rng(0)
    held = rng.standard_normal((batches[-1], -(-LAW_SAMPLES // 20), 2)) * 8.0
    u = np.repeat(held, 20, axis=1)[:, :LAW_SAMPLES]
    actions = {"scalar": _scalar_law(u[:8])} | {f"{size}": _batched_law(u[:size]) for size in batches}
    # The quickest round of each: which law wins must not depend on what else the machine was doing.
    times = {name: float(each.min()) for name, each in interleave(actions, rounds).items()}
    scalar = times["scalar"] / 8
    wins = [size for size in batches if times[f"{size}"] < size * scalar]
    each = times[f"{batches[-1]}"] / batches[-1]
    return LawSpeed(LAW_SAMPLES, batches[-1], scalar, each, min(wins, default=None))


def _scalar_law(u: FloatArray) -> Callable[[], object]:
    start = np.zeros(4)
    return lambda: [slide_one(start, each, NOMINAL) for each in u]


def _batched_law(u: FloatArray) -> Callable[[], object]:
    start = np.zeros((len(u), 4))
    return lambda: slide_batch(start, u, NOMINAL.static, NOMINAL.kinetic)


def process_time(model: Path, rounds: int) -> Spread:
    """Time `slide-plan` on a figure eight, from the start of the process to the plan on the disc (s).

    Raises:
        SlideError: it failed, or wrote no plan.
    """
    environment = environment_with_runtime()
    durations = []
    with tempfile.TemporaryDirectory() as folder:
        command_file, plan_file = Path(folder) / "command.csv", Path(folder) / "plan.json"
        write_command(command_file, shapes().positions[shapes().labels.index("eight 0.05 m")])
        arguments = [sys.executable, "-c", SLIDE_PLAN, str(command_file), "-o", str(plan_file), "--model", str(model)]
        for _ in range(rounds + 1):  # the first one fills the disc cache and does not count
            plan_file.unlink(missing_ok=True)
            durations.append(_run(arguments, environment))
            if not plan_file.exists():
                raise SlideError("slide-plan wrote no plan")
    return Spread.of(np.array(durations[1:]))


def _run(arguments: Sequence[str], environment: dict[str, str]) -> float:
    begin = time.perf_counter()
    done = subprocess.run(arguments, env=environment, capture_output=True, text=True, check=False)
    duration = time.perf_counter() - begin
    if done.returncode < 0 or done.returncode >= BAD_INPUT:
        raise SlideError(f"slide-plan failed with exit code {done.returncode}: {done.stderr.strip()}")
    return duration


def write_command(path: Path, position: FloatArray) -> None:
    """Write positions (K, 2) (m) at 1 kHz as a command file."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["x", "y"])
        writer.writerows(position.tolist())


def speed_tables(speed: Speed, verdicts: Sequence[Verdict]) -> list[Table]:
    """Return the speed of planning, beside its targets."""
    details = {
        f"{name}.samples_per_second.median": _planning_rows(planning)
        for name in ("single", "compiled", "batch", "large")
        if (planning := getattr(speed, name)) is not None
    }
    details["slide_plan.median"] = [span(speed.slide_plan, SECONDS)]
    law = speed.law
    wins = f"> {law.trajectories}" if law.crossover is None else f"{law.crossover}"
    details["law.batched"] = [("  of so many at once", f"{law.trajectories}"), ("  batched wins from", wins)]
    return targets_table("Speed, one thread", verdicts, details)


def _planning_rows(speed: PlanningSpeed) -> list[tuple[str, str]]:
    ours, torch = speed.samples_per_second, speed.torch_samples_per_second
    return [
        span(ours, SAMPLES_PER_SECOND),
        (f"  over the paper's {PAPER_SAMPLES_PER_SECOND:g}", f"{ours.median / PAPER_SAMPLES_PER_SECOND:,.0f} x"),
        *([] if torch is None else [("  torch eager", SAMPLES_PER_SECOND.text(torch.median))]),
    ]


SECTION = Section(
    "speed",
    "samples planned per second, beside torch eager; the law alone; slide-plan from start to file",
    SpeedSettings(),
    measure_speed,
    TARGETS,
    speed_tables,
    timed=True,
)
