"""What lasts: commands far longer than any that was trained on, and a closed loop that is disturbed."""

from __future__ import annotations

import tracemalloc
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from rich.table import Table

from benchmarks.harness.section import Measured, Section, Subject
from benchmarks.harness.tables import table, targets_table
from benchmarks.harness.targets import MEGABYTES, MILLIMETRES, PERCENT, TIMES, Target, Verdict
from benchmarks.suite.families import long
from runtime.cli.console import MM
from runtime.documents.checks import FloatArray
from runtime.errors import extra
from runtime.friction import Friction
from runtime.physics.law import DT, slide_one
from runtime.physics.pan import IN_PLANE, integrate_pan
from runtime.planner import Planner

FAMILIES = ("drawings", "spline_position", "loops")

PIECE = 1200
"""Samples of a piece of a long command, whose RMSE is held against that of short commands of as many."""

NOISE = (0.001, 0.001, 0.01, 0.01)
"""Standard deviation of measured positions (m) and velocities (m/s)."""

ACTUAL = Friction(0.9, 0.45)
"""The plant's friction from FRICTION_STEP on; the planner is not told."""

FRICTION_STEP, PUSHED, ALLOWED = 4, 8, 3
"""Chunks after which the friction changes and the object is pushed, and within which the error must be back."""

PUSH = 0.02
"""By which the object is pushed (m)."""


@dataclass(frozen=True)
class LongSettings:
    """How much is planned.

    Attributes:
        seconds: length of a long command (s).
        commands: long commands of each family.
        short: short commands of each family.
        seeds: times that each command is followed under noise, a step of the friction and a push.
    """

    seconds: float = 60.0
    commands: int = 6
    short: int = 48
    seeds: int = 3


@dataclass(frozen=True)
class Recovery:
    """A disturbed loop, command by command, the suite's `long`.

    Attributes:
        nominal: mean tracking RMSE of a chunk without noise, friction step and push (m).
        noisy: the same with noise only (m).
        after: mean tracking RMSE of the chunk that ends ALLOWED chunks after the push, with all three (m).
        ratio: `after` over `nominal`.
        recovered: share of the runs whose error was under twice the nominal one in one of these chunks.
    """

    nominal: float
    noisy: float
    after: float
    ratio: float
    recovered: float


@dataclass(frozen=True)
class Endurance:
    """Everything this section measures.

    Attributes:
        seconds: length of the long commands (s).
        short: mean tracking RMSE of short commands (m), by family.
        pieces: that of the pieces of long ones.
        ratio: of these over those, in the family where it is largest.
        memory_third, memory: most memory taken while a third of a long command is planned, and all of it (bytes).
        recovery: of the closed loop.
    """

    seconds: float
    short: Mapping[str, float]
    pieces: Mapping[str, float]
    ratio: float
    memory_third: float
    memory: float
    recovery: Recovery


TARGETS = (
    Target("ratio", "60 s over short commands, worst", TIMES, "<=", 1.0),
    Target("memory_third", "memory for a third of a long command", MEGABYTES),
    Target("memory", "memory for a long command", MEGABYTES),
    Target("recovery.ratio", "error after a push over nominal", TIMES, "<=", 2.0),
    Target("recovery.nominal", "undisturbed, a chunk", MILLIMETRES),
    Target("recovery.noisy", "under noise", MILLIMETRES),
    Target("recovery.after", "third chunk after the push", MILLIMETRES),
    Target("recovery.recovered", "runs back under 2 x within 3 chunks", PERCENT),
)


