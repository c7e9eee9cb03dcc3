"""What `slide-run --simulator` is told on its command line."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

from runtime.arm.simulated import Simulator
from runtime.documents.options import option
from runtime.errors import InputError


@dataclass(frozen=True)
class ArmOptions:
    """The options of the simulated arm.

    What is None, False or empty was not given. Each field is an option of `slide-run`, told by its metadata.
    """

    simulator: Simulator | None = option("Execute on a simulated arm; what follows is for it.")
    closed_loop: bool = option("Decode again with what is measured.", False)
    model: Path | None = option("Bundle for it: a folder, or a shipped one.", metavar="DIR")
    server: str | None = option("Closed loop through this server instead.", metavar="URL")
    paper_control: bool = option("Control without feed-forward and gravity terms.", False)
    gui: bool = option("Open the simulator's window, no faster than real time.", False)
    video: Path | None = option("Film to write.", metavar="MP4")
    friction: float | None = option("Friction in the simulator; 0.5 if not given.", metavar="MU")
    object_mass: float | None = option("Mass of the object; 0.1 kg if not given.", metavar="KG")
    noise: float | None = option("Spread of the measured object position (m).", metavar="M")
    seed: int | None = option("Seed of the noise.")
    disturb: tuple[str, ...] = option("push@T=FX,FY (N) or friction@T=MU; may be repeated.", (), metavar="WHAT")

    @property
    def given(self) -> list[str]:
        """The options that were given, as they are written."""
        given = [each.name for each in fields(self) if getattr(self, each.name) != each.default]
        return [f"--{name.replace('_', '-')}" for name in given]

    def refuse_without_simulator(self) -> None:
        """Check that no option is given that would have no effect.

        Raises:
            InputError: one is.
        """
        for name in self.given:
            raise InputError(f"{name} needs --simulator")
