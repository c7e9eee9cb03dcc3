"""How far the network is from the best plans that long searches find, on ten commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from rich.table import Table

from benchmarks.harness.section import NAME, Measured, Section, Subject, at_least
from benchmarks.harness.tables import table, targets_table
from benchmarks.harness.targets import MILLIMETRES, TIMES, Target, Verdict
from benchmarks.suite.best_found import read_best, record_best, ten_commands
from benchmarks.suite.families import NOMINAL, Family
from benchmarks.suite.pans import HEIGHT, tracking
from runtime.cli.console import MM, say
from runtime.documents.checks import FloatArray
from runtime.documents.options import option
from runtime.errors import InputError, extra
from runtime.limits import Limits
from runtime.planner import Planner

LEVEL, LIFTING = Limits(), Limits(height=HEIGHT)

CANDIDATES, REFINED_MS = 24, 50.0
"""Candidates, and time of refinement (ms), of the better plans of the network."""


@dataclass(frozen=True)
class BestSettings:
    """What is done.

    Attributes:
        commands: the first ones; all ten if None.
        search: steps of refinement in a search for a better plan of each command, made before; None for none.
    """

    commands: int | None = option("Only the first commands of each family.", metavar="N")
    search: int | None = option("Search for better plans in so many steps a command, and record them.", metavar="N")

    def __post_init__(self) -> None:
        at_least(1, commands=self.commands, search=self.search)


@dataclass(frozen=True)
class Row:
    """One command: tracking RMSE (m) of the best plan found, and of the network's.

    Attributes:
        command: its label.
        best: of the best level plan found.
        network: of the network's.
        refined: of the best of its candidates, refined.
        lifting: of the network's, with a pan that lifts.
    """

    command: str
    best: float
    network: float
    refined: float
    lifting: float


@dataclass(frozen=True)
class Best:
    """The commands in figures.

    Attributes:
        rows: the commands.
        best_mean, network_mean, refined_mean, lifting_mean: mean tracking RMSE (m).
        network_ratio, refined_ratio, lifting_ratio: geometric mean of their errors over the best ones.
    """

    rows: tuple[Row, ...]
    best_mean: float
    network_mean: float
    refined_mean: float
    lifting_mean: float
    network_ratio: float
    refined_ratio: float
    lifting_ratio: float


TARGETS = (
    Target("network_ratio", "network over best found", TIMES, "<=", 2.0),
    Target("refined_ratio", f"best of {CANDIDATES}, refined for {REFINED_MS:g} ms, over best found", TIMES, "<=", 1.4),
    Target("lifting_ratio", "network lifting over best level one found", TIMES),
    Target("best_mean", "best found, mean", MILLIMETRES),
    Target("network_mean", "network, mean", MILLIMETRES),
    Target("refined_mean", "refined, mean", MILLIMETRES),
    Target("lifting_mean", "network lifting, mean", MILLIMETRES),
)


def measure_best(subject: Subject, settings: BestSettings) -> Measured:
    """Plan the ten commands with the network, and compare with the plans that are recorded.

    Raises:
        InputError: a command has no recorded plan.
        OutputError: better plans cannot be recorded.
        MissingExtraError: numba is not installed.
    """
    commands = ten_commands()
    if settings.commands is not None:
        commands = commands.first(settings.commands)
    if settings.search is not None:
        search_all(subject.planner, commands, settings.search)
    return Measured(compare(subject.planner, commands, read_best()))


def search_all(planner: Planner, commands: Family, steps: int) -> None:
    """Search for better plans of commands, in so many steps for each, and record each that is better at once."""
    with extra("refine"):
        from benchmarks.peers.search import search
    plans = read_best()
    for label, position in zip(commands.labels, commands.positions, strict=True):
        known = [plans[label]] if label in plans else []
        found = search(planner, position, NOMINAL, LEVEL, steps, known)
        errors = tracking([position] * (1 + len(known)), [found, *known], NOMINAL)
        say(NAME, f"best: {label}: {', before '.join(f'{error * MM:.3f} mm' for error in errors)}")
        if errors.argmin() == 0:
            plans[label] = found
            record_best(plans)


def compare(planner: Planner, commands: Family, plans: Mapping[str, FloatArray]) -> Best:
    """Compare the network's plans of commands with others, (K, 2) (m/s^2), by the labels of the commands.

    Raises:
        InputError: a command has no other plan.
        MissingExtraError: numba is not installed.
    """
    missing = [label for label in commands.labels if label not in plans]
    if missing:
        raise InputError(f"no plan is recorded for {', '.join(missing)}: slide-bench best --search 100000 makes them")
    with extra("refine"):
        import numba  # noqa: F401 (refines)
    planner.plan(np.zeros((200, 2)), NOMINAL, refine_iterations=1, robust=0.0)  # compiles
    positions = list(commands.positions)
    level, lifting = (
        [plan.pan_acceleration for plan in planner.plan_batch(positions, NOMINAL, limits=limits)]
        for limits in (LEVEL, LIFTING)
    )
    refined = [
        planner.plan(
            each, NOMINAL, limits=LEVEL, candidates=CANDIDATES, refine_ms=REFINED_MS, robust=0.0
        ).pan_acceleration
        for each in positions
    ]
    found: list[Sequence[FloatArray]] = [[plans[label] for label in commands.labels], level, refined, lifting]
    best, *others = (tracking(positions, each, NOMINAL) for each in found)
    means = (float(each.mean()) for each in (best, *others))
    ratios = (float(np.exp(np.log(each / best).mean())) for each in others)
    rows = zip(commands.labels, *(each.tolist() for each in (best, *others)), strict=True)
    return Best(tuple(Row(*row) for row in rows), *means, *ratios)


def best_tables(best: Best, verdicts: Sequence[Verdict]) -> list[Table]:
    """Return the commands, and the ratios beside their targets."""
    rows = [
        (each.command, *(f"{value * MM:.2f}" for value in (each.best, each.network, each.refined, each.lifting)))
        for each in best.rows
    ]
    header = ("command", "best found", "network", "refined", "network, lifting")
    return [table("Tracking RMSE (mm)", header, rows), *targets_table("Best found", verdicts)]


SECTION = Section(
    "best",
    "the network beside the best plans that long searches find, on ten commands",
    BestSettings(),
    measure_best,
    TARGETS,
    best_tables,
    timed=True,
    usual=False,
)
