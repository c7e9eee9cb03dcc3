"""Drawings of people as commands, from a file: points of the pen in the order in which it passed them.

None are in this project. The public set "Pen-Based Recognition of Handwritten Digits" (Alpaydin and Alimoglu, UCI
Machine Learning Repository, 1998) is a file of this kind: eight points of each of 10,992 digits of 44 people.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.suite.families import SAMPLES, Family, lengths, minimum_jerk, same_friction
from benchmarks.suite.letters import REACH
from runtime.documents.checks import FloatArray
from runtime.errors import InputError

MOST = 25
"""Drawings that are read."""

FEWEST_POINTS = 4

POWER = 1.0 / 3.0
"""People draw at a speed of about this power of the radius: Lacquaniti et al., Acta Psychologica 54 (1983)."""

STRAIGHTEST = 0.5
"""Radius from which a line counts as straight, as a share of the largest distance from the start."""

EASE = 0.15
"""Share of the time in which the pen gets up to speed, and again in which it comes to rest."""

FINE = 2_000
"""Points to which a drawing is refined."""


def drawings(path: Path) -> Family:
    """Read the first drawings of a file: on each line x1, y1, x2, y2, ... in any unit, and after them perhaps a label.

    Raises:
        InputError: the file cannot be read, or a line is no drawing.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"--drawings: cannot read {path}: {error}") from error
    lines = [line for line in lines if line.strip()]
    if not lines:
        raise InputError(f"--drawings: {path} holds no drawing")
    positions = [drawn(_points(line, f"{path}, line {index + 1}")) for index, line in enumerate(lines[:MOST])]
    return same_friction("drawings", positions, [f"drawing {index + 1}" for index in range(len(positions))])


def _points(line: str, place: str) -> FloatArray:
    """Return the points (n, 2) of a line."""
    values = line.replace(",", " ").split()
    try:
        points = np.array([float(value) for value in values[: len(values) // 2 * 2]]).reshape(-1, 2)
    except ValueError as error:
        raise InputError(f"--drawings: {place}: {error}") from error
    if len(points) < FEWEST_POINTS or not np.isfinite(points).all() or not (np.diff(points, axis=0) != 0.0).any():
        raise InputError(f"--drawings: {place}: expected at least {FEWEST_POINTS} points x, y, not all the same")
    return points


def drawn(points: FloatArray) -> FloatArray:
    """Return (K, 2) positions (m) along a curve through points, as a hand moves: slowly where it bends.

    It begins and ends at rest. The drawing takes SAMPLES samples and goes REACH far from where it begins.
    """
    from scipy.interpolate import CubicSpline

    points = points[np.concatenate([[True], (np.diff(points, axis=0) != 0.0).any(axis=1)])]
    points = (points - points[0]) * REACH / lengths(points - points[0]).max()
    along = np.concatenate([[0.0], np.cumsum(lengths(np.diff(points, axis=0)))])
    curve, at = CubicSpline(along, points), np.linspace(0.0, along[-1], FINE)
    first, second = curve(at, 1), curve(at, 2)
    size = np.maximum(lengths(first), 1e-6)
    bend = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / size**3
    slowness = size * np.maximum(bend, 1.0 / (STRAIGHTEST * REACH)) ** POWER
    passed = np.concatenate([[0.0], np.cumsum(0.5 * (slowness[1:] + slowness[:-1]))])
    position: FloatArray = curve(np.interp(_eased(SAMPLES) * passed[-1], passed, at))
    return position


def _eased(samples: int) -> FloatArray:
    """Return what share of the way is behind at each sample: from rest, evenly, to rest."""
    t = np.linspace(0.0, 1.0, samples)
    rate = minimum_jerk(t / EASE) * minimum_jerk((1.0 - t) / EASE)
    way = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]))])
    share: FloatArray = way / way[-1]
    return share
