"""How well the network plans: the figures of the suite."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.harness.section import Measured, Section, Subject, at_least
from benchmarks.harness.tables import table, targets_table
from benchmarks.harness.targets import (
    ACCELERATION,
    COUNT,
    MILLIMETRES,
    PERCENT,
    TIMES,
    Target,
    Verdict,
)
from benchmarks.sections.on_pans import PAN_TARGETS, OnPans, on_pans, pans_tables
from benchmarks.sections.parts import Part, measure_parts
from benchmarks.suite.drawings import drawings
from benchmarks.suite.families import FRICTION_GRID
from benchmarks.suite.outcome import PAN_REACH, Outcome, PlanFunction, one_by_one, plan_family
from benchmarks.suite.pans import DRAWINGS, tasks
from benchmarks.suite.suite import FAMILIES, suite
from runtime.cli.console import MM
from runtime.documents.options import option
from runtime.errors import InputError
from runtime.planner import Planner


@dataclass(frozen=True)
class AccuracySettings:
    """Which commands are planned.

    Attributes:
        family: names of the families.
        commands: the first ones of each family; all if None.
        limits: names of pans, whose tasks (`benchmarks.suite.pans`) are measured in the place of the suite; `commands`
            are spread over each family then.
        drawings: a file of people's drawings, which are planned with these; see `benchmarks.suite.drawings`.
        ray: address of the cluster that measures; None for none.
    """

    family: tuple[str, ...] = option("Family of the suite, or letters; may be repeated.", tuple(FAMILIES), "NAME")
    commands: int | None = option("Only the first commands of each family.", metavar="N")
    limits: tuple[str, ...] = option("Only within the limits of this pan; may be repeated.", (), "NAME|all")
    drawings: Path | None = option("With --limits: drawings of people, one a line.", metavar="FILE")
    ray: str | None = option("Measure on a Ray cluster: its address, or local.", metavar="ADDRESS")

    def __post_init__(self) -> None:
        at_least(1, commands=self.commands)
        if self.drawings is not None and not self.limits:
            raise InputError("--drawings are planned within limits: add --limits default, or leave the option out")


@dataclass(frozen=True)
class Figures:
    """A family in figures.

    Attributes:
        commands: number of commands.
        tracking_mean, tracking_median, tracking_p95, tracking_max: of the tracking RMSE of a command (m).
        worst: label of the command with the largest tracking RMSE.
        pan_reach_mean, pan_reach_max: of the pan's reach in a command (m).
        pan_reach_share: share of the commands with a pan reach of at most PAN_REACH (0 to 1).
        acceleration_max: largest |u| (m/s^2).
        acceleration_mean: mean over the commands of mean |u| (m/s^2).
        change_mean: mean over the commands of mean |u[k] - u[k-1]| (m/s^2).
        no_better_than_unmoved: number of commands tracked no better than by a pan that never moves.
        samples_per_second: samples planned per second of planning time, each command by itself.
    """

    commands: int
    tracking_mean: float
    tracking_median: float
    tracking_p95: float
    tracking_max: float
    worst: str
    pan_reach_mean: float
    pan_reach_max: float
    pan_reach_share: float
    acceleration_max: float
    acceleration_mean: float
    change_mean: float
    no_better_than_unmoved: int
    samples_per_second: float


@dataclass(frozen=True)
class FrictionCell:
    """Mean tracking RMSE (m) of the spline commands under one friction."""

    static: float
    kinetic: float
    tracking_mean: float


@dataclass(frozen=True)
class Accuracy:
    """The suite in figures.

    Attributes:
        families: each family's, by its name.
        pans: what is measured in the place of all others where limits are named; None if there are none.
        total: over the commands of all of these but `friction`, whose many would drown the others.
        friction: the family `friction`, friction by friction; empty if it was not measured.
        friction_worst: largest mean tracking RMSE of these (m); None if there is none.
        friction_ratio: the same over that of the family `spline`, whose commands these are, under nominal friction.
    """

    families: Mapping[str, Figures]
    total: Figures | None
    friction: tuple[FrictionCell, ...]
    friction_worst: float | None
    friction_ratio: float | None
    pans: OnPans | None = None


TARGETS = (
    Target("families.spline.tracking_mean", "spline, mean RMSE", MILLIMETRES, "<=", 1.3e-3),
    Target("families.spline.tracking_max", "spline, worst RMSE", MILLIMETRES, "<=", 6.0e-3),
    Target("families.shapes.tracking_mean", "shapes, mean RMSE", MILLIMETRES, "<=", 4.5e-3),
    Target("families.shapes.tracking_max", "shapes, worst RMSE", MILLIMETRES, "<=", 20e-3),
    Target("friction_worst", "friction, worst cell", MILLIMETRES, "<=", 2.5e-3),
    Target("friction_ratio", "friction, worst cell over nominal", TIMES, "<=", 1.4),
    Target("total.pan_reach_share", "pan reach up to 0.21 m", PERCENT, ">=", 0.99),
    Target("total.change_mean", "mean |du|", ACCELERATION, "<=", 1.0),
    Target("families.spline.no_better_than_unmoved", "spline, no better than a still pan", COUNT, "<=", 0),
    *PAN_TARGETS,
)


def measure_accuracy(subject: Subject, settings: AccuracySettings) -> Measured:
    """Plan the suite with the network, or the tasks of pans.

    Raises:
        InputError: there is no family, or no pan, of that name, or the drawings cannot be read.
        MissingExtraError: Ray is asked for, and not installed.
    """
    if settings.limits:
        chosen = tasks(settings.limits, settings.family)
        if settings.drawings is not None:
            chosen.append(replace(DRAWINGS, own=drawings(settings.drawings)))
        notes = [] if settings.drawings else ["people's drawings are left out: --drawings FILE plans them"]
        pans = on_pans(subject, chosen, settings.commands, settings.ray)
        return Measured(Accuracy({}, None, (), None, None, pans), notes)
    names = list(suite(settings.family, settings.commands))
    outcomes = measure_parts(subject, [Part(plan_one, name, settings.commands) for name in names], settings.ray)
    return Measured(summed_up(dict(zip(names, outcomes, strict=True))))


def plan_one(planner: Planner, name: str, commands: int | None) -> Outcome:
    """Plan a family, each command by itself."""
    return plan_family(one_by_one(planner), suite([name], commands)[name])


def accuracy_of(plan: PlanFunction, settings: AccuracySettings) -> Accuracy:
    """Plan the suite with any planner.

    Raises:
        InputError: there is no family of that name, or a plan is no plan.
    """
    chosen = suite(settings.family, settings.commands)
    return summed_up({name: plan_family(plan, family) for name, family in chosen.items()})


def summed_up(outcomes: Mapping[str, Outcome]) -> Accuracy:
    """Sum up families, by their names."""
    nominal = [outcome for name, outcome in outcomes.items() if name != "friction"]
    families = {name: figures([outcome]) for name, outcome in outcomes.items()}
    friction = friction_cells(outcomes["friction"]) if "friction" in outcomes else ()
    worst = max((cell.tracking_mean for cell in friction), default=None)
    return Accuracy(
        families=families,
        total=figures(nominal or list(outcomes.values())),
        friction=friction,
        friction_worst=worst,
        friction_ratio=worst / families["spline"].tracking_mean if worst is not None and "spline" in families else None,
    )


def figures(outcomes: Sequence[Outcome]) -> Figures:
    """Sum up one family, or several as if they were one."""
    tracking, unmoved, reach, largest, mean, change = (
        np.concatenate([getattr(outcome, name) for outcome in outcomes])
        for name in ("tracking", "unmoved", "pan_reach", "acceleration_max", "acceleration_mean", "change_mean")
    )
    labels = [label for outcome in outcomes for label in outcome.family.labels]
    samples = sum(len(position) for outcome in outcomes for position in outcome.family.positions)
    return Figures(
        commands=len(tracking),
        tracking_mean=float(tracking.mean()),
        tracking_median=float(np.median(tracking)),
        tracking_p95=float(np.percentile(tracking, 95)),
        tracking_max=float(tracking.max()),
        worst=labels[int(tracking.argmax())],
        pan_reach_mean=float(reach.mean()),
        pan_reach_max=float(reach.max()),
        pan_reach_share=float(np.mean(reach <= PAN_REACH)),
        acceleration_max=float(largest.max()),
        acceleration_mean=float(mean.mean()),
        change_mean=float(change.mean()),
        no_better_than_unmoved=int(np.sum(tracking >= unmoved)),
        samples_per_second=samples / sum(outcome.planning_time for outcome in outcomes),
    )


def friction_cells(outcome: Outcome) -> tuple[FrictionCell, ...]:
    """Return the mean tracking RMSE of the family `friction` under each friction of the grid."""
    frictions = np.array([(each.static, each.kinetic) for each in outcome.family.frictions])
    return tuple(
        FrictionCell(*cell, float(outcome.tracking[(frictions == cell).all(axis=1)].mean()))
        for cell in [(each.static, each.kinetic) for each in FRICTION_GRID]
    )


def accuracy_tables(accuracy: Accuracy, verdicts: Sequence[Verdict]) -> list[Table]:
    """Return the accuracy of each family, beside its targets."""
    if accuracy.pans is not None:
        return [*pans_tables(accuracy.pans), *targets_table("Accuracy", verdicts)]
    rows = {name: each for name, each in accuracy.families.items() if name != "friction"}
    if accuracy.total is not None:
        rows["together"] = accuracy.total
    if "friction" in accuracy.families:
        rows["friction"] = accuracy.families["friction"]
    tables = [
        table(
            "Tracking RMSE (mm)",
            ("family", "commands", "mean", "median", "95 %", "worst", "worst command"),
            [_tracking_row(name, each) for name, each in rows.items()],
        ),
        table(
            "Pan reach (mm), pan acceleration u (m/s^2), planning speed",
            ("family", "mean", "worst", f"<= {PAN_REACH * MM:.0f}", "max |u|", "mean |u|", "mean |du|", "samples/s"),
            [_pan_row(name, each) for name, each in rows.items()],
        ),
    ]
    if accuracy.friction:
        tables.append(_friction_table(accuracy))
    return [*tables, *targets_table("Accuracy", verdicts)]


def _tracking_row(name: str, figures: Figures) -> tuple[str, ...]:
    lengths = (figures.tracking_mean, figures.tracking_median, figures.tracking_p95, figures.tracking_max)
    return (name, f"{figures.commands}", *(f"{length * MM:.2f}" for length in lengths), figures.worst)


def _pan_row(name: str, figures: Figures) -> tuple[str, ...]:
    return (
        name,
        f"{figures.pan_reach_mean * MM:.0f}",
        f"{figures.pan_reach_max * MM:.0f}",
        f"{figures.pan_reach_share:.0%}",
        f"{figures.acceleration_max:.1f}",
        f"{figures.acceleration_mean:.2f}",
        f"{figures.change_mean:.3f}",
        f"{figures.samples_per_second:,.0f}",
    )


def _friction_table(accuracy: Accuracy) -> Table:
    static = sorted({cell.static for cell in accuracy.friction})
    kinetic = sorted({cell.kinetic for cell in accuracy.friction})
    means = {(cell.static, cell.kinetic): f"{cell.tracking_mean * MM:.2f}" for cell in accuracy.friction}
    return table(
        "Mean tracking RMSE (mm) of `spline` by friction",
        ("kinetic \\ static", *(f"{each:g}" for each in static)),
        [(f"{row:g}", *(means.get((column, row), "") for column in static)) for row in kinetic],
    )


SECTION = Section(
    "accuracy",
    "tracking error, pan reach and smoothness on the suite",
    AccuracySettings(),
    measure_accuracy,
    TARGETS,
    accuracy_tables,
)
