"""A plan as a figure of matplotlib: where the object and the pan go, and how fast, within which limits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.errors import extra
from runtime.outputs.columns import AXES, columns
from runtime.outputs.picture import FARTHEST_REACH, MM, OBJECT, PAN, RIM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COMMAND = "#201d1a"
"""Colour of ink."""

MIDDLE = np.zeros(2)

CORNERS = 121
"""Points by which a circle is drawn."""

STOP = "#ebe7df"
"""Colour behind the time of the stop."""


def plot(document: Mapping[str, Any]) -> Figure:
    """Draw a plan's document.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    with extra("report"):
        from matplotlib import pyplot
    table = columns(document)
    quality, friction = document["quality"], document["friction"]
    figure: Figure = pyplot.figure(figsize=(11.0, 6.6), layout="constrained")
    figure.suptitle(
        f"{document['model']['name']}: {quality['status'].replace('_', ' ')}, "
        f"RMSE {quality['tracking_rmse'] * MM:.2f} mm, friction {friction['static']:g}/{friction['kinetic']:g}",
        x=0.01,
        ha="left",
        fontweight="bold",
    )
    lifts = bool(np.any(table["pan_z"]))
    halves = figure.add_gridspec(1, 2, width_ratios=(1.0, 1.5))
    maps, rows = halves[0].subgridspec(2, 1), halves[1].subgridspec(4 if lifts else 3, 1)
    _draw_object(figure.add_subplot(maps[0]), document)
    _draw_pan(figure.add_subplot(maps[1]), table, quality["limits"])
    error = figure.add_subplot(rows[0])
    over_time = [error, *(figure.add_subplot(rows[row], sharex=error) for row in range(1, 4 if lifts else 3))]
    speed, acceleration = over_time[1:3]
    if lifts:
        _draw_height(over_time[3], table, quality["limits"]["height"])
    _draw_error(error, table)
    _draw_length(speed, table, "pan_v", "pan speed (m/s)", quality["limits"]["speed"])
    _draw_length(acceleration, table, "pan_a", "pan acceleration (m/s²)", quality["limits"]["acceleration"])
    over_time[-1].set_xlabel("time (s)")
    for axes in over_time:
        axes.grid(alpha=0.3)
        axes.margins(x=0.0)
        if table["stop"].any():
            axes.axvspan(table["t"][table["stop"]][0], table["t"][-1], color=STOP, zorder=0)
    return figure


def _draw_object(axes: Axes, document: Mapping[str, Any]) -> None:
    """Draw the object over the command on the pan with its rim, and the object where it begins."""
    command, sliding = (document[part]["position"] * MM for part in ("command", "object"))
    sizes = document["sizes"]
    _draw_circle(axes, MIDDLE, sizes["pan_radius"] * MM, linewidth=2.0, label="rim")
    _draw_circle(axes, sliding[0], sizes["object_radius"] * MM, linewidth=0.8, label="its start")
    axes.plot(*sliding.T, color=OBJECT, linewidth=1.8, label="object")
    axes.plot(*command.T, color=COMMAND, linewidth=0.9, dashes=(4, 2), label="command")
    _finish_map(axes, "object on the pan (mm)")


def _draw_pan(axes: Axes, table: Mapping[str, Any], limits: Mapping[str, float | None]) -> None:
    """Draw where the pan goes, and how far it may."""
    x, y = table["pan_x"] * MM, table["pan_y"] * MM
    reach = limits["pan_reach"]
    if reach is not None and reach <= FARTHEST_REACH:
        _draw_circle(axes, MIDDLE, reach * MM, linewidth=1.2, dashes=(4, 3), label="reach")
    axes.plot(x, y, color=PAN, linewidth=1.2, label="pan")
    axes.plot(x[0], y[0], marker="o", color=PAN, markersize=5, linestyle="none", label="its start")
    axes.plot(x[-1], y[-1], marker="s", color=PAN, markersize=5, linestyle="none", label="its end")
    _finish_map(axes, "pan in the world (mm)")


def _draw_circle(axes: Axes, centre: FloatArray, radius: float, **look: Any) -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, CORNERS)
    axes.plot(centre[0] + radius * np.cos(turn), centre[1] + radius * np.sin(turn), color=RIM, **look)


def _finish_map(axes: Axes, title: str) -> None:
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title(title, fontsize="medium", loc="left")
    axes.grid(alpha=0.3)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize="small")


def _draw_error(axes: Axes, table: Mapping[str, Any]) -> None:
    error = np.hypot(table["object_x"] - table["command_x"], table["object_y"] - table["command_y"])
    axes.plot(table["t"], error * MM, color=OBJECT, linewidth=1.2)
    axes.set_title("distance of the object from the command (mm)", fontsize="medium", loc="left")
    axes.set_ylim(bottom=0.0)


def _draw_length(axes: Axes, table: Mapping[str, Any], name: str, title: str, limit: float | None) -> None:
    """Draw the length of a vector over time, and its limit."""
    axes.plot(table["t"], _length(table, name), color=PAN, linewidth=1.2)
    if limit is not None:
        axes.axhline(limit, color=RIM, linewidth=1.2, dashes=(4, 3))
        axes.annotate(f"limit {limit:g}", (1.0, limit), (-4, 3), ("axes fraction", "data"), "offset points", ha="right")
    axes.set_title(title, fontsize="medium", loc="left")
    axes.set_ylim(0.0, None if limit is None else 1.25 * limit)


def _draw_height(axes: Axes, table: Mapping[str, Any], limit: float | None) -> None:
    """Draw the pan's height over time, and its limits."""
    axes.plot(table["t"], table["pan_z"] * MM, color=PAN, linewidth=1.2)
    for bound in () if limit is None else (limit, -limit):
        axes.axhline(bound * MM, color=RIM, linewidth=1.2, dashes=(4, 3))
    axes.set_title("pan height (mm)", fontsize="medium", loc="left")


def _length(table: Mapping[str, Any], name: str) -> FloatArray:
    parts = [table[name + axis] for axis in AXES if name + axis in table]
    length: FloatArray = np.linalg.norm(parts, axis=0)
    return length
