"""The law of time: how fast a path without times is run along.

From rest to rest, at the speed that was asked for, slower in bends, so that a pan which moves its object by friction
alone can follow. The page has the same law in `path.js`; tests hold the two together.
"""

from __future__ import annotations

import numpy as np

from runtime.commands.bounds import MAX_DURATION
from runtime.documents.checks import FloatArray, number, table
from runtime.errors import InputError
from runtime.physics.law import DT

ACCELERATION = 2.0
"""Acceleration along the path (m/s^2) if none is named."""

ACROSS = 4.0 / 3.0
"""Acceleration across the path over that along it: the speed in a bend of radius r is at most sqrt(across r)."""

CORNER = 0.002
"""Standard deviation of the smoothing along the path (m): a right angle is cut by about a millimetre."""

SPACING = 0.001
"""Distance between the points that smoothing and speeds are worked out on (m)."""

SHORTEST = 0.01
"""Shortest path (m): a shorter one is a slip of the hand, or in another unit."""

LONGEST = 100.0
"""Longest path (m): ten minutes at 0.17 m/s."""

EASE = 30
"""Samples over which an acceleration sets in, twice over."""


def run_along(
    points: object, speed: object, acceleration: object = ACCELERATION, corner: float = CORNER
) -> tuple[FloatArray, float]:
    """Return where the object is to be at every millisecond to run along a path, and how far that leaves the path.

    Args:
        points: (n, 2) the corners of the path (m).
        speed: highest speed along it (m/s).
        acceleration: highest acceleration along it (m/s^2); across it may be a third more.
        corner: standard deviation of the smoothing along it (m).

    Returns:
        (K, 2) positions (m), from rest to rest, and the distance by which corners are cut (m).

    Raises:
        InputError: the path is shorter than 10 mm or longer than 100 m; speed or acceleration is not above zero.
    """
    path = table(points, "path")
    top, pull = number(speed, "speed"), number(acceleration, "acceleration")
    if top <= 0.0:
        raise InputError(f"speed must be greater than 0 m/s, got {top:g} m/s")
    if pull <= 0.0:
        raise InputError(f"acceleration must be greater than 0 m/s^2, got {pull:g} m/s^2")
    length = _length(path)
    if length / top > MAX_DURATION:
        message = f"the path takes {length / top:.4g} s at {top:g} m/s, at most {MAX_DURATION:g} s are allowed"
        raise InputError(message, "speed")
    if not SHORTEST <= length <= LONGEST:
        allowed = f"{SHORTEST:g} to {LONGEST:g} m are allowed"
        raise InputError(f"the path is {length:.4g} m long, {allowed} (is it in metres?)", "position")
    sharp = _spaced(path)
    smooth = _smoothed(sharp, corner / SPACING)
    path = _spaced(smooth)
    return _eased(_eased(_timed(path, _speeds(path, top, pull)))), float(np.hypot(*(smooth - sharp).T).max())


def _length(points: FloatArray) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def _spaced(points: FloatArray) -> FloatArray:
    """Return evenly spaced points along a polyline, about SPACING apart, both ends included."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    kept = np.insert(steps > 0.0, 0, True)
    passed = np.insert(np.cumsum(steps), 0, 0.0)
    wanted = np.linspace(0.0, passed[-1], max(2, int(passed[-1] / SPACING + 0.5)) + 1)
    return np.stack([np.interp(wanted, passed[kept], points[kept, axis]) for axis in range(2)], axis=1)


def _smoothed(points: FloatArray, width: float) -> FloatArray:
    """Smooth by a Gaussian over `width` points; the path goes on point-symmetrically beyond its ends: these stay."""
    half, last = int(np.ceil(3.0 * width)), len(points) - 1
    weights = np.exp(-0.5 * (np.arange(-half, half + 1) / max(width, np.finfo(np.float64).tiny)) ** 2)
    beyond = np.minimum(np.arange(1, half + 1), last)
    before, after = 2.0 * points[0] - points[beyond[::-1]], 2.0 * points[last] - points[last - beyond]
    held = np.concatenate([before, points, after])
    return np.stack([np.convolve(held[:, axis], weights / weights.sum(), "valid") for axis in range(2)], axis=1)


def _speeds(points: FloatArray, top: float, pull: float) -> FloatArray:
    """Return the highest speed at each of the evenly spaced points (m/s): from rest to rest, slower in bends."""
    steps = np.hypot(*np.diff(points, axis=0).T)  # shorter than their mean where the path turns on the spot
    step = float(steps.mean())
    top *= step / float(steps.max())
    bend = np.hypot(*np.diff(points, 2, axis=0).T) / step**2
    square = np.zeros(len(points))
    square[1:-1] = np.minimum(top**2, ACROSS * pull / np.maximum(bend, 1e-9))
    gained = 2.0 * pull * step * np.arange(len(points))
    square = np.minimum.accumulate(square - gained) + gained
    square = (np.minimum.accumulate((square + gained)[::-1]))[::-1] - gained
    speeds: FloatArray = np.sqrt(np.maximum(square, 0.0))
    return speeds


def _timed(points: FloatArray, speeds: FloatArray) -> FloatArray:
    """Return the positions at every millisecond, running along evenly spaced points at these speeds (m/s).

    Raises:
        InputError: it takes longer than ten minutes.
    """
    step = _length(points) / (len(points) - 1)
    times = np.insert(np.cumsum(2.0 * step / (speeds[:-1] + speeds[1:])), 0, 0.0)
    if times[-1] > MAX_DURATION:
        message = f"the path takes {times[-1]:.4g} s at this acceleration, at most {MAX_DURATION:g} s are allowed"
        raise InputError(message, "path_acceleration")
    t = np.minimum(np.arange(int(np.ceil(times[-1] / DT)) + 1) * DT, times[-1])
    piece = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
    since, pull = t - times[piece], (np.diff(speeds) / np.diff(times))[piece]
    share = np.clip((speeds[piece] + pull * since / 2.0) * since / step, 0.0, 1.0)[:, None]
    positions: FloatArray = points[piece] + share * (points[piece + 1] - points[piece])
    return positions


def _eased(positions: FloatArray) -> FloatArray:
    """Return the moving average over EASE samples, the object at rest before the first and after the last of them."""
    held = np.concatenate([np.repeat(positions[:1], EASE, 0), positions, np.repeat(positions[-1:], EASE, 0)])
    return np.stack([np.convolve(held[:, axis], np.full(EASE, 1.0 / EASE), "valid") for axis in range(2)], axis=1)
