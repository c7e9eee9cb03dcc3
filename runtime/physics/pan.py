"""The pan: a double integrator."""

from __future__ import annotations

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.physics.law import DT

IN_PLANE = [0, 1, 3, 4]
"""Where in a pan's state, (6,), x, y, vx and vy are."""


def pan_step(position: float, velocity: float, acceleration: float, dt: float) -> tuple[float, float]:
    """Advance the pan by one sample along one of its axes: position (m), velocity (m/s), acceleration (m/s^2).

    `integrate_pan` in plain floats, for loops over samples that move the object too; they may be compiled.
    """
    return position + velocity * dt + acceleration * (0.5 * dt * dt), velocity + acceleration * dt


def integrate_pan(state: FloatArray, acceleration: FloatArray, dt: float = DT) -> FloatArray:
    """Integrate the pan, a double integrator (Eqs. 3, 7 and 8).

    Args:
        state: (..., 2d) pan position (m) and velocity (m/s) in the world before the first sample; d is 2, or 3 for a
            pan that lifts.
        acceleration: (..., n, d) pan acceleration (m/s^2).
        dt: sampling interval (s).

    Returns:
        (..., n, 2d) pan states after each sample.
    """
    axes = acceleration.shape[-1]
    out = np.empty((*acceleration.shape[:-1], 2 * axes))
    position, velocity = out[..., :axes], out[..., axes:]
    velocity[...] = state[..., None, axes:] + np.cumsum(acceleration, axis=-2) * dt
    before = velocity - acceleration * dt
    position[...] = state[..., None, :axes] + np.cumsum(before * dt + acceleration * (0.5 * dt * dt), axis=-2)
    return out
