"""What training costs on one thread: the trainer's own step, friction's share of it, and whole configurations.

A step is `train.learn.trainer.Trainer.step` on the last batch of a run, of trajectories of the mean length: forward,
the configuration's loss, backward, the bound on the gradient, the configuration's optimizer, the moving average of the
weights, and the tracking error that is reported. Not in it are the drawing of trajectories, which the trainer does in
another thread, validation and checkpoints.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from rich.table import Table

from benchmarks.harness.section import Measured, Section, Subject
from benchmarks.harness.tables import span, table, targets_table
from benchmarks.harness.targets import PERCENT, Target, Unit, Verdict
from benchmarks.harness.timing import Spread, interleave, one_torch_thread
from runtime.errors import extra

if TYPE_CHECKING:  # torch may not be installed
    from train.config import AnyConfig

PUSH = 8.0
"""Standard deviation of the accelerations that friction is timed with (m/s^2): objects stick and slide."""


class Variation(NamedTuple):
    """A configuration of the training, by name, and what is changed in it."""

    configuration: str
    changes: Mapping[str, object] = {}


@dataclass(frozen=True)
class TrainingSettings:
    """Which steps are timed.

    Attributes:
        configuration: whose step is timed and taken apart.
        batch, samples: trajectories of that step, and their length; a multiple of 8 and one of 128.
        rounds: steps.
        projected: configurations whose whole cost is projected.
        projection_rounds: steps of each of these.
    """

    configuration: str = "default"
    batch: int = 64
    samples: int = 1024
    rounds: int = 10
    projected: tuple[Variation, ...] = (
        Variation("default"),
        Variation("default", {"units": 512}),
        Variation("paper"),
        Variation("paper", {"precision": "float32"}),
    )
    projection_rounds: int = 2


@dataclass(frozen=True)
class Projection:
    """What a whole configuration would cost on one thread, from steps of its own batch at its mean length.

    Times are of the processor, so that what else the machine does counts little.

    Attributes:
        configuration: its name.
        units: LSTM units per layer.
        batch: trajectories of a step.
        samples: mean length of a trajectory, to a whole chunk.
        precision: of the network's matrix products, as the configuration trains on this machine.
        step: one step (s).
        epoch: all steps of an epoch (s).
        steps: of the whole run.
        duration: all steps of the whole run (s).
    """

    configuration: str
    units: int
    batch: int
    samples: int
    precision: str
    step: float
    epoch: float
    steps: int
    duration: float


@dataclass(frozen=True)
class Training:
    """The cost of training.

    Attributes:
        configuration: its name.
        units: LSTM units per layer.
        batch: trajectories.
        samples: samples of a trajectory.
        precision: of the network's matrix products, as the configuration trains on this machine.
        step: one step (s).
        step_float32: the same in float32 (s); None if that is the precision.
        friction: the rollout and its adjoint alone, same shapes and motion (s).
        friction_share: median of friction over step, round by round (0 to 1).
        projections: the cost of whole configurations.
    """

    configuration: str
    units: int
    batch: int
    samples: int
    precision: str
    step: Spread
    step_float32: Spread | None
    friction: Spread
    friction_share: float
    projections: tuple[Projection, ...]


THOUSANDTHS = Unit("s", show="{:.3f}")

TARGETS = (
    Target("step.median", "training step", THOUSANDTHS, "<=", 0.4),
    Target("step_float32.median", "training step in float32", THOUSANDTHS),
    Target("friction_share", "friction's share of a step", PERCENT, "<", 0.1),
    Target("friction.median", "friction and its adjoint", Unit("s", show="{:.4f}")),
)


def measure_training(subject: Subject, settings: TrainingSettings) -> Measured:
    """Time steps of the training; the bundle plays no part in it.

    Raises:
        MissingExtraError: torch, or what else the training needs, is not installed.
    """
    with extra("train"):
        import train.learn.trainer  # noqa: F401
        from train.config import load_config
    sizes = {"batch": settings.batch, "samples": (settings.samples, settings.samples)}
    configuration = load_config(settings.configuration, **sizes)
    projected = [load_config(name, **changes) for name, changes in settings.projected]
    with one_torch_thread():
        projections = tuple(project(each, settings.projection_rounds) for each in projected)
        return Measured(_training(configuration, settings, projections))


def _training(config: AnyConfig, settings: TrainingSettings, projections: tuple[Projection, ...]) -> Training:
    own, precision = trainer_step(config)
    actions = {"friction": friction(settings.batch, settings.samples), precision: own}
    if precision != "float32":
        actions["float32"] = trainer_step(config.model_copy(update={"precision": "float32"}))[0]
    durations = interleave(actions, settings.rounds)
    return Training(
        configuration=config.name,
        units=config.units,
        batch=settings.batch,
        samples=settings.samples,
        precision=precision,
        step=Spread.of(durations[precision]),
        step_float32=None if precision == "float32" else Spread.of(durations["float32"]),
        friction=Spread.of(durations["friction"]),
        friction_share=float(np.median(durations["friction"] / durations[precision])),
        projections=projections,
    )


def project(config: AnyConfig, rounds: int) -> Projection:
    """Time steps of `config` at its own batch and mean length, and multiply."""
    from runtime.network.units import ENCODER_CHUNK
    from train.paper.config import PaperConfig

    chunk = config.chunk if isinstance(config, PaperConfig) else ENCODER_CHUNK
    samples = round(sum(config.samples) / 2 / chunk) * chunk
    step, precision = trainer_step(config.model_copy(update={"samples": (samples, samples)}))
    step()  # warms up
    begin = time.process_time()
    for _ in range(rounds):
        step()
    duration = (time.process_time() - begin) / rounds
    steps = config.trajectories // config.batch
    return Projection(
        configuration=config.name,
        units=config.units,
        batch=config.batch,
        samples=samples,
        precision=precision,
        step=duration,
        epoch=steps * duration,
        steps=config.epochs * steps,
        duration=config.epochs * steps * duration,
    )


def trainer_step(config: AnyConfig) -> tuple[Callable[[], object], str]:
    """Return the last step of a run of the trainer, and the precision it has."""
    import torch

    from train.learn.trainer import Trainer

    with torch.random.fork_rng():  # building a network seeds torch's own generator
        trainer = Trainer(config.model_copy(update={"threads": 1}), Path())  # a step writes nothing into the folder
    last = trainer.steps - 1
    drawn = trainer.recipe.draw(last, trainer.steps, slice(0, config.batch))
    return lambda: trainer.step(last, drawn), trainer.config.precision


def friction(count: int, samples: int) -> Callable[[], object]:
    """Return what only friction does in a step: rollouts of `count` pans that lift, chunk by chunk, and adjoints."""
    import torch

    from runtime.network.units import CHUNK
    from train.physics.rollout import rollout

    u = torch.from_numpy(np.random.default_rng(0).normal(0.0, PUSH, (count, samples, 3)))
    u[..., 2].clamp_(min=-PUSH)
    chunks = [chunk.contiguous().requires_grad_() for chunk in torch.split(u, CHUNK, dim=1)]
    static, kinetic = (torch.full((count,), each, dtype=torch.float64) for each in (1.0, 0.5))

    def slide() -> None:
        start, moved = torch.zeros(count, 10, dtype=torch.float64), []
        for chunk in chunks:
            states = rollout(start, chunk, static, kinetic)
            start = states[:, -1]
            moved.append(states)
        torch.autograd.grad(moved, chunks, [torch.ones_like(states) for states in moved])

    return slide


def training_tables(training: Training, verdicts: Sequence[Verdict]) -> list[Table]:
    """Return the cost of a step beside its targets, and that of whole configurations."""
    details = {"step.median": [span(training.step, THOUSANDTHS)]}
    size = f"{training.batch} x {training.samples} samples, {training.precision}"
    title = f"Training step of {training.configuration}, one thread: {size}"
    rows = [
        (
            each.configuration,
            f"{each.units}",
            f"{each.batch} x {each.samples}, {each.precision}",
            f"{each.step:.2f}",
            f"{each.epoch / 60.0:.1f}",
            f"{each.steps:,}",
            f"{each.duration / 3600.0:.1f}",
        )
        for each in training.projections
    ]
    header = ("configuration", "units", "step", "s/step", "min/epoch", "steps", "hours")
    whole = table("Whole trainings on one thread, steps only, projected from a few of them", header, rows)
    return [*targets_table(title, verdicts, details), whole]


SECTION = Section(
    "training",
    "the trainer's own step, friction's share of it, and the cost of whole trainings",
    TrainingSettings(),
    measure_training,
    TARGETS,
    training_tables,
    timed=True,
)
