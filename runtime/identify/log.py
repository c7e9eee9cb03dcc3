"""Logs: what a pan did and where the object was seen, as CSV."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.documents.files import reading
from runtime.documents.writing import write_whole
from runtime.errors import InputError
from runtime.physics.law import DT

TIMES = ("t", "time")
ACCELERATIONS = ("pan_ax", "pan_ay", "pan_az")
POSITIONS = ("pan_x", "pan_y", "pan_z")
OBJECT = ("object_x", "object_y")

COLUMNS = "t, then pan_ax and pan_ay or pan_x and pan_y, then object_x and object_y (SI units)"

SHORTEST, LONGEST = 0.2, 60.0
"""Duration of a log (s)."""

FEWEST = 20
"""Fewest frames in a log."""

SLOWEST = 0.02
"""Longest time between two rows of a pan (s)."""

LIFTS = 1e-3
"""Height (m) from which on a pan is logged as one that lifts: below, it trembles."""

FARTHEST = 1e3
"""Largest value (m, m/s^2): beyond is a slip of the unit."""

WINDOWS = (7, 11, 15, 21, 31, 41, 61)
"""Samples from which an acceleration is found where positions of the pan were logged, fewest first."""

ACCELERATION_NOISE = 0.5
"""Largest noise of such an acceleration for which fewer samples are enough (m/s^2)."""


class Log(NamedTuple):
    """A log, sampled at 1 kHz.

    Attributes:
        acceleration: (n, d) of the pan (m/s^2); d is 2, or 3 for a pan that lifts.
        time: (m,) of the frames, from the first row (s).
        position: (m, 2) of the object in them, relative to the pan (m).
    """

    acceleration: FloatArray
    time: FloatArray
    position: FloatArray


def read_log(path: Path) -> Log:
    """Read a log.

    A row without a position of the object, an empty cell or nan, is one without a frame.

    Raises:
        InputError: a column is missing, a cell is no number, times do not increase, or there is too little; the line
            (from 1) is named.
    """
    with reading(str(path)):
        try:
            text = path.read_text(encoding="utf-8-sig")
        except UnicodeDecodeError as error:
            raise InputError(f"not UTF-8 text (byte {error.start})") from error
        rows = list(csv.reader(text.splitlines()))
        names = [name.strip() for name in rows[0]] if rows else []
        time_name = next((name for name in TIMES if name in names), TIMES[0])
        possible = ACCELERATIONS if ACCELERATIONS[0] in names else POSITIONS
        pan_names = possible if possible[2] in names else possible[:2]
        for name in (time_name, *pan_names, *OBJECT):
            if name not in names:
                raise InputError(f"missing column {name!r}: a log has the columns {COLUMNS}")
        time = _column(rows, names, time_name)
        pan = np.stack([_column(rows, names, name) for name in pan_names], axis=1)
        position = np.stack([_column(rows, names, name, may_miss=True) for name in OBJECT], axis=1)
        return log_of(time, pan, position, are_positions=pan_names[0] == POSITIONS[0])


def write_log(path: Path, pan: FloatArray, position: FloatArray) -> None:
    """Write what was recorded every millisecond, as `read_log` reads it.

    Args:
        path: of the file.
        pan: (n, 6) pan position (m) and velocity (m/s).
        position: (n, 2) of the object relative to the pan (m); NaN where there was no frame.

    Raises:
        OutputError: it cannot be written.
    """
    names = POSITIONS if np.abs(pan[:, 2]).max() > LIFTS else POSITIONS[:2]
    lines = [",".join((TIMES[0], *names, *OBJECT))]
    for k, (row, seen) in enumerate(zip(pan[:, : len(names)].tolist(), position.tolist(), strict=True)):
        frame = [f"{value:.7g}" for value in seen] if math.isfinite(seen[0]) else ["", ""]
        lines.append(",".join([f"{k * DT:.3f}", *(f"{value:.9g}" for value in row), *frame]))
    write_whole(path, "\n".join([*lines, ""]).encode())


def log_of(time: FloatArray, pan: FloatArray, position: FloatArray, are_positions: bool = False) -> Log:
    """Return a log of what was recorded.

    Args:
        time: (n,) of the rows (s).
        pan: (n, d) pan acceleration, which acts from its row to the next (m/s^2), or position (m).
        position: (n, 2) of the object relative to the pan (m); NaN where there was no frame.
        are_positions: whether `pan` are positions.

    Raises:
        InputError: times do not increase, or there is too little.
    """
    later = np.diff(time)
    if (later <= 0.0).any():
        row = int((later <= 0.0).argmax()) + 1
        raise InputError(f"row {row}: the time {time[row]:g} s does not come after {time[row - 1]:g} s")
    duration = float(time[-1] - time[0]) if len(time) else 0.0
    if not SHORTEST <= duration <= LONGEST:
        raise InputError(f"the log lasts {duration:g} s, it must last from {SHORTEST:g} to {LONGEST:g} s")
    if later.max() > SLOWEST:
        raise InputError(
            f"there are {later.max():.3g} s without a row at {time[int(later.argmax())]:g} s: the pan must be logged "
            f"every {SLOWEST:g} s or oftener"
        )
    seen = np.isfinite(position).all(axis=1)
    if seen.sum() < FEWEST:
        raise InputError(f"the object is seen in {seen.sum()} rows, at least {FEWEST} are needed")
    time = time - time[0]
    grid = np.arange(round(duration / DT)) * DT
    if are_positions:
        at = np.append(grid, grid[-1] + DT)
        acceleration = _second_derivative(np.stack([np.interp(at, time, axis) for axis in pan.T], axis=1))
    else:
        acceleration = pan[np.searchsorted(time, grid + 0.5 * DT, side="right") - 1]
    return Log(acceleration, time[seen], position[seen])


def _column(rows: list[list[str]], names: list[str], name: str, may_miss: bool = False) -> FloatArray:
    place, values = names.index(name), []
    for number, row in enumerate(rows[1:], 2):
        if not row:
            continue
        cell = row[place].strip() if place < len(row) else ""
        try:
            value = float(cell) if cell or not may_miss else math.nan
        except ValueError:
            raise InputError(f"line {number}, column {name!r}: {cell!r} is not a number") from None
        if not abs(value) <= FARTHEST and not (may_miss and math.isnan(value)) and name not in TIMES:
            raise InputError(f"line {number}, column {name!r}: {cell} must be between -{FARTHEST:g} and {FARTHEST:g}")
        if name in TIMES and not math.isfinite(value):
            raise InputError(f"line {number}, column {name!r}: {cell} is not a finite number")
        values.append(value)
    return np.array(values, dtype=np.float64)


def _second_derivative(position: FloatArray) -> FloatArray:
    """Return (n - 1, d) accelerations (m/s^2) of positions (n, d) at 1 kHz, by parabolas through as few as noise lets.

    Over a sample of noise s, the second derivative of a parabola through w of them has the noise s sqrt(720/w^5)/dt^2.
    """
    third = np.diff(position, n=3, axis=0)
    noise = float(np.median(np.abs(third))) / 0.6745 / math.sqrt(20.0)
    window = next((w for w in WINDOWS if noise * math.sqrt(720.0 / w**5) / DT**2 <= ACCELERATION_NOISE), WINDOWS[-1])
    half = window // 2
    k = np.arange(-half, half + 1) * DT
    weights = np.linalg.pinv(np.stack([np.ones_like(k), k, 0.5 * k * k], axis=1))[2]
    padded = np.pad(position, ((half, half), (0, 0)), mode="reflect", reflect_type="odd")
    found = np.stack([np.convolve(axis, weights[::-1], mode="valid") for axis in padded.T], axis=1)
    acceleration: FloatArray = 0.5 * (found[:-1] + found[1:])
    return acceleration
