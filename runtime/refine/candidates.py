"""One command planned turned and mirrored: the same task to the law, and not quite the same to the network.

A pan has no front. A command that is turned, or mirrored, planned, and turned back gives another plan for the same
command, and the best of several is better than one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from runtime.command import Command
from runtime.documents.checks import FloatArray
from runtime.network.bundle import Bundle
from runtime.network.decode import decode_all
from runtime.network.job import Job
from runtime.network.reach import shares_about
from runtime.physics.law import slide_one
from runtime.physics.motion import Motion
from runtime.physics.pan import integrate_pan
from runtime.refine.refine import expected, robust_error
from runtime.safety.pan import Pan, state_after
from runtime.start import Pair, Start, Vector


def best_candidate(bundle: Bundle, job: Job, count: int, robust: float) -> tuple[Motion, Pan]:
    """Plan a command turned and mirrored, as one batch, and return the plan that tracks best by the law.

    Args:
        bundle: the network.
        job: the command; the first candidate is its plan as it is.
        count: number of candidates.
        robust: share by which the friction may be off; see `runtime.refine.refine.Effort`.

    Returns:
        The motion, and the pan at its end.

    Raises:
        InputError, BundleError: as `decode`.
    """
    if count == 1:
        return decode_all(bundle, [job])[0]
    turns, shares = _turns(count), shares_about(job.reach_used)
    jobs = [job, *(_turned(job, turn) for turn in turns[1:])]
    jobs = [each._replace(reach_used=shares[index % len(shares)]) for index, each in enumerate(jobs)]
    return _best(job, decode_all(bundle, jobs), turns, robust)


def better_candidate(
    bundle: Bundle, job: Job, lone: tuple[Motion, Pan], count: int, robust: float
) -> tuple[Motion, Pan] | None:
    """Plan a command turned and mirrored whose plan as it is is there, and bad.

    All have the share of the reach of that one: they are one batch then, and where a plan is bad they gain more.

    Args:
        bundle, job, robust: as for `best_candidate`.
        lone: the command's plan as it is, and the pan at its end.
        count: number of candidates, that one among them.

    Returns:
        The best motion, and the pan at its end; None if that is the lone plan.
    """
    turns = _turns(count)
    others = decode_all(bundle, [_turned(job, turn) for turn in turns[1:]])
    best = _best(job, [lone, *others], turns, robust)
    return None if best is lone else best


def _best(
    job: Job, decoded: Sequence[tuple[Motion, Pan]], turns: Sequence[FloatArray], robust: float
) -> tuple[Motion, Pan]:
    """Return the plan that tracks best by the law, turned back; the first is of the job as it is."""
    first, _ = decoded[0]
    samples, sliding = len(job.command), first.sliding[0]
    frictions = expected(job.friction, robust)
    errors = [
        robust_error(_back(motion.acceleration[:samples], turn), sliding, job.command.position, frictions)
        for (motion, _), turn in zip(decoded, turns, strict=True)
    ]
    best = int(np.argmin(errors))
    if best == 0:
        return decoded[0]
    (motion, after), turn = decoded[best], turns[best]
    u, asked = (_back(each, turn) for each in (motion.acceleration, motion.asked))
    pan = integrate_pan(first.pan[0], u)
    turned = Motion(
        u,
        asked,
        np.concatenate([first.pan[:1], pan]),
        np.concatenate([sliding[None], slide_one(sliding, u, job.friction)]),
    )
    return turned, Pan(state_after(pan, u), after.brake.turned(turn), job.limits)


def _back(u: FloatArray, turn: FloatArray) -> FloatArray:
    """Return accelerations (n, 3) of a turned job turned back; what goes up goes up."""
    return np.concatenate([u[:, :2] @ turn, u[:, 2:]], axis=1)


def _turns(count: int) -> list[FloatArray]:
    """Return the (2, 2) matrices of candidates: half of them turned by even angles, the other half mirrored too.

    The first changes nothing.
    """
    return [_turn(index, count) for index in range(count)]


def _turn(index: int, count: int) -> FloatArray:
    turned = -(-count // 2)
    angle = 2.0 * math.pi * (index % turned) / turned
    cos, sin = math.cos(angle), math.sin(angle)
    mirrored = -1.0 if index >= turned else 1.0
    return np.array([[cos, -sin * mirrored], [sin, cos * mirrored]])


def _turned(job: Job, turn: FloatArray) -> Job:
    """Return a job with all of its vectors turned; the command about where it begins, so that it stays on the pan."""
    start, origin = job.start, job.command.position[0]

    def plane(x: float, y: float) -> Pair:
        x, y = turn @ (x, y)
        return float(x), float(y)

    def vector(given: Vector) -> Vector:
        pair = plane(given[0], given[1])
        return pair if len(given) == 2 else (*pair, given[2])

    placed = start.object_position
    if placed is not None:
        x, y = origin + turn @ (placed - origin)
        placed = float(x), float(y)
    return job._replace(
        command=Command(origin + (job.command.position - origin) @ turn.T),
        start=Start(
            pan_position=vector(start.pan_position),
            pan_velocity=vector(start.pan_velocity),
            pan_acceleration=vector(start.pan_acceleration),
            object_position=placed,
            object_velocity=plane(*start.object_velocity),
        ),
    )
