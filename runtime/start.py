"""Where a plan or a stream begins: the pan maybe off centre and moving, the object maybe off its mark and sliding."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from runtime.documents.checks import FloatArray, number
from runtime.errors import InputError

ORIGIN = (0.0, 0.0)

FARTHEST = 1e3
"""Largest value of a state (m, m/s, m/s^2): nothing on a pan is beyond, it is a slip of the unit."""

Pair = tuple[float, float]


@dataclass(frozen=True)
class Start:
    """The state of pan and object at t_0.

    Attributes:
        pan_position: in the world, relative to the centre of the pan's reach (m).
        pan_velocity: in the world (m/s).
        pan_acceleration: in the world, over the sample before (m/s^2): where the jerk limit begins to count.
        object_position: relative to the pan (m); the command's first position if None.
        object_velocity: relative to the pan (m/s); exactly zero is rest.

    Raises:
        InputError: a value is not a pair of finite numbers of at most FARTHEST.
    """

    pan_position: Pair = ORIGIN
    pan_velocity: Pair = ORIGIN
    pan_acceleration: Pair = ORIGIN
    object_position: Pair | None = None
    object_velocity: Pair = ORIGIN

    def __post_init__(self) -> None:
        for name, value in vars(self).copy().items():
            if value is not None:
                object.__setattr__(self, name, _pair(value, name))

    def pan_state(self) -> FloatArray:
        """Return (4,) pan position and velocity."""
        return np.array([*self.pan_position, *self.pan_velocity])

    def object_state(self, position: FloatArray) -> FloatArray:
        """Return (4,) object position and velocity, `position` (2,) (m) in the place of None."""
        return np.array([*(position if self.object_position is None else self.object_position), *self.object_velocity])


def _pair(value: Any, key: str) -> Pair:
    name = f"start {key}"
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise InputError(f"{name} must be a pair of numbers [x, y], got {value!r}", key)
    x, y = (number(item, f"{name}[{axis}]", f"{key}[{axis}]") for axis, item in enumerate(value))
    if max(abs(x), abs(y)) > FARTHEST:
        raise InputError(f"{name} must be between {-FARTHEST:g} and {FARTHEST:g}, got [{x:g}, {y:g}]", key)
    return x, y
