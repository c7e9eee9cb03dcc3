"""Checks a bundle against the network it came from: the same commands, and the same questions to both."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from export.float_graphs import DECODER_SCALE, ENCODER_SCALE
from runtime import Friction
from runtime.errors import SlideError
from runtime.network.bundle import Bundle, LstmState
from runtime.network.units import ACCELERATION, SEEN_ROWS
from train.commands.families import free_commands
from train.network.lstm import DecoderState
from train.network.network import Network, Told, encoder_input
from train.network.real_time import PanLimits, follow

COMMANDS = 16
SAMPLES = 1200
SEED = 9

MAX_DIFFERENCE = 1e-4
"""Largest difference of an answer that an export may show, over the largest acceleration."""


class VerificationError(SlideError):
    """The exported graphs do not do what the network does."""


class Agreement(NamedTuple):
    """How far the answers of a bundle and its network differ, to the same questions.

    Attributes:
        commands: number of commands that were followed, level and lifting.
        questions: asked in all.
        acceleration: largest difference of pan acceleration, over the largest acceleration of a pan.
        memory: largest difference of what the decoder carries.
    """

    commands: int
    questions: int
    acceleration: float
    memory: float

    def rows(self) -> list[tuple[str, str]]:
        """Return it for a person."""
        return [
            ("commands followed with torch and onnxruntime", str(self.commands)),
            ("questions put to both", str(self.questions)),
            ("largest difference of pan acceleration", f"{self.acceleration:.2g} of the limit"),
            ("largest difference of memory", f"{self.memory:.2g}"),
        ]


class Compared(Network):
    """A network that compares each of its answers with those of a bundle.

    Args:
        network: whose weights it has.
        bundle: what is compared.
    """

    def __init__(self, network: Network, bundle: Bundle) -> None:
        super().__init__(network.units, network.layers, network.feedforward.out_features)
        self.load_state_dict(network.state_dict())
        self._bundle = bundle
        self.questions, self.acceleration, self.memory = 0, 0.0, 0.0

    def encode(self, command: Tensor, told: Told) -> DecoderState:
        """Read a command."""
        state = super().encode(command, told)
        self._compare(self._bundle.encode((encoder_input(command, told) / ENCODER_SCALE).numpy()), state)
        return state

    def step(self, observation: Tensor, told: Told, state: DecoderState) -> tuple[Tensor, DecoderState]:
        """Plan one chunk."""
        answer, after = super().step(observation, told, state)
        seen = 10 * len(SEEN_ROWS)
        once = torch.cat([observation[:, :seen], observation[:, seen + 10 :]], dim=1) / DECODER_SCALE
        own = LstmState(state.hidden.numpy(), state.cell.numpy())
        found, memory = self._bundle.decode_step(once.numpy(), own)
        self.questions += 1
        self.acceleration = max(self.acceleration, float(np.abs(found - answer.numpy()).max()) / ACCELERATION)
        self._compare(memory, after)
        return answer, after

    def _compare(self, found: LstmState, own: DecoderState) -> None:
        for ours, its in zip(own, found, strict=True):
            self.memory = max(self.memory, float(np.abs(ours.numpy() - its).max()))


def compare(network: Network, bundle: Path) -> Agreement:
    """Follow commands with a network, level and lifting, and ask its bundle the same questions."""
    compared = Compared(network, Bundle.load(bundle)).eval()
    rng = np.random.default_rng(SEED)
    position = free_commands(rng, COMMANDS, SAMPLES, {"spline_acceleration": 1.0}, (0.03, 0.15), 0.7, 1).position
    for height in (0.0, 0.1):
        follow(compared, position, PanLimits(0.2, 30.0, 10_000.0, height=height), Friction(), Friction())
    return Agreement(2 * COMMANDS, compared.questions, compared.acceleration, compared.memory)


def verify(network: Network, bundle: Path) -> Agreement:
    """Compare, and refuse a bundle that differs from its network by more than rounding.

    Raises:
        VerificationError: the difference and its limit are named.
    """
    agreement = compare(network, bundle)
    if not max(agreement.acceleration, agreement.memory) <= MAX_DIFFERENCE:
        raise VerificationError(
            f"answers of the bundle and the network differ by {agreement.acceleration:.3g} of the largest "
            f"acceleration, their memories by {agreement.memory:.3g}; the limit is {MAX_DIFFERENCE:g}"
        )
    return agreement
