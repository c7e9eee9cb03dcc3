"""How a real controller sees and acts: a camera that is slow, late, noisy and blind now and then, and a late arm."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from runtime.arm.interface import Arm, Measured, ObjectStatus, PanCommand
from runtime.arm.run import LONGEST_ENDING, RESTED, Source
from runtime.documents.checks import FloatArray, check_ranges
from runtime.errors import InputError
from runtime.physics.law import DT

RANGES = (
    ("camera_rate", 5.0, 1000.0, " frames a second"),
    ("latency", 0.0, 0.1, " s"),
    ("noise", 0.0, 0.1, " m"),
    ("dropout", 0.0, 0.9, ""),
    ("command_delay", 0.0, 0.1, " s"),
)
"""Names of what is chosen, the lowest and the highest value, and the unit."""


@dataclass(frozen=True)
class Eyes:
    """What a camera sees, and when.

    Attributes:
        camera_rate: frames a second (1/s).
        latency: time from a frame's exposure until it is told (s).
        noise: standard deviation of a position (m).
        dropout: share of the frames that are lost.
        command_delay: time from a command to its execution (s).
        seed: of noise and losses: with the same seed everything repeats.

    Raises:
        InputError: a value is out of range.
    """

    camera_rate: float = 60.0
    latency: float = 0.0
    noise: float = 0.0
    dropout: float = 0.0
    command_delay: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        check_ranges(self, RANGES)
        if self.seed < 0:
            raise InputError(f"seed must be 0 or more, got {self.seed}", "seed")


class Frame(NamedTuple):
    """A picture: the sample at which it was taken, and where it shows the object, (2,) relative to the pan (m)."""

    taken: int
    position: FloatArray


class Camera:
    """Takes frames sample by sample and tells them later.

    Args:
        eyes: how it sees.

    Attributes:
        eyes: how it sees.
        frames: all that were not lost.
    """

    def __init__(self, eyes: Eyes) -> None:
        self.frames: list[Frame] = []
        self.eyes, self._rng = eyes, np.random.default_rng(eyes.seed)
        self._late, self._count = round(eyes.latency / DT), 0
        self._coming: deque[Frame] = deque()

    def look(self, k: int, measured: Measured) -> list[Frame]:
        """Return the frames that are told at sample k, in which something was measured; an object off the pan is not
        seen.
        """
        if k >= round(self._count / (self.eyes.camera_rate * DT)):
            self._count += 1
            noise, lost = self._rng.normal(0.0, 1.0, 2), self._rng.random() < self.eyes.dropout
            if not lost and measured.status is not ObjectStatus.OFF_PAN:
                self.frames.append(Frame(k, measured.sliding[:2] + self.eyes.noise * noise))
                self._coming.append(self.frames[-1])
        told = []
        while self._coming and self._coming[0].taken + self._late <= k:
            told.append(self._coming.popleft())
        return told


class Seeing(Protocol):
    """What `Planner.stream` gives: told what is seen, it gives chunks; see `runtime.Stream`."""

    def see_object(self, position: FloatArray, age: float, executed: int) -> None:
        """Take in where the object was, `age` ago (s), when so many samples of the chunk have been executed."""

    def see_pan(self, state: FloatArray, age: float, executed: int) -> None:
        """Take in where the pan was."""

    @property
    def due(self) -> bool:
        """Whether it should be asked before its chunk has ended."""

    def step(self, *, executed: int) -> FloatArray:
        """Give the accelerations (C, 3) (m/s^2) of the next chunk, after so many samples of the last one."""


def watching(stream: Seeing, camera: Camera, chunk: int, samples: int) -> Source:
    """Let a stream follow by what a camera and the arm's encoders tell; encoders tell every sample, at once.

    The source ends as that of `runtime.arm.run.closed_loop`.

    Args:
        stream: what follows.
        camera: what sees.
        chunk: samples of a chunk, C.
        samples: of its command, K.
    """
    u, rested, begin = np.zeros((chunk, 3)), 0, -chunk

    def source(k: int, measured: Sequence[Measured]) -> FloatArray | None:
        nonlocal u, rested, begin
        executed = k - begin
        for frame in camera.look(k, measured[-1]):
            stream.see_object(frame.position, (k - frame.taken) * DT, executed)
        stream.see_pan(measured[-1].pan, 0.0, executed)
        if executed == chunk or stream.due:
            u, begin = stream.step(executed=executed), k
            rested = 0 if u.any() or k < samples else rested + 1
        now: FloatArray = u[k - begin]
        return None if rested > RESTED or k >= samples + round(LONGEST_ENDING / DT) else now

    return source


class LateArm:
    """An arm that executes what it is told some time later; until then it holds still.

    Args:
        arm: the arm.
        delay: the time (s).
    """

    def __init__(self, arm: Arm, delay: float) -> None:
        self._arm, self._samples = arm, round(delay / DT)
        self._waiting: deque[PanCommand] = deque()

    def reset(self, object_position: FloatArray) -> Measured:
        """Begin; see `Arm`."""
        still = PanCommand(np.zeros(3), np.zeros(3), np.zeros(3))
        self._waiting = deque([still] * self._samples)
        return self._arm.reset(object_position)

    def step(self, command: PanCommand) -> Measured:
        """Execute what was told a while ago; see `Arm`."""
        self._waiting.append(command)
        return self._arm.step(self._waiting.popleft())

    def close(self) -> None:
        """Let go of the arm; see `Arm`."""
        self._arm.close()
