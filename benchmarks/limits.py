"""The suite under the limits of arms that people own: `python -m benchmarks.limits RUN`, level and with height.

Mean and worst tracking error in mm. Acceleration, jerk and speed are held at every sample; reach and height are the
network's own affair, and are measured.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from benchmarks.suite.suite import suite
from runtime.documents.checks import FloatArray
from runtime.errors import SlideError
from runtime.friction import Friction
from runtime.physics.law import GRAVITY
from train.general.network import GeneralNetwork
from train.general.real_time import Followed, PanLimits, follow
from train.general.recipe import load_network
from train.network.checkpoint import load_checkpoint

HEIGHT = 0.1
"""Height of pans that lift (m)."""


class Row(NamedTuple):
    """Commands, and the pan and the friction they are followed with.

    Attributes:
        name: of the row.
        limits: of the pan, without height.
        friction: of the object.
        family: of the suite.
        size: what the commands are multiplied by.
        slowness: how many times as long they take.
        reach_used: share of its reach that the network is told.
    """

    name: str
    limits: PanLimits
    friction: Friction
    family: str
    size: float = 1.0
    slowness: int = 1
    reach_used: float = 1.0


DEFAULT = PanLimits(0.2, 30.0, 10_000.0)
PANDA = PanLimits(0.2, 13.0, 6_500.0, 1.7)
FR3 = PanLimits(0.2, 9.0, 4_500.0, 3.0)
SMALL = PanLimits(0.1, 30.0, 10_000.0)

ROWS = (
    Row("default", DEFAULT, Friction(1.0, 0.5), "spline"),
    Row("default", DEFAULT, Friction(1.0, 0.5), "shapes"),
    Row("default", DEFAULT, Friction(1.0, 0.5), "stops"),
    Row("panda", PANDA, Friction(1.0, 0.5), "spline"),
    Row("panda", PANDA, Friction(1.0, 0.5), "shapes"),
    Row("panda", PANDA, Friction(1.0, 0.5), "stops"),
    Row("panda", PANDA, Friction(0.5, 0.3), "spline"),
    Row("fr3", FR3, Friction(1.0, 0.5), "spline"),
    Row("fr3", FR3, Friction(0.5, 0.3), "spline"),
    Row("fr3", FR3, Friction(0.3, 0.2), "spline"),
    Row("4 m/s^2, 4 x time", PanLimits(0.2, 4.0, 1_000.0), Friction(0.2, 0.15), "spline", slowness=4),
    Row("reach 0.1, half size", SMALL, Friction(1.0, 0.5), "spline", size=0.5),
    Row("reach 0.1, half size", SMALL, Friction(1.0, 0.5), "shapes", size=0.5),
    Row("default, 0.15 x size", DEFAULT, Friction(1.0, 0.5), "spline", size=0.15, reach_used=0.3),
)


class Figures(NamedTuple):
    """Tracking error of the commands (m), and the pans' largest distances in the plane and up or down (m)."""

    errors: FloatArray
    reach: float
    height: float


def commands_of(row: Row, count: int | None = None) -> FloatArray:
    """Return a row's commands, (B, K, 2) in metres at 1 kHz."""
    position = row.size * np.stack(suite([row.family])[row.family].positions[:count])
    if row.slowness == 1:
        return position
    old = np.arange(position.shape[1])
    t = np.arange((position.shape[1] - 1) * row.slowness + 1) / row.slowness
    slow = [[np.interp(t, old, axis) for axis in each.T] for each in position]
    return np.moveaxis(np.array(slow), 1, 2)


def measure(network: GeneralNetwork, row: Row, height: float, count: int | None = None, **how: float) -> Figures:
    """Follow a row's commands with pans that lift by `height`; `how` is for `follow`."""
    position = commands_of(row, count)
    how = {"reach_used": row.reach_used} | how
    followed = follow(network, position, row.limits._replace(height=height), row.friction, row.friction, **how)
    return figures(followed, position)


def figures(followed: Followed, position: FloatArray) -> Figures:
    """Return how well B commands (B, K, 2) were followed; their first row, where all begin, counts as on its mark."""
    squared = ((followed.sliding[:, :-1, :2] - position[:, 1:]) ** 2).sum(-1)
    pan = followed.pan
    return Figures(
        np.sqrt(squared.sum(1) / position.shape[1]),
        float(np.linalg.norm(pan[..., :2], axis=-1).max()),
        float(np.abs(pan[..., 2]).max()),
    )


def main(arguments: Sequence[str]) -> None:
    """Print the table for the run or checkpoint that is named, of the first COUNT commands of each family if given."""
    torch.set_num_threads(1)
    _, network = load_network(load_checkpoint(Path(arguments[0])))
    count = int(arguments[1]) if len(arguments) > 1 else None
    print(f"{'limits':22s} {'friction':9s} {'commands':8s} {'level':>40s} {'height 0.1 m':>40s}")
    for row in ROWS:
        cells = []
        for height in (0.0, HEIGHT):
            if height == 0.0 and row.friction.static * GRAVITY >= row.limits.acceleration:
                cells.append("cannot slide")
                continue
            found = measure(network, row, height, count)
            cells.append(
                f"{1e3 * found.errors.mean():6.2f} ({1e3 * found.errors.max():5.1f}) "
                f"reach {found.reach:.3f} z {found.height:.3f}"
            )
        friction = f"{row.friction.static:g}/{row.friction.kinetic:g}"
        print(f"{row.name:22s} {friction:9s} {row.family:8s} {cells[0]:>40s} {cells[1]:>40s}", flush=True)


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except SlideError as error:
        sys.exit(f"benchmarks.limits: {error}")
