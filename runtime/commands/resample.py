"""From waypoints to 1 kHz: between two waypoints the command stays between them.

Intervals are short or long, which `LONG` parts:

- Short ones are those of a recording. A cubic runs through them with the slopes of the not-a-knot spline, each limited
  so that monotone data stay monotone (F. N. Fritsch and R. E. Carlson, "Monotone Piecewise Cubic Interpolation", SIAM
  J. Numer. Anal. 17, 1980). Where the data turn, the crest of a smooth recording lies between its samples: there a
  slope may be anything between the secants around, and the command leaves the box around all waypoints by less than
  `OVERSHOOT`.
- Long ones are those of somebody who wrote down when the object is to be where. They are run straight, with constant
  acceleration at both ends. The velocity at a waypoint is PCHIP's (F. N. Fritsch and J. Butland, "A Method for
  Constructing Local Monotone Piecewise Cubic Interpolants", SIAM J. Sci. Stat. Comput. 5, 1984), scaled down until the
  path leaves the straight line by at most `ROUNDING`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime.documents.checks import FloatArray

LONG = 0.075
"""Longest interval of a recording (s): half as long again as at 20 Hz. A longer one is run straight."""

SPARSE_SHARE = 0.25
"""Waypoints are sparse if long intervals take this share of their time or more; then they begin and end at rest."""

OVERSHOOT = 0.9e-3
"""Farthest that a crest between two samples may lie outside the box around all of them (m)."""

ROUNDING = 1.5e-3
"""Farthest that a long interval may leave the straight line (m)."""

RAMP_ACCELERATION = 6.0
"""Acceleration at the ends of a long interval (m/s^2), as long as both together take less than two thirds of it."""


def resample(t: FloatArray, position: FloatArray, at: FloatArray) -> FloatArray:
    """Return where the command is at given times.

    Args:
        t: (n,) increasing times of the waypoints (s), n at least 2.
        position: (n, 2) waypoints (m).
        at: (m,) times within those of the waypoints (s).

    Returns:
        (m, 2) positions (m).
    """
    long = np.diff(t) > LONG
    slope = _slopes(t, position, long)
    return _hermite(*_with_ramps(t, position, slope, long), at)


def is_sparse(t: FloatArray) -> bool:
    """Return whether waypoints at these times (s) are sparse, see `SPARSE_SHARE`."""
    h = np.diff(t)
    return bool(h[h > LONG].sum() >= SPARSE_SHARE * (t[-1] - t[0]))


def deviation(t: FloatArray, position: FloatArray, at: FloatArray, command: FloatArray) -> float:
    """Return how far a command leaves the straight lines between its waypoints (m).

    Args:
        t, position: the waypoints, as for `resample`.
        at: (m,) times (s).
        command: (m, 2) where the command is at these times (m).
    """
    piece = _pieces(t, at)
    chord, offset = np.diff(position, axis=0)[piece], command - position[piece]
    square = np.sum(chord * chord, axis=1)
    share = np.clip(np.sum(offset * chord, axis=1) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    return float(np.hypot(*(offset - share[:, None] * chord).T).max())


def spline_slopes(t: FloatArray, y: FloatArray) -> FloatArray:
    """Return the slopes of the not-a-knot cubic spline at its knots, in O(n).

    They solve the tridiagonal system of a twice continuously differentiable piecewise cubic whose third derivative is
    continuous at the second and the last but one knot too (C. de Boor, "A Practical Guide to Splines", chapter IV).
    Two points give the line and three the parabola through them, as in `scipy.interpolate.CubicSpline`.

    Args:
        t: (n,) increasing knots (s), n at least 2.
        y: (n, 2) values at the knots.

    Returns:
        (n, 2) slopes.
    """
    h = np.diff(t)
    secant = np.diff(y, axis=0) / h[:, None]
    if len(t) == 2:
        return np.repeat(secant, 2, axis=0)
    if len(t) == 3:
        bend = (secant[1] - secant[0]) / (t[2] - t[0])
        return np.stack([secant[0] - h[0] * bend, secant[0] + h[0] * bend, secant[1] + h[1] * bend])
    values = secant[:, 0] + 1j * secant[:, 1]  # both columns at once
    first, last = t[2] - t[0], t[-1] - t[-3]
    right = np.empty(len(t), dtype=np.complex128)
    right[0] = ((h[0] + 2.0 * first) * h[1] * values[0] + h[0] ** 2 * values[1]) / first
    right[1:-1] = 3.0 * (h[1:] * values[:-1] + h[:-1] * values[1:])
    right[-1] = (h[-1] ** 2 * values[-2] + (2.0 * last + h[-1]) * h[-2] * values[-1]) / last
    below = [0.0, *h[1:].tolist(), last]
    diagonal = [h[1], *(2.0 * (h[:-1] + h[1:])).tolist(), h[-2]]
    above = [first, *h[:-1].tolist()]
    solution = right.tolist()  # Python's own numbers: three times as fast as an array's, one by one
    for row in range(1, len(t)):
        factor = below[row] / diagonal[row - 1]
        diagonal[row] -= factor * above[row - 1]
        solution[row] -= factor * solution[row - 1]
    solution[-1] /= diagonal[-1]
    for row in range(len(t) - 2, -1, -1):
        solution[row] = (solution[row] - above[row] * solution[row + 1]) / diagonal[row]
    slopes = np.array(solution)
    return np.stack([slopes.real, slopes.imag], axis=1)


def _slopes(t: FloatArray, y: FloatArray, long: NDArray[np.bool_]) -> FloatArray:
    """Return the velocity at each waypoint, (n, 2) (m/s)."""
    h = np.diff(t)[:, None]
    secant = np.diff(y, axis=0) / h
    beside_long = np.append(long, False) | np.insert(long, 0, False)
    slope = _limited(spline_slopes(t, y), secant)
    slope[beside_long] = _harmonic_means(h, secant)[beside_long]
    if is_sparse(t):
        slope[0] = slope[-1] = 0.0
    slope *= _straightness(h[:, 0], secant, slope, long)[:, None]
    return _within_box(h[:, 0], y, slope)


def _limited(slope: FloatArray, secant: FloatArray) -> FloatArray:
    """Limit slopes by the secants around: monotone between monotone data, within the secants where these turn."""
    pad = np.zeros((2, 2))
    around = np.concatenate([pad, secant, pad])
    around = np.stack([around[k : k + len(slope)] for k in range(4)])  # the two before each waypoint, the two after
    lowest, highest = around.min(axis=0), around.max(axis=0)
    turns = (lowest < 0.0) & (highest > 0.0)
    before, after = np.concatenate([secant[:1], secant]), np.concatenate([secant, secant[-1:]])
    falling, rising = np.minimum(np.maximum(before, after), 0.0), np.maximum(np.minimum(before, after), 0.0)
    return np.clip(slope, np.where(turns, lowest, 3.0 * falling), np.where(turns, highest, 3.0 * rising))


def _harmonic_means(h: FloatArray, secant: FloatArray) -> FloatArray:
    """Return PCHIP's slopes, (n, 2): weighted harmonic means of the secants around, 0 where their signs differ."""
    slope = np.concatenate([secant[:1], np.zeros_like(secant[1:]), secant[-1:]])
    before, after = 2.0 * h[1:] + h[:-1], h[1:] + 2.0 * h[:-1]
    alike = secant[:-1] * secant[1:] > 0.0
    first, second = np.where(alike, secant[:-1], 1.0), np.where(alike, secant[1:], 1.0)
    slope[1:-1] = np.where(alike, (before + after) / (before / first + after / second), 0.0)
    return slope


