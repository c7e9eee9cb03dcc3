"""A pan that can stop: where it is, within what it must stay, and a stop from there."""

from __future__ import annotations

import math
from typing import NamedTuple

from runtime.errors import InputError
from runtime.limits import Limits
from runtime.safety.stop import RESTING, Brake, PanState, find_brake, stop_reach
from runtime.start import Start


def begin(start: Start, limits: Limits) -> Motion:
    """Return the pan at its start, with a stop from there.

    Raises:
        InputError: it is outside its limits already, or too fast to stop inside; the numbers are named.
    """
    state = PanState(*start.pan_position, *start.pan_velocity, *start.pan_acceleration)
    if not limits.finite:
        return Motion(state, RESTING, limits)
    size, distance, speed = math.hypot(state.ux, state.uy), math.hypot(*state[:2]), math.hypot(*state[2:4])
    if size > limits.acceleration:
        message = f"start: pan acceleration {size:.4g} m/s^2 exceeds the limit, {limits.acceleration:g} m/s^2"
        raise InputError(message, "start")
    if distance > limits.pan_reach:
        message = f"start: the pan is {distance:.4g} m from its centre, its reach is {limits.pan_reach:g} m"
        raise InputError(message, "start")
    shortest = 0.5 * speed * speed / limits.acceleration
    if shortest > 2.0 * limits.pan_reach:
        raise InputError(
            f"start: the pan is too fast to stop inside its reach: at {speed:.4g} m/s it needs {shortest:.4g} m within "
            f"{limits.acceleration:g} m/s^2, and its reach of {limits.pan_reach:g} m is {2 * limits.pan_reach:g} m "
            "wide",
            "start",
        )
    brake = find_brake(state, limits)
    needed = stop_reach(state, brake)
    if needed > limits.pan_reach:
        raise InputError(
            f"start: the pan, {distance:.4g} m from its centre at {speed:.4g} m/s, cannot be sure to stop inside its "
            f"reach of {limits.pan_reach:g} m: within {limits.acceleration:g} m/s^2 and {limits.jerk:g} m/s^3 it may "
            f"need {needed:.4g} m",
            "start",
        )
    return Motion(state, brake, limits)


class Motion(NamedTuple):
    """A pan about to be asked for its next chunk.

    Attributes:
        state: where it is.
        brake: a stop from there, within its limits.
        limits: of this pan.
    """

    state: PanState
    brake: Brake
    limits: Limits
