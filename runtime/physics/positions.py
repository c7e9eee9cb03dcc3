"""Where the object slides under several frictions, and nothing else of it: the law in complex numbers.

A plan is looked at under other friction than it was made for, each time it is made. A vector of the plane is one
complex number here, which plain Python moves in a third of the time that two floats take, and the position is
integrated at the end: p+ = p + v dt + a dt^2/2 is p + (v + v+) dt/2. The result is `rollout`'s but for rounding; where
that is compiled, it is quicker, and used.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.physics.law import DT, GRAVITY, law_is_compiled, rollout


def slide_positions(state: FloatArray, acceleration: FloatArray, frictions: Sequence[Friction]) -> FloatArray:
    """Slide an object along pan accelerations, once under each friction (Eqs. 4 and 9).

    Args:
        state: (4,) object position (m) and velocity (m/s) relative to the pan before the first sample.
        acceleration: (n, 2) of the pan (m/s^2), or (n, 3) where it lifts.
        frictions: F of them.

    Returns:
        (F, n + 1, 2) object positions before and after each sample (m).
    """
    if law_is_compiled():
        after = [rollout(state, acceleration, friction)[:, :2] for friction in frictions]
        return np.stack([np.concatenate([state[None, :2], positions]) for positions in after])
    samples = len(acceleration)
    change = (acceleration[:, 0] + 1j * acceleration[:, 1]) * DT
    normal = np.full(samples, GRAVITY * DT)
    if acceleration.shape[1] == 3:
        normal += acceleration[:, 2] * DT
    inputs = list(zip(change.tolist(), np.abs(change).tolist(), normal.tolist(), strict=True))
    most, pressed = (float(values.max(initial=0.0)) for values in (np.abs(change), normal))
    begin = complex(*state[2:])
    out = np.empty((len(frictions), samples + 1), dtype=np.complex128)
    out[:, 0] = complex(*state[:2])
    for row, friction in enumerate(frictions):
        surely = most + friction.kinetic * pressed
        velocity = np.array(_velocities(begin, inputs, friction.static, friction.kinetic, surely))
        out[row, 1:] = out[row, 0] + np.cumsum((velocity[1:] + velocity[:-1]) * (0.5 * DT))
    return np.stack([out.real, out.imag], axis=-1)


def _velocities(
    v: complex, inputs: Sequence[tuple[complex, float, float]], static: float, kinetic: float, surely: float
) -> list[complex]:
    """Return the object's velocities (m/s) before and after each sample.

    Args:
        v: before the first (m/s).
        inputs: of each sample u dt, |u| dt and n dt (m/s).
        static, kinetic: the coefficients.
        surely: the speed (m/s) from which the object cannot come to rest within a sample.
    """
    velocities = [v]
    for change, push, normal in inputs:
        if v:
            speed = abs(v)
            after = v - change - v * (kinetic * normal / speed)
            if speed <= surely and after.real * v.real + after.imag * v.imag <= 0.0:
                after = 0j
            v = after
        elif push >= static * normal and push > 0.0:
            v = change * (static * normal / push - 1.0)
        velocities.append(v)
    return velocities