def _ramps(h: FloatArray, secant: FloatArray) -> FloatArray:
    """Return how long each ramp of long intervals of duration h (n,) (s) takes (s)."""
    return np.clip(1.5 * np.hypot(secant[:, 0], secant[:, 1]) / RAMP_ACCELERATION, h / 100.0, h / 3.0)


def _straightness(h: FloatArray, secant: FloatArray, slope: FloatArray, long: NDArray[np.bool_]) -> FloatArray:
    """Return what each slope is multiplied by, (n,), so that no long interval is left by more than ROUNDING."""
    factor = np.ones(len(slope))
    speed, ramp = np.hypot(secant[:, 0], secant[:, 1]), _ramps(h, secant)
    for end in (slice(None, -1), slice(1, None)):
        across = np.abs(secant[:, 0] * slope[end, 1] - secant[:, 1] * slope[end, 0]) / np.where(speed > 0.0, speed, 1.0)
        aside = 0.5 * ramp * across
        factor[end] = np.where(
            long & (aside > ROUNDING), np.minimum(factor[end], ROUNDING / np.maximum(aside, ROUNDING)), factor[end]
        )
    return factor


def _within_box(h: FloatArray, y: FloatArray, slope: FloatArray) -> FloatArray:
    """Shrink slopes until the cubics leave the box around all waypoints by OVERSHOOT at most.

    How far a cubic leaves the box is a convex function of its two slopes, and not above zero where both are zero: what
    an interval needs by itself is one step, and a few more follow where a neighbour had to shrink too.
    """
    lowest, highest = y.min(axis=0), y.max(axis=0)
    slope = slope.copy()
    for axis in range(2):
        s, v = slope[:, axis], y[:, axis]
        swing = h * (np.abs(s[:-1]) + np.abs(s[1:])) * (4.0 / 27.0)
        near = np.maximum(v[:-1], v[1:]) + swing > highest[axis] + OVERSHOOT
        near |= np.minimum(v[:-1], v[1:]) - swing < lowest[axis] - OVERSHOOT
        piece = np.flatnonzero(near)
        while len(piece):
            pieces = h[piece], v[piece], v[piece + 1], s[piece], s[piece + 1]
            curve = _cubic(_crests(*pieces), *pieces)
            outside = np.maximum(lowest[axis] - curve, curve - highest[axis]).max(axis=0)
            over = outside > OVERSHOOT
            if not over.any():
                break
            factor = 0.99 * OVERSHOOT / outside[over]
            scale = np.ones(len(s))
            np.minimum.at(scale, piece[over], factor)
            np.minimum.at(scale, piece[over] + 1, factor)
            s *= scale
    return slope


