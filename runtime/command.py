"""A command: where the object is to be on the pan, sample by sample, from a file, waypoints or an array.

Positions are metres relative to the pan, 1 kHz. The object starts at the first position, at rest.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any, Self

import numpy as np

from runtime.documents.checks import FloatArray, column, number, table
from runtime.documents.files import parse_json, parse_npz, read_bytes, read_text, reading
from runtime.errors import InputError
from runtime.physics.law import DT

MAX_DURATION = 600.0
"""Longest command (s). Nobody shakes a pan for ten minutes; a time column in milliseconds looks as if."""

MAX_SAMPLES = round(MAX_DURATION / DT) + 1

MAX_JUMP = 0.05
"""Largest distance from one 1 kHz sample to the next (m): 50 m/s, so it is a gap, another unit or a broken line."""

MAX_POSITION = 100.0
"""Largest coordinate (m): beyond it the unit is not metres, and digits of the motion begin to be lost."""

CLOCK_RESOLUTION = 1e-6
"""Times closer than this are the same time (s): what a time stamp of 1e9 s, or one of six decimals, can tell."""


def command_velocity(position: FloatArray, dt: float = DT) -> FloatArray:
    """Return the velocity of a command as the network is given it: central differences, one-sided at the ends.

    Args:
        position: (..., K, 2) (m), K at least 2.
        dt: sampling interval (s).

    Returns:
        (..., K, 2) velocity (m/s).
    """
    return np.gradient(position, dt, axis=-2)


@dataclass(frozen=True, eq=False)
class Command:
    """Where the object is to be at t_k = k dt, dt = 1 ms.

    Attributes:
        position: (K, 2) relative to the pan (m), K at least 2; a read-only copy of what was given.

    Raises:
        InputError: another shape, fewer than two samples, longer than 600 s, a value that is no finite number or
            beyond 100 m, or a jump of more than 0.05 m from one sample to the next; row and column are named.
    """

    position: FloatArray

    def __post_init__(self) -> None:
        position = table(self.position, "position")
        _check_length(len(position))
        _check_extent(position)
        if len(position) > MAX_SAMPLES:
            message = f"position has {len(position)} samples at 1 kHz, at most {MAX_SAMPLES} are allowed"
            raise InputError(message, "position")
        jumps = np.hypot(*np.diff(position, axis=0).T)
        for row in np.flatnonzero(jumps > MAX_JUMP):
            raise InputError(
                f"position jumps by {jumps[row]:.4g} m from sample {row} to {row + 1} of the 1 kHz time line "
                f"(t = {row * DT:.3f} s), at most {MAX_JUMP:g} m is allowed",
                "position",
            )
        position.setflags(write=False)
        object.__setattr__(self, "position", position)

    def __len__(self) -> int:
        """Return the number of samples, K."""
        return len(self.position)

    @cached_property
    def velocity(self) -> FloatArray:
        """(K, 2) velocity relative to the pan (m/s)."""
        return command_velocity(self.position)

    @property
    def reach(self) -> float:
        """Largest distance from the first position (m)."""
        return float(np.hypot(*(self.position - self.position[0]).T).max())

    @property
    def speed(self) -> float:
        """Largest speed (m/s)."""
        return float(np.hypot(*self.velocity.T).max())

    @classmethod
    def from_samples(cls, position: object, dt: float = DT) -> Self:
        """Build a command from evenly spaced samples, resampled to 1 kHz by a cubic spline if dt is not 1 ms.

        Args:
            position: (n, 2) relative to the pan (m).
            dt: their sampling interval (s).

        Raises:
            InputError: dt is not greater than zero, or see `Command`.
        """
        dt = number(dt, "dt")
        if dt <= 0.0:
            raise InputError(f"dt must be greater than 0 s, got {dt:g} s", "dt")
        if dt == DT:
            return cls(position)  # type: ignore[arg-type]  # which is checked there
        points = table(position, "position")
        return cls._resampled(np.arange(len(points), dtype=np.float64) * dt, points)

    @classmethod
    def from_waypoints(cls, t: object, position: object) -> Self:
        """Build a command from positions at any times, resampled to 1 kHz by a not-a-knot cubic spline.

        Positions that are on the 1 kHz grid already are taken as they are. A last piece shorter than 1 ms is cut.

        Args:
            t: (n,) increasing times (s); the first is the start, whatever its value.
            position: (n, 2) relative to the pan (m).

        Raises:
            InputError: t does not increase, lasts less than 1 ms or more than 600 s, or see `Command`.
        """
        times = column(t, "t")
        points = table(position, "position")
        if len(times) != len(points):
            raise InputError(f"t has {len(times)} rows, position has {len(points)}", "t")
        return cls._resampled(times, points)

    @classmethod
    def _resampled(cls, times: FloatArray, points: FloatArray) -> Self:
        """Build a command from as many times as points, both of them finite numbers.

        Raises:
            InputError: see `from_waypoints`.
        """
        _check_length(len(points))
        _check_extent(points)
        for row in np.flatnonzero(np.diff(times) < CLOCK_RESOLUTION):
            raise InputError(
                f"t must increase: t[{row + 1}] = {times[row + 1]:.9g} s does not come after "
                f"t[{row}] = {times[row]:.9g} s",
                f"t[{row + 1}]",
            )
        duration = times[-1] - times[0]
        if duration > MAX_DURATION:
            message = f"t spans {duration:g} s, at most {MAX_DURATION:g} s are allowed (is it in seconds?)"
            raise InputError(message, "t")
        grid = np.arange(int((duration + CLOCK_RESOLUTION) / DT) + 1) * DT
        if len(grid) < 2:
            raise InputError(f"t spans {duration:g} s, at least {DT:g} s are needed", "t")
        elapsed = times - times[0]
        if len(grid) == len(times) and np.allclose(elapsed, grid, rtol=0.0, atol=CLOCK_RESOLUTION):
            return cls(points)
        return cls(cubic_spline(elapsed, points, np.minimum(grid, duration)))

    @classmethod
    def from_dict(cls, document: object, source: str = "command") -> Self:
        """Build a command from `{"dt", "position"}` or `{"t", "position"}`.

        Args:
            document: the parsed document.
            source: where it came from, for the message.

        Raises:
            FormatError: a key is missing or unknown, or see `from_samples` and `from_waypoints`.
        """
        with reading(source):
            if not isinstance(document, Mapping):
                raise InputError('must be an object with the keys "dt" (or "t") and "position"')
            for name in document:
                if name not in ("t", "dt", "position"):
                    raise InputError(f"unknown key {name!r}, expected t or dt, and position")
            if "position" not in document:
                raise InputError("missing key 'position'")
            if ("t" in document) == ("dt" in document):
                raise InputError("exactly one of the keys 't' and 'dt' is needed")
            if "t" in document:
                return cls.from_waypoints(document["t"], document["position"])
            return cls.from_samples(document["position"], document["dt"])

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Read a command file: `.csv` with the header t,x,y or x,y (1 kHz), `.json` or `.npz` as for `from_dict`.

        Raises:
            FormatError: the file cannot be read, or is not what its suffix says; see also `from_waypoints`.
        """
        path = Path(path)
        with reading(str(path)):
            suffix = path.suffix.lower()
            if suffix not in (".csv", ".json", ".npz"):
                raise InputError(f"a command is a .csv, .json or .npz file, got the suffix {path.suffix!r}")
            data = read_bytes(path)
            if suffix == ".csv":
                columns = _parse_csv(read_text(data))
                position = np.column_stack([columns["x"], columns["y"]])
                return cls.from_waypoints(columns["t"], position) if "t" in columns else cls.from_samples(position)
            document: Any
            if suffix == ".json":
                document = parse_json(read_text(data))
            else:
                arrays = parse_npz(data)
                document = {name: array.item() if array.ndim == 0 else array for name, array in arrays.items()}
        return cls.from_dict(document, str(path))


