"""What stands between the runner and an arm, simulated or real: a pan command goes in, what was measured comes out."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple, Protocol

from runtime.documents.checks import FloatArray


class PanCommand(NamedTuple):
    """Where the pan is to be at t_k, and how it is to be accelerated from t_k to t_(k+1) (Eqs. 3 and 29).

    Attributes:
        position: (3,) relative to where the pan began (m), z upwards.
        velocity: (3,) (m/s).
        acceleration: (3,) (m/s^2); the attitude is to stay as it is.
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


class ObjectStatus(StrEnum):
    """What has become of the object."""

    ON_PAN = "on the pan"
    TOPPLED = "toppled"
    OFF_PAN = "off the pan"


class Measured(NamedTuple):
    """What an arm measures at one sample.

    Attributes:
        pan: (6,) position of the pan's centre relative to where it began (m) and velocity (m/s), along the axes of the
            command, z upwards.
        tilt: angle between the pan's attitude and the one commanded (rad).
        sliding: (4,) position (m) and velocity (m/s) of the object in the pan's frame, as a camera gives it.
        status: what has become of the object.
        torque: (n,) joint torques applied over the sample before (N m).
        joint_velocity: (n,) joint speeds (rad/s).
        limits: what held the arm back over the sample before, such as "torque of joint 3"; empty if nothing did.
    """

    pan: FloatArray
    tilt: float
    sliding: FloatArray
    status: ObjectStatus
    torque: FloatArray
    joint_velocity: FloatArray
    limits: tuple[str, ...] = ()


class Arm(Protocol):
    """An arm that holds a pan with an object on it."""

    def reset(self, object_position: FloatArray) -> Measured:
        """Bring the pan to where it begins, at rest, with the object at rest on it.

        Args:
            object_position: (2,) relative to the pan (m).

        Returns:
            What is measured at t_0.
        """

    def step(self, command: PanCommand) -> Measured:
        """Control the pan for one sample of 1 ms.

        Args:
            command: for t_k.

        Returns:
            What is measured at t_(k+1).
        """

    def close(self) -> None:
        """Let go of the arm; may be called twice."""
