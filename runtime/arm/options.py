"""What `slide-run --pybullet` is told on its command line."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

from runtime.errors import InputError


@dataclass(frozen=True)
class ArmOptions:
    """The options of the simulated arm; what is None or False was not given.

    Attributes:
        closed_loop: decode again, with the measured states, every chunk.
        model: bundle folder for that; the shipped one if None.
        server: address of a server that decodes instead.
        paper_control: the controller as Fig. 7 draws it.
        gui: open the simulator's window, and run no faster than real time.
        video: film to write, .mp4.
        friction: coefficient between pan and object.
        object_mass: (kg).
        noise: standard deviation of the measured object position (m).
        seed: of the noise.
        disturb: what is done to the object; see `runtime.arm.disturbance`.
    """

    closed_loop: bool = False
    model: Path | None = None
    server: str | None = None
    paper_control: bool = False
    gui: bool = False
    video: Path | None = None
    friction: float | None = None
    object_mass: float | None = None
    noise: float | None = None
    seed: int | None = None
    disturb: tuple[str, ...] = ()

    @property
    def given(self) -> list[str]:
        """The options that were given, as they are written."""
        given = [field.name for field in fields(self) if getattr(self, field.name) != field.default]
        return [f"--{name.replace('_', '-')}" for name in given]

    def refuse_without_pybullet(self) -> None:
        """Check that no option is given that would have no effect.

        Raises:
            InputError: one is.
        """
        for name in self.given:
            raise InputError(f"{name} needs --pybullet")
