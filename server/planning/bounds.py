"""How much a request can cost, known before anything is computed."""

from __future__ import annotations

import math

from runtime import Friction, InputError, Limits, Start
from runtime.limits import LARGEST_SINK
from runtime.physics.law import DT
from runtime.safety.rest import LONGEST_STOP as LONGEST_GENTLE_STOP
from runtime.safety.stop import gentle_strength
from server.problems import Problem

LONGEST_STOP = 10.0
"""Longest stop that is planned, or sent beside a chunk (s)."""

LEAST_FRICTION = 1e-6
"""What a friction of zero is taken for, so that nothing is divided by zero."""

ROW_BYTES, NPZ_ROW_BYTES = 420, 160
"""Bytes of a sample in a plan, at most: as JSON, where a number takes up to 24, and as npz."""

PLAN_BYTES = 1 << 14
"""Bytes of all else in a plan, at most."""

BRACKET = b"]"
"""Each position of a command has one."""

OTHER_BRACKETS = 1000
"""Brackets of a request that may belong to something else than positions."""

SHORT_CHUNKS = 70
"""Most chunks of a job that is planned among the short ones: it takes some 40 ms."""


def check_positions(brackets: int, most: int) -> None:
    """Check that what has so many brackets has no more positions than samples are taken, before it is parsed.

    Raises:
        Problem: `invalid`.
    """
    if brackets > most + OTHER_BRACKETS:
        raise Problem("invalid", f"the command has more than {most} positions, at most {most} are taken")


def stop_samples(limits: Limits, start: Start, friction: Friction | None = None) -> int:
    """Return the samples that a stop may take.

    With an acceleration a the speed v is lost in v/a, on a way of v^2/2a, at most twice the reach r: 2 sqrt(r/a). Going
    to a and back takes a/jerk each, and as long again from an acceleration that points the other way. Upwards the same
    holds with the height, and no more than LARGEST_SINK.

    Args:
        limits: finite ones; without them a plan ends by ordinary ones.
        start: where the pan is; its acceleration may be beyond the limit.
        friction: if the stop is as gentle as the reach allows, as that of a stream is.

    Raises:
        InputError: it may take longer than LONGEST_STOP.
    """
    if not limits.finite:
        limits = Limits()
    a = weakest(limits, friction)
    ramps = 3.0 * limits.acceleration + math.hypot(*start.pan_acceleration)
    along, upwards = limits.pan_reach / a, limits.height / min(a, LARGEST_SINK)
    longest = max(LONGEST_GENTLE_STOP, 2.0 * math.sqrt(along), 2.0 * math.sqrt(upwards)) + ramps / limits.jerk
    if longest > LONGEST_STOP:
        gentle = "" if friction is None else f" and a kinetic friction of {friction.kinetic:g}"
        raise InputError(
            f"within these limits{gentle} a stop may take {longest:.3g} s, at most {LONGEST_STOP:g} s are taken",
            "limits",
        )
    return math.ceil(longest / DT) + 1


def weakest(limits: Limits, friction: Friction | None) -> float:
    """Return the smallest acceleration that a stop may brake with (m/s^2)."""
    if friction is None:
        return limits.acceleration
    return min(limits.acceleration, gentle_strength(max(friction.kinetic, LEAST_FRICTION), limits))


def fastest(limits: Limits, friction: Friction) -> float:
    """Return the speed (m/s) from which a stop takes LONGEST_STOP: a pan that is measured faster is not followed."""
    return weakest(limits, friction) * LONGEST_STOP
