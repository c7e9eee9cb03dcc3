"""How sure a plan is: what becomes of it if the friction is another than it was made for."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.physics.law import compiled_law, slide_batch
from runtime.physics.motion import Motion, lengths
from runtime.physics.positions import slide_positions, slide_positions_batch
from runtime.quality import FrictionRange

FRICTION_OFF = 0.1
"""Share by which the friction is taken to be off: what measuring it, or a drop of oil, makes of it."""

FRICTION_STEP = 0.05
"""Spacing of the coefficients that a plan is replayed under; a hundredth is less than anyone measures."""

ROUNDING = 1e-6
"""Share of a step by which a range may fall short of a whole number of steps."""

MOST_SAMPLES = 1 << 18
"""Samples of all plans that are replayed at once: 17 MB of positions."""


def friction_off_error(motion: Motion, command_position: FloatArray, friction: Friction) -> float:
    """Return the tracking RMSE (m) of a plan, replayed open loop under friction that is FRICTION_OFF off.

    Of the four corners, each coefficient lower or higher by that share, the worst.

    Args:
        motion: K samples of pan and object, as planned.
        command_position: (K, 2) where the object should be (m).
        friction: what it was made for.
    """
    corners, compiled = friction.corners(FRICTION_OFF), compiled_law()
    if compiled is not None:
        squares = compiled.squares(motion.sliding[0], motion.acceleration, command_position, corners)
        return float(np.sqrt(squares.max() / len(command_position)))
    u = motion.acceleration[: len(command_position) - 1]
    return _worst_error(slide_positions(motion.sliding[0], u, corners), command_position)


def friction_off_errors(
    motions: Sequence[Motion], command_positions: Sequence[FloatArray], frictions: Sequence[Friction]
) -> list[float]:
    """Return `friction_off_error` of each of B plans, to the last bit, in less time.

    Args:
        motions: of each, of as many samples as its command or more.
        command_positions: (K, 2) of each (m).
        frictions: what each was made for.
    """
    if compiled_law() is not None:
        return [friction_off_error(*one) for one in zip(motions, command_positions, frictions, strict=True)]
    equal: dict[int, list[int]] = defaultdict(list)
    for index, motion in enumerate(motions):
        equal[len(motion.acceleration)].append(index)
    errors: dict[int, float] = {}
    for samples, indices in equal.items():
        many = max(1, MOST_SAMPLES // samples)
        for first in range(0, len(indices), many):
            part = indices[first : first + many]
            positions = slide_positions_batch(
                np.stack([motions[index].sliding[0] for index in part]),
                np.stack([motions[index].acceleration[:-1] for index in part]),
                [frictions[index].corners(FRICTION_OFF) for index in part],
            )
            for index, each in zip(part, positions, strict=True):
                command = command_positions[index]
                errors[index] = _worst_error(each[:, : len(command)], command)
    return [errors[index] for index in range(len(motions))]


def _worst_error(positions: FloatArray, command_position: FloatArray) -> float:
    """Return the largest tracking RMSE (m) of several positions (F, K, 2)."""
    errors = positions - command_position
    squares: FloatArray = np.mean(errors[..., 0] ** 2 + errors[..., 1] ** 2, axis=1)
    return float(np.sqrt(squares.max()))


def friction_range(
    motion: Motion,
    command_position: FloatArray,
    friction: Friction,
    tolerance: float,
    trained_on: Mapping[str, tuple[float, float]],
) -> FrictionRange:
    """Replay a plan open loop under other friction, on a grid over what the model was trained on.

    Args:
        motion: K samples of pan and object, as planned.
        command_position: (K, 2) where the object should be (m).
        friction: what it was made for.
        tolerance: largest tracking RMSE (m).
        trained_on: lowest and highest coefficient, under "static" and "kinetic".
    """
    static, kinetic = (_grid(getattr(friction, name), *trained_on[name]) for name in ("static", "kinetic"))
    static, kinetic = static[static >= friction.kinetic], kinetic[kinetic <= friction.static]
    cells = [(each, friction.kinetic) for each in static] + [(friction.static, each) for each in kinetic]
    u, start = motion.acceleration, motion.sliding[0]
    inputs = np.broadcast_to(u[:-1], (len(cells), *u[:-1].shape))
    grid = np.array(cells)
    states = slide_batch(np.tile(start, (len(cells), 1)), inputs, grid[:, 0], grid[:, 1])
    errors = lengths(states[..., :2] - command_position[1:])
    begin = lengths(start[None, :2] - command_position[:1])
    rmse = np.sqrt((np.sum(errors * errors, axis=1) + begin[0] ** 2) / len(command_position))
    good = (rmse <= tolerance).tolist()
    return FrictionRange(
        tolerance,
        *_around(static, good[: len(static)], friction.static),
        *_around(kinetic, good[len(static) :], friction.kinetic),
    )


def _grid(nominal: float, low: float, high: float) -> FloatArray:
    """Return coefficients FRICTION_STEP apart from `low` to `high`, and `nominal` among them, (n,) increasing."""
    count = int((high - low) / FRICTION_STEP + ROUNDING)
    return np.unique(np.concatenate([low + FRICTION_STEP * np.arange(count + 1), [nominal]]))


def _around(values: FloatArray, good: Sequence[bool], nominal: float) -> tuple[float | None, float | None]:
    """Return the first and last of the values around `nominal` that are good without a gap."""
    middle = values.tolist().index(nominal)
    if not good[middle]:
        return None, None
    low = high = middle
    while low > 0 and good[low - 1]:
        low -= 1
    while high + 1 < len(values) and good[high + 1]:
        high += 1
    return float(values[low]), float(values[high])
