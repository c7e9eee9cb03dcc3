"""From what was read to a command at 1 kHz, by the options of `Reading`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from runtime.commands.bounds import CLOCK_RESOLUTION, MAX_JUMP, MAX_SAMPLES, check_extent, check_length
from runtime.commands.path import run_along
from runtime.commands.points import Points
from runtime.commands.questions import ask_clock, ask_rate, ask_unit
from runtime.commands.reading import Reading
from runtime.commands.resample import deviation, resample
from runtime.commands.smoothing import noise, smooth
from runtime.documents.checks import FloatArray
from runtime.errors import InputError
from runtime.physics.law import DT
from runtime.physics.motion import squares

NANOSECONDS_FROM = 1e17
"""Times beyond this are nanoseconds since 1970: in any other unit they lie beyond the year 3 million."""

MM = 1e3
"""Millimetres in a metre."""


class Built(NamedTuple):
    """A command at 1 kHz, (K, 2) (m), and what `Command` tells of it."""

    position: FloatArray
    deviation: float = 0.0
    notes: tuple[str, ...] = ()


def build(points: Points, reading: Reading) -> Built:
    """Make a command of what was read.

    Raises:
        InputError: something is missing, in another unit as it seems, or not possible; a waypoint is named by its row,
            its time and its line.
    """
    check_length(len(points.position))
    if points.dt == DT and len(points.position) > MAX_SAMPLES:
        message = f"position has {len(points.position)} samples at 1 kHz, at most {MAX_SAMPLES} are allowed"
        raise InputError(message, "position")
    notes = list(points.found)
    untimed = points.t is None and points.dt is None
    if untimed and points.drawing and reading.speed is None:
        size = "" if points.unit or reading.scale or reading.size else ", and --size 0.1 says its reach in metres"
        raise InputError(f"a drawing has no times: --speed 0.3 runs along it at 0.3 m/s{size}")
    position = _placed(points, reading, notes)
    if reading.speed is not None:
        if not untimed:
            notes.append("passed its times by, for the speed")
        position, left = run_along(position, reading.speed, reading.pull)
        return _smoothed(Built(position, left, tuple(notes)), reading)
    t = _times(points, reading, notes)
    if t is None:
        ask_rate(position)
        notes.append("found no times, and took 1 kHz")
        t = np.multiply(np.arange(len(position)), DT)
    return _smoothed(_sampled(t, position, points, reading, notes), reading)


def _placed(points: Points, reading: Reading, notes: list[str]) -> FloatArray:
    """Return the positions in metres, relative to the pan's centre."""
    position = points.position
    scale = reading.scale or points.unit
    if reading.size is not None:
        reach = float(np.hypot(*(position - position[0]).T).max())
        if reach == 0.0:
            raise InputError("size needs a command that goes somewhere: all positions are the same", "size")
        scale = reading.size / reach
    if scale is not None and scale != 1.0:
        with np.errstate(over="ignore"):
            position = position * scale
        if not np.isfinite(position).all():
            raise InputError(f"scaled by {scale:g}, a coordinate is no finite number", "scale")
        notes.append(f"scaled by {scale:.6g}")
    if reading.scale is None and reading.size is None:
        ask_unit(position, points.drawing and points.unit is None)
    origin = reading.origin
    if origin is None and (points.drawing or reading.size is not None):
        middle = (position.min(axis=0) + position.max(axis=0)) / 2.0
        notes.append("laid its middle on the pan's centre")
        position = position - middle
    elif origin == "first":
        notes.append(f"laid its first position ({position[0, 0]:.4g}, {position[0, 1]:.4g}) m on the pan's centre")
        position = position - position[0]
    elif isinstance(origin, tuple):
        position = position - origin
    check_extent(position, points.place)
    return position


def _times(points: Points, reading: Reading, notes: list[str]) -> FloatArray | None:
    """Return the times in seconds; None if there are none."""
    count = len(points.position)
    if reading.rate is not None:
        if points.t is not None or points.dt is not None:
            notes.append("passed its times by, for the rate")
        return np.divide(np.arange(count), reading.rate)
    if points.dt is not None:
        return np.multiply(np.arange(count), points.dt)
    if points.t is None:
        return None
    if len(points.t) != count:
        raise InputError(f"t has {len(points.t)} rows, position has {count}", "t")
    scale = reading.time_scale or points.time_unit
    if scale is None and abs(points.t[0]) > NANOSECONDS_FROM:
        scale = 1e-9
    if scale is None or scale == 1.0:
        return points.t
    notes.append(f"scaled times by {scale:g}")
    inverse = 1.0 / scale
    if round(inverse) == inverse:  # dividing by 1000 keeps the digits that times 0.001 does not
        return np.divide(points.t, round(inverse))
    return np.multiply(points.t, scale)


def _sampled(t: FloatArray, position: FloatArray, points: Points, reading: Reading, notes: list[str]) -> Built:
    """Return the command at 1 kHz through waypoints at these times (s)."""
    for row in np.flatnonzero(np.diff(t) < CLOCK_RESOLUTION)[:1]:
        raise InputError(
            f"t must increase: t[{row + 1}] = {_digits(t[row + 1])} s{points.place(row + 1)} does not come after "
            f"t[{row}] = {_digits(t[row])} s{points.place(row)}",
            f"t[{row + 1}]",
        )
    ask_clock(t, position, reading.time_scale is not None or reading.rate is not None)
    elapsed = t - t[0]
    duration = float(elapsed[-1])
    grid = np.arange(int((duration + CLOCK_RESOLUTION) / DT) + 1) * DT
    if len(grid) < 2:
        raise InputError(f"t spans {duration:g} s, at least {DT:g} s are needed", "t")
    if len(grid) == len(t) and np.abs(elapsed - grid).max() <= CLOCK_RESOLUTION:
        made, left = position, 0.0
    else:
        at = np.minimum(grid, duration)
        made = resample(elapsed, position, at)
        left = deviation(elapsed, position, at, made)
    jumps = squares(np.diff(made, axis=0))
    for sample in np.flatnonzero(jumps > MAX_JUMP * MAX_JUMP)[:1]:
        row = int(np.clip(np.searchsorted(elapsed, grid[sample] + 0.5 * DT) - 1, 0, len(t) - 2))
        distance = float(np.hypot(*(position[row + 1] - position[row])))
        ends = (f"waypoint {each}{points.place(each)} at {_digits(t[each])} s" for each in (row, row + 1))
        raise InputError(
            f"position jumps by {distance:.4g} m from {' to '.join(ends)}: {math.sqrt(jumps[sample]) / DT:.4g} m/s, at "
            f"most {MAX_JUMP / DT:g} m/s is allowed",
            f"position[{row + 1}]",
        )
    seen = noise(elapsed, position) if reading.smooth is None else 0.0
    if seen:
        width = max(20.0, round(2.5e3 * duration / (len(t) - 1)))
        notes.append(f"looks noisy, by about {seen * MM:.1f} mm: --smooth {width:g} would take it out")
    return Built(made, left, tuple(notes))


def _smoothed(built: Built, reading: Reading) -> Built:
    if reading.smooth is None:
        return built
    position = smooth(built.position, reading.smooth * 1e-3 / DT)
    moved = float(np.hypot(*(position - built.position).T).max())
    note = f"smoothing moved it by {moved * MM:.2g} mm at most"
    return Built(position, built.deviation + moved, (*built.notes, note))


def _digits(t: float) -> str:
    """Return a time with all its digits, also one since 1970."""
    return repr(float(t)).removesuffix(".0")
