"""Noise: how to see it in waypoints, and how to smooth it out of a command."""

from __future__ import annotations

import numpy as np

from runtime.documents.checks import FloatArray

SEEN = 0.2e-3
"""Noise from which on something is said of it (m)."""

ALTERNATING = -0.3
"""Correlation of second differences with the next below which they are noise: -0.67 for white noise, 1 for a curve."""

WIDTH = 4.0
"""Standard deviations that the smoothing reaches to both sides."""


def noise(t: FloatArray, position: FloatArray) -> float:
    """Return the noise of a recording (m), 0 where none is seen.

    Args:
        t: (n,) increasing times (s).
        position: (n, 2) (m).
    """
    if len(t) < 12:
        return 0.0
    second = np.diff(position, 2, axis=0)
    power = float(np.sum(second * second))
    if power == 0.0 or float(np.sum(second[1:] * second[:-1])) > ALTERNATING * power:
        return 0.0
    if np.median(np.diff(t)) > 0.05:
        return 0.0
    size = float(np.sqrt(np.mean(np.diff(second, axis=0) ** 2) / 20.0))  # 1 + 9 + 9 + 1
    return size if size > SEEN else 0.0


def smooth(position: FloatArray, width: float) -> FloatArray:
    """Smooth evenly spaced positions by a Gaussian: at each, the straight line that fits best around it.

    A steady motion stays what it is, up to both ends.

    Args:
        position: (K, 2), K at least 2.
        width: standard deviation of the Gaussian, in samples.
    """
    half = min(int(np.ceil(WIDTH * width)), len(position) - 1)
    offset = np.arange(-half, half + 1)
    weight = np.exp(-0.5 * (offset / width) ** 2)

    def summed(values: FloatArray, weights: FloatArray) -> FloatArray:
        """Return the sum of weights[j] values[k + j] for every k."""
        return np.convolve(values, weights[::-1])[half : half + len(values)]

    ones = np.ones(len(position))
    total, first, second = (summed(ones, weight * offset**power) for power in range(3))
    columns = [
        (second * summed(values, weight) - first * summed(values, weight * offset)) / (total * second - first**2)
        for values in position.T
    ]
    return np.stack(columns, axis=1)
