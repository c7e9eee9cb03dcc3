"""The pans, objects and commands of a training step, each drawn by itself, in the network's units."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from runtime.documents.checks import FloatArray
from runtime.network.units import ACCELERATION, CHUNK, ENCODER_CHUNK, REACH, SEEN_ROWS, Situation, Units
from train.commands.batch import make_batch
from train.commands.families import Commands, free_commands
from train.network.config import GROUPS, TrainConfig
from train.network.network import Told

LEAST_EASE = 0.05
"""Share of its friction that an object has when a run begins: with so little, pans need not stick and slip."""

SLOW_GROUPS = (1, 5)
"""Groups whose commands take twice as long."""

EARLIEST = 16
"""Samples that are executed at least before the decoder is asked again."""

NOMINAL = (1.0, 0.5)
"""The paper's friction."""


class Step(NamedTuple):
    """What all trajectories of a step have in common.

    Attributes:
        samples: length of the trajectories, K.
        executed: samples that are executed before each next question to the decoder; their sum is K.
        reread: the question before which the encoder reads the rest of the command anew; None for never.
        pushed_at: sample before which objects are pushed.
    """

    samples: int
    executed: tuple[int, ...]
    reread: int | None
    pushed_at: int


class Trajectories(NamedTuple):
    """B trajectories; row k of what has K rows, but for `command`, is the instant t_(k+1).

    Attributes:
        command: (B, K, 4) positions and velocities.
        object_position: (B, K, 2) where the objects should be.
        mask: (B, K) 1 for samples that count.
        told: what the network is told.
        static, kinetic, gravity: (B,) of the law.
        jerk, speed, height: (B,) limits.
        start: (B, 10) states before the first sample.
        push: (B, 10) added to the states at the push.
        noise: (questions, B, rows, 10) added to what the decoder sees.
    """

    command: Tensor
    object_position: Tensor
    mask: Tensor
    told: Told
    static: Tensor
    kinetic: Tensor
    gravity: Tensor
    jerk: Tensor
    speed: Tensor
    height: Tensor
    start: Tensor
    push: Tensor
    noise: Tensor

    def to(self, device: torch.device) -> Trajectories:
        """Return them on another device."""
        return Trajectories(
            *(Told(*(x.to(device) for x in part)) if isinstance(part, Told) else part.to(device) for part in self)  # type: ignore[arg-type]
        )


