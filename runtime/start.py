"""Where a plan or a stream begins: the pan maybe off centre and moving, the object maybe off its mark and sliding."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from runtime.documents.checks import FloatArray, number
from runtime.errors import InputError

ORIGIN = (0.0, 0.0)
MIDDLE = (0.0, 0.0, 0.0)

FARTHEST = 1e3
"""Largest value of a state (m, m/s, m/s^2): nothing on a pan is beyond, it is a slip of the unit."""

Pair = tuple[float, float]
Triple = tuple[float, float, float]
Vector = Pair | Triple


@dataclass(frozen=True)
class Start:
    """The state of pan and object at t_0.

    What belongs to the pan is [x, y, z], and may be given as [x, y] for a pan in its plane, z = 0.

    Attributes:
        pan_position: in the world, relative to the centre of the pan's reach (m).
        pan_velocity: in the world (m/s).
        pan_acceleration: in the world, over the sample before (m/s^2): where the jerk limit begins to count.
        object_position: relative to the pan (m); the command's first position if None.
        object_velocity: relative to the pan (m/s); exactly zero is rest.

    Raises:
        InputError: a value is not a pair, or of the pan a triple, of finite numbers of at most FARTHEST.
    """

    pan_position: Vector = MIDDLE
    pan_velocity: Vector = MIDDLE
    pan_acceleration: Vector = MIDDLE
    object_position: Pair | None = None
    object_velocity: Pair = ORIGIN

    def __post_init__(self) -> None:
        for name, value in vars(self).copy().items():
            if value is not None:
                read = _triple if name.startswith("pan_") else _numbers
                object.__setattr__(self, name, read(value, name))

    def pan_state(self) -> FloatArray:
        """Return (6,) pan position and velocity."""
        return np.array([*self.pan_position, *self.pan_velocity])

    def object_state(self, position: FloatArray) -> FloatArray:
        """Return (4,) object position and velocity, `position` (2,) (m) in the place of None."""
        return np.array([*(position if self.object_position is None else self.object_position), *self.object_velocity])


def _triple(value: Any, key: str) -> tuple[float, ...]:
    """Return the [x, y, z] of the pan, z = 0 for [x, y]."""
    numbers = _numbers(value, key, (2, 3), "a pair or a triple of numbers [x, y] or [x, y, z]")
    return numbers if len(numbers) == 3 else (*numbers, 0.0)


def _numbers(
    value: Any, key: str, sizes: tuple[int, ...] = (2,), what: str = "a pair of numbers [x, y]"
) -> tuple[float, ...]:
    name = f"start {key}"
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, (list, tuple)) or len(value) not in sizes:
        raise InputError(f"{name} must be {what}, got {value!r}", key)
    numbers = tuple(number(item, f"{name}[{axis}]", f"{key}[{axis}]") for axis, item in enumerate(value))
    if max(map(abs, numbers)) > FARTHEST:
        given = ", ".join(f"{each:g}" for each in numbers)
        raise InputError(f"{name} must be between {-FARTHEST:g} and {FARTHEST:g}, got [{given}]", key)
    return numbers
