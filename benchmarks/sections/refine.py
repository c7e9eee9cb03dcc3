"""What refinement makes of plans in 50 ms, beside the sampling optimizer on the same commands."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.sections.accuracy import PlanFunction, measure
from benchmarks.suite.families import Family
from benchmarks.suite.suite import suite
from runtime.documents.checks import FloatArray
from runtime.planner import Planner

FAMILIES = ("spline", "shapes", "stops", "long", "short", "odd")
"""All of the suite but `friction`, which is `spline` again under what nobody is told."""

COMMANDS = 12
"""Commands of each family, the first ones, or all where there are no more."""

BUDGET = 50.0
"""Time for each plan (ms)."""


@dataclass(frozen=True)
class Refined:
    """One family.

    Attributes:
        commands: number of commands.
        before, after: mean tracking RMSE without and with refinement (m).
        optimizer: the same of the optimizer; None if it was not measured.
        pan_reach_max: largest reach of the refined plans (m).
        worse: number of commands that refinement made worse.
    """

    commands: int
    before: float
    after: float
    optimizer: float | None
    pan_reach_max: float
    worse: int


@dataclass(frozen=True)
class Refinement:
    """Everything this section measures.

    Attributes:
        families: by name.
        reduction: share by which the mean tracking RMSE over all of the commands falls.
        over_optimizer: the mean tracking RMSE over the optimizer's, in the family where this is largest; None if the
            optimizer was not measured.
        time: of a refined plan, median (s).
        worse: number of commands that refinement made worse.
    """

    families: Mapping[str, Refined]
    reduction: float
    over_optimizer: float | None
    time: float
    worse: int


def measure_refinement(planner: Planner, optimizer: PlanFunction | None) -> Refinement:
    """Plan the first commands of each family without refinement, with it, and with the optimizer."""
    planner.plan(np.zeros((200, 2)), refine_iterations=1)  # compiles
    families, before, after = {}, [], []
    times: list[float] = []
    for name, family in suite(FAMILIES).items():
        part = first(family, COMMANDS)
        plain = measure(_one_by_one(planner, None, []), part)
        refined = measure(_one_by_one(planner, BUDGET, times), part)
        peer = None if optimizer is None else float(measure(optimizer, part).tracking.mean())
        families[name] = Refined(
            commands=len(part),
            before=float(plain.tracking.mean()),
            after=float(refined.tracking.mean()),
            optimizer=peer,
            pan_reach_max=float(refined.pan_reach.max()),
            worse=int(np.sum(refined.tracking > plain.tracking * (1.0 + 1e-9))),
        )
        before.append(plain.tracking)
        after.append(refined.tracking)
    ratios = [each.after / each.optimizer for each in families.values() if each.optimizer is not None]
    return Refinement(
        families=families,
        reduction=float(1.0 - np.concatenate(after).mean() / np.concatenate(before).mean()),
        over_optimizer=max(ratios, default=None),
        time=float(np.median(times)),
        worse=sum(each.worse for each in families.values()),
    )


def first(family: Family, commands: int) -> Family:
    """Return a family with its first commands only."""
    some = slice(commands)
    return replace(
        family, positions=family.positions[some], frictions=family.frictions[some], labels=family.labels[some]
    )


def _one_by_one(planner: Planner, budget: float | None, times: list[float]) -> PlanFunction:
    """Plan each command alone, with that much refinement (ms); the time of each (s) is added to `times`."""

    def plan(positions: tuple[FloatArray, ...], frictions: tuple[object, ...]) -> list[FloatArray]:
        accelerations = []
        for position in positions:
            begin = time.perf_counter()
            accelerations.append(planner.plan(position, refine_ms=budget, robust=0.0).pan_acceleration)
            times.append(time.perf_counter() - begin)
        return accelerations

    return plan  # type: ignore[return-value]
