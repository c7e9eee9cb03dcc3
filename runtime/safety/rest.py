"""How a motion ends: the stop that leaves the object where it should be, as far as there is one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.physics.compiled import Compiler, compile_together, compiler
from runtime.physics.law import DT, GRAVITY, compiled_law, slide_step
from runtime.physics.motion import Motion
from runtime.physics.positions import slide_to_rest
from runtime.safety.governor import compiled_governor
from runtime.safety.pan import Pan
from runtime.safety.stop import (
    Brake,
    PanState,
    find_brake,
    gentle_strength,
    quickest,
    squared_extent,
    stop_extent,
    strongest,
)

STRONGER = 1.4
"""Times that each stop tried is stronger than the one before, at most."""

MOST_STRONGER = 30.0
"""Times that a stop is tried in steps of STRONGER beyond the first that does not hold back a sliding object; after
them comes the strongest."""

KEPT = 5e-4
"""Distance (m) that the object may be moved by a stop, and counts as kept where it was."""

LONGEST_STOP = 0.6
"""Time (s) that a stop may take for gentleness, where the limits allow a shorter one."""

ORDINARY = Limits()
"""How a pan without limits brakes, wherever that leads it."""


def stop_after(motion: Motion, samples: int, ahead: Pan, mark: FloatArray, friction: Friction) -> FloatArray:
    """Return the stop that follows the first samples of a motion.

    It keeps the limits, and begins at once; where the pan could not stop within them then, it follows the motion until
    it can, at the latest by the stop that the governor kept for the motion's end.

    Args:
        motion: of pan and object.
        samples: after which the stop follows; at least 1, at most all.
        ahead: the pan at the motion's end.
        mark: (2,) where the object should come to rest, relative to the pan's centre (m).
        friction: what the object is predicted with.

    Returns:
        (n, 3) pan accelerations (m/s^2), n at least 1; the last is zero, and the pan is at rest after it.
    """
    u = motion.acceleration
    for k in range(samples, len(u) + 1):
        state = PanState(*motion.pan[k].tolist(), *u[k - 1].tolist())
        brake = kindest_stop(state, motion.sliding[k], mark, ahead.limits, friction)
        if brake is not None:
            return np.concatenate([u[samples:k], brake.accelerations(brake.samples)])
    return np.concatenate([u[samples:], ahead.brake.accelerations(max(1, ahead.brake.samples))])


def kindest_stop(
    state: PanState, sliding: FloatArray, mark: FloatArray, limits: Limits, friction: Friction
) -> Brake | None:
    """Return the stop within the limits that by the law leaves the object nearest to its mark; None if there is none.

    Of several strengths the gentlest comes first: one that holds back an object that slides, one that does not break
    away an object that rests, and on to the strongest. A stronger one must gain more than KEPT.

    Args:
        state: the pan.
        sliding: (4,) the object relative to the pan (m, m/s).
        mark: (2,) where it should come to rest (m).
        limits: where there are none, the pan is stopped as by ORDINARY ones, anywhere.
        friction: coefficients.
    """
    limits, anywhere = (limits, False) if limits.finite else (ORDINARY, True)
    compiled = _compiled  # which another thread may replace
    best, least = None, math.inf
    good = math.dist(sliding[:2], mark) + KEPT
    for strength in _strengths(state, limits, friction):
        if compiled is not None:
            within, rest = compiled.tried(state, sliding, limits, strength, friction)
            if not (within or anywhere):
                continue
        else:
            brake = find_brake(state, limits, strength)
            if not (anywhere or stop_extent(state, brake).within(limits)):
                continue
            rest = slide_to_rest(sliding, brake.accelerations(brake.samples), friction)
        left = math.dist(rest, mark)
        if left <= good:
            return find_brake(state, limits, strength)
        if left < least - KEPT:
            best, least = strength, left
    return None if best is None else find_brake(state, limits, best)


def try_stop(
    state: PanState,
    sliding: FloatArray,
    bounds: tuple[float, float, float],
    step: float,
    strength: float,
    friction: tuple[float, float],
    gravity: float,
    dt: float,
) -> tuple[bool, float, float]:
    """Return whether a stop keeps its bounds, and where it leaves the object, to be compiled.

    Args:
        state, sliding: as for `kindest_stop`.
        bounds: on reach (m), height (m) and speed (m/s).
        step: largest change of the acceleration in a sample (m/s^2).
        strength: largest braking acceleration (m/s^2).
        friction: mu and mu'.
        gravity, dt: of the law.
    """
    brake = quickest(state, step, strength)
    reach, height, speed = squared_extent(state, brake)
    within = math.sqrt(reach) <= bounds[0] and height <= bounds[1] and math.sqrt(speed) <= bounds[2]
    static, kinetic = friction
    px, py, vx, vy = sliding[0], sliding[1], sliding[2], sliding[3]
    u, w, before_out = brake.u, brake.w, brake.ramp_in + brake.hold
    for k in range(1, before_out + brake.ramp_out + 1):
        rising = min(k / brake.ramp_in, 1.0)
        held = rising * min(max(1.0 - (k - before_out) / brake.ramp_out, 0.0), 1.0)
        start = 1.0 - rising
        normal = gravity + start * u[2] + held * w[2]
        px, py, vx, vy = slide_step(
            px,
            py,
            vx,
            vy,
            start * u[0] + held * w[0],
            start * u[1] + held * w[1],
            static * normal,
            kinetic * normal,
            dt,
        )
    slowing, left = kinetic * gravity, math.sqrt(vx * vx + vy * vy)
    if left > 0.0 and slowing > 0.0:
        px += vx * left / (2.0 * slowing)
        py += vy * left / (2.0 * slowing)
    return within, px, py


class CompiledStops:
    """Stops that are tried by numba.

    Args:
        compile_one: compiles a function.
        known: what they are made of, compiled, by name.
    """

    def __init__(self, compile_one: Compiler, known: Mapping[str, Any]) -> None:
        self._try = compile_together([try_stop], compile_one, known)["try_stop"]
        self.tried(PanState(*[0.0] * 9), np.zeros(4), ORDINARY, 1.0, Friction())  # compiles

    def tried(
        self, state: PanState, sliding: FloatArray, limits: Limits, strength: float, friction: Friction
    ) -> tuple[bool, tuple[float, float]]:
        """Return whether the stop of this strength keeps the limits, and where it leaves the object (m)."""
        bounds = limits.pan_reach, limits.height, limits.speed
        strongest_allowed, pair = min(strength, limits.acceleration), (friction.static, friction.kinetic)
        moving = np.ascontiguousarray(sliding)
        within, x, y = self._try(state, moving, bounds, limits.jerk * DT, strongest_allowed, pair, GRAVITY, DT)
        return within, (x, y)


_compiled: CompiledStops | None = None


def run_compiled(use: bool) -> None:
    """Let numba try the stops from now on, in all of this process, or no longer; where it runs law and governor too."""
    global _compiled
    compile_one, law, governor = compiler() if use else None, compiled_law(), compiled_governor()
    if compile_one is None or law is None or governor is None:
        _compiled = None
        return
    _compiled = CompiledStops(compile_one, {**law.functions, **governor.functions})


def _strengths(state: PanState, limits: Limits, friction: Friction) -> Iterator[float]:
    """Yield braking accelerations (m/s^2) from the gentlest to the strongest; the first is often enough."""
    most = strongest(state, limits.acceleration, limits.jerk)
    least = min(most, math.hypot(*state[3:6]) / LONGEST_STOP)
    holding, carrying = (gentle_strength(coefficient, limits) for coefficient in (friction.kinetic, friction.static))
    gentlest = min(max(holding, least), most)
    if gentlest > 0.0:
        yield gentlest
    first = min(max(carrying, least), most)
    last = min(most, first * MOST_STRONGER)
    more = np.geomspace(first, last, 1 + math.ceil(math.log(last / first) / math.log(STRONGER))).tolist()
    stronger = {min(max(strength, least), most) for strength in (*more, most)} - {gentlest}
    yield from sorted(strength for strength in stronger if strength > 0.0)
