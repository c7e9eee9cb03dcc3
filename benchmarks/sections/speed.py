"""How fast the runtime plans, on one thread: the network beside torch eager, the law alone, the whole program."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

import numpy as np

import runtime
from benchmarks.harness.timing import Spread, interleave
from benchmarks.suite.families import NOMINAL, SAMPLES, shapes, spline
from runtime.cli.console import BAD_INPUT
from runtime.documents.checks import FloatArray
from runtime.errors import SlideError
from runtime.network.bundle import Bundle
from runtime.physics.law import compile_law, rollout, rollout_batch
from runtime.planner import Planner

SINGLE_ROUNDS = 60
"""Single plans timed; at least 30 for a percentile to mean something."""

BATCH = 64
BATCH_ROUNDS = 10

LAW_ROUNDS = 7
LAW_SAMPLES = 300
LAW_BATCHES = (8, 16, 24, 32, 48, 64, 96, 128)
"""Numbers of trajectories at which the batched law is timed against the scalar one in a loop."""

PROCESS_ROUNDS = 5

LARGE_ROUNDS = 12

SLIDE_PLAN = "from runtime.cli.plan import plan_main; plan_main()"
"""What the installed script `slide-plan` runs."""


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
        step: time of a decoder step, on the mean of those of a plan (s).
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
        scalar: time of a trajectory by the scalar law (s).
        batched: time of a trajectory by the batched law with LAW_BATCHES[-1] of them (s).
        crossover: smallest of LAW_BATCHES at which the batched law wins; None if it never does.
    """

    samples: int
    scalar: float
    batched: float
    crossover: int | None


@dataclass(frozen=True)
class Speed:
    """Everything this section measures.

    Attributes:
        single, batch: of the bundle, one command at a time and BATCH.
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


def measure(planner: Planner, eager: Planner | None, model: Path | None) -> Speed:
    """Measure the speed of one bundle.

    Args:
        planner: the runtime's planner.
        eager: the same bundle on torch eager, None if torch is not installed.
        model: the bundle's folder, None for the shipped one.

    Raises:
        SlideError: `slide-plan` failed.
    """
    return Speed(
        single=planning_speed(planner, eager, 1, SINGLE_ROUNDS),
        compiled=compiled_speed(planner, eager),
        batch=planning_speed(planner, eager, BATCH, BATCH_ROUNDS),
        network=None if eager is None else network_speed(planner, eager),
        large=None if eager is None else large_speed(),
        law=law_speed(),
        slide_plan=process_time(model, PROCESS_ROUNDS),
    )


def planning_speed(planner: Planner, eager: Planner | None, commands: int, rounds: int) -> PlanningSpeed:
    """Plan spline commands, `commands` at a time, with the runtime and with torch eager in turn."""
    planners = {"ours": planner} if eager is None else {"ours": planner, "torch": eager}
    durations = interleave({name: _action(each, commands) for name, each in planners.items()}, rounds)
    rates = {name: Spread.of(commands * SAMPLES / duration) for name, duration in durations.items()}
    ratio = None if eager is None else float(np.median(durations["torch"] / durations["ours"]))
    return PlanningSpeed(commands, SAMPLES, rates["ours"], rates.get("torch"), ratio)


def compiled_speed(planner: Planner, eager: Planner | None) -> PlanningSpeed | None:
    """Plan as `single` does, with the law run by numba."""
    try:
        return planning_speed(planner, eager, 1, SINGLE_ROUNDS) if compile_law() else None
    finally:
        compile_law(False)


def network_speed(planner: Planner, eager: Planner) -> NetworkSpeed:
    """Run the graphs as a plan does, the encoder once and then step after step, with both engines in turn."""
    manifest, rng = planner.bundle.manifest, np.random.default_rng(0)
    steps = SAMPLES // manifest.chunk
    command = rng.uniform(-0.1, 0.1, (1, steps, 4 * manifest.chunk)).astype(np.float32)
    width = (8 + 4 * manifest.command_ahead) * manifest.chunk
    observation = rng.uniform(-0.1, 0.1, (1, width)).astype(np.float32)

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
    encoding = interleave({name: encode(bundle) for name, bundle in bundles.items()}, SINGLE_ROUNDS)
    decoding = interleave({name: decode(bundle) for name, bundle in bundles.items()}, SINGLE_ROUNDS)
    whole = {name: encoding[name] + decoding[name] for name in bundles}
    return NetworkSpeed(
        Spread.of(decoding["ours"] / steps),
        float(np.median(decoding["torch"] / decoding["ours"])),
        float(np.median(whole["torch"] / whole["ours"])),
    )


def large_speed() -> PlanningSpeed:
    """Plan with a network of the paper's size, 8-bit, and the same size on torch eager, in turn."""
    from benchmarks.peers.large import write_large
    from benchmarks.peers.torch_eager import EagerPlanner

    with tempfile.TemporaryDirectory() as folder:
        bundle = write_large(Path(folder))
        return planning_speed(Planner(bundle), EagerPlanner(bundle), 1, LARGE_ROUNDS)


def _action(planner: Planner, commands: int) -> Callable[[], object]:
    """Return what one round does: the next spline command planned, or as many as asked for at once."""
    positions = spline().positions
    if commands > 1:
        return lambda: planner.plan_batch(positions[:commands])
    one_by_one = cycle(positions)
    return lambda: planner.plan(next(one_by_one))


def law_speed() -> LawSpeed:
    """Time the scalar and the batched law on trajectories that stick and slide."""
    rng = np.random.default_rng(0)
    held = rng.standard_normal((LAW_BATCHES[-1], -(-LAW_SAMPLES // 20), 2)) * 8.0
    u = np.repeat(held, 20, axis=1)[:, :LAW_SAMPLES]
    actions = {"scalar": _scalar_law(u[:8])} | {f"{size}": _batched_law(u[:size]) for size in LAW_BATCHES}
    # The quickest round of each: which law wins must not depend on what else the machine was doing.
    times = {name: float(each.min()) for name, each in interleave(actions, LAW_ROUNDS).items()}
    scalar = times["scalar"] / 8
    wins = [size for size in LAW_BATCHES if times[f"{size}"] < size * scalar]
    return LawSpeed(LAW_SAMPLES, scalar, times[f"{LAW_BATCHES[-1]}"] / LAW_BATCHES[-1], min(wins, default=None))


def _scalar_law(u: FloatArray) -> Callable[[], object]:
    start = np.zeros(4)
    return lambda: [rollout(start, each, NOMINAL) for each in u]


def _batched_law(u: FloatArray) -> Callable[[], object]:
    start = np.zeros((len(u), 4))
    return lambda: rollout_batch(start, u, NOMINAL.static, NOMINAL.kinetic)


def process_time(model: Path | None, rounds: int) -> Spread:
    """Time `slide-plan` on a figure eight, from the start of the process to the plan on the disc (s).

    Raises:
        SlideError: it failed, or wrote no plan.
    """
    root = Path(runtime.__file__).resolve().parent.parent
    paths = [str(root), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in paths if path)}
    durations = []
    with tempfile.TemporaryDirectory() as folder:
        command_file, plan_file = Path(folder) / "command.csv", Path(folder) / "plan.json"
        write_command(command_file, shapes().positions[shapes().labels.index("eight 0.05 m")])
        arguments = [sys.executable, "-c", SLIDE_PLAN, str(command_file), "-o", str(plan_file)]
        arguments += [] if model is None else ["--model", str(model.resolve())]
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
