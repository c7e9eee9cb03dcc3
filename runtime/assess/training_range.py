"""What a plan asks of the network, beside what the network was trained on."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from runtime.command import Command
from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.network.manifest import ONE_PAN, TRAINED_ON
from runtime.physics.law import DT
from runtime.physics.motion import lengths
from runtime.start import Start

SPAN = 20
"""Samples over which a command's velocity is averaged, to tell its speed and its corners: noise of a millimetre is
neither, and no object turns faster."""


def asked_for(command: Command, friction: Friction, start: Start) -> dict[str, float]:
    """Return what a plan asks for, by the names and in the units of TRAINED_ON, for a network for one pan."""
    velocity = _mean_velocity(command.position)
    turns = lengths(velocity[SPAN:] - velocity[:-SPAN])
    return {
        "static": friction.static,
        "kinetic": friction.kinetic,
        "reach": command.reach,
        "speed": float(lengths(velocity).max()),
        "samples": float(len(command)),
        "start_speed": math.hypot(*start.pan_velocity),
        "corner": float(turns.max()),
    }


def beyond(found: Mapping[str, float], trained_on: Mapping[str, tuple[float, float]]) -> list[str]:
    """Return a line for each thing that is outside the range trained on.

    Commands with more samples than any trained on are not outside: they are planned by windows.
    """
    lines = []
    for name, (low, high) in trained_on.items():
        value, unit = found[name], f" {TRAINED_ON[ONE_PAN][name]}" if TRAINED_ON[ONE_PAN][name] else ""
        if low <= value <= high or (name == "samples" and value > high):
            continue
        what = name.replace("_", " ")
        lines.append(f"{what} {value:.4g}{unit} is outside the range trained on, {low:g} to {high:g}{unit}")
    return lines


def _mean_velocity(position: FloatArray) -> FloatArray:
    """Return the mean velocity (m/s) over SPAN samples, from each; the object rests before the command begins."""
    before = np.repeat(position[:1], 2 * SPAN, axis=0)
    held = np.concatenate([before, position])
    velocity: FloatArray = (held[SPAN:] - held[:-SPAN]) / (SPAN * DT)
    return velocity
