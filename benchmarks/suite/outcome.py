"""What somebody's plans lead to, from nothing but the pan accelerations that were planned.

A planner of any kind is measured as a `PlanFunction`. What it predicts of its own plan is not used: pan and object are
moved here, by the double integrator and the law of friction.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.suite.families import Family, lengths
from runtime.documents.checks import FloatArray
from runtime.errors import InputError
from runtime.friction import Friction
from runtime.physics.law import slide_batch
from runtime.physics.pan import integrate_pan
from runtime.planner import Planner

PlanFunction = Callable[[Sequence[FloatArray], Sequence[Friction]], Sequence[FloatArray]]
"""Plans: (K, 2) command positions (m) and the friction of each, to (K, 2) pan accelerations (m/s^2) for each."""

PAN_REACH = 0.21
"""Pan reach up to which a plan counts as within its limit of 0.2 m (m)."""


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


def one_by_one(
    planner: Planner, refine_ms: float | None = None, robust: float | None = None, candidates: int | None = None
) -> PlanFunction:
    """Return the network as a plan function that plans each command by itself, as a user with one command would.

    A command whose plan is bad is then planned several ways: see `Planner.plan`.

    Args:
        planner: of the bundle; it is told the friction.
        refine_ms, robust, candidates: of each plan; see `Planner.plan`.
    """

    def plan(positions: Sequence[FloatArray], frictions: Sequence[Friction]) -> list[FloatArray]:
        return [
            planner.plan(
                position, friction, refine_ms=refine_ms, robust=robust, candidates=candidates
            ).pan_acceleration[:, :2]
            for position, friction in zip(positions, frictions, strict=True)
        ]

    return plan


def plan_family(plan: PlanFunction, family: Family) -> Outcome:
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
        tracking=_tracking(states, family),
        unmoved=np.array([_rms(p - p[0]) for p in family.positions]),
        pan_reach=np.array([lengths(s[:, :2]).max() for s in states]),
        acceleration_max=np.array([lengths(u).max() for u in accelerations]),
        acceleration_mean=np.array([lengths(u).mean() for u in accelerations]),
        change_mean=np.array([each.mean() for each in change]),
        planning_time=planning_time,
    )


def tracking(planned: Sequence[FloatArray], family: Family) -> FloatArray:
    """Return the root mean square distance between object and command (m) of each plan, under the family's friction.

    Raises:
        InputError: a plan is not (K, 2) finite numbers; the command is named.
    """
    return _tracking(measured_states(planned, family), family)


def _tracking(states: Sequence[FloatArray], family: Family) -> FloatArray:
    return np.array([_rms(s[:, 4:6] - p) for s, p in zip(states, family.positions, strict=True)])


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
    sliding = slide_batch(start[:, 0, 4:], u, static, kinetic)
    after = np.concatenate([integrate_pan(start[:, 0, :4], u), sliding], axis=-1)
    states = np.concatenate([start, after], axis=1)
    return [each[: len(position)] for each, position in zip(states, family.positions, strict=True)]


def _rms(error: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum(error * error, axis=1))))
