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
from runtime.physics.law import DT, GRAVITY, CompiledLaw, compiled_law

BATCHED_FROM = 16
"""Number of objects from which arrays of them are quicker than one after the other in plain Python."""

BLOCK = 50
"""Samples after which arrays are put together: so few stay in the processor's cache."""


def slide_positions(state: FloatArray, acceleration: FloatArray, frictions: Sequence[Friction]) -> FloatArray:
    """Slide an object along pan accelerations, once under each friction (Eqs. 4 and 9).

    Args:
        state: (4,) object position (m) and velocity (m/s) relative to the pan before the first sample.
        acceleration: (n, 2) of the pan (m/s^2), or (n, 3) where it lifts.
        frictions: F of them.

    Returns:
        (F, n + 1, 2) object positions before and after each sample (m).
    """
    compiled = compiled_law()
    if compiled is not None:
        return _positions(compiled, state[None], acceleration[None], [frictions]).reshape(len(frictions), -1, 2)
    begin, inputs = complex(*state[2:]), _inputs(acceleration)
    out = np.empty((len(frictions), len(acceleration) + 1), dtype=np.complex128)
    out[:, 0] = complex(*state[:2])
    for row, friction in enumerate(frictions):
        velocity = np.array(_velocities(begin, *inputs, friction))
        out[row, 1:] = out[row, 0] + np.cumsum((velocity[1:] + velocity[:-1]) * (0.5 * DT))
    return np.stack([out.real, out.imag], axis=-1)


def slide_positions_batch(
    states: FloatArray, acceleration: FloatArray, frictions: Sequence[Sequence[Friction]]
) -> FloatArray:
    """Slide B objects along pan accelerations of their own, each once under each of its F frictions (Eqs. 4 and 9).

    It is `slide_positions` over arrays, operation for operation: the same positions, to the last bit.

    Args:
        states: (B, 4) object position (m) and velocity (m/s) relative to the pan before the first sample.
        acceleration: (B, n, 2) of the pans (m/s^2), or (B, n, 3) where they lift.
        frictions: F for each object.

    Returns:
        (B, F, n + 1, 2) object positions before and after each sample (m).
    """
    compiled = compiled_law()
    if compiled is not None:
        return _positions(compiled, states, acceleration, frictions)
    if len(states) < BATCHED_FROM:
        return np.stack([slide_positions(*one) for one in zip(states, acceleration, frictions, strict=True)])
    batch, samples, columns = acceleration.shape
    static, kinetic = (each.T for each in _coefficients(frictions))
    place = np.zeros((2, *static.shape))
    velocity = np.broadcast_to(states.T[2:, None], place.shape)
    out = np.empty((batch, len(static), samples + 1, 2))
    out[:, :, 0] = states[:, None, :2]
    for first in range(0, samples, BLOCK):
        # Time comes first and the object last, so that one sample of all objects lies together in memory.
        change = np.ascontiguousarray(acceleration[:, first : first + BLOCK].transpose(1, 2, 0))[:, :, None] * DT
        normal = GRAVITY * DT + change[:, 2] if columns == 3 else np.full((len(change), 1, 1), GRAVITY * DT)
        v = _velocities_batch(velocity, change[:, :2], static * normal, kinetic * normal)
        moved = (v[1:] + v[:-1]) * (0.5 * DT)
        moved[0] += place
        moved = np.cumsum(moved, axis=0)
        velocity, place = v[-1], moved[-1]
        last = first + len(moved)
        out[:, :, first + 1 : last + 1] = states[:, None, None, :2] + moved.transpose(3, 2, 0, 1)
    return out


def _coefficients(frictions: Sequence[Sequence[Friction]]) -> tuple[FloatArray, FloatArray]:
    """Return the static and the kinetic coefficients, each (B, F)."""
    pairs = np.array([[(each.static, each.kinetic) for each in those] for those in frictions])
    return np.ascontiguousarray(pairs[..., 0]), np.ascontiguousarray(pairs[..., 1])


def _positions(
    compiled: CompiledLaw, states: FloatArray, acceleration: FloatArray, frictions: Sequence[Sequence[Friction]]
) -> FloatArray:
    """Return what `slide_positions_batch` does, by the compiled law."""
    static, kinetic = _coefficients(frictions)
    begin = np.repeat(states, static.shape[1], axis=0)
    out = np.empty((*static.shape, acceleration.shape[1] + 1, 2))
    out[:, :, 0] = states[:, None, :2]
    after = compiled.slide(begin, acceleration, static.ravel(), kinetic.ravel())
    out[:, :, 1:] = after[..., :2].reshape(*static.shape, -1, 2)
    return out


def _velocities_batch(begin: FloatArray, change: FloatArray, holding: FloatArray, braking: FloatArray) -> FloatArray:
    """Return the velocities of B objects under F frictions before and after each sample, (n + 1, 2, F, B) (m/s).

    Args:
        begin: (2, F, B) before the first (m/s).
        change: (n, 2, 1, B) u dt of each sample (m/s).
        holding, braking: (n, F, B) mu n dt and mu' n dt (m/s).
    """
    push = np.abs(change[:, 0] + 1j * change[:, 1])
    v = np.empty((len(change) + 1, *begin.shape))
    v[0] = begin
    with np.errstate(divide="ignore", invalid="ignore"):  # by an object or a pan at rest, whose value is not used
        breaks = (push >= holding) & (push > 0.0)
        pushed = np.where(breaks[:, None], change * (holding / push - 1.0)[:, None], 0.0)
        for k in range(len(change)):
            speed = np.hypot(v[k, 0], v[k, 1])
            slid = v[k] * (1.0 - braking[k] / speed) - change[k]
            along = slid * v[k]
            turned = along[0] + along[1] <= 0.0
            v[k + 1] = np.where(speed > 0.0, np.where(turned, 0.0, slid), pushed[k])
    return v


def slide_to_rest(state: FloatArray, acceleration: FloatArray, friction: Friction) -> tuple[float, float]:
    """Slide an object along pan accelerations, and on while the pan is at rest.

    Args:
        state, acceleration: as for `slide_positions`.
        friction: coefficients; without friction the object never rests, and is left where the accelerations end.

    Returns:
        Where the object comes to rest (m).
    """
    compiled = compiled_law()
    if compiled is not None and len(acceleration):
        static, kinetic = (part[0] for part in _coefficients([[friction]]))
        end = compiled.slide(state[None], acceleration[None], static, kinetic)[0, -1]
        place, last = complex(*end[:2]), complex(*end[2:])
    else:
        begin = complex(*state[2:])
        velocity = _velocities(begin, *_inputs(acceleration), friction)
        place = complex(*state[:2]) + (sum(velocity) - 0.5 * (begin + velocity[-1])) * DT
        last = velocity[-1]
    brake = friction.kinetic * GRAVITY
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
