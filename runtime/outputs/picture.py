"""Pictures of a plan as SVG, made of text alone: the object on the pan, and the pan in the world."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.outputs.columns import columns

MM = 1e3
"""Millimetres in a metre."""

OBJECT, PAN, RIM = "#d55e00", "#0072b2", "#8d867b"
"""Colours of the report too, which stand out on light and on dark; the command has the colour of the text."""

FARTHEST_REACH = 2.0
"""Largest reach that is drawn (m): beside a larger one the pan's path would be a dot."""

MAX_POINTS = 240
"""Most points of a line: more cannot be told apart at this size."""

SIDE = 230
"""Width and height of a picture (pixels)."""


def object_picture(document: Mapping[str, Any]) -> str:
    """Return the object's path over the command on the pan with its rim, and the object where it begins."""
    command, sliding, sizes = document["command"]["position"], document["object"]["position"], document["sizes"]
    parts = [
        _circle((0.0, 0.0), sizes["pan_radius"], f'fill="none" stroke="{RIM}" stroke-width="2"'),
        _circle(sliding[0], sizes["object_radius"], f'fill="{OBJECT}" fill-opacity=".2"'),
        _line(command, 'stroke="currentColor" stroke-width="1.2" stroke-dasharray="4 3"'),
        _line(sliding, f'stroke="{OBJECT}" stroke-width="1.8"'),
    ]
    return _svg("The object over the command on the pan", parts, sizes["pan_radius"], command, sliding)


def pan_picture(document: Mapping[str, Any]) -> str:
    """Return the pan's path in the world, the stop included, and the circle that it keeps to."""
    table, reach = columns(document), document["quality"]["limits"]["pan_reach"]
    pan = np.stack([table["pan_x"], table["pan_y"]], axis=1)
    parts = [_line(pan, f'stroke="{PAN}" stroke-width="1.5"')]
    if reach is None or reach > FARTHEST_REACH:
        return _svg("The pan in the world", parts, 0.0, pan)
    look = f'fill="none" stroke="{RIM}" stroke-width="1.2" stroke-dasharray="4 3"'
    return _svg("The pan in the world", [_circle((0.0, 0.0), reach, look), *parts], reach, pan)


def _svg(title: str, parts: Sequence[str], radius: float, *paths: FloatArray) -> str:
    """Lay parts out around the middle, as wide as a circle and paths need; y points up."""
    half = 1.05 * MM * max(radius, *(float(np.abs(path).max()) for path in paths), 1e-3)
    box = " ".join(f"{number:.1f}" for number in (-half, -half, 2.0 * half, 2.0 * half))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{SIDE}" height="{SIDE}" viewBox="{box}" role="img" '
        f'aria-label="{title}"><title>{title}</title>{"".join(parts)}</svg>'
    )


def _circle(centre: Sequence[float] | FloatArray, radius: float, look: str) -> str:
    x, y, r = centre[0] * MM, -centre[1] * MM, radius * MM
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{r:.1f}" vector-effect="non-scaling-stroke" {look}/>'


def _line(points: FloatArray, look: str) -> str:
    rows = np.unique(np.linspace(0, len(points) - 1, MAX_POINTS).round().astype(int))
    text = " ".join(f"{x:.1f},{y:.1f}" for x, y in points[rows] * (MM, -MM))
    return (
        f'<polyline points="{text}" fill="none" stroke-linejoin="round" stroke-linecap="round" '
        f'vector-effect="non-scaling-stroke" {look}/>'
    )
