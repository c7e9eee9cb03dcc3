"""What refinement makes of plans, beside the cross-entropy optimizer on the same commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from rich.table import Table

from benchmarks.harness.section import Measured, Section, Subject, at_least
from benchmarks.harness.tables import table, targets_table
from benchmarks.harness.targets import COUNT, MILLIMETRES, MILLISECONDS, PERCENT, TIMES, Target, Verdict
from benchmarks.suite.families import Family
from benchmarks.suite.outcome import PlanFunction, one_by_one, plan_family, tracking
from benchmarks.suite.suite import suite
from runtime.cli.console import MM
from runtime.documents.options import option
from runtime.errors import extra
from runtime.friction import Friction
from runtime.planner import Planner

FAMILIES = ("spline", "shapes", "stops", "long", "short", "odd")
"""All of the suite but `friction`, which is `spline` again under what nobody is told."""

OFF_FAMILIES = ("spline", "shapes")
"""Families whose plans are also run under friction that nobody was told."""

OFF, OFF_FRICTIONS, OFF_SEED = 0.1, 6, 2018
"""Share by which that friction is off at most, how many are drawn, and the seed: both coefficients by themselves."""

ROUNDING = 1e-9
"""Share by which the error of a plan may differ where refinement leaves the plan as it is."""


@dataclass(frozen=True)
class RefineSettings:
    """What is refined, and by how much.

    Attributes:
        family: names of the families.
        commands: of each family, the first ones, or all where there are no more.
        budget: time for each plan (ms).
        robust: share by which the friction may be off; see `Planner.plan`.
        off_budget: time for each plan that is run under other friction (ms).
        candidates, iterations: of the optimizer; see `benchmarks.peers.cross_entropy`.
    """

    family: tuple[str, ...] = option("Family of the suite, or letters; may be repeated.", FAMILIES, "NAME")
    commands: int | None = option("Only the first commands of each family.", 12, "N")
    budget: float = option("Time for the refinement of a plan (ms).", 50.0, "MS")
    robust: float = option("Share by which friction may be off, for refinement.", 0.0, "SHARE")
    off_budget: float = option("The same, of plans that are run under other friction (ms).", 100.0, "MS")
    candidates: int = option("The optimizers' candidates in an iteration.", 512, "N")
    iterations: int = option("The optimizers' iterations in a planning.", 20, "N")

    def __post_init__(self) -> None:
        at_least(1, commands=self.commands, budget=self.budget, off_budget=self.off_budget, iterations=self.iterations)
        at_least(8, candidates=self.candidates)
        at_least(0, robust=self.robust)


@dataclass(frozen=True)
class RefinedFamily:
    """One family.

    Attributes:
        commands: number of commands.
        before, after: mean tracking RMSE of one plan, and of the best of several with refinement (m).
        optimizer: the same of the optimizer.
        pan_reach_max: largest reach of the refined plans (m).
        worse: number of commands that refinement made worse.
    """

    commands: int
    before: float
    after: float
    optimizer: float
    pan_reach_max: float
    worse: int


@dataclass(frozen=True)
class OffFamily:
    """One family's plans under friction that is off: mean tracking RMSE over commands and frictions (m).

    Attributes:
        network: of plans that are not refined.
        nominal: refined for the friction they are made for alone.
        robust: refined as a user's plans are unless something else is said.
    """

    network: float
    nominal: float
    robust: float


@dataclass(frozen=True)
class Refinement:
    """Everything this section measures.

    Attributes:
        families: by name.
        reduction: share by which the mean tracking RMSE over all of the commands falls.
        over_optimizer: the mean tracking RMSE over the optimizer's, in the family where this is largest.
        budget: time that refinement was given for a plan (ms).
        time: of a refined plan, mean (s).
        worse: number of commands that refinement made worse.
        off: families' plans, open loop, under friction that is up to OFF off.
    """

    families: Mapping[str, RefinedFamily]
    reduction: float
    over_optimizer: float
    budget: float
    time: float
    worse: int
    off: Mapping[str, OffFamily]


TARGETS = (
    Target("reduction", "refinement, error down by", PERCENT, ">=", 0.25),
    Target("worse", "refinement, commands made worse", COUNT, "<=", 0),
    Target("over_optimizer", "refined over optimizer, worst family", TIMES, "<=", 1.0),
    Target("off.spline.robust", "spline, friction off, refined", MILLIMETRES, "<=", 2e-3),
    Target("off.shapes.robust", "shapes, friction off, refined", MILLIMETRES, "<=", 3.8e-3),
    Target("time", "a refined plan, mean", MILLISECONDS),
)


def measure_refinement(subject: Subject, settings: RefineSettings) -> Measured:
    """Plan the first commands of each family without refinement, with it, and with the optimizer.

    Raises:
        MissingExtraError: numba is not installed.
    """
    with extra("refine"):
        from benchmarks.peers.cross_entropy import CrossEntropy
    optimizer = CrossEntropy(settings.candidates, settings.iterations)
    optimizer.plan(np.zeros((10, 2)), Friction())  # compiles
    return Measured(_refinement(subject.planner, optimizer, settings))


def _refinement(planner: Planner, optimizer: PlanFunction, settings: RefineSettings) -> Refinement:
    planner.plan(np.zeros((200, 2)), refine_iterations=1, robust=settings.robust)  # compiles
    families, before, after = {}, [], []
    time = 0.0
    for name, family in suite(settings.family, settings.commands).items():
        plain = plan_family(one_by_one(planner, candidates=1), family)
        refined = plan_family(one_by_one(planner, settings.budget, settings.robust), family)
        families[name] = RefinedFamily(
            commands=len(family),
            before=float(plain.tracking.mean()),
            after=float(refined.tracking.mean()),
            optimizer=float(plan_family(optimizer, family).tracking.mean()),
            pan_reach_max=float(refined.pan_reach.max()),
            worse=int(np.sum(refined.tracking > plain.tracking * (1.0 + ROUNDING))),
        )
        before.append(plain.tracking)
        after.append(refined.tracking)
        time += refined.planning_time
    return Refinement(
        families=families,
        reduction=float(1.0 - np.concatenate(after).mean() / np.concatenate(before).mean()),
        over_optimizer=max(each.after / each.optimizer for each in families.values()),
        budget=settings.budget,
        time=time / sum(each.commands for each in families.values()),
        worse=sum(each.worse for each in families.values()),
        off={
            name: _under_other_friction(planner, family, settings.off_budget)
            for name, family in suite(OFF_FAMILIES, settings.commands).items()
        },
    )


def _under_other_friction(planner: Planner, family: Family, budget: float) -> OffFamily:
    draws = np.random.default_rng(OFF_SEED).uniform(1.0 - OFF, 1.0 + OFF, (OFF_FRICTIONS, 2))

    def error(plan: PlanFunction) -> float:
        planned = plan(family.positions, family.frictions)
        errors = []
        for static, kinetic in draws:
            frictions = tuple(Friction(static * each.static, kinetic * each.kinetic) for each in family.frictions)
            errors.append(tracking(planned, replace(family, frictions=frictions)))
        return float(np.mean(errors))

    return OffFamily(
        error(one_by_one(planner, candidates=1)),
        error(one_by_one(planner, budget, 0.0)),
        error(one_by_one(planner, budget)),
    )


def refine_tables(refinement: Refinement, verdicts: Sequence[Verdict]) -> list[Table]:
    """Return what refinement does to each family, beside its targets."""
    rows = [
        (
            name,
            f"{each.commands}",
            f"{each.before * MM:.2f}",
            f"{each.after * MM:.2f}",
            f"{each.after / each.before - 1.0:+.0%}",
            f"{each.optimizer * MM:.2f}",
            f"{each.pan_reach_max * MM:.0f}",
        )
        for name, each in refinement.families.items()
    ]
    title = f"Refinement in {refinement.budget:g} ms: mean tracking RMSE, pan reach (mm)"
    header = ("family", "commands", "before", "after", "change", "optimizer", "reach")
    off = [
        (name, *(f"{value * MM:.2f}" for value in (each.network, each.nominal, each.robust)))
        for name, each in refinement.off.items()
    ]
    off_title = f"Open loop, friction up to {OFF:.0%} off: mean tracking RMSE (mm)"
    off_header = ("family", "network", "refined for one friction", "refined")
    return [
        table(title, header, rows),
        table(off_title, off_header, off),
        *targets_table("Refinement", verdicts),
    ]


SECTION = Section(
    "refine",
    "what refinement makes of plans, beside the optimizer",
    RefineSettings(),
    measure_refinement,
    TARGETS,
    refine_tables,
    timed=True,
)