def _check_length(samples: int) -> None:
    if samples < 2:
        message = f"position has {samples} sample{'' if samples == 1 else 's'}, at least 2 are needed"
        raise InputError(message, "position")


def _check_extent(position: FloatArray) -> None:
    for row, axis in np.argwhere(np.abs(position) > MAX_POSITION):
        raise InputError(
            f"position[{row}], column {'xy'[axis]}: {position[row, axis]:g} m is beyond {MAX_POSITION:g} m "
            "(is it in metres?)",
            f"position[{row}][{axis}]",
        )


def _parse_csv(content: str) -> dict[str, FloatArray]:
    """Read the columns of a CSV file with a header.

    Raises:
        InputError: a column is missing or unknown, a row has another number of cells, or a cell is no finite number;
            the line of the file (the header is line 1) and the column are named.
    """
    lines = csv.reader(io.StringIO(content, newline=""))
    try:
        header = [name.strip() for name in next(lines, [])]
        for name in header:
            if name not in ("t", "x", "y"):
                raise InputError(f"line 1: unknown column {name!r}, the header must be t,x,y or x,y")
        for name in ("x", "y"):
            if name not in header:
                raise InputError(f"line 1: missing column {name!r}, the header must be t,x,y or x,y")
        if len(set(header)) != len(header):
            raise InputError(f"line 1: a column is given twice: {','.join(header)}")
        rows = []
        for cells in lines:
            if not cells:  # a blank line, mostly the last
                continue
            if len(cells) != len(header):
                raise InputError(f"line {lines.line_num}: has {len(cells)} cells, the header has {len(header)}")
            rows.append([_parse_cell(cell, lines.line_num, name) for cell, name in zip(cells, header, strict=True)])
    except csv.Error as error:
        raise InputError(f"line {lines.line_num}: not CSV: {error}") from error
    values = np.array(rows, dtype=np.float64).reshape(-1, len(header))
    return {name: values[:, index] for index, name in enumerate(header)}


