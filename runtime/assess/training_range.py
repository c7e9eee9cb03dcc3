"""What a plan asks of the network, beside what the network was trained on."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.network.job import Job
from runtime.network.manifest import Manifest
from runtime.network.reader import units_of_one
from runtime.network.units import ACCELERATION
from runtime.physics.law import DT, GRAVITY
from runtime.physics.motion import squares

SPAN = 20
"""Samples, of the network's time, over which a command's velocity is averaged, to tell its speed and its corners: noise
of a millimetre is neither, and no object turns faster."""

ROUNDING = 1e-9
"""Share by which a value may pass a range and nothing is said: it was converted."""


class Asked(NamedTuple):
    """What a plan asks of the network in one respect.

    Attributes:
        value: how much.
        unit: its unit, for people.
        scale: of the manifest's range, in the value's unit.
    """

    value: float
    unit: str = ""
    scale: float = 1.0


def beyond_training(manifest: Manifest, job: Job) -> list[str]:
    """Return a line for each thing of a job that is outside the range its network was trained on.

    Commands with more samples than any trained on are not outside: they are read by windows.
    """
    lines = []
    for name, (value, unit, scale) in asked_for(job, manifest.trained_on["pan_speed"][1]).items():
        low, high = (scale * end for end in manifest.trained_on[name])
        if low <= value <= high * (1.0 + ROUNDING) or (name == "samples" and value > high):
            continue
        of = f" {unit}" if unit else ""
        what = name.replace("_", " ")
        lines.append(f"{what} {value:.4g}{of} is outside the range trained on, {low:.4g} to {high:.4g}{of}")
    return lines


def asked_for(job: Job, fastest: float) -> dict[str, Asked]:
    """Return what a plan asks of the network, by the names of `runtime.network.manifest.TRAINED_ON`.

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
    turn = math.sqrt(squares(velocity[span:] - velocity[:-span]).max())
    push = friction.static * weight / (1.0 if limits.level else math.hypot(1.0, friction.static))
    return {
        "static": Asked(friction.static),
        "kinetic": Asked(friction.kinetic),
        "push": Asked(push, "of the acceleration limit"),
        "pan_reach": Asked(limits.pan_reach, "m"),
        "height": Asked(limits.height, "m"),
        "pan_speed": Asked(min(limits.speed, fastest), "m/s"),
        "acceleration": Asked(limits.acceleration, "m/s^2"),
        "jerk": Asked(limits.jerk, "m/s^3"),
        "reach": Asked(job.command.reach, "m", limits.pan_reach),
        "speed": Asked(math.sqrt(squares(velocity).max()), "m/s", velocity_unit),
        "start_speed": Asked(math.hypot(*job.start.pan_velocity), "m/s", velocity_unit),
        "corner": Asked(turn, "m/s", velocity_unit),
        "samples": Asked(len(job.command), "", step),
    }


def _mean_velocity(position: FloatArray, span: int) -> FloatArray:
    """Return the mean velocity (m/s) over `span` samples, from each; the object rests before the command begins."""
    before = np.repeat(position[:1], 2 * span, axis=0)
    held = np.concatenate([before, position])
    velocity: FloatArray = (held[span:] - held[:-span]) / (span * DT)
    return velocity
