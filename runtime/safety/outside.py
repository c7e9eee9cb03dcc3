"""A pan outside its reach: its reach is moved towards it, no farther than the stop from where it is needs.

The reach stays as wide as it was, so that on the other side nothing is won; as the pan comes back, the reach goes back
before it. Only a stop that is longer than the reach is wide, or faster or higher than the limits, widens them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple, Self

import numpy as np

from runtime.limits import Limits
from runtime.physics.pan import integrate_pan
from runtime.safety.pan import Pan
from runtime.safety.stop import Brake, PanState, find_brake, stop_extent

MIDDLE = (0.0, 0.0)

HALVINGS = 12
"""Halvings of the way that the reach is moved: to within a four thousandth of it."""

MARGIN = 1e-9
"""What the limits are widened by beyond the need (m, m/s): rounding is below."""


class Room(NamedTuple):
    """Where a pan may be.

    Attributes:
        centre: of its reach, in the plane (m); (0, 0) unless the pan is outside.
        limits: about that centre.
    """

    centre: tuple[float, float]
    limits: Limits

    @classmethod
    def of(cls, state: PanState, limits: Limits) -> Self:
        """Return the room of a pan, from which it can come to rest in it."""
        brake = find_brake(state, limits)
        needed = stop_extent(state, brake)
        if needed.within(limits):
            return cls(MIDDLE, limits)
        limits = replace(
            limits,
            height=limits.height if needed.height <= limits.height else needed.height + MARGIN,
            speed=limits.speed if needed.speed <= limits.speed else needed.speed + MARGIN,
        )
        if needed.reach <= limits.pan_reach:
            return cls(MIDDLE, limits)
        x, y = _middle(state, brake)

        def reach(share: float) -> float:
            return stop_extent(moved(state, (-share * x, -share * y)), brake).reach

        farthest = reach(1.0)
        if farthest > limits.pan_reach:
            return cls((x, y), replace(limits, pan_reach=farthest + MARGIN))
        least, most = 0.0, 1.0
        for _ in range(HALVINGS):
            share = 0.5 * (least + most)
            least, most = (least, share) if reach(share) <= limits.pan_reach else (share, most)
        return cls((most * x, most * y), limits)

    def off_limits(self, limits: Limits) -> bool:
        """Whether this is another room than the limits give."""
        return self.centre != MIDDLE or self.limits != limits

    def seen_inside(self, state: PanState) -> PanState:
        """Return a pan's state as seen from the centre."""
        return state if self.centre == MIDDLE else moved(state, (-self.centre[0], -self.centre[1]))

    def inside(self, pan: Pan) -> Pan:
        """Return a pan as seen from the centre."""
        return pan if self.centre == MIDDLE else pan._replace(state=self.seen_inside(pan.state))

    def outside(self, pan: Pan) -> Pan:
        """Return a pan that is seen from the centre as seen from the middle of all."""
        return pan if self.centre == MIDDLE else pan._replace(state=moved(pan.state, self.centre))


def moved(state: PanState, by: tuple[float, float]) -> PanState:
    """Return a pan elsewhere in the plane, by (m)."""
    return state._replace(x=state.x + by[0], y=state.y + by[1])


def _middle(state: PanState, brake: Brake) -> tuple[float, float]:
    """Return the middle between where a pan is and where its stop ends, in the plane (m)."""
    end = integrate_pan(np.array(state[:6]), brake.accelerations(brake.samples))[-1]
    return 0.5 * (state.x + float(end[0])), 0.5 * (state.y + float(end[1]))
