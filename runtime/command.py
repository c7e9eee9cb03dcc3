"""A command: where the object is to be on the pan, sample by sample, from a file, waypoints or an array.

Positions are metres relative to the pan, 1 kHz. The object starts at the first position, at rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any, Self

import numpy as np

from runtime.commands import arrays
from runtime.commands.bounds import MAX_JUMP, MAX_SAMPLES, check_extent, check_length
from runtime.commands.build import build
from runtime.commands.files import STANDARD_INPUT, parse, read_source
from runtime.commands.json_documents import from_document
from runtime.commands.points import Points
from runtime.commands.reading import Reading
from runtime.documents.checks import FloatArray
from runtime.documents.files import reading as prefixed
from runtime.errors import InputError
from runtime.physics.law import DT
from runtime.physics.motion import squares

MAX_DEVIATION = 0.002
"""Deviation from the straight lines between waypoints of which nothing is said (m)."""

PLAIN = Reading()
"""Metres relative to the pan's centre, and seconds."""


def command_velocity(position: FloatArray, dt: float = DT) -> FloatArray:
    """Return the velocity of a command as the network is given it: central differences, one-sided at the ends.

    Args:
        position: (..., K, 2) (m), K at least 2.
        dt: sampling interval (s).

    Returns:
        (..., K, 2) velocity (m/s).
    """
    velocity = np.empty(position.shape)
    np.subtract(position[..., 2:, :], position[..., :-2, :], out=velocity[..., 1:-1, :])
    velocity[..., 1:-1, :] /= 2.0 * dt
    velocity[..., 0, :] = (position[..., 1, :] - position[..., 0, :]) / dt
    velocity[..., -1, :] = (position[..., -1, :] - position[..., -2, :]) / dt
    return velocity


