"""`python -m benchmarks.pictures.moving docs/pictures/plan.gif`: a plan as a moving picture, for the README."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from runtime import Command, Plan, Planner

COMMAND = Path(__file__).resolve().parents[2] / "examples" / "figure_eight.csv"

SLOWER = 4.0
"""How many times slower than in reality the plan plays."""

FRAME = 0.04
"""Time between two frames as played (s)."""

HOLD = 0.8
"""How long the last frame stays before the picture begins again (s)."""

VIEW, CLOSE_VIEW = 0.36, 0.085
"""Half of what is seen of the world and of the pan (m)."""

WIDTH, HEIGHT, DPI = 7.2, 3.6, 100
"""Of the picture (inches), and the pixels of an inch."""

COLOURS = 48
"""Of the picture's palette."""


def moving(
    picture: Annotated[Path, typer.Argument(help="GIF to write.", show_default=False)],
    command: Annotated[Path, typer.Option("--command", help="Command to plan.")] = COMMAND,
) -> None:
    """Plan a command and draw pan and object from above, in the world and on the pan."""
    write_gif(picture, Planner().plan(Command.load(command)))


def write_gif(picture: Path, plan: Plan) -> None:
    """Draw a plan from above, frame by frame, and write it as one GIF that repeats."""
    import matplotlib

    matplotlib.use("Agg")
    from PIL import Image

    shots = [_frame(plan, k) for k in range(0, len(plan), round(FRAME / SLOWER / plan.dt))]
    frames = [Image.open(io.BytesIO(shot)).convert("RGB") for shot in shots]
    palette = frames[-1].quantize(COLOURS)
    first, *others = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    durations = [round(FRAME * 1e3)] * len(frames)
    durations[-1] += round(HOLD * 1e3)
    first.save(picture, save_all=True, append_images=others, duration=durations, loop=0, optimize=True)


def _frame(plan: Plan, k: int) -> bytes:
    """Return sample k of a plan as PNG: on the left in the world, on the right as seen from the pan."""
    import matplotlib.pyplot as plt
    from matplotlib.patches import Circle

    figure, (world, pan) = plt.subplots(1, 2, figsize=(WIDTH, HEIGHT), dpi=DPI, layout="constrained")
    centre, on_pan = plan.pan_position[k, :2], plan.object_position[k]
    for axes, title, origin, limit in (
        (world, "In the world: the pan shakes", centre, VIEW),
        (pan, "On the pan: the object follows the path", np.zeros(2), CLOSE_VIEW),
    ):
        axes.set(xlim=(-limit, limit), ylim=(-limit, limit), aspect="equal", xticks=[], yticks=[])
        axes.set_title(title, fontsize=10)
        for side in axes.spines.values():
            side.set_visible(False)
        axes.add_patch(
            Circle(origin.tolist(), plan.sizes.pan_radius, facecolor="#e8eaed", edgecolor="#5f6368", linewidth=2)
        )
        axes.plot(*(plan.command_position + origin).T, color="#9aa0a6", linewidth=1.2, linestyle=(0, (4, 2)))
        axes.plot(*(plan.object_position[: k + 1] + origin).T, color="#d93025", linewidth=1.8)
        axes.add_patch(
            Circle((on_pan + origin).tolist(), plan.sizes.object_radius, facecolor="#d9302540", edgecolor="#d93025")
        )
        axes.plot(*(on_pan + origin), "o", color="#d93025", markersize=4)
    world.plot(*plan.pan_position[: k + 1, :2].T, color="#1a73e8", linewidth=1.2)
    world.plot(*centre, "+", color="#1a73e8", markersize=9)
    world.text(-0.35, -0.35, f"{k * plan.dt:.2f} s, {SLOWER:g} x slower", fontsize=8, color="#5f6368")
    pan.plot([0.03, 0.08], [-0.08, -0.08], color="#5f6368", linewidth=2)
    pan.text(0.055, -0.078, "0.05 m", fontsize=8, color="#5f6368", ha="center", va="bottom")
    shot = io.BytesIO()
    figure.savefig(shot, format="png")
    plt.close(figure)
    return shot.getvalue()


if __name__ == "__main__":
    typer.run(moving)
