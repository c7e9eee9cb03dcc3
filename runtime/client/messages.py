"""The messages of `WS /stream` in their packed form, the same for both ends; little-endian, float32.

    step:   sequence uint32, age float32 (s), pan rows uint16, object rows uint16, frames uint16, encoder readings
            uint16, samples executed uint16 (EXECUTED for all), two bytes of nothing; then the pan's rows, 6 numbers
            each, the object's, 4 numbers each, the frames (x, y, age, executed) and the encoder readings (state of 6
            numbers, age, executed); there a NaN as executed is all samples
    chunk:  sequence uint32, status uint16, acceleration rows uint16, brake rows uint16, two bytes of nothing; then
            the rows, 3 numbers each

No rows are a state that is missing, one row is the last state, C rows are the last C. The same messages as JSON:
{"sequence", "age", "pan", "object", "frames", "encoders", "executed"} and {"sequence", "status", "acceleration",
"brake"}; there nothing is rounded.

Clients that open a stream as LEVEL_STREAM_FORMAT move a level pan: its rows have 4 numbers, accelerations 2, and the
head of a step ends after the object rows.
"""

from __future__ import annotations

import math
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

STEP_HEAD = struct.Struct("<IfHHHHHxx")
LEVEL_STEP_HEAD = struct.Struct("<IfHH")
CHUNK_HEAD = struct.Struct("<IHHHxx")
STATUSES = tuple(StreamStatus)

EXECUTED = (1 << 16) - 1
"""Stands for all samples of a chunk."""

MOST_READINGS = 256
"""Most frames, and most encoder readings, that one step tells of."""


class Reading(NamedTuple):
    """What a camera or encoders saw: see `Stream.see_object` and `Stream.see_pan`.

    Attributes:
        value: (2,) position of the object (m), or (6,) or of a level pan (4,) state of the pan (m, m/s).
        age: when it was told (s).
        executed: samples of the chunk given last that had been executed then; None for all of them.
    """

    value: FloatArray
    age: float = 0.0
    executed: int | None = None


class Step(NamedTuple):
    """What a controller sends: the last states, (n, 6) of the pan, (n, 4) of the object, and their age (s).

    They are None where one is missing; those of a level pan may be (n, 4). `executed` is the number of the chunk's
    samples after which the next one is asked for, None for all of them.
    """

    sequence: int
    pan: FloatArray | None
    object: FloatArray | None
    age: float = 0.0
    frames: tuple[Reading, ...] = ()
    encoders: tuple[Reading, ...] = ()
    executed: int | None = None


class Chunk(NamedTuple):
    """What it gets: the next C pan accelerations, (C, 3), and the stop from the end of them, (n, 3) (m/s^2)."""

    sequence: int
    acceleration: FloatArray
    brake: FloatArray
    status: StreamStatus


def pack_step(step: Step) -> bytes:
    """Return the bytes of a step."""
    pan, sliding = _rows(None if step.pan is None else _in_space(step.pan), 2 * AXES), _rows(step.object, 4)
    executed = EXECUTED if step.executed is None else step.executed
    counts = len(pan), len(sliding), len(step.frames), len(step.encoders), executed
    parts = [STEP_HEAD.pack(step.sequence, step.age, *counts), pan.tobytes(), sliding.tobytes()]
    parts += [_packed(frame.value, frame) for frame in step.frames]
    parts += [_packed(_in_space(encoder.value)[0], encoder) for encoder in step.encoders]
    return b"".join(parts)


def unpack_step(data: bytes, axes: int = AXES) -> Step:
    """Read a step, of a pan that moves along so many axes; a value that is no finite number is one that is missing.

    Raises:
        InputError: another length than its head says.
    """
    head = STEP_HEAD if axes == AXES else LEVEL_STEP_HEAD
    if len(data) < head.size:
        raise InputError(f"a step has at least {head.size} bytes, got {len(data)}")
    sequence, age, *counts = head.unpack_from(data)
    pan_rows, object_rows, frames, encoders, executed = counts if axes == AXES else (*counts, 0, 0, EXECUTED)
    widths = (2 * axes * pan_rows, 4 * object_rows, (2 + 2) * frames, (2 * axes + 2) * encoders)
    values = _values(data, head.size, sum(widths))
    pan, sliding, seen, read = np.split(values, np.cumsum(widths)[:-1])
    return Step(
        sequence,
        pan.reshape(-1, 2 * axes) if pan_rows else None,
        sliding.reshape(-1, 4) if object_rows else None,
        age,
        _unpacked(seen.reshape(-1, 2 + 2)),
        _unpacked(read.reshape(-1, 2 * axes + 2)),
        None if executed == EXECUTED else executed,
    )


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


def _packed(value: FloatArray, reading: Reading) -> bytes:
    executed = math.nan if reading.executed is None else reading.executed
    return np.array([*value, reading.age, executed], "<f4").tobytes()


def _unpacked(rows: FloatArray) -> tuple[Reading, ...]:
    """Return readings from rows (n, d + 2).

    Raises:
        InputError: a number of samples is not whole.
    """
    executed = rows[:, -1]
    if not (np.isnan(executed) | (executed == np.floor(np.clip(executed, 0.0, EXECUTED)))).all():
        raise InputError("the samples executed at a reading must be a whole number, or NaN for all of them")
    return tuple(Reading(row[:-2], float(row[-2]), None if math.isnan(row[-1]) else int(row[-1])) for row in rows)


def _rows(state: FloatArray | None, width: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return np.zeros((0, width), "<f4") if state is None else np.reshape(np.asarray(state, "<f4"), (-1, width))


def _values(data: bytes, offset: int, count: int) -> FloatArray:
    if len(data) != offset + 4 * count:
        raise InputError(f"the head says {offset + 4 * count} bytes, got {len(data)}")
    return np.frombuffer(data, "<f4", count, offset).astype(np.float64)
