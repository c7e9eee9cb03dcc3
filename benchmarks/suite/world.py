"""A world in which the law of friction holds exactly: an arm without faults, an object on it, and what may happen."""

from __future__ import annotations

import numpy as np

from runtime.arm.interface import Measured, ObjectStatus, PanCommand
from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.physics.law import slide_one
from runtime.physics.pan import integrate_pan

NOTHING = np.zeros(0)


class LawArm:
    """An `Arm` whose pan does what it is told, with an object that slides by the law.

    Args:
        friction: between pan and object.
        pushes: by which the object is moved, (2,) (m), before a sample, by the number of the sample.
        start: (6,) of the pan: position (m) and velocity (m/s).
    """

    def __init__(
        self, friction: Friction, pushes: dict[int, FloatArray] | None = None, start: FloatArray | None = None
    ) -> None:
        self._friction, self._pushes = friction, pushes or {}
        self._start = np.zeros(6) if start is None else start

    def reset(self, object_position: FloatArray) -> Measured:
        """Begin; see `Arm`."""
        self._pan, self._sliding, self._k = self._start, np.array([*object_position, 0.0, 0.0]), 0
        return self._measured()

    def step(self, command: PanCommand) -> Measured:
        """Move pan and object by a sample; see `Arm`."""
        u = command.acceleration[None]
        self._pan, self._sliding = integrate_pan(self._pan, u)[0], slide_one(self._sliding, u, self._friction)[0]
        self._k += 1
        if self._k in self._pushes:
            self._sliding[:2] += self._pushes[self._k]
        return self._measured()

    def close(self) -> None:
        """Do nothing; see `Arm`."""

    def _measured(self) -> Measured:
        pan, sliding = self._pan.copy(), self._sliding.copy()
        return Measured(pan, 0.0, sliding, ObjectStatus.ON_PAN, NOTHING, NOTHING)
