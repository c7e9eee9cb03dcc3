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
    friction: float | None = option("Friction in the simulator; the plan's kinetic one if not given.", metavar="MU")
    object_mass: float | None = option("Mass of the object; 0.1 kg if not given.", metavar="KG")
    noise: float | None = option("Spread of the measured object position (m).", metavar="M")
    camera_rate: float | None = option("Closed loop by a camera of so many frames a second.", metavar="HZ")
    latency: float | None = option("Time until a frame is told (s).", metavar="S")
    dropout: float | None = option("Share of the frames that are lost.", metavar="SHARE")
    command_delay: float | None = option("Time until the arm executes a command (s).", metavar="S")
    seed: int | None = option("Seed of noise and losses.")
    identify: bool = option("Say what friction and delay were found on the way.", False)
    log: Path | None = option("Log to write, for slide-identify.", metavar="CSV")
    disturb: tuple[str, ...] = option("push@T=FX,FY (N) or friction@T=MU; may be repeated.", (), metavar="WHAT")

    @property
    def sees(self) -> bool:
        """Whether the loop is closed by a camera, rather than by states every millisecond."""
        return any(value is not None for value in (self.camera_rate, self.latency, self.dropout)) or self.identify

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
