"""`python -m train.evaluation.pictures FOLDER` draws the commands that a configuration trains on, `commands.png`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from runtime.cli.console import MM, run, say
from runtime.errors import InputError, OutputError, extra
from runtime.physics.law import DT

NAME = "train.evaluation.pictures"
PICTURE = "commands.png"

COLUMNS = 4
SHOWN = 5
"""Commands drawn of each family."""

SAMPLES = 1200
SEED = 3


def main(
    folder: Annotated[Path, typer.Argument(help="Folder to write commands.png into.", show_default=False)],
    config: Annotated[str, typer.Option(help="Configuration whose commands are drawn.")] = "default",
) -> None:
    """Draw some commands of each family that a configuration trains on, coloured by speed, with the family's share."""
    with extra("train"):
        from train.config import load_config
        from train.network.config import TrainConfig
    with extra("report"):
        from matplotlib.figure import Figure
    settings = load_config(config)
    if not isinstance(settings, TrainConfig):
        raise InputError(f"configuration {config} has one family of commands only: there is nothing to compare")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        draw_families(Figure, settings).savefig(folder / PICTURE, dpi=110)
    except OSError as error:
        raise OutputError(f"cannot write to {folder}: {error.strerror}") from error
    say(NAME, f"wrote {folder / PICTURE}")


def draw_families(figure_class: Any, config: Any) -> Any:
    """Return a figure with a panel for each family of a `TrainConfig`."""
    from matplotlib.colors import Normalize

    from train.commands.families import free_commands

    total = sum(config.families.values())
    panels = []
    for name, share in config.families.items():
        rng = np.random.default_rng(SEED)
        commands = free_commands(rng, SHOWN, SAMPLES, {name: 1.0}, config.reach, config.speed[1], 1)
        panels.append((f"{name}, {share / total:.0%}", commands.position))

    rows = -(-len(panels) // COLUMNS)
    figure = figure_class(figsize=(2.9 * COLUMNS + 0.8, 3.1 * rows), layout="constrained")
    grid = np.reshape(figure.subplots(rows, COLUMNS, sharex=True, sharey=True), -1)
    colours = Normalize(0.0, config.speed[1])
    for axes, (title, positions) in zip(grid, panels, strict=False):
        for position in positions:
            lines = axes.add_collection(_path(position, colours))
        half = MM * 1.1 * config.reach[1]
        axes.set(title=title, aspect="equal", xlim=(-half, half), ylim=(-half, half))
    for axes in grid[len(panels) :]:
        axes.set_axis_off()
    figure.supxlabel("x (mm)")
    figure.supylabel("y (mm)")
    figure.colorbar(lines, ax=list(grid), label="speed (m/s)", shrink=0.8, extend="max")
    return figure


def _path(position: Any, colours: Any) -> Any:
    """Return a (K, 2) path from above (mm), coloured by its speed."""
    from matplotlib.collections import LineCollection

    points = MM * position
    speed = np.linalg.norm(np.diff(position, axis=0), axis=-1) / DT
    pieces = list(np.stack([points[:-1], points[1:]], axis=1))
    lines = LineCollection(pieces, norm=colours, cmap="viridis", linewidths=1.5)
    lines.set_array(speed)
    return lines


if __name__ == "__main__":
    run(NAME, main)
