"""What can be varied about a simulated arm."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from runtime.arm.controller import FULL_CONTROL, ControlSettings
from runtime.documents.checks import check_ranges
from runtime.errors import InputError


class Simulator(StrEnum):
    """The physics engines there are."""

    PYBULLET = "pybullet"
    MUJOCO = "mujoco"


RANGES = (
    ("friction", 0.0, 10.0, ""),
    ("object_mass", 0.001, 10.0, " kg"),
    ("noise", 0.0, 0.1, " m"),
    ("joint_friction", 0.0, 100.0, " N m"),
)
"""Names of what is chosen, the lowest and the highest value, and the unit."""


@dataclass(frozen=True)
class Simulated:
    """What can be varied about the simulation.

    Attributes:
        control: which parts of the controller act.
        friction: coefficient between pan and object, static and kinetic alike.
        object_mass: (kg).
        noise: standard deviation of the measured object position (m); see `NOISE_WINDOW`.
        seed: of the noise.
        joint_friction: dry friction of every joint (N m), which the controller does not know of.
        gui: open the simulator's window.
        simulator: the physics engine.
    """

    control: ControlSettings = FULL_CONTROL
    friction: float = 0.5
    object_mass: float = 0.1
    noise: float = 0.0
    seed: int = 0
    joint_friction: float = 0.0
    gui: bool = False
    simulator: Simulator = Simulator.PYBULLET

    def __post_init__(self) -> None:
        check_ranges(self, RANGES)
        if self.seed < 0:
            raise InputError(f"seed must be 0 or more, got {self.seed}")
