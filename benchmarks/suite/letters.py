"""Outlines of letters and digits: commands with corners, faster than what is trained on, that no generator draws.

What people write by hand is not in this project; these stand in for it, and are harder: an outline is twice as long as
the stroke of a pen. They are no part of the suite; `slide-bench peers --family letters` measures them.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from benchmarks.suite.families import SAMPLES, Family, lengths, minimum_jerk, same_friction
from runtime.documents.checks import FloatArray

CHARACTERS = "abcdeghkmnopqrsuwyz23568"

REACH = 0.10
"""Largest distance of a command from its start (m)."""

ROUNDING = 15.0
"""Standard deviation (samples) of the Gaussian that rounds corners, as a hand does."""


@cache
def letters() -> Family:
    """Return the outlines, largest part of a character only, in DejaVu Sans, which comes with matplotlib."""
    return same_friction("letters", [outline(character) for character in CHARACTERS], list(CHARACTERS))


def outline(character: str) -> FloatArray:
    """Return (K, 2) positions along a character's outline, from rest to rest."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath
    from scipy.ndimage import gaussian_filter1d

    path = TextPath((0.0, 0.0), character, size=1.0, prop=FontProperties(family="DejaVu Sans"))
    polygons = [np.asarray(polygon, dtype=np.float64) for polygon in path.to_polygons()]
    points = max(polygons, key=len)
    along = np.concatenate([[0.0], np.cumsum(lengths(np.diff(points, axis=0)))])
    way = minimum_jerk(np.linspace(0.0, 1.0, SAMPLES)) * along[-1]
    drawn = np.stack([np.interp(way, along, points[:, axis]) for axis in range(2)], axis=1)
    drawn = gaussian_filter1d(drawn, ROUNDING, axis=0, mode="nearest")
    drawn -= drawn[0]
    return np.asarray(REACH / lengths(drawn).max() * drawn, dtype=np.float64)