def _parse_cell(cell: str, line: int, name: str) -> float:
    key, place = f"line {line}, column {name}", f"line[{line}].{name}"
    try:
        value = float(cell.replace("_", "?"))  # Python's 1_000 is no number in a file
    except ValueError:
        raise InputError(f"{key}: {cell[:20]!r} is not a number", place) from None
    return number(value, key, place)


def cubic_spline(t: FloatArray, y: FloatArray, at: FloatArray) -> FloatArray:
    """Interpolate by the not-a-knot cubic spline, in O(n).

    The slopes s at the knots solve the tridiagonal system of a twice continuously differentiable piecewise cubic
    whose third derivative is continuous at the second and the last but one knot too (C. de Boor, "A Practical Guide
    to Splines", chapter IV). Two points give the line and three the parabola through them. The result is that of
    `scipy.interpolate.CubicSpline`, which tests hold it to.

    Args:
        t: (n,) increasing knots (s), n at least 2.
        y: (n, d) values at the knots.
        at: (m,) where to evaluate, within the knots (s).

    Returns:
        (m, d) values.
    """
    n = len(t)
    h = np.diff(t)
    slope: FloatArray = np.diff(y, axis=0) / h[:, None]
    if n == 2:
        line: FloatArray = y[0] + slope[0] * (at - t[0])[:, None]
        return line
    if n == 3:
        curvature = (slope[1] - slope[0]) / (t[2] - t[0])
        parabola: FloatArray = y[0] + (at - t[0])[:, None] * (slope[0] + curvature * (at - t[1])[:, None])
        return parabola

    first, last = t[2] - t[0], t[-1] - t[-3]
    below = np.concatenate([h[1:], [last]])
    diagonal = np.concatenate([[h[1]], 2.0 * (h[:-1] + h[1:]), [h[-2]]])
    above = np.concatenate([[first], h[:-1]])
    right = np.empty_like(y)
    right[0] = ((h[0] + 2.0 * first) * h[1] * slope[0] + h[0] ** 2 * slope[1]) / first
    right[1:-1] = 3.0 * (h[1:, None] * slope[:-1] + h[:-1, None] * slope[1:])
    right[-1] = (h[-1] ** 2 * slope[-2] + (2.0 * last + h[-1]) * h[-2] * slope[-1]) / last

    for row in range(1, n):
        factor = below[row - 1] / diagonal[row - 1]
        diagonal[row] -= factor * above[row - 1]
        right[row] -= factor * right[row - 1]
    s = right
    s[-1] /= diagonal[-1]
    for row in range(n - 2, -1, -1):
        s[row] = (s[row] - above[row] * s[row + 1]) / diagonal[row]

    piece = np.clip(np.searchsorted(t, at, side="right") - 1, 0, n - 2)
    bend = (s[:-1] + s[1:] - 2.0 * slope) / h[:, None]
    x = (at - t[piece])[:, None]
    square = (slope - s[:-1]) / h[:, None] - bend
    cube = bend / h[:, None]
    return y[piece] + x * (s[piece] + x * (square[piece] + x * cube[piece]))
