"""Ten commands, and the best level plans for them that anybody found: what a network may be compared with.

The plans are recorded beside this file, under the default limits and nominal friction. `slide-bench best
--search 100000` looks for better ones and records them.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.suite.families import Family, same_friction
from benchmarks.suite.suite import suite
from runtime.documents.checks import FloatArray
from runtime.documents.writing import write_whole

FILE = Path(__file__).with_suffix(".npz")
"""The plans by the labels of their commands: (K, 2) pan accelerations (m/s^2)."""

LABELS = {
    "spline": ("spline 26", "spline 0", "spline 1", "spline 2"),
    "shapes": ("circle 0.05 m", "eight 0.05 m", "point to point 0.08 m"),
    "letters": ("a", "e", "s"),
}
"""The commands by their families; `spline 26` is the slowest of all."""


def ten_commands() -> Family:
    """Return the commands."""
    families = suite(LABELS)
    positions = [
        families[name].positions[families[name].labels.index(label)] for name in LABELS for label in LABELS[name]
    ]
    return same_friction("ten", positions, [label for labels in LABELS.values() for label in labels])


def read_best() -> dict[str, FloatArray]:
    """Return the recorded plans by the labels of their commands; none if nothing is recorded."""
    if not FILE.exists():
        return {}
    with np.load(FILE) as recorded:
        return {label: recorded[label].astype(np.float64) for label in recorded.files}


def record_best(plans: Mapping[str, FloatArray]) -> None:
    """Record plans in the place of those that are recorded.

    Raises:
        OutputError: the file cannot be written.
    """
    file = io.BytesIO()
    np.savez_compressed(file, **{label: u.astype(np.float32) for label, u in plans.items()})  # type: ignore[arg-type]
    write_whole(FILE, file.getvalue())
