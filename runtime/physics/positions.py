"""Where the object slides under several frictions, and nothing else of it: the law in complex numbers.

A plan is looked at under other friction than it was made for, each time it is made. A vector of the plane is one
complex number here, which plain Python moves in a third of the time that two floats take, and the position is
integrated at the end: p+ = p + v dt + a dt^2/2 is p + (v + v+) dt/2. The result is `slide_one`'s but for rounding;
where that is compiled, it is quicker, and used.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.physics.law import DT, GRAVITY, law_is_compiled, slide_one


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
        after = [slide_one(state, acceleration, friction)[:, :2] for friction in frictions]
        return np.stack([np.concatenate([state[None, :2], positions]) for positions in after])
    begin, inputs = complex(*state[2:]), _inputs(acceleration)
    out = np.empty((len(frictions), len(acceleration) + 1), dtype=np.complex128)
    out[:, 0] = complex(*state[:2])
    for row, friction in enumerate(frictions):
        velocity = np.array(_velocities(begin, *inputs, friction))
        out[row, 1:] = out[row, 0] + np.cumsum((velocity[1:] + velocity[:-1]) * (0.5 * DT))
    return np.stack([out.real, out.imag], axis=-1)


def slide_to_rest(state: FloatArray, acceleration: FloatArray, friction: Friction) -> tuple[float, float]:
    """Slide an object along pan accelerations, and on while the pan is at rest.

    Args:
        state, acceleration: as for `slide_positions`.
        friction: coefficients; without friction the object never rests, and is left where the accelerations end.

    Returns:
        Where the object comes to rest (m).
    """
    begin = complex(*state[2:])
    velocity = _velocities(begin, *_inputs(acceleration), friction)
    place = complex(*state[:2]) + (sum(velocity) - 0.5 * (begin + velocity[-1])) * DT
    last, brake = velocity[-1], friction.kinetic * GRAVITY
    if last and brake > 0.0:
        place += last * abs(last) / (2.0 * brake)
    return place.real, place.imag


def _inputs(acceleration: FloatArray) -> tuple[list[tuple[complex, float, float]], float, float]:
    """Return u dt, |u| dt and n dt (m/s) of each sample, and the largest of each of the last two."""
    change = (acceleration[:, 0] + 1j * acceleration[:, 1]) * DT
    push, normal = np.abs(change), np.full(len(acceleration), GRAVITY * DT)
    if acceleration.shape[1] == 3:
        normal += acceleration[:, 2] * DT
    inputs = list(zip(change.tolist(), push.tolist(), normal.tolist(), strict=True))
    return inputs, float(push.max(initial=0.0)), float(normal.max(initial=0.0))


def _velocities(
    v: complex, inputs: Sequence[tuple[complex, float, float]], most: float, pressed: float, friction: Friction
) -> list[complex]:
    """Return the object's velocities (m/s) before and after each sample.

    Args:
        v: before the first (m/s).
        inputs, most, pressed: what `_inputs` gives.
        friction: coefficients.
    """
    static, kinetic = friction.static, friction.kinetic
    safe = most + kinetic * pressed  # faster than this, the object cannot come to rest within a sample
    velocities = [v]
    for change, push, normal in inputs:
        if v:
            speed = abs(v)
            after = v * (1.0 - kinetic * normal / speed) - change
            if speed <= safe and after.real * v.real + after.imag * v.imag <= 0.0:
                after = 0j
            v = after
        elif push >= static * normal and push > 0.0:
            v = change * (static * normal / push - 1.0)
        velocities.append(v)
    return velocities
