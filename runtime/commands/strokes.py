"""Strokes of a pen, as drawing programs and the Quick, Draw! data set keep them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from runtime.commands.points import Points
from runtime.documents.checks import FloatArray, column, table
from runtime.errors import InputError

KEYS = ("drawing", "strokes")


def is_strokes(document: object) -> bool:
    """Return whether a document holds strokes."""
    return isinstance(document, Mapping) and any(key in document for key in KEYS)


def from_strokes(document: Mapping[str, object]) -> Points:
    """Read the strokes of one drawing, one after the other; y points down in them, as on a screen.

    Args:
        document: {"drawing": [[xs, ys], ...]} or {"strokes": [[[x, y], ...], ...]}. Times beside xs and ys, which raw
            drawings have, are passed by.

    Raises:
        InputError: there is no stroke, or one is not understood.
    """
    key = next(key for key in KEYS if key in document)
    strokes = document[key]
    if not isinstance(strokes, list) or not strokes:
        raise InputError(f"{key} must be a list of strokes")
    lines = [_stroke(stroke, f"{key}[{index}]") for index, stroke in enumerate(strokes)]
    found = (f"took {len(lines)} strokes, joined by straight lines",) if len(lines) > 1 else ()
    return Points(np.concatenate(lines) * (1.0, -1.0), drawing=True, found=found)


def _stroke(stroke: object, key: str) -> FloatArray:
    """Return the points (n, 2) of a stroke: [xs, ys], [xs, ys, ts], or a list of points."""
    if isinstance(stroke, list) and len(stroke) in (2, 3) and all(isinstance(each, list) for each in stroke):
        lengths = {len(each) for each in stroke}
        if lengths != {2} or key.startswith("drawing"):
            x, y = (column(each, f"{key}[{axis}]") for axis, each in enumerate(stroke[:2]))
            if len(x) != len(y):
                raise InputError(f"{key} has {len(x)} x and {len(y)} y")
            return np.column_stack([x, y])
    return table(stroke, key)
