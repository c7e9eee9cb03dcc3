"""How a stream ends: the pan comes to rest, stays there, and brings back an object that left its mark."""

from __future__ import annotations

import math
from typing import NamedTuple

from runtime.commands.come_back import come_back
from runtime.documents.checks import FloatArray
from runtime.following.course import Course
from runtime.following.state import Ending, StreamState, StreamStatus, moved_to
from runtime.physics.law import DT
from runtime.safety.outside import Room
from runtime.safety.pan import Pan
from runtime.safety.rest import kindest_stop

ENDING_TIME, RETURN_TIME = 1.0, 3.0
"""Time (s) in which the object may be brought to its mark: past the end of the command, and after it was moved."""

STOPPING_TIME = 0.3
"""Time (s) that is kept for the stop after the object was brought back."""

STILL_SPEED = 0.05
"""Speed (m/s) up to which an object counts as at rest when it is measured: noise is below."""

SAME_SPEED = 0.05
"""Difference (m/s) between a measured pan and what was commanded, up to which it is taken for noise: the stop brings to
rest what was commanded, so that nothing drifts."""


class End(NamedTuple):
    """What holds past the end of a command.

    Attributes:
        tolerance: distance of the object from its mark (m) up to which the pan rests.
        pan_radius: beyond which the object has left the pan (m).
    """

    tolerance: float
    pan_radius: float

    def ending(self, last: StreamState, course: Course, sliding: FloatArray, samples: int) -> Ending | None:
        """Return what goes on past the end of the command, None before.

        Args:
            last: what is carried.
            course: what is followed.
            sliding: (4,) the object, as it is believed to be.
            samples: executed since the network was asked before.
        """
        if last.ending is None:
            return Ending(round(ENDING_TIME / DT) - course.past) if course.over else None
        if last.ending.place is not None and math.dist(sliding[:2], last.ending.place) > self.tolerance:
            return Ending(round(RETURN_TIME / DT))
        return last.ending._replace(left=last.ending.left - samples)

    def rests(self, last: StreamState, course: Course, ending: Ending, sliding: FloatArray) -> bool:
        """Whether the pan is to come to rest, or to stay there, rather than to bring the object (4,) to its mark."""
        if not course.over:
            return False
        if last.status is not StreamStatus.RESTING or last.after.brake.samples > 0 or ending.place is not None:
            return True
        off, speed = math.dist(sliding[:2], course.mark), math.hypot(sliding[2], sliding[3])
        lost = math.hypot(sliding[0], sliding[1]) > self.pan_radius
        if off <= self.tolerance or speed > STILL_SPEED or lost:
            return True
        needed = len(come_back(sliding[:2], course.mark, last.sight.friction)) + round(STOPPING_TIME / DT)
        return needed > ending.left

    def rest(
        self, last: StreamState, course: Course, ending: Ending, before: Pan, room: Room, sliding: FloatArray
    ) -> StreamState:
        """Return what is carried with the next chunk of the stop past the end of the command, or of the rest after it.

        Args:
            last: what is carried.
            course: what was followed.
            ending: what goes on.
            before: the pan, where it is believed to be; looked at again only if it has left its place.
            room: where it may be.
            sliding: (4,) the object.
        """
        state = before.state
        commanded = moved_to(state, last.commanded)
        moved = math.dist(state[:3], last.after.state[:3]) > self.tolerance
        if last.status is StreamStatus.RESTING and not moved:
            before, room = last.after, last.room
            if before.brake.samples == 0 and math.hypot(sliding[2], sliding[3]) <= STILL_SPEED:
                ending = ending._replace(place=sliding[:2].copy())
        else:
            near = math.dist(state[:3], commanded[:3]) <= self.tolerance
            if near and math.dist(state[3:6], commanded[3:6]) <= SAME_SPEED:
                state = commanded
            inside = room.seen_inside(state)
            brake = kindest_stop(inside, sliding, course.mark, before.limits, last.sight.friction)
            before = before if brake is None else before._replace(state=state, brake=brake)
        return last.braked(before, room, sliding, StreamStatus.RESTING, ending)
