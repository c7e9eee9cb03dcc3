"""A pan that can stop: where it is, within what it must stay, and a stop from there."""

from __future__ import annotations

import math
from typing import NamedTuple, Self

from runtime.documents.checks import FloatArray
from runtime.errors import InputError
from runtime.limits import Limits
from runtime.safety.stop import RESTING, Brake, PanState, find_brake, stop_reach
from runtime.start import Start


class Pan(NamedTuple):
    """A pan about to be asked for its next chunk.

    Attributes:
        state: where it is.
        brake: a stop from there, within its limits.
        limits: of this pan.
    """

    state: PanState
    brake: Brake
    limits: Limits

    @classmethod
    def at(cls, state: PanState, limits: Limits) -> Self:
        """Return a pan with finite limits and the strongest stop; whether that is in reach, `can_stop` says."""
        return cls(state, find_brake(state, limits), limits)

    @classmethod
    def at_start(cls, start: Start, limits: Limits) -> Self:
        """Return the pan at its start, with a stop from there.

        Raises:
            InputError: it is outside its limits already, or too fast to stop inside; the numbers are named.
        """
        state = PanState(*start.pan_position, *start.pan_velocity, *start.pan_acceleration)
        if not limits.finite:
            return cls(state, RESTING, limits)
        pan = cls.at(state, limits)
        problem = _refusal(pan)
        if problem is not None:
            raise InputError(f"start: {problem}", "start")
        return pan

    @property
    def stop_reach(self) -> float:
        """A distance from the centre that the pan does not pass on its stop (m), nothing of which is done yet."""
        return stop_reach(self.state, self.brake)

    @property
    def can_stop(self) -> bool:
        """Whether its stop, nothing of which is done yet, stays in reach."""
        return self.stop_reach <= self.limits.pan_reach

    def braked(self, samples: int, states: FloatArray, acceleration: FloatArray) -> Self:
        """Return the pan after so many samples of its stop, and what leads it there: the last of (n, 4) and (n, 2)."""
        done = self.brake.done + min(samples, self.brake.samples)
        return self._replace(state=state_after(states, acceleration), brake=self.brake._replace(done=done))


def _refusal(pan: Pan) -> str | None:
    """Say why a pan cannot begin where it is, None if it can."""
    limits, state = pan.limits, pan.state
    acceleration, distance, speed = math.hypot(*state[4:]), math.hypot(*state[:2]), math.hypot(*state[2:4])
    if acceleration > limits.acceleration:
        return f"pan acceleration {acceleration:.4g} m/s^2 exceeds the limit, {limits.acceleration:g} m/s^2"
    if distance > limits.pan_reach:
        return f"the pan is {distance:.4g} m from its centre, its reach is {limits.pan_reach:g} m"
    shortest = 0.5 * speed * speed / limits.acceleration
    if shortest > 2.0 * limits.pan_reach:
        return (
            f"the pan is too fast to stop inside its reach: at {speed:.4g} m/s it needs {shortest:.4g} m within "
            f"{limits.acceleration:g} m/s^2, and its reach of {limits.pan_reach:g} m is {2 * limits.pan_reach:g} m wide"
        )
    if not pan.can_stop:
        return (
            f"the pan, {distance:.4g} m from its centre at {speed:.4g} m/s, cannot be sure to stop inside its reach of "
            f"{limits.pan_reach:g} m: within {limits.acceleration:g} m/s^2 and {limits.jerk:g} m/s^3 it may need "
            f"{pan.stop_reach:.4g} m"
        )
    return None


def state_after(states: FloatArray, acceleration: FloatArray) -> PanState:
    """Return the pan's state after the last of n samples: states after each (n, 4), accelerations (n, 2) (m/s^2)."""
    return PanState(*states[-1].tolist(), *acceleration[-1].tolist())