@dataclass(frozen=True, eq=False)
class Command:
    """Where the object is to be at t_k = k dt, dt = 1 ms.

    Attributes:
        position: (K, 2) relative to the pan's centre (m), K at least 2; a read-only copy of what was given.
        deviation: how far it leaves the straight lines between the waypoints it was made of (m); 0 if it is these.
        notes: what was taken from where and what was changed on the way, a line each.

    Raises:
        InputError: another shape, fewer than two samples, longer than 600 s, a value that is no finite number or
            beyond 100 m, or a jump of more than 0.05 m from one sample to the next; row and column are named.
    """

    position: FloatArray
    deviation: float = 0.0
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        position = arrays.positions(self.position)
        check_length(len(position))
        check_extent(position)
        if len(position) > MAX_SAMPLES:
            message = f"position has {len(position)} samples at 1 kHz, at most {MAX_SAMPLES} are allowed"
            raise InputError(message, "position")
        jumps = squares(np.diff(position, axis=0))
        for row in np.flatnonzero(jumps > MAX_JUMP * MAX_JUMP):
            raise InputError(
                f"position jumps by {math.sqrt(jumps[row]):.4g} m from sample {row} to {row + 1} of the 1 kHz time "
                f"line (t = {row * DT:.3f} s), at most {MAX_JUMP:g} m is allowed",
                "position",
            )
        position.setflags(write=False)
        object.__setattr__(self, "position", position)

    def __reduce__(self) -> tuple[type[Self], tuple[Any, ...]]:
        return type(self), tuple(getattr(self, field.name) for field in fields(self))  # read-only after pickling too

    def __len__(self) -> int:
        """Return the number of samples, K."""
        return len(self.position)

    def __repr__(self) -> str:
        x, y = self.position[0]
        return (
            f"<Command of {(len(self) - 1) * DT:g} s ({len(self)} samples) from ({x:.4f}, {y:.4f}) m: "
            f"reach {self.reach:.4g} m, speed {self.speed:.3g} m/s>"
        )

    @cached_property
    def velocity(self) -> FloatArray:
        """(K, 2) velocity relative to the pan (m/s)."""
        return command_velocity(self.position)

    @property
    def reach(self) -> float:
        """Largest distance from the first position (m)."""
        return math.sqrt(squares(self.position - self.position[0]).max())

    @property
    def speed(self) -> float:
        """Largest speed (m/s)."""
        return math.sqrt(squares(self.velocity).max())

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a plan says of the command: that it leaves the straight lines between its waypoints."""
        if self.deviation <= MAX_DEVIATION:
            return ()
        return (f"the command leaves the straight lines between its waypoints by {self.deviation * 1e3:.1f} mm",)

    @classmethod
    def from_samples(cls, position: object, dt: float = DT, reading: Reading = PLAIN) -> Self:
        """Build a command from evenly spaced samples, resampled to 1 kHz if dt is not 1 ms.

        Args:
            position: (n, 2) relative to the pan (m), by numpy, torch, pandas or as a list; or a DataFrame, whose
                columns are found by their names, time among them.
            dt: their sampling interval (s), if there are no times.
            reading: what the numbers mean, if they are not metres relative to the pan's centre.

        Raises:
            InputError: dt is not greater than zero, or see `Command` and `from_waypoints`.
        """
        dt = arrays.interval(dt)
        points = arrays.from_array(position, reading) if reading.columns else arrays.from_samples(position, reading)
        if points.t is None and reading.rate is None and reading.speed is None:
            points = points._replace(dt=dt)
        return cls._built(points, reading)

    @classmethod
    def from_waypoints(cls, t: object, position: object, reading: Reading = PLAIN) -> Self:
        """Build a command from positions at any times, resampled to 1 kHz so that it stays between them.

        Positions that are on the 1 kHz grid already are taken as they are. A last piece shorter than 1 ms is cut.
        Sparse waypoints begin and end at rest; see `runtime.commands.resample`.

        Args:
            t: (n,) increasing times (s), or dates of numpy or pandas; the first is the start, whatever its value.
            position: (n, 2) relative to the pan (m), as for `from_samples`.
            reading: what the numbers mean, if they are not metres relative to the pan's centre.

        Raises:
            InputError: t does not increase, lasts less than 1 ms or more than 600 s, the numbers look like another unit
                than metres and seconds, or see `Command`.
        """
        return cls._built(Points(arrays.positions(position), arrays.times(t, "t")), reading)

    @classmethod
    def from_path(
        cls, points: object, speed: float, acceleration: float | None = None, reading: Reading = PLAIN
    ) -> Self:
        """Build a command that runs along a path without times, from rest to rest, slower in bends.

        Args:
            points: (n, 2) corners of the path, relative to the pan (m).
            speed: highest speed along it (m/s).
            acceleration: highest acceleration along it (m/s^2); 2 if None.
            reading: what the numbers mean, if they are not metres relative to the pan's centre.

        Raises:
            InputError: the path is shorter than 10 mm or longer than 100 m, speed or acceleration is not greater than
                zero, or see `Command`.
        """
        reading = replace(reading, speed=speed, path_acceleration=acceleration)
        return cls._built(Points(arrays.positions(points)), reading)

    @classmethod
    def from_dict(cls, document: object, source: str = "command", reading: Reading = PLAIN) -> Self:
        """Build a command from a document: `{"dt", "position"}`, `{"t", "position"}`, columns by name, points, strokes.

        Args:
            document: the parsed document; options of `Reading` may stand beside its keys.
            source: where it came from, for the message.
            reading: options that count before the document's.

        Raises:
            FormatError: a key is missing or unknown, or see `from_samples` and `from_waypoints`.
        """
        with prefixed(source):
            return cls._built(*from_document(document, reading))

    @classmethod
    def load(cls, path: str | PathLike[str], reading: Reading = PLAIN) -> Self:
        """Read a command file: a table as text, JSON, npz, npy, Parquet or SVG, whatever its name.

        Args:
            path: the file; "-" is standard input.
            reading: what its numbers mean, where it does not say it.

        Raises:
            FormatError: the file cannot be read, or is not what it seems to be; see also `from_waypoints`.
            MissingExtraError: it is Parquet, and pyarrow is not installed.
        """
        with prefixed("standard input" if str(path) == STANDARD_INPUT else str(path)):
            return cls._built(*parse(read_source(Path(path)), reading))

    @classmethod
    def _built(cls, points: Points, reading: Reading) -> Self:
        return cls(*build(points, reading))
