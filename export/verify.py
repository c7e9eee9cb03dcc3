"""Checks a bundle against the network it came from: the same commands, decoded in closed loop by both."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from export.general_graphs import DECODER_SCALE, ENCODER_SCALE
from runtime import Friction, Planner
from runtime.errors import SlideError
from runtime.limits import NO_LIMITS
from runtime.network.bundle import Bundle, LstmState
from runtime.network.units import ACCELERATION, SEEN_ROWS
from train.batches.batches import make_batch
from train.commands.families import free_commands
from train.config import TrainConfig
from train.general.network import GeneralNetwork, Told, encoder_input
from train.general.real_time import PanLimits, follow
from train.network.model import DecoderState, Seq2Seq
from train.physics.closed_loop import decode

COMMANDS = 16
SAMPLES = 1200
SEED = 9

MAX_ACCELERATION_DIFFERENCE = 1e-3
"""Largest difference of pan accelerations (m/s^2) that an export may show before the branches part."""

MAX_POSITION_DIFFERENCE = 1e-5
"""Largest difference of pan and object positions (m) that an export may show before the branches part."""


MAX_ANSWER_DIFFERENCE = 1e-4
"""Largest difference of an answer that an export may show, over the largest acceleration."""


class VerificationError(SlideError):
    """The exported graphs do not do what the network does."""


class Agreement(NamedTuple):
    """How far a bundle and its network differ up to the first difference of stick/slip branch.

    Attributes:
        commands: number of commands replayed.
        samples: samples compared, of all commands.
        parted: commands in which the branches parted before the end.
        acceleration: largest difference of pan acceleration (m/s^2).
        position: largest difference of pan or object position (m).
    """

    commands: int
    samples: int
    parted: int
    acceleration: float
    position: float

    def rows(self) -> list[tuple[str, str]]:
        """Return it for a person."""
        return [
            ("commands replayed through torch and onnxruntime", str(self.commands)),
            ("samples until a branch parted, or the end", f"{self.samples} ({self.parted} parted)"),
            ("largest difference of pan acceleration", f"{self.acceleration:.2g} m/s^2"),
            ("largest difference of position", f"{self.position:.2g} m"),
        ]


def compare(model: Seq2Seq, config: TrainConfig, bundle: Path) -> Agreement:
    """Decode the same commands through torch and through the bundle, and measure how far they differ.

    A difference in the last digit of an acceleration can make an object break away one sample later; from there on
    both trajectories are right and different, so each command is compared up to that instant only.
    """
    rng = np.random.default_rng(SEED)
    longest = min(SAMPLES, config.samples[1])  # longer ones are planned by windows, which torch's loop knows nothing of
    commands = free_commands(rng, COMMANDS, longest, config.families, config.reach, config.speed, config.chunk)
    friction = Friction(config.static, config.kinetic)
    planner = Planner(bundle)
    acceleration = position = 0.0
    samples = parted = 0
    for command, count in zip(commands.position, commands.samples, strict=True):
        plan = planner.plan(command[:count], friction=friction, limits=NO_LIMITS)  # the network itself
        batch = make_batch(
            command[None], np.array([count]), None, np.array([friction.static]), np.array([friction.kinetic])
        )
        with torch.no_grad():
            motion = decode(model, batch.command, batch.static, batch.kinetic)
        # Row k of `after` is the state at t_{k+1}; the plan's row k is the state at t_k.
        after = motion.states[0, : count - 1].numpy()
        sliding = (plan.object_velocity[1:] != 0).any(axis=1)
        differs = np.flatnonzero(sliding != (after[:, 6:8] != 0).any(axis=1))
        end = int(differs[0]) if differs.size else int(count) - 1
        if end == 0:
            raise VerificationError("the branches part at the first sample: the graphs do not match the network")
        parted += bool(differs.size)
        samples += end
        acceleration = max(
            acceleration, float(np.abs(plan.pan_acceleration[:end, :2] - motion.u[0, :end].numpy()).max())
        )
        position = max(
            position,
            float(np.abs(plan.pan_position[1 : end + 1, :2] - after[:end, 0:2]).max()),
            float(np.abs(plan.object_position[1 : end + 1] - command[0] - after[:end, 4:6]).max()),
        )
    return Agreement(COMMANDS, samples, parted, acceleration, position)


def verify(model: Seq2Seq, config: TrainConfig, bundle: Path) -> Agreement:
    """Compare, and refuse a bundle that differs from its network by more than rounding.

    Raises:
        VerificationError: the difference and its limit are named.
    """
    agreement = compare(model, config, bundle)
    if not agreement.acceleration <= MAX_ACCELERATION_DIFFERENCE:
        raise VerificationError(
            f"pan accelerations of the bundle and the network differ by {agreement.acceleration:.3g} m/s^2 before the "
            f"first difference of branch; the limit is {MAX_ACCELERATION_DIFFERENCE:g}"
        )
    if not agreement.position <= MAX_POSITION_DIFFERENCE:
        raise VerificationError(
            f"positions of the bundle and the network differ by {agreement.position:.3g} m before the first "
            f"difference of branch; the limit is {MAX_POSITION_DIFFERENCE:g}"
        )
    return agreement


class AnswersAgreement(NamedTuple):
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


class Compared(GeneralNetwork):
    """A network that compares each of its answers with those of a bundle.

    Args:
        network: whose weights it has.
        bundle: what is compared.
    """

    def __init__(self, network: GeneralNetwork, bundle: Bundle) -> None:
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


def compare_answers(network: GeneralNetwork, bundle: Path) -> AnswersAgreement:
    """Follow commands with a network, level and lifting, and ask its bundle the same questions."""
    compared = Compared(network, Bundle.load(bundle)).eval()
    rng = np.random.default_rng(SEED)
    position = free_commands(rng, COMMANDS, SAMPLES, {"spline_acceleration": 1.0}, (0.03, 0.15), 0.7, 1).position
    for height in (0.0, 0.1):
        follow(compared, position, PanLimits(0.2, 30.0, 10_000.0, height=height), Friction(), Friction())
    return AnswersAgreement(2 * COMMANDS, compared.questions, compared.acceleration, compared.memory)


def verify_answers(network: GeneralNetwork, bundle: Path) -> AnswersAgreement:
    """Compare, and refuse a bundle that differs from its network by more than rounding.

    Raises:
        VerificationError: the difference and its limit are named.
    """
    agreement = compare_answers(network, bundle)
    if not max(agreement.acceleration, agreement.memory) <= MAX_ANSWER_DIFFERENCE:
        raise VerificationError(
            f"answers of the bundle and the network differ by {agreement.acceleration:.3g} of the largest "
            f"acceleration, their memories by {agreement.memory:.3g}; the limit is {MAX_ANSWER_DIFFERENCE:g}"
        )
    return agreement
