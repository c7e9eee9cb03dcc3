"""What a program is told of the arm."""

from __future__ import annotations

import math
import reprlib
from dataclasses import dataclass

from runtime.arms.description import FARTHEST, Frame
from runtime.arms.load import arm_names, load_arm
from runtime.arms.model import ArmModel
from runtime.arms.place import Place, find_place
from runtime.documents.options import option
from runtime.errors import InputError


@dataclass(frozen=True)
class ArmChoice:
    """Which arm holds the pan, where and how; what is None was not given."""

    arm: str | None = option("Arm: fr3, iiwa14, panda, paper, ur10e, ur5e, xarm6, or a file.", metavar="NAME|FILE")
    at: str | None = option("Where the pan begins in the arm's base frame (m).", metavar="X,Y,Z")
    tip: str | None = option("Link of a URDF or an MJCF that is the flange.", metavar="LINK")
    mount: str | None = option(
        "The pan in the flange's frame: position (m), roll, pitch, yaw (deg).", metavar="X,Y,Z,R,P,Y"
    )

    @property
    def given(self) -> list[str]:
        """The options that were given, as they are written."""
        return [f"--{name}" for name, value in vars(self).items() if value is not None]


def choose(choice: ArmChoice) -> tuple[ArmModel, Place]:
    """Return the arm that was chosen, and where its pan begins.

    Raises:
        InputError: no arm was chosen, a place or a mount is not as many numbers, or see `load_arm` and `find_place`.
        MissingExtraError: mujoco is not installed.
    """
    if choice.arm is None:
        raise InputError(f"--arm is needed: {', '.join(arm_names())}, or a file")
    mount = None
    if choice.mount is not None:
        x, y, z, *angles = _numbers(choice.mount, "--mount", 6)
        roll, pitch, yaw = (math.radians(angle) for angle in angles)
        mount = Frame((x, y, z), (roll, pitch, yaw))
    at = None
    if choice.at is not None:
        x, y, z = _numbers(choice.at, "--at", 3)
        at = (x, y, z)
    model = ArmModel(load_arm(choice.arm, choice.tip, mount))
    return model, find_place(model, at)


def _numbers(text: str, name: str, count: int) -> list[float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count or not all(math.isfinite(value) for value in values):
        raise InputError(f"{name} must be {count} numbers with commas between them, got {reprlib.repr(text)}")
    for value in values[:3]:
        if abs(value) > FARTHEST:
            raise InputError(f"{name} must be within {FARTHEST:g} m, got {value:g}: is it in millimetres?")
    return values