def draw_step(config: TrainConfig, progress: float, rng: np.random.Generator) -> Step:
    """Draw what the trajectories of a step have in common, at `progress` (0 to 1) of the run."""
    low, high = (samples // ENCODER_CHUNK for samples in config.samples)
    if progress < config.eased:
        high = max(low, high // 2)  # what they learn first, they learn on short ones
    samples = int(rng.integers(low, high + 1)) * ENCODER_CHUNK
    early = progress >= config.asked_from and rng.random() < config.asked
    executed = draw_executed(samples, rng) if early else (CHUNK,) * (samples // CHUNK)
    reread = None
    if progress >= config.disturbed_from and rng.random() < config.reread:
        reread = int(rng.integers(1, len(executed)))
    return Step(samples, executed, reread, int(rng.integers(1, samples)))


def draw_executed(samples: int, rng: np.random.Generator) -> tuple[int, ...]:
    """Draw how many samples are executed each time: as many each time, or as it happens."""
    regular = int(rng.choice([EARLIEST, 32, 32, 48])) if rng.random() < 0.55 else 0
    executed: list[int] = []
    while (left := samples - sum(executed)) > 0:
        irregular = int(rng.integers(EARLIEST, CHUNK + 1)) if rng.random() < 0.7 else CHUNK
        executed.append(min(left, regular or irregular))
    return tuple(executed)


def draw_trajectories(config: TrainConfig, progress: float, step: Step, group: int, seed: list[int]) -> Trajectories:
    """Draw one of the GROUPS parts of a step's trajectories; all of it follows from `seed` and `group`."""
    rng = np.random.default_rng([*seed, group + 1])
    count = config.batch // GROUPS
    commands = draw_commands(config, step.samples, count, group, rng)
    situation = draw_situation(config, progress, count, rng)
    disturbed = float(progress >= config.disturbed_from)

    start, push = np.zeros((count, 10)), np.zeros((count, 10))
    start[:, :6] = _pan_states(config, situation.height, rng)
    start[:, 6:] = _off_mark(config, rng, count)
    start *= rng.random((count, 1)) < disturbed * config.displaced
    push[:, 6:] = _off_mark(config, rng, count) * (rng.random((count, 1)) < disturbed * config.pushed)
    noise = np.zeros((len(step.executed), count, len(SEEN_ROWS), 10))
    noisy = rng.random(count) < disturbed * config.noisy
    shape = (len(step.executed), int(noisy.sum()), len(SEEN_ROWS), 10)
    noise[:, noisy] = rng.standard_normal(shape) * np.repeat([*config.noise, *config.noise], [3, 3, 2, 2])

    return trajectories_of(commands, situation, start, push, noise)


def trajectories_of(
    commands: Commands, situation: Situation, start: FloatArray, push: FloatArray, noise: FloatArray
) -> Trajectories:
    """Return commands to be followed, each in its situation; `start`, `push` and `noise` as in `Trajectories`."""
    batch = make_batch(commands.position, commands.samples, None, situation.static, situation.kinetic)
    of_pans = (situation.gravity, situation.jerk, situation.speed, situation.height, start, push, noise)
    return Trajectories(
        batch.command,
        batch.object_position,
        batch.mask,
        Told.of(situation),
        batch.static,
        batch.kinetic,
        *(torch.from_numpy(part) for part in of_pans),
    )


def join(parts: list[Trajectories]) -> Trajectories:
    """Return several parts as one."""
    columns: list[Tensor | Told] = []
    for name, several in zip(Trajectories._fields, zip(*parts, strict=True), strict=True):
        if name == "told":
            columns.append(Told(*(torch.cat(column) for column in zip(*several, strict=True))))
        else:
            columns.append(torch.cat(several, dim=1 if name == "noise" else 0))
    return Trajectories(*columns)  # type: ignore[arg-type]


def draw_commands(config: TrainConfig, samples: int, count: int, group: int, rng: np.random.Generator) -> Commands:
    """Draw commands, faster ones in later groups, and slower than anybody draws them in SLOW_GROUPS."""
    slowness = 2 if group in SLOW_GROUPS else 1
    low, high = config.speed
    speed = low + (high - low) * (group + rng.random()) / GROUPS
    reach = config.far if rng.random() < config.far_share else config.reach
    drawn = free_commands(rng, count, samples // slowness, config.families, reach, speed * slowness, CHUNK // slowness)
    if slowness == 1:
        return drawn
    # Straight lines between the samples: at half a millisecond, a network sees no difference.
    between = 0.5 * (drawn.position + np.concatenate([drawn.position[:, 1:], drawn.position[:, -1:]], axis=1))
    position = np.stack([drawn.position, between], axis=2).reshape(count, samples, 2)
    return Commands(position, 2 * drawn.samples - 1, None)


def draw_situation(config: TrainConfig, progress: float, count: int, rng: np.random.Generator) -> Situation:
    """Draw pans with their limits, and objects with their friction, as strong as `progress` has it."""
    most = rng.random(count) < config.most
    acceleration = np.where(most, _evenly(rng, config.strength, count), _evenly(rng, config.acceleration, count))
    jerk = np.clip(acceleration * _evenly(rng, config.rise, count), *config.jerk)
    reach = np.where(rng.random(count) < config.usual_reach, REACH, _evenly(rng, config.pan_reach, count))
    speed = np.where(rng.random(count) < config.any_speed, np.inf, _evenly(rng, config.pan_speed, count))
    height = np.where(rng.random(count) < config.usual_height, 0.1, _evenly(rng, config.height, count))
    level = rng.random(count) < config.level
    height[level] = 0.0

    units = Units.of(reach, acceleration, jerk)
    told = (rng.random(count) < config.told).astype(np.float64)
    none = np.zeros(count)
    situation = Situation.of(units, jerk, speed, height, none, none, told)
    top = np.minimum(config.static[1], strongest_friction(situation.gravity, ~level, config.drive))
    low = np.minimum(config.static[0], 0.5 * top)
    static = np.where(
        rng.random(count) < 0.5,
        rng.uniform(np.minimum(0.1, 0.5 * top), top),
        np.exp(rng.uniform(np.log(low), np.log(top))),
    )
    kinetic = static * rng.uniform(*config.kinetic, count)
    nominal = (rng.random(count) < config.nominal) & (top > NOMINAL[0])
    ease = LEAST_EASE + (1.0 - LEAST_EASE) * min(1.0, progress / config.eased) if config.eased > 0.0 else 1.0
    return situation._replace(
        static=ease * np.where(nominal, NOMINAL[0], static), kinetic=ease * np.where(nominal, NOMINAL[1], kinetic)
    )


def strongest_friction(gravity: FloatArray, lifts: NDArray[np.bool_], drive: float) -> FloatArray:
    """Return the static friction (B,) that pans overcome with the share `drive` of their acceleration limit.

    A level pan needs mu g. One that lifts accelerates downwards meanwhile: mu (g - a sin) = a cos is within reach of
    a = mu g / sqrt(1 + mu^2).
    """
    share = drive * ACCELERATION / gravity
    lifting = share / np.sqrt(np.maximum(1.0 - share * share, 1e-9))
    return np.where(lifts, np.where(share < 1.0, lifting, np.inf), share)


def _pan_states(config: TrainConfig, height: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draw where pans are and how they move, (B, 6): those that may lift, up and down too."""
    count = len(height)
    angle, radius = rng.uniform(0.0, 2.0 * np.pi, count), rng.uniform(0.0, config.start_reach, count)
    velocity = rng.normal(0.0, config.start_speed, (count, 3))
    # Half of the height is left to stop in: v^2 / (2 braking) with the braking of the loss.
    fastest = np.sqrt(0.5 * config.braking * height)
    states = np.stack(
        [radius * np.cos(angle), radius * np.sin(angle), height * rng.uniform(-0.5, 0.5, count), *velocity.T], axis=1
    )
    states[:, 5] = np.clip(0.5 * states[:, 5], -fastest, fastest)
    return states


def _off_mark(config: TrainConfig, rng: np.random.Generator, count: int) -> FloatArray:
    """Draw how far objects are from their marks, and the velocities of those that slide, (count, 4)."""
    sliding = rng.integers(0, 2, (count, 1))
    return np.concatenate(
        [rng.normal(0.0, config.push, (count, 2)), rng.normal(0.0, config.push_speed, (count, 2)) * sliding], axis=1
    )


def _evenly(rng: np.random.Generator, ends: tuple[float, float], count: int) -> FloatArray:
    """Draw numbers whose logarithms are uniform."""
    return np.exp(rng.uniform(np.log(ends[0]), np.log(ends[1]), count))
