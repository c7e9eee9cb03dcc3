"""What the server and its planning process say to each other, and how it travels.

A message is pickled, which is safe between two programs that are one. Before it goes its length, and the length of the
bytes that follow it: a plan travels beside its message, for to pickle it would copy it three times more.
"""

from __future__ import annotations

import pickle
import struct
from pathlib import Path
from typing import NamedTuple

from runtime import Command, Friction, InputError, Limits, Sizes, Start

LENGTHS = struct.Struct("<QQ")
"""Lengths (bytes) of a message and of what follows it."""

BUFFER = 1 << 20
"""Bytes that may wait between the processes, as far as the system allows: about three plans."""


class PlannerOptions(NamedTuple):
    """What the process plans with; its first message.

    Attributes:
        model: the bundle's folder; the shipped one if None.
        sha256: what the bundle must have.
        compile: whether to compile what can be, which takes seconds: plans are made faster, and can be refined.
    """

    model: Path | None
    sha256: str
    compile: bool


class PlanJob(NamedTuple):
    """One command to be planned, in the runtime's terms; a list of them is one batch.

    Attributes:
        command, friction, limits, start, sizes, tolerance, candidates, robust, refine_ms: as for `Planner.plan`.
        npz: whether the plan is written as npz; as JSON otherwise.
    """

    command: Command
    friction: Friction
    limits: Limits
    start: Start
    sizes: Sizes
    tolerance: float | None = None
    candidates: int | None = None
    robust: float | None = None
    refine_ms: float | None = None
    npz: bool = False

    @property
    def alone(self) -> bool:
        """Whether no other job can be planned together with this one."""
        return self.candidates is not None or self.refine_ms is not None


class PlanReply(NamedTuple):
    """About a plan, which follows.

    Attributes:
        number: of the job in its batch, from 0.
        status: of the plan.
        together: plans made together, said with the first of them; 0 with the others.
        encode, decode: time in the encoder, and in all the rest of the planning, of all made together (s).
        write: time to write this plan (s).
    """

    number: int
    status: str
    together: int
    encode: float
    decode: float
    write: float


class PlanFailure(NamedTuple):
    """About a plan that could not be made.

    Attributes:
        number: of the job in its batch, from 0.
        error: what is wrong with the job; None if it is not to blame.
    """

    number: int
    error: InputError | None


def frame(message: object, follows: int = 0) -> bytes:
    """Return a message as it travels, with the lengths before it; so many bytes will follow it."""
    data = pickle.dumps(message, pickle.HIGHEST_PROTOCOL)
    return LENGTHS.pack(len(data), follows) + data
