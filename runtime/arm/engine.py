"""What a simulated arm needs of a physics engine; `runtime.arm.bullet` and `runtime.arm.mujoco` have one each."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from runtime.arm.controller import ArmState
from runtime.documents.checks import FloatArray

Image = NDArray[np.uint8]
"""A picture, (height, width, 3)."""

Size = tuple[int, int]
"""Width and height of a picture (pixels)."""


class Pose(NamedTuple):
    """A place in the world: position (3,) (m), and attitude (3, 3), whose columns are the axes there."""

    position: FloatArray
    rotation: FloatArray


class Body(NamedTuple):
    """A rigid body in the world.

    Attributes:
        position: (3,) of its centre (m).
        rotation: (3, 3) attitude.
        velocity: (3,) of its centre (m/s).
        turning: (3,) angular velocity (rad/s).
    """

    position: FloatArray
    rotation: FloatArray
    velocity: FloatArray
    turning: FloatArray


class Camera(Protocol):
    """Takes pictures of a simulated arm, with the command drawn onto the pan."""

    size: Size

    def picture(self, k: int) -> Image:
        """Return what is seen at t_k, (height, width, 3)."""


class Engine(Protocol):
    """An arm, the pan in its hand and an object on it, moved by joint torques.

    Attributes:
        posture: (n,) joint angles at home (rad).
        home: where the pan is there; the columns of its attitude are the axes of plans and measurements. Known from
            the first start on.
    """

    posture: FloatArray
    home: Pose

    def start(self, object_position: FloatArray) -> None:
        """Start afresh: the arm at home and at rest, the object on the pan at (2,) relative to its centre (m)."""

    def arm(self) -> ArmState:
        """Return the arm as it is now."""

    def object(self) -> Body:
        """Return the object as it is now."""

    def advance(self, torque: FloatArray) -> None:
        """Advance by one sample of 1 ms under joint torques (n,) (N m)."""

    def push(self, force: FloatArray) -> None:
        """Push the object with a horizontal force (2,) (N), in the world, over the next sample."""

    def set_friction(self, friction: float) -> None:
        """Change the friction coefficient between pan and object."""

    def camera(self, command: FloatArray | None, size: Size | None) -> Camera:
        """Return a camera; see `SimulatedArm.camera`."""

    def stop(self) -> None:
        """Let go of what the engine holds; may be called twice."""
