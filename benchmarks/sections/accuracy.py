"""How well somebody plans: the figures of the suite, from nothing but the pan accelerations that were planned.

A planner of any kind is measured as a `PlanFunction`. What it predicts of its own plan is not asked: pan and object
are moved here, by the double integrator and the law of friction.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.suite.families import FRICTION_GRID, Family, lengths
from benchmarks.suite.suite import suite
from runtime.documents.checks import FloatArray
from runtime.errors import InputError
from runtime.friction import Friction
from runtime.physics.law import rollout_batch
from runtime.physics.pan import integrate_pan
from runtime.planner import Planner

PlanFunction = Callable[[Sequence[FloatArray], Sequence[Friction]], Sequence[FloatArray]]
"""Plans: (K, 2) command positions (m) and the friction of each, to (K, 2) pan accelerations (m/s^2) for each."""

PAN_REACH = 0.21
"""Pan reach up to which a plan counts as within its limit of 0.2 m (m)."""

BATCH = 64
"""Commands handed to the network at once."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one family's plans led to, one entry a command.

    Attributes:
        family: the commands.
        tracking: root mean square distance between object and command (m).
        unmoved: the same for a pan that never moves, which leaves the object at its start (m).
        pan_reach: largest distance of the pan from where it began (m).
        acceleration_max: largest |u| (m/s^2).
        acceleration_mean: mean |u| over the samples (m/s^2).
        change_mean: mean |u[k] - u[k-1]| over the samples (m/s^2).
        planning_time: time all of the plans took (s).
    """

    family: Family
    tracking: FloatArray
    unmoved: FloatArray
    pan_reach: FloatArray
    acceleration_max: FloatArray
    acceleration_mean: FloatArray
    change_mean: FloatArray
    planning_time: float


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
        samples_per_second: samples planned per second of planning time.
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
        total: over the commands of all of these but `friction`, whose many would drown the others.
        friction: the family `friction`, friction by friction; empty if it was not measured.
        friction_worst: largest mean tracking RMSE of these (m); None if there is none.
        friction_ratio: the same over that of the family `spline`, whose commands these are, under nominal friction.
    """

    families: Mapping[str, Figures]
    total: Figures
    friction: tuple[FrictionCell, ...]
    friction_worst: float | None
    friction_ratio: float | None


def measure_suite(plan: PlanFunction, names: Iterable[str] | None = None) -> Accuracy:
    """Measure a planner on the families of these names, all of them if None.

    Raises:
        InputError: there is no family of that name, or a plan is no plan.
    """
    outcomes = {name: measure(plan, family) for name, family in suite(names).items()}
    nominal = [outcome for name, outcome in outcomes.items() if name != "friction"]
    families = {name: figures([outcome]) for name, outcome in outcomes.items()}
    friction = friction_table(outcomes["friction"]) if "friction" in outcomes else ()
    worst = max((cell.tracking_mean for cell in friction), default=None)
    return Accuracy(
        families=families,
        total=figures(nominal or list(outcomes.values())),
        friction=friction,
        friction_worst=worst,
        friction_ratio=worst / families["spline"].tracking_mean if worst is not None and "spline" in families else None,
    )


def network(planner: Planner, batch: int = BATCH) -> PlanFunction:
    """Return the network as a plan function, `batch` commands at a time; it is not told the friction it decodes in."""

    def plan(positions: Sequence[FloatArray], frictions: Sequence[Friction]) -> list[FloatArray]:
        accelerations: list[FloatArray] = []
        for begin in range(0, len(positions), batch):
            some = slice(begin, begin + batch)
            plans = planner.plan_batch(positions[some], friction=frictions[some])
            accelerations += [plan.pan_acceleration for plan in plans]
        return accelerations

    return plan


def measure(plan: PlanFunction, family: Family) -> Outcome:
    """Plan all of a family's commands and see where pan and object go.

    Raises:
        InputError: a plan is not (K, 2) finite numbers; the command is named.
    """
    begin = time.perf_counter()
    planned = plan(family.positions, family.frictions)
    planning_time = time.perf_counter() - begin
    accelerations = _checked(planned, family)
    states = _move(accelerations, family)
    change = [lengths(np.diff(u, axis=0)) for u in accelerations]
    return Outcome(
        family=family,
        tracking=np.array([_rms(s[:, 4:6] - p) for s, p in zip(states, family.positions, strict=True)]),
        unmoved=np.array([_rms(p - p[0]) for p in family.positions]),
        pan_reach=np.array([lengths(s[:, :2]).max() for s in states]),
        acceleration_max=np.array([lengths(u).max() for u in accelerations]),
        acceleration_mean=np.array([lengths(u).mean() for u in accelerations]),
        change_mean=np.array([each.mean() for each in change]),
        planning_time=planning_time,
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


def friction_table(outcome: Outcome) -> tuple[FrictionCell, ...]:
    """Return the mean tracking RMSE of the family `friction` under each friction of the grid."""
    frictions = np.array([(each.static, each.kinetic) for each in outcome.family.frictions])
    return tuple(
        FrictionCell(*cell, float(outcome.tracking[(frictions == cell).all(axis=1)].mean()))
        for cell in [(each.static, each.kinetic) for each in FRICTION_GRID]
    )


def measured_states(planned: Sequence[FloatArray], family: Family) -> list[FloatArray]:
    """Return where pan and object go, one (K, 8) array a command, in the rows of `runtime.plan`.

    Raises:
        InputError: a plan is not (K, 2) finite numbers; the command is named.
    """
    return _move(_checked(planned, family), family)


def _checked(planned: Sequence[FloatArray], family: Family) -> list[FloatArray]:
    if len(planned) != len(family):
        raise InputError(f"{family.name}: {len(planned)} plans for {len(family)} commands")
    accelerations = [np.asarray(u, dtype=np.float64) for u in planned]
    for u, position, label in zip(accelerations, family.positions, family.labels, strict=True):
        if u.shape != position.shape:
            raise InputError(f"{label}: pan acceleration must have the shape {position.shape}, got {u.shape}")
        if not np.isfinite(u).all():
            raise InputError(f"{label}: pan acceleration holds a value that is no finite number")
    return accelerations


def _move(accelerations: Sequence[FloatArray], family: Family) -> list[FloatArray]:
    """Move pan and object from rest, all commands in one batch; shorter ones are padded behind their end.

    Returns:
        One (K, 8) array a command: states (pan, object) at t_0..t_(K-1), in the rows of `runtime.plan`.
    """
    longest = max(len(u) for u in accelerations)
    u = np.zeros((len(accelerations), longest - 1, 2))
    for row, each in zip(u, accelerations, strict=True):
        row[: len(each) - 1] = each[:-1]  # the last one leads out of the command
    start = np.zeros((len(u), 1, 8))
    start[:, 0, 4:6] = [position[0] for position in family.positions]
    static = np.array([each.static for each in family.frictions])
    kinetic = np.array([each.kinetic for each in family.frictions])
    sliding = rollout_batch(start[:, 0, 4:], u, static, kinetic)
    after = np.concatenate([integrate_pan(start[:, 0, :4], u), sliding], axis=-1)
    states = np.concatenate([start, after], axis=1)
    return [each[: len(position)] for each, position in zip(states, family.positions, strict=True)]


def _rms(error: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum(error * error, axis=1))))
