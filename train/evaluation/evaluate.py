"""Evaluation of trained networks, as checkpoints or as bundles: tracking, pan reach, robustness to friction."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from runtime import Friction, Plan, Planner
from runtime.arm.run import Follower
from runtime.errors import InputError
from runtime.limits import Limits
from runtime.network.manifest import MANIFEST_FILE, Manifest
from runtime.network.units import CHUNK
from runtime.physics.motion import in_space
from runtime.physics.pan import IN_PLANE
from train.commands.batch import Batch, make_batch
from train.commands.families import FAMILIES, FloatArray, free_commands
from train.config import AnyConfig, read_config
from train.learn.checkpoint import load_checkpoint
from train.network.real_time import PanLimits
from train.network.real_time import follow as follow_commands
from train.network.recipe import load_network
from train.paper import recipe as paper
from train.paper.closed_loop import decode
from train.paper.config import PaperConfig
from train.paper.network import PaperNetwork

SEED = 11
COMMANDS = 64
SAMPLES = 1200
REACH = (0.03, 0.15)
SPEED = 0.7
NOMINAL = Friction()

PANS = {"": 0.0, ", lifting": 0.1}
"""What is added to a network's name, and how far the pan lifts (m)."""


class Subject(NamedTuple):
    """A network under evaluation.

    Attributes:
        name: what it is called.
        plan: plans (B, K, 2) commands under a friction.
        follow: begins to follow a (K, 2) command from measured states.
        chunk: samples it decodes at a time, C.
        origin: how it came about, for people: its training and the limits it is decoded with.
    """

    name: str
    plan: Callable[[FloatArray, Friction], list[Plan]]
    follow: Callable[[FloatArray], Follower]
    chunk: int
    origin: str


class Row(NamedTuple):
    """Figures over one family of commands; RMSE and reach in metres, change of acceleration in m/s^2."""

    rmse_mean: float
    rmse_median: float
    rmse_worst: float
    still_mean: float
    reach_mean: float
    reach_worst: float
    change_mean: float


def load_subjects(source: Path, name: str = "") -> list[Subject]:
    """Return the network of a run's folder, a checkpoint file or a bundle's folder.

    It is two subjects, on a level pan and on one that lifts; the paper's own, which moves level pans only, is one.

    Args:
        source: its path.
        name: what to call it; as its folder if empty.

    Raises:
        FormatError, BundleError: it is none of these.
    """
    name = name or (source.parent.name if source.is_file() else source.name)
    if (source / MANIFEST_FILE).exists():
        planner = Planner(source)
        return [_of_bundle(planner, f"{name}{lifting}", Limits(height=height)) for lifting, height in PANS.items()]
    checkpoint = load_checkpoint(source)
    if isinstance(read_config(checkpoint["config"]), PaperConfig):
        return [_of_papers_run(checkpoint, name)]
    return [_of_run(checkpoint, f"{name}{lifting}", height) for lifting, height in PANS.items()]


def _of_bundle(planner: Planner, name: str, limits: Limits) -> Subject:
    def plan(position: FloatArray, friction: Friction) -> list[Plan]:
        return planner.plan_batch(list(position), friction, limits=limits)

    def follow(position: FloatArray) -> Follower:
        return planner.stream(position, limits=limits)

    chunk = planner.stream(np.zeros((2, 2)), limits=limits).chunk
    return Subject(name, plan, follow, chunk, f"{_origin_of(planner.bundle.manifest)}; limits in force")


def _of_papers_run(checkpoint: dict[str, Any], name: str) -> Subject:
    config, network = paper.load_network(checkpoint)

    def plan(position: FloatArray, friction: Friction) -> list[Plan]:
        inputs = _held(position, config.chunk, friction)
        with torch.no_grad():
            u = decode(network, inputs.command, inputs.static, inputs.kinetic).u.numpy()
        samples = position.shape[1]
        return [
            Plan.of_accelerations(one[:samples], friction, name, each) for one, each in zip(u, position, strict=True)
        ]

    origin = f"{_trained(config, checkpoint['epoch'], checkpoint['began_with'])}; no limits"
    return Subject(name, plan, lambda position: PaperStream(network, position), config.chunk, origin)