def measure_endurance(subject: Subject, settings: LongSettings) -> Measured:
    """Plan long commands, and follow disturbed ones in closed loop.

    Raises:
        MissingExtraError: the generators of the training, which draw the commands, need what is not installed.
    """
    planner = subject.planner
    commands = {name: _commands(name, settings.commands, round(settings.seconds / DT)) for name in FAMILIES}
    short = {
        name: float(np.mean([_rmse(planner, position) for position in _commands(name, settings.short, PIECE)]))
        for name in FAMILIES
    }
    pieces = {name: float(np.mean([_pieces(planner, each) for each in commands[name]])) for name in FAMILIES}
    ratio = max(pieces[name] / short[name] for name in FAMILIES)
    position = commands[FAMILIES[0]][0]
    memory_third, memory = (_memory(planner, each) for each in (position[: len(position) // 3], position))
    recovery = recovery_of(planner, settings.seeds)
    return Measured(Endurance(settings.seconds, short, pieces, ratio, memory_third, memory, recovery))


def _commands(family: str, count: int, samples: int) -> FloatArray:
    """Draw commands (count, samples, 2) of a family of the training, which none of it has drawn."""
    with extra("train"):
        from train.commands.families import free_commands
        from train.evaluation.evaluate import REACH, SPEED

    rng = np.random.default_rng([1, samples])
    return free_commands(rng, count, samples, {family: 1.0}, REACH, SPEED, 1).position


def _rmse(planner: Planner, position: FloatArray) -> float:
    return planner.plan(position).quality.tracking_rmse


def _pieces(planner: Planner, position: FloatArray) -> float:
    """Return the mean RMSE (m) of the pieces of a command that is planned in one call."""
    error = planner.plan(position).object_position - position
    squared = (error * error).sum(axis=1)[: len(error) // PIECE * PIECE]
    return float(np.sqrt(squared.reshape(-1, PIECE).mean(axis=1)).mean())


def _memory(planner: Planner, position: FloatArray) -> float:
    """Return the most memory (bytes) that planning a command takes besides what is loaded, the plan included."""
    tracemalloc.start()
    try:
        planner.plan(position)
        return float(tracemalloc.get_traced_memory()[1])
    finally:
        tracemalloc.stop()


def recovery_of(planner: Planner, seeds: int) -> Recovery:
    """Follow commands undisturbed, under noise, and under noise, a step of the friction and a push."""
    positions = [position for position in long().positions for _ in range(seeds)]
    runs = [
        [follow(planner, position, seed, noise, disturbed) for seed, position in enumerate(positions)]
        for noise, disturbed in ((False, False), (True, False), (True, True))
    ]
    nominal, noisy, disturbed = (np.array(run) for run in runs)
    usual = float(nominal.mean())
    back = disturbed[:, PUSHED : PUSHED + ALLOWED]
    after = float(back[:, -1].mean())
    return Recovery(usual, float(noisy.mean()), after, after / usual, float(np.mean(back.min(axis=1) <= 2.0 * usual)))


def follow(planner: Planner, position: FloatArray, seed: int, noise: bool, disturbed: bool) -> FloatArray:
    """Follow a command in closed loop with the law; returns the tracking RMSE of each chunk (m)."""
    rng = np.random.default_rng(seed)
    friction = planner.bundle.manifest.friction
    spread = np.array(NOISE) * float(noise)
    pan, sliding, states = np.zeros(6), np.array([*position[0], 0.0, 0.0]), (None, None)
    stream, errors = planner.stream(position), []
    chunk = stream.chunk
    for count in range(len(position) // chunk):
        u = stream.step(*states)
        pans = integrate_pan(pan, u)
        slidings = slide_one(sliding, u, ACTUAL if disturbed and count >= FRICTION_STEP else friction)
        commanded = position[np.minimum(np.arange(count * chunk + 1, (count + 1) * chunk + 1), len(position) - 1)]
        errors.append(np.sqrt(((slidings[:, :2] - commanded) ** 2).sum(axis=1).mean()))
        if disturbed and count == PUSHED - 1:
            angle = rng.uniform(0.0, 2.0 * np.pi)
            slidings[-1, :2] += PUSH * np.array([np.cos(angle), np.sin(angle)])
        pan, sliding = pans[-1], slidings[-1]
        drawn = rng.standard_normal((2, chunk, 4)) * spread
        states = pans[:, IN_PLANE] + drawn[0], slidings + drawn[1]
    return np.array(errors)


def long_tables(endurance: Endurance, verdicts: Sequence[Verdict]) -> list[Table]:
    """Return the error of long commands, and the memory and a disturbed loop beside their targets."""
    names = list(endurance.short)
    rows = [
        ("short commands", *(f"{endurance.short[name] * MM:.2f}" for name in names), ""),
        ("long ones", *(f"{endurance.pieces[name] * MM:.2f}" for name in names), f"{endurance.ratio:.2f}"),
    ]
    title = f"Commands of {endurance.seconds:g} s: mean tracking RMSE of each 1.2 s (mm)"
    header = ("", *names, "worst ratio")
    return [table(title, header, rows), *targets_table("Long commands", verdicts)]


SECTION = Section(
    "long",
    "commands of a minute, and a closed loop under noise, friction and a push",
    LongSettings(),
    measure_endurance,
    TARGETS,
    long_tables,
)
