"""The training curriculum: Table I of the paper, as a tuple of stages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Model = Literal["A", "B", "C"]
"""The models of Section V-B: A the whole curriculum, B stage 3 alone, C stage 1 alone, for the same epochs."""


@dataclass(frozen=True)
class Stage:
    """One row of Table I.

    A pair of probabilities is (value at the end of the stage before, value at the last epoch of this stage), linear
    in between: (0, 1) over epochs 11-20 is the table's (e - 10)/10.

    Attributes:
        number: the stage's number.
        last_epoch: the stage runs up to and including this epoch.
        pan_loss: probability of the loss L' (Eq. 25) instead of L (Eq. 21), drawn per batch.
        physics: probability of physics-generated command trajectories instead of free ones, drawn per batch.
    """

    number: int
    last_epoch: int
    pan_loss: tuple[float, float]
    physics: tuple[float, float]


ALWAYS = (1.0, 1.0)
NEVER = (0.0, 0.0)

# In stage 2 the table prints "L' with probability (e - 10)/10", which makes L most likely at once and then fades it
# out again until stage 3, and likewise for the trajectories of stage 4. We take the table at its word here.
TABLE_I = (
    Stage(1, 10, pan_loss=ALWAYS, physics=ALWAYS),
    Stage(2, 20, pan_loss=(0.0, 1.0), physics=ALWAYS),
    Stage(3, 30, pan_loss=NEVER, physics=ALWAYS),
    Stage(4, 40, pan_loss=NEVER, physics=(0.0, 1.0)),
    Stage(5, 50, pan_loss=NEVER, physics=NEVER),
)


@dataclass(frozen=True)
class Task:
    """What one epoch trains on; see `Stage` for the probabilities."""

    stage: int
    pan_loss: float
    physics: float


def task_at(model: Model, epoch: int, epochs: int) -> Task:
    """Return the task of `epoch` (from 1) when the stages are stretched over `epochs` epochs."""
    if model != "A":
        only = next(stage for stage in TABLE_I if stage.number == (3 if model == "B" else 1))
        return Task(only.number, only.pan_loss[1], only.physics[1])
    position = epoch * TABLE_I[-1].last_epoch / epochs
    begin = 0
    for stage in TABLE_I:
        if position <= stage.last_epoch:
            break
        begin = stage.last_epoch
    share = (position - begin) / (stage.last_epoch - begin)
    return Task(stage.number, _mix(stage.pan_loss, share), _mix(stage.physics, share))


def _mix(ends: tuple[float, float], share: float) -> float:
    return ends[0] + (ends[1] - ends[0]) * share
