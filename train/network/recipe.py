"""How the network is trained.

There is one curriculum: friction. A run begins on pans so slippery that the object, wherever the pan goes, hardly
follows it: to move the object is to move the pan the other way. Friction then grows to all of it within the share
`eased` of the run, and with it the need to stick and slip. Later, trajectories are disturbed, and decoders are asked
before their chunk has ended.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from torch import Tensor, nn

from runtime.errors import InputError
from runtime.network.units import CHUNK, SEEN_ROWS, Situation, Units
from train.commands.families import free_commands
from train.learn.checkpoint import weights_to_use
from train.learn.recipe import Outcome, cosine_decay
from train.network.closed_loop import Decoding, decode, replay
from train.network.config import GROUPS, TrainConfig
from train.network.losses import farthest, loss, tracking_errors, tracking_price
from train.network.network import Network
from train.network.situations import Step, Trajectories, draw_step, draw_trajectories, join, trajectories_of

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
    config: TrainConfig
    """The prices at this step."""


class NetworkRecipe:
    """The recipe of a `TrainConfig`; see `train.learn.recipe.Recipe`."""

    def __init__(self, config: TrainConfig) -> None:
        self.config = config

    def build(self) -> Network:
        """Return the network."""
        return build_network(self.config)

    def decoding(self, network: nn.Module) -> Decoding:
        """Return `decode` as a module."""
        return Decoding(cast(Network, network))

    def stage(self, step: int, steps: int) -> int:
        """Return 1 while friction grows, 3 once trajectories are disturbed, 4 once decoders are asked early, else 2."""
        progress = step / steps
        config = self.config
        return (
            1 if progress < config.eased else 2 + (progress >= config.disturbed_from) + (progress >= config.asked_from)
        )

    def learning_rate(self, step: int, steps: int) -> float:
        """Return the learning rate: in each part of the run it rises in `warm_up` steps and falls."""
        config = self.config
        parts = [0, *(math.ceil(restart.after * steps) for restart in config.restarts), steps]
        began = max(part for part in parts if part <= step)
        ends = min(part for part in parts if part > step)
        decayed = cosine_decay(
            config.at(step / steps).learning_rate, config.final_learning_rate, (step - began) / (ends - began)
        )
        return decayed * min(1.0, (step - began + 1) / config.warm_up)

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
        return Part(shared, join(parts), self.config.at(progress))

    def outcome(self, decoding: nn.Module, drawn: Part, device: torch.device) -> Outcome:
        """Decode, and take the loss."""
        trajectories = drawn.trajectories.to(device)
        with torch.autocast(device.type, torch.bfloat16, enabled=self.config.precision == "bfloat16"):
            moved = decoding(trajectories, drawn.step)
        errors = tracking_errors(moved, trajectories)
        config = drawn.config
        price = loss(moved, trajectories, errors, config)
        if config.robust > 0.0:
            other = replay(moved.u, trajectories, drawn.step, *other_friction(trajectories, config.off))
            price = price + config.robust * tracking_price(tracking_errors(other, trajectories))
        return Outcome(price, errors.detach().mean(), farthest(moved).detach().mean())

    def validate(self, network: nn.Module, device: torch.device) -> dict[str, float]:
        """Track fixed commands with the pans of VALIDATED, told their friction."""
        figures = {}
        chunks = (CHUNK,) * (VALIDATION_SAMPLES // CHUNK)
        for name, pan in VALIDATED.items():
            trajectories = validation_trajectories(*pan, questions=len(chunks)).to(device)
            with torch.no_grad():
                moved = decode(cast(Network, network), trajectories, Step(VALIDATION_SAMPLES, chunks, None, 0))
            figures[f"{name}_tracking"] = tracking_errors(moved, trajectories).mean().item()
            figures[f"{name}_reach"] = farthest(moved).mean().item()
        return figures


def other_friction(drawn: Trajectories, share: float) -> tuple[Tensor, Tensor]:
    """Return static and kinetic coefficients (B,) that are off by `share`: one of four corners each, by turns."""
    row = torch.arange(len(drawn.static), device=drawn.static.device)
    static = drawn.static * (1.0 + share * (2 * (row % 2) - 1))
    kinetic = drawn.kinetic * (1.0 + share * (2 * (row // 2 % 2) - 1))
    return static, torch.minimum(static, kinetic)


def build_network(config: TrainConfig) -> Network:
    """Return the configuration's network with freshly drawn weights."""
    torch.manual_seed(config.seed)
    return Network(config.units, config.layers, config.features)


def load_network(checkpoint: dict[str, Any]) -> tuple[TrainConfig, Network]:
    """Return a checkpoint's configuration and the network to evaluate or export.

    Raises:
        InputError: it is the paper's own network.
    """
    if checkpoint["config"].get("network") == "paper":
        raise InputError("a run of the paper's own network is only evaluated:  slide-eval RUN --reproduce DIR")
    config = TrainConfig.model_validate(checkpoint["config"])
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
