"""What a plan asks of the network, beside what the network was trained on."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from runtime.command import Command
from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.network.general import units_of_one
from runtime.network.job import Job
from runtime.network.manifest import ONE_PAN, TRAINED_ON, Manifest
from runtime.network.units import ACCELERATION
from runtime.physics.law import DT, GRAVITY
from runtime.physics.motion import lengths
from runtime.start import Start

SPAN = 20
"""Samples over which a command's velocity is averaged, to tell its speed and its corners: noise of a millimetre is
neither, and no object turns faster."""

ROUNDING = 1e-9
"""Share by which a value may pass a range and nothing is said: it was converted."""


def beyond_training(manifest: Manifest, job: Job) -> list[str]:
    """Return a line for each thing of a job that is outside the range its network was trained on."""
    if manifest.kind == ONE_PAN:
        found = asked_for(job.command, job.friction, job.start)
    else:
        found = asked_of_general(job, manifest.trained_on["pan_speed"][1])
    return beyond(found, manifest.trained_on, TRAINED_ON[manifest.kind])


def asked_for(command: Command, friction: Friction, start: Start) -> dict[str, float]:
    """Return what a plan asks of a network for one pan, by the names and in the units of TRAINED_ON."""
    velocity = _mean_velocity(command.position, SPAN)
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


def asked_of_general(job: Job, fastest: float) -> dict[str, float]:
    """Return what a plan asks of a network for every pan, by the names and in the units of TRAINED_ON.

    Args:
        job: what is to be planned.
        fastest: largest limit on speed that was trained on (m/s); a larger one is as good as none, which was, too.
    """
    limits, friction = job.limits, job.friction
    units = units_of_one(limits)
    weight = GRAVITY / float(units.acceleration[0]) / ACCELERATION
    step, velocity_unit = float(units.time[0]), float(units.velocity[0])
    span = max(1, round(SPAN * step))
    velocity = _mean_velocity(job.command.position, span)
    turns = lengths(velocity[span:] - velocity[:-span])
    return {
        "static": friction.static,
        "kinetic": friction.kinetic,
        "push": friction.static * weight / (1.0 if limits.level else math.hypot(1.0, friction.static)),
        "pan_reach": limits.pan_reach,
        "height": limits.height,
        "pan_speed": min(limits.speed, fastest),
        "acceleration": limits.acceleration,
        "jerk": limits.jerk,
        "reach": job.command.reach / limits.pan_reach,
        "speed": float(lengths(velocity).max()) / velocity_unit,
        "start_speed": math.hypot(*job.start.pan_velocity) / velocity_unit,
        "corner": float(turns.max()) / velocity_unit,
        "samples": len(job.command) / step,
    }


def beyond(
    found: Mapping[str, float],
    trained_on: Mapping[str, tuple[float, float]],
    units: Mapping[str, str] = TRAINED_ON[ONE_PAN],
) -> list[str]:
    """Return a line for each thing that is outside the range trained on.

    Commands with more samples than any trained on are not outside: they are planned by windows.
    """
    lines = []
    for name, (low, high) in trained_on.items():
        value, unit = found[name], f" {units[name]}" if units[name] else ""
        if low <= value <= high * (1.0 + ROUNDING) or (name == "samples" and value > high):
            continue
        what = name.replace("_", " ")
        lines.append(f"{what} {value:.4g}{unit} is outside the range trained on, {low:g} to {high:g}{unit}")
    return lines


def _mean_velocity(position: FloatArray, span: int) -> FloatArray:
    """Return the mean velocity (m/s) over `span` samples, from each; the object rests before the command begins."""
    before = np.repeat(position[:1], 2 * span, axis=0)
    held = np.concatenate([before, position])
    velocity: FloatArray = (held[span:] - held[:-span]) / (span * DT)
    return velocity
