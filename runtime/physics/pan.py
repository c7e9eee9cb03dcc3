"""The pan: a double integrator."""

from __future__ import annotations

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.physics.law import (
    DT,
)


def integrate_pan(state: FloatArray, acceleration: FloatArray, dt: float = DT) -> FloatArray:
    """Integrate the pan, a double integrator (Eqs. 3, 7 and 8).

    Args:
        state: (..., 4) pan position (m) and velocity (m/s) in the world before the first sample.
        acceleration: (..., n, 2) pan acceleration (m/s^2).
        dt: sampling interval (s).

    Returns:
        (..., n, 4) pan states after each sample.
    """
    out = np.empty((*acceleration.shape[:-1], 4))
    position, velocity = out[..., :2], out[..., 2:]
    velocity[...] = state[..., None, 2:] + np.cumsum(acceleration, axis=-2) * dt
    before = velocity - acceleration * dt
    position[...] = state[..., None, :2] + np.cumsum(before * dt + acceleration * (0.5 * dt * dt), axis=-2)
    return out
