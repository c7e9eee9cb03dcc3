"""A pan that can stop: where it is, within what it must stay, and a stop from there."""

from __future__ import annotations

import math
from typing import NamedTuple, Self

from runtime.documents.checks import FloatArray
from runtime.errors import InputError
from runtime.limits import LARGEST_SINK, Limits
from runtime.safety.stop import RESTING, Brake, Extent, PanState, find_brake, stop_extent
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
        """Return a pan with finite limits and the strongest stop; whether that keeps the limits, `can_stop` says."""
        return cls(state, find_brake(state, limits), limits)

    @classmethod
    def at_start(cls, start: Start, limits: Limits) -> Self:
        """Return the pan at its start, with a stop from there.

        Raises:
            InputError: it is outside its limits already, or too fast to stop inside; the numbers are named. A level pan
                must be in its plane.
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
    def stop_extent(self) -> Extent:
        """How far and how fast the pan comes at most on its stop, nothing of which is done yet."""
        return stop_extent(self.state, self.brake)

    @property
    def can_stop(self) -> bool:
        """Whether its stop, nothing of which is done yet, keeps its limits."""
        return self.stop_extent.within(self.limits)

    def braked(self, samples: int, states: FloatArray, acceleration: FloatArray) -> Self:
        """Return the pan after so many samples of its stop, and what leads it there: the last of (n, 6) and (n, 3)."""
        done = self.brake.done + min(samples, self.brake.samples)
        return self._replace(state=state_after(states, acceleration), brake=self.brake._replace(done=done))


def _refusal(pan: Pan) -> str | None:
    """Say why a pan cannot begin where it is, None if it can."""
    limits, state = pan.limits, pan.state
    acceleration, distance, speed = math.hypot(*state[6:]), math.hypot(*state[:2]), math.hypot(*state[3:6])
    if limits.level and (state.z, state.vz, state.uz) != (0.0, 0.0, 0.0):
        return (
            f"the pan is level, its height is 0 m, and it would begin at z {state.z:g} m, {state.vz:g} m/s, "
            f"{state.uz:g} m/s^2"
        )
    if acceleration > limits.acceleration:
        return f"pan acceleration {acceleration:.4g} m/s^2 exceeds the limit, {limits.acceleration:g} m/s^2"
    if state.uz < -LARGEST_SINK:
        return (
            f"the pan accelerates downwards by {-state.uz:.4g} m/s^2, and the object keeps its hold up to "
            f"{LARGEST_SINK:g} m/s^2"
        )
    if distance > limits.pan_reach:
        return f"the pan is {distance:.4g} m from its centre, its reach is {limits.pan_reach:g} m"
    if abs(state.z) > limits.height:
        return f"the pan is at a height of {state.z:.4g} m, it keeps within {limits.height:g} m"
    if speed > limits.speed:
        return f"pan speed {speed:.4g} m/s exceeds the limit, {limits.speed:g} m/s"
    along = math.hypot(state.vx, state.vy)
    shortest = 0.5 * along * along / limits.acceleration
    if shortest > 2.0 * limits.pan_reach:
        return (
            f"the pan is too fast to stop inside its reach: at {along:.4g} m/s it needs {shortest:.4g} m within "
            f"{limits.acceleration:g} m/s^2, and its reach of {limits.pan_reach:g} m is {2 * limits.pan_reach:g} m wide"
        )
    extent = pan.stop_extent
    if extent.reach > limits.pan_reach:
        return (
            f"the pan, {distance:.4g} m from its centre at {along:.4g} m/s, cannot be sure to stop inside its reach of "
            f"{limits.pan_reach:g} m: within {limits.acceleration:g} m/s^2 and {limits.jerk:g} m/s^3 it may need "
            f"{extent.reach:.4g} m"
        )
    if extent.height > limits.height:
        return (
            f"the pan, at a height of {state.z:.4g} m with {state.vz:.4g} m/s upwards, cannot be sure to stop within "
            f"{limits.height:g} m: within {limits.acceleration:g} m/s^2 and {limits.jerk:g} m/s^3 it may come to "
            f"{extent.height:.4g} m"
        )
    if extent.speed > limits.speed:
        return (
            f"the pan, which accelerates at {speed:.4g} m/s, would come to {extent.speed:.4g} m/s before it brakes "
            f"within {limits.jerk:g} m/s^3, and its speed is limited to {limits.speed:g} m/s"
        )
    return None


def state_after(states: FloatArray, acceleration: FloatArray) -> PanState:
    """Return the pan's state after the last of n samples: states after each (n, 6), accelerations (n, 3) (m/s^2)."""
    return PanState(*states[-1].tolist(), *acceleration[-1].tolist())
