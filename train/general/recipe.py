"""How the network for every arm and every pan is trained.

There is one curriculum: friction. A run begins on pans so slippery that the object, wherever the pan goes, hardly
follows it: to move the object is to move the pan the other way. Friction then grows to all of it within the share
`eased` of the run, and with it the need to stick and slip. Later, trajectories are disturbed, and decoders are asked
before their chunk has ended.
"""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numpy as np
import torch
from torch import nn

from runtime.errors import InputError
from runtime.network.units import CHUNK, SEEN_ROWS, Situation, Units
from train.commands.families import free_commands
from train.config import read_config
from train.general.closed_loop import Decoding, decode
from train.general.config import GROUPS, GeneralConfig
from train.general.losses import farthest, loss, tracking_errors
from train.general.network import GeneralNetwork
from train.general.situations import Step, Trajectories, draw_step, draw_trajectories, join, trajectories_of
from train.learn.recipe import Outcome, learning_rate
from train.network.checkpoint import weights_to_use

VALIDATION_SEED = 2018
VALIDATION_COMMANDS = 32
VALIDATION_SAMPLES = 1280

VALIDATED = {
    "30_level": (30.0, 10_000.0, 0.0, 1.0, 0.5),
    "30_lifting": (30.0, 10_000.0, 0.1, 1.0, 0.5),
    "9_level": (9.0, 4_500.0, 0.0, 0.3, 0.2),
    "9_lifting": (9.0, 4_500.0, 0.1, 0.5, 0.3),
}
"""Pans with a reach of 0.2 m: acceleration (m/s^2), jerk (m/s^3), height (m), static and kinetic friction."""


class Part(NamedTuple):
    """A process's part of a step's batch."""

    step: Step
    trajectories: Trajectories


class GeneralRecipe:
    """The recipe of a `GeneralConfig`; see `train.learn.recipe.Recipe`."""

    def __init__(self, config: GeneralConfig) -> None:
        self.config = config

    def build(self) -> GeneralNetwork:
        """Return the network."""
        return build_network(self.config)

    def decoding(self, network: nn.Module) -> Decoding:
        """Return `decode` as a module."""
        return Decoding(cast(GeneralNetwork, network))

    def stage(self, step: int, steps: int) -> int:
        """Return 1 while friction grows, 3 once trajectories are disturbed, 4 once decoders are asked early, else 2."""
        progress = step / steps
        config = self.config
        return (
            1 if progress < config.eased else 2 + (progress >= config.disturbed_from) + (progress >= config.asked_from)
        )

    def learning_rate(self, step: int, steps: int) -> float:
        """Return the learning rate, which comes to its own within `warm_up` steps."""
        return learning_rate(self.config, step / steps) * min(1.0, (step + 1) / self.config.warm_up)

    def draw(self, step: int, steps: int, rows: slice) -> Part:
        """Draw the groups that the rows belong to.

        Raises:
            InputError: the rows are not whole groups.
        """
        size = self.config.batch // GROUPS
        if rows.start % size or rows.stop % size:
            raise InputError(f"batch: its {GROUPS} groups cannot be shared evenly by this many processes")
        progress, seed = step / steps, [self.config.seed, step]
        shared = draw_step(self.config, progress, np.random.default_rng([*seed, 0]))
        groups = range(rows.start // size, rows.stop // size)
        parts = [draw_trajectories(self.config, progress, shared, group, seed) for group in groups]
        return Part(shared, join(parts))

    def outcome(self, decoding: nn.Module, drawn: Part, device: torch.device) -> Outcome:
        """Decode, and take the loss."""
        trajectories = drawn.trajectories.to(device)
        with torch.autocast(device.type, torch.bfloat16, enabled=self.config.precision == "bfloat16"):
            moved = decoding(trajectories, drawn.step)
        errors = tracking_errors(moved, trajectories)
        price = loss(moved, trajectories, errors, self.config)
        return Outcome(price, errors.detach().mean(), farthest(moved).detach().mean())

    def validate(self, network: nn.Module, device: torch.device) -> dict[str, float]:
        """Track fixed commands with the pans of VALIDATED, told their friction."""
        figures = {}
        chunks = (CHUNK,) * (VALIDATION_SAMPLES // CHUNK)
        for name, pan in VALIDATED.items():
            trajectories = validation_trajectories(*pan, questions=len(chunks)).to(device)
            with torch.no_grad():
                moved = decode(cast(GeneralNetwork, network), trajectories, Step(VALIDATION_SAMPLES, chunks, None, 0))
            figures[f"{name}_tracking"] = tracking_errors(moved, trajectories).mean().item()
            figures[f"{name}_reach"] = farthest(moved).mean().item()
        return figures


def build_network(config: GeneralConfig) -> GeneralNetwork:
    """Return the configuration's network with freshly drawn weights."""
    torch.manual_seed(config.seed)
    return GeneralNetwork(config.units, config.layers, config.features)


def load_network(checkpoint: dict[str, Any]) -> tuple[GeneralConfig, GeneralNetwork]:
    """Return a checkpoint's configuration and the network to evaluate or export.

    Raises:
        InputError: it is a network of another kind.
    """
    config = read_config(checkpoint["config"])
    if not isinstance(config, GeneralConfig):
        raise InputError(f"{config.name} is a network for one pan, and this works with networks for every pan")
    network = build_network(config)
    network.load_state_dict(weights_to_use(checkpoint, config))
    return config, network.eval()


def validation_trajectories(
    acceleration: float, jerk: float, height: float, static: float, kinetic: float, questions: int
) -> Trajectories:
    """Return fixed commands, to be followed from rest, on one kind of pan with a reach of 0.2 m (SI)."""
    count = VALIDATION_COMMANDS
    rng = np.random.default_rng(VALIDATION_SEED)
    commands = free_commands(rng, count, VALIDATION_SAMPLES, {"spline_acceleration": 1.0}, (0.03, 0.15), 0.7, 1)
    ones = np.ones(count)
    units = Units.of(0.2 * ones, acceleration * ones, jerk * ones)
    situation = Situation.of(units, jerk * ones, np.inf * ones, height * ones, static * ones, kinetic * ones, ones)
    none = np.zeros((count, 10))
    return trajectories_of(commands, situation, none, none, np.zeros((questions, count, len(SEEN_ROWS), 10)))