def _crests(h: FloatArray, first: FloatArray, last: FloatArray, begin: FloatArray, end: FloatArray) -> FloatArray:
    """Return the two shares (2, n) at which the cubics of `_cubic` turn, 0 or 1 where they do not turn between."""
    chord, begin, end = last - first, h * begin, h * end
    a, b, c = 3.0 * (begin + end - 2.0 * chord), 2.0 * (3.0 * chord - 2.0 * begin - end), begin
    root = -0.5 * (b + np.copysign(np.sqrt(np.maximum(b * b - 4.0 * a * c, 0.0)), b))
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.stack([root / a, c / root])
    return np.clip(np.nan_to_num(shares), 0.0, 1.0)


def _with_ramps(
    t: FloatArray, y: FloatArray, slope: FloatArray, long: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Part each long interval in three: two ramps of constant acceleration, and a steady speed between them.

    Returns:
        Times (m,), positions (m, 2) and velocities (m, 2) of the waypoints and of the ends of the ramps.
    """
    first = np.flatnonzero(long)
    h, chord = np.diff(t)[first], np.diff(y, axis=0)[first]
    ramp = _ramps(h, chord / h[:, None])[:, None]
    begin, end = slope[first], slope[first + 1]
    steady = (chord - 0.5 * ramp * (begin + end)) / (h[:, None] - ramp)
    where = np.repeat(first + 1, 2)

    def insert(values: FloatArray, after_begin: FloatArray, before_end: FloatArray) -> FloatArray:
        return np.insert(values, where, np.stack([after_begin, before_end], axis=1).reshape(-1, *values.shape[1:]), 0)

    return (
        insert(t, t[first] + ramp[:, 0], t[first + 1] - ramp[:, 0]),
        insert(y, y[first] + 0.5 * ramp * (begin + steady), y[first + 1] - 0.5 * ramp * (end + steady)),
        insert(slope, steady, steady),
    )


def _hermite(t: FloatArray, y: FloatArray, slope: FloatArray, at: FloatArray) -> FloatArray:
    piece = _pieces(t, at)
    h = np.diff(t)[piece][:, None]
    share = (at - t[piece])[:, None] / h
    return _cubic(share, h, y[piece], y[piece + 1], slope[piece], slope[piece + 1])


def _pieces(t: FloatArray, at: FloatArray) -> NDArray[np.intp]:
    """Return the interval (0 to n-2) that each time lies in."""
    return np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)


def _cubic(
    share: FloatArray, h: FloatArray, first: FloatArray, last: FloatArray, begin: FloatArray, end: FloatArray
) -> FloatArray:
    """Return the cubic over an interval h (s) from `first` to `last` with slopes `begin` and `end`, at shares of it."""
    rest = 1.0 - share
    chord: FloatArray = first + share * share * (3.0 - 2.0 * share) * (last - first)
    return chord + h * share * rest * (rest * begin - share * end)
