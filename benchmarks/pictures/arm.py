"""`python -m benchmarks.pictures.arm docs/pictures/arm.webp`: an arm executes a plan in MuJoCo, as a moving picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from benchmarks.pictures.moving import COMMAND, FRAME, HOLD, QUALITY, SLOWER
from runtime import Command, Plan, Planner
from runtime.arm.interface import Measured
from runtime.arm.run import closed_loop, execute
from runtime.arm.simulated import Simulated, Simulator
from runtime.arm.simulation import SimulatedArm
from runtime.arms.options import ArmChoice, choose
from runtime.cli.console import run, say
from runtime.errors import extra

if TYPE_CHECKING:
    from PIL.Image import Image

NAME = "benchmarks.pictures.arm"

SIZE = (560, 315)
"""Of the picture (pixels)."""


def moving_arm(
    picture: Annotated[Path, typer.Argument(help="Picture to write, .webp.", show_default=False)],
    arm: Annotated[str, typer.Option("--arm", help="Which arm.")] = "ur5e",
    command: Annotated[Path, typer.Option("--command", help="Command to plan.")] = COMMAND,
) -> None:
    """Plan a command, execute it on an arm in closed loop, and film it."""
    planner = Planner()
    first, *others = film(planner, planner.plan(Command.load(command)), arm)
    durations = [round(FRAME * 1e3)] * len(others) + [round(HOLD * 1e3)]
    first.save(picture, save_all=True, append_images=others, duration=durations, loop=0, quality=QUALITY, method=6)
    say(NAME, f"wrote {picture}")


def film(planner: Planner, plan: Plan, arm: str) -> list[Image]:
    """Return an arm that executes a plan, frame by frame."""
    with extra("dev"):
        from PIL import Image
    model, place = choose(ArmChoice(arm=arm))
    simulated = SimulatedArm(Simulated(simulator=Simulator.MUJOCO), model.arm, place.home)
    camera = simulated.camera(plan.command_position, SIZE)
    frames: list[Image.Image] = []
    step = round(FRAME / SLOWER / plan.dt)

    def shoot(k: int, measured: Measured) -> None:
        if k % step == 0 and k < len(plan):
            frames.append(Image.fromarray(camera.picture(k)))

    stream = planner.stream(plan.command_position, plan.friction)
    execute(plan, simulated, closed_loop(stream, stream.chunk, len(plan)), [shoot])
    return frames


if __name__ == "__main__":
    run(NAME, moving_arm)