def _of_run(checkpoint: dict[str, Any], name: str, height: float) -> Subject:
    config, network = load_network(checkpoint)
    limits = Limits()
    pan = PanLimits(limits.pan_reach, limits.acceleration, limits.jerk, height=height)

    def plan(position: FloatArray, friction: Friction) -> list[Plan]:
        u = follow_commands(network, position, pan, friction, friction).acceleration
        return [Plan.of_accelerations(one, friction, name, each) for one, each in zip(u, position, strict=True)]

    def follow(_: FloatArray) -> Follower:
        raise InputError(f"{name}: a network follows as a bundle: make one of it with  slide-export")

    origin = f"{_trained(config, checkpoint['epoch'], checkpoint['began_with'])}; acceleration, jerk and speed held"
    return Subject(name, plan, follow, CHUNK, origin)


def _origin_of(manifest: Manifest) -> str:
    """Say on how much a bundle's network was trained; its manifest may say so in another way, or not at all."""
    training = manifest.training
    try:
        return _trained(read_config(training["configuration"]), training["epochs"], training["began_with"])
    except (KeyError, TypeError, ValueError):
        return "training unknown"


def _trained(config: AnyConfig, epochs: int, began_with: Mapping[str, str] | None) -> str:
    """Say on how much a network was trained, and after what."""
    model = f"model {config.model}, " if isinstance(config, PaperConfig) else ""
    after = f", after {began_with['name']}" if began_with else ""
    return f"{model}{epochs * config.trajectories:,} trajectories{after}"


def _held(position: FloatArray, chunk: int, friction: Friction) -> Batch:
    """Hold (B, K, 2) commands at their last position to the next whole chunk."""
    batch, samples = position.shape[:2]
    held = np.concatenate([position, position[:, -1:].repeat(-samples % chunk, axis=1)], axis=1)
    ones = np.ones(batch)
    return make_batch(held, np.full(batch, samples), None, friction.static * ones, friction.kinetic * ones)


class PaperStream:
    """`runtime.Stream` for the paper's own network.

    Args:
        network: the network.
        position: (K, 2) where the object should be, from the origin (m).
    """

    def __init__(self, network: PaperNetwork, position: FloatArray) -> None:
        command = _held(position[None], network.chunk, NOMINAL).command
        self._network = network
        with torch.no_grad():
            self._state = network.encode(command.reshape(1, -1, 4 * network.chunk))

    def step(self, pan_state: FloatArray, object_state: FloatArray) -> FloatArray:
        """Give the next chunk's accelerations; see `Follower`."""
        seen = torch.from_numpy(np.concatenate([pan_state[:, IN_PLANE], object_state], axis=1))[None]
        with torch.no_grad():
            output, self._state = self._network.step(seen, self._state)
        return in_space(output.acceleration[0].double().numpy())


def commands_of(family: str, count: int = COMMANDS, seed: int = SEED) -> FloatArray:
    """Draw the evaluation's commands of one family, (count, 1200, 2), none of which training draws."""
    rng = np.random.default_rng([seed, list(FAMILIES).index(family)])
    return free_commands(rng, count, SAMPLES, {family: 1.0}, REACH, SPEED, 1).position


def still_rmse(position: FloatArray) -> FloatArray:
    """RMS over time of the distance that a pan that never moves leaves between object and command, (B,) in metres."""
    return np.asarray(np.sqrt((position**2).sum(-1).mean(axis=1)))


def evaluate(subject: Subject, family: str, friction: Friction = NOMINAL) -> Row:
    """Evaluate a network on one family of commands."""
    position = commands_of(family)
    plans = subject.plan(position, friction)
    error = np.array([plan.quality.tracking_rmse for plan in plans])
    reach = np.array([plan.quality.pan_reach for plan in plans])
    change = np.mean([np.linalg.norm(np.diff(plan.pan_acceleration, axis=0), axis=-1).mean() for plan in plans])
    return Row(
        float(error.mean()),
        float(np.median(error)),
        float(error.max()),
        float(still_rmse(position).mean()),
        float(reach.mean()),
        float(reach.max()),
        float(change),
    )
