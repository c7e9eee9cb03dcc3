"""What training costs on one thread: a step, friction's share of it, and whole configurations."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from benchmarks.harness.timing import Spread, interleave
from benchmarks.suite.families import spline
from train.batches.batches import Batch, make_batch
from train.config import CONFIGURATIONS, Precision, TrainConfig
from train.learn.losses import Weights, loss_object
from train.learn.trainer import settle_precision
from train.network.checkpoint import build_model
from train.network.model import Seq2Seq
from train.physics.closed_loop import decode
from train.physics.rollout import rollout

BATCH = 64
SAMPLES = 1000
ROUNDS = 10

SLIPPERY = (0.02, 0.01)
"""Static and kinetic friction of the step that is timed.

An untrained network's accelerations, well under 1 m/s^2, would leave every object stuck, where friction and its
adjoint are cheapest; on a pan this slippery the objects slide.
"""

PROJECTED = {
    "base": CONFIGURATIONS["base"],
    "base, 512 units": CONFIGURATIONS["base"].model_copy(update={"units": 512}),
    "paper": CONFIGURATIONS["paper"],
    "paper, float32": CONFIGURATIONS["paper"].model_copy(update={"precision": "float32"}),
}
"""Configurations whose whole cost is projected from a step or two."""

PROJECTION_ROUNDS = 2


@dataclass(frozen=True)
class Projection:
    """What a whole configuration would cost on one thread, from steps at its mean length.

    Times are of the processor, so that what else the machine does counts little. Drawing the commands and validating
    after each epoch are left out.

    Attributes:
        configuration: its name.
        units: LSTM units per layer.
        batch: trajectories of a step.
        samples: mean length of a trajectory, to a whole chunk.
        precision: of the network's matrix products, as the configuration trains on this machine.
        step: forward, backward and Adam (s).
        epoch: all of its steps (s).
        steps: of the whole run.
        duration: of the whole run (s).
    """

    configuration: str
    units: int
    batch: int
    samples: int
    precision: Precision
    step: float
    epoch: float
    steps: int
    duration: float


@dataclass(frozen=True)
class Training:
    """The cost of a training step.

    Attributes:
        units: LSTM units per layer.
        batch: trajectories.
        samples: samples of a trajectory.
        precision: of the network's matrix products, as the configuration trains on this machine.
        step: forward and backward (s).
        step_float32: the same in float32 (s); None if that is the precision.
        friction: the rollout and its adjoint alone, same shapes and motion (s).
        friction_share: median of friction over step, round by round (0 to 1).
        projections: the cost of whole configurations.
    """

    units: int
    batch: int
    samples: int
    precision: Precision
    step: Spread
    step_float32: Spread | None
    friction: Spread
    friction_share: float
    projections: tuple[Projection, ...]


def measure(
    config: TrainConfig = CONFIGURATIONS["default"],
    rounds: int = ROUNDS,
    projected: Mapping[str, TrainConfig] = PROJECTED,
) -> Training:
    """Time a training step of `config`, batch and length apart, and the rollouts in it by themselves."""
    with torch.random.fork_rng():  # building a network seeds torch's own generator
        model = build_model(config)
    batch = _batch(BATCH, SAMPLES // config.chunk * config.chunk)
    weights = Weights(config.alpha, config.beta, config.gamma, config.pan_limit)
    chunks = decoded_chunks(model, batch)
    precision = settle_precision(config.precision, torch.device("cpu"))
    actions = {
        "friction": lambda: slide(chunks, batch),
        precision: lambda: step(model, batch, weights, precision),
        "float32": lambda: step(model, batch, weights, "float32"),  # the same entry if that is the precision
    }
    durations = interleave(actions, rounds)
    return Training(
        units=config.units,
        batch=BATCH,
        samples=batch.mask.shape[1],
        precision=precision,
        step=Spread.of(durations[precision]),
        step_float32=None if precision == "float32" else Spread.of(durations["float32"]),
        friction=Spread.of(durations["friction"]),
        friction_share=float(np.median(durations["friction"] / durations[precision])),
        projections=tuple(project(name, each) for name, each in projected.items()),
    )


def project(name: str, config: TrainConfig) -> Projection:
    """Time steps of `config` at its own batch and mean length, and multiply."""
    with torch.random.fork_rng():
        model = build_model(config)
    samples = round(sum(config.samples) / 2 / config.chunk) * config.chunk
    batch, weights = _batch(config.batch, samples), Weights(config.alpha, config.beta, config.gamma, config.pan_limit)
    precision = settle_precision(config.precision, torch.device("cpu"))
    optimizer = torch.optim.Adam(model.parameters(), lr=config.learning_rate)

    def whole_step() -> None:
        step(model, batch, weights, precision)
        optimizer.step()

    whole_step()  # warms up
    begin = time.process_time()
    for _ in range(PROJECTION_ROUNDS):
        whole_step()
    duration = (time.process_time() - begin) / PROJECTION_ROUNDS
    steps = config.trajectories // config.batch
    whole = config.epochs * steps
    return Projection(
        name, config.units, config.batch, samples, precision, duration, steps * duration, whole, whole * duration
    )


def _batch(count: int, samples: int) -> Batch:
    """Return the beginnings of the spline commands, as often as it takes, as a batch of the training."""
    commands = spline().positions
    position = np.stack([commands[index % len(commands)][:samples] for index in range(count)])
    static, kinetic = (np.full(count, coefficient) for coefficient in SLIPPERY)
    return make_batch(position, np.full(count, samples), None, static, kinetic)


def step(model: Seq2Seq, batch: Batch, weights: Weights, precision: Precision) -> None:
    """Do the forward and the backward pass of the loss L (Eq. 21)."""
    with torch.autocast("cpu", torch.bfloat16, enabled=precision == "bfloat16"):
        motion = decode(model, batch.command, batch.static, batch.kinetic)
    loss = loss_object(motion.states, motion.u, motion.covariance, batch.object_position, batch.mask, weights)
    model.zero_grad(set_to_none=True)
    loss.backward()  # type: ignore[no-untyped-call]


def decoded_chunks(model: Seq2Seq, batch: Batch) -> list[Tensor]:
    """Return the pan accelerations of a step, (B, C, 2) a chunk, as leaves to differentiate by."""
    with torch.no_grad():
        u = decode(model, batch.command, batch.static, batch.kinetic).u
    return [chunk.contiguous().requires_grad_() for chunk in torch.split(u, model.chunk, dim=1)]


def slide(chunks: list[Tensor], batch: Batch) -> None:
    """Do only what friction does in a step: its rollouts, chunk after chunk, and their adjoints."""
    start = torch.zeros(len(chunks[0]), 8, dtype=torch.float64)
    moved = []
    for u in chunks:
        states = rollout(start, u, batch.static, batch.kinetic)
        start = states[:, -1]
        moved.append(states)
    torch.autograd.grad(moved, chunks, [torch.ones_like(states) for states in moved])
