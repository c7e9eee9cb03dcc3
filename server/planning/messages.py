"""What the server and its planning process say to each other."""

from __future__ import annotations

import pickle
import struct
from pathlib import Path
from typing import NamedTuple

from runtime import Command, Friction, InputError, Limits, Start

LENGTHS = struct.Struct("<QQ")

BUFFER = 1 << 20
"""Bytes that may wait between the processes, as far as the system allows: about three plans."""


class Order(NamedTuple):
    """What the process plans with.

    Attributes:
        model: the bundle's folder; the shipped one if None.
        sha256: what the bundle must have.
        compile: whether to compile what can be, which takes seconds: plans are made faster, and can be refined.
    """

    model: Path | None
    sha256: str
    compile: bool


class PlanJob(NamedTuple):
    """What is to be planned, in the runtime's terms; written as npz or as JSON."""

    command: Command
    friction: Friction
    limits: Limits
    start: Start
    refine_ms: float | None = None
    tolerance: float | None = None
    npz: bool = False


class Made(NamedTuple):
    """What there is to say of a plan, which comes after it.

    Attributes:
        number: of what was asked, in its batch, from 0.
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


class Failed(NamedTuple):
    """A plan that could not be made, and the error if what was asked for is to blame."""

    number: int
    error: InputError | None


def packed(message: object, follows: int = 0) -> bytes:
    """Return a message as it is sent, with the lengths before it; so many bytes will follow it."""
    data = pickle.dumps(message, pickle.HIGHEST_PROTOCOL)
    return LENGTHS.pack(len(data), follows) + data
