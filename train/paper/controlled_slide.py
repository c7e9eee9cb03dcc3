"""Commands that a controlled pan has made: sliding that is known to be possible."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from runtime.physics.law import DT, GRAVITY, slide_step
from runtime.physics.pan import pan_step
from train.commands.families import (
    TINY,
    Commands,
    Range,
    scale,
    spline_acceleration,
    turn,
)

POSITION_GAIN = 200.0
"""Feedback of the controlled slide on the object's position error (1/s^2)."""

VELOCITY_GAIN = 40.0
"""Feedback of the controlled slide on the object's velocity error (1/s)."""


def physics_commands(
    rng: np.random.Generator, batch: int, samples: int, knots: Range, reach: Range, static: float, kinetic: float
) -> Commands:
    """Draw commands by the "controlled slide": what an object does on a pan that is driven to slide it along a spline.

    The pan accelerates by the inverse of Eq. 9 plus a little feedback, so the object slides nearly all the time and
    the pan wanders off by metres. The mapping from the object's motion to the pan's is smooth, which is what makes
    it learnable in stage 1, where the network is to reproduce the pan.
    """
    wanted = turn(rng, scale(spline_acceleration(rng, batch, samples, knots), rng.uniform(*reach, batch), np.inf))
    velocity = np.gradient(wanted, DT, axis=1)
    acceleration = np.gradient(velocity, DT, axis=1)
    position, pan_position = np.zeros_like(wanted), np.zeros_like(wanted)
    _controlled_slide(wanted, velocity, acceleration, static * GRAVITY, kinetic * GRAVITY, position, pan_position)
    return Commands(position, np.full(batch, samples), pan_position)


_slide_step, _pan_step = numba.njit(slide_step), numba.njit(pan_step)


@numba.njit(nogil=True)  # type: ignore[untyped-decorator]
def _controlled_slide(
    wanted: Any, velocity: Any, acceleration: Any, static_limit: float, kinetic_limit: float, position: Any, pan: Any
) -> None:
    for b in range(wanted.shape[0]):
        px = py = vx = vy = x = y = wx = wy = 0.0
        for k in range(wanted.shape[1]):
            position[b, k, 0], position[b, k, 1], pan[b, k, 0], pan[b, k, 1] = px, py, x, y
            ax = (
                acceleration[b, k, 0]
                + VELOCITY_GAIN * (velocity[b, k, 0] - vx)
                + POSITION_GAIN * (wanted[b, k, 0] - px)
            )
            ay = (
                acceleration[b, k, 1]
                + VELOCITY_GAIN * (velocity[b, k, 1] - vy)
                + POSITION_GAIN * (wanted[b, k, 1] - py)
            )
            speed = np.sqrt(vx * vx + vy * vy)
            if speed > 0.0:
                ux = -ax - kinetic_limit * vx / speed
                uy = -ay - kinetic_limit * vy / speed
            else:
                size = max(np.sqrt(ax * ax + ay * ay), TINY)
                ux = -ax - static_limit * ax / size
                uy = -ay - static_limit * ay / size
            px, py, vx, vy = _slide_step(px, py, vx, vy, ux, uy, static_limit, kinetic_limit, DT)
            x, wx = _pan_step(x, wx, ux, DT)
            y, wy = _pan_step(y, wy, uy, DT)
