"""The messages of `WS /stream` in their packed form, the same for both ends; little-endian, float32.

    step:   sequence uint32, age float32 (s), pan rows uint16, object rows uint16; then the pan's rows, 6 numbers each,
            and the object's, 4 numbers each
    chunk:  sequence uint32, status uint16, acceleration rows uint16, brake rows uint16, two bytes of nothing; then
            the rows, 3 numbers each

No rows are a state that is missing, one row is the last state, C rows are the last C. The same messages as JSON:
{"sequence", "age", "pan", "object"} and {"sequence", "status", "acceleration", "brake"}; there nothing is rounded.

Clients that open a stream as LEVEL_STREAM_FORMAT move a level pan: its rows have 4 numbers, and accelerations 2.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.errors import InputError
from runtime.physics.pan import IN_PLANE
from runtime.stream import StreamStatus

STREAM_FORMAT = "slide-stream/2"
LEVEL_STREAM_FORMAT = "slide-stream/1"

AXES = 3
"""Axes that a pan moves along; 2 under LEVEL_STREAM_FORMAT."""

STEP_HEAD = struct.Struct("<IfHH")
CHUNK_HEAD = struct.Struct("<IHHHxx")
STATUSES = tuple(StreamStatus)


class Step(NamedTuple):
    """What a controller sends: the last states, (n, 6) of the pan, (n, 4) of the object, and their age (s).

    They are None where one is missing; those of a level pan may be (n, 4).
    """

    sequence: int
    pan: FloatArray | None
    object: FloatArray | None
    age: float = 0.0


class Chunk(NamedTuple):
    """What it gets: the next C pan accelerations, (C, 3), and the stop from the end of them, (n, 3) (m/s^2)."""

    sequence: int
    acceleration: FloatArray
    brake: FloatArray
    status: StreamStatus


def pack_step(step: Step) -> bytes:
    """Return the bytes of a step."""
    pan, sliding = _rows(None if step.pan is None else _in_space(step.pan), 2 * AXES), _rows(step.object, 4)
    head = STEP_HEAD.pack(step.sequence, step.age, len(pan), len(sliding))
    return head + pan.tobytes() + sliding.tobytes()


def unpack_step(data: bytes, axes: int = AXES) -> Step:
    """Read a step, of a pan that moves along so many axes; a value that is no finite number is one that is missing.

    Raises:
        InputError: another length than its head says.
    """
    if len(data) < STEP_HEAD.size:
        raise InputError(f"a step has at least {STEP_HEAD.size} bytes, got {len(data)}")
    sequence, age, pan_rows, object_rows = STEP_HEAD.unpack_from(data)
    values = _values(data, STEP_HEAD.size, 2 * axes * pan_rows + 4 * object_rows)
    pan = values[: 2 * axes * pan_rows].reshape(-1, 2 * axes)
    sliding = values[2 * axes * pan_rows :].reshape(-1, 4)
    return Step(sequence, pan if len(pan) else None, sliding if len(sliding) else None, age)


def pack_chunk(chunk: Chunk) -> bytes:
    """Return the bytes of a chunk, along as many axes as its accelerations have."""
    axes = chunk.acceleration.shape[1]
    head = CHUNK_HEAD.pack(chunk.sequence, STATUSES.index(chunk.status), len(chunk.acceleration), len(chunk.brake))
    return head + _rows(chunk.acceleration, axes).tobytes() + _rows(chunk.brake, axes).tobytes()


def unpack_chunk(data: bytes) -> Chunk:
    """Read a chunk.

    Raises:
        InputError: another length than its head says, an unknown status, or a value that is no finite number.
    """
    if len(data) < CHUNK_HEAD.size:
        raise InputError(f"a chunk has at least {CHUNK_HEAD.size} bytes, got {len(data)}")
    sequence, status, rows, brake_rows = CHUNK_HEAD.unpack_from(data)
    if status >= len(STATUSES):
        raise InputError(f"there is no status {status}")
    values = _values(data, CHUNK_HEAD.size, AXES * (rows + brake_rows)).reshape(-1, AXES)
    if not np.isfinite(values).all():
        raise InputError("a value is no finite number")
    return Chunk(sequence, values[:rows], values[rows:], STATUSES[status])


def _in_space(pan: FloatArray) -> FloatArray:
    """Return pan states as (n, 6): those of a level pan may be (n, 4), or (4,)."""
    rows = np.atleast_2d(pan)
    if rows.shape[-1] == 2 * AXES:
        return rows
    states = np.zeros((len(rows), 2 * AXES))
    states[:, IN_PLANE] = rows
    return states


def _rows(state: FloatArray | None, width: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return np.zeros((0, width), "<f4") if state is None else np.reshape(np.asarray(state, "<f4"), (-1, width))


def _values(data: bytes, offset: int, count: int) -> FloatArray:
    if len(data) != offset + 4 * count:
        raise InputError(f"the head says {offset + 4 * count} bytes, got {len(data)}")
    return np.frombuffer(data, "<f4", count, offset).astype(np.float64)
