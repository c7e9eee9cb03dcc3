"""The next chunk of a stream: one policy, in `next_chunk`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from runtime.errors import BundleError, InputError
from runtime.following.course import Course
from runtime.following.end import End
from runtime.following.state import StreamState, StreamStatus, predict
from runtime.limits import Limits
from runtime.network.reader import Reader
from runtime.physics.motion import Motion
from runtime.safety.governor import govern
from runtime.safety.outside import Room
from runtime.safety.pan import Pan

UNSEEN = 200
"""Samples without a reading after which the pan is braked, two chunks at least: an object unseen for longer may be
anywhere."""


def next_chunk(
    last: StreamState,
    course: Course,
    end: End,
    limits: Limits,
    samples: int,
    late: int | None,
    tight: Limits | None = None,
) -> tuple[StreamState, Course]:
    """Return what is carried with the next chunk, and what is followed after it.

    Args:
        last: what is carried.
        course: what is followed.
        end: what holds past its end.
        limits: of the pan.
        samples: executed since the network was asked before.
        late: by which the arm executes late, as it was found; None if it was told.
        tight: on speed, acceleration and jerk of this chunk and of a stop that begins with it; None for the pan's own.
    """
    sight = last.sight
    if last.status is StreamStatus.BRAKING:
        return last.stopped(last.after, last.room), course
    unseen = sight.end - min(sight.arrived)
    if unseen >= max(UNSEEN, 2 * last.chunk):
        return last.stopped(_within(last.after, tight), last.room), course
    if late is not None:
        course = course.advanced(late)
    course = course.told(sight.friction_estimate)
    try:
        before, room = last.located(limits)
    except InputError:  # so far away, or so fast, that no reach holds its stop: millimetres, maybe
        return last.stopped(last.after, last.room), course
    if tight is not None:
        before = _within(before, tight) if before is last.after else _stopping_within(before, room, tight)
    sliding = sight.sliding[-1]
    ending = end.ending(last, course, sliding, samples)
    if ending is not None and end.rests(last, course, ending, sliding):
        return end.rest(last, course, ending, before, room, sliding), course
    if course.over:
        course = course.bringing_back(sliding[:2], sight.friction)
    try:
        motion, after, asked = _follow(last, course, before, room)
    except BundleError:
        return last.stopped(before, room), course
    status = last.judged(room, limits, unseen >= last.chunk)
    going_on = course._replace(reader=asked.after(last.chunk))
    return last.followed_by(motion, before, after, room, status, asked, ending), going_on


def _within(pan: Pan, tight: Limits | None) -> Pan:
    if tight is None:
        return pan
    limits = replace(pan.limits, speed=tight.speed, acceleration=tight.acceleration, jerk=tight.jerk)
    return pan._replace(limits=limits)


def _stopping_within(pan: Pan, room: Room, tight: Limits) -> Pan:
    """Return a pan whose stop was found where it is believed to be, with one within these limits if there is one."""
    pan = _within(pan, tight)
    gentler = Pan.at(room.seen_inside(pan.state), pan.limits)
    return room.outside(gentler) if gentler.can_stop else pan


def _follow(last: StreamState, course: Course, before: Pan, room: Room) -> tuple[Motion, Pan, Reader]:
    """Ask the network and govern: the motion of the next chunk, the pan at its end, and the reader that was asked.

    Raises:
        BundleError: the network gave no finite number.
    """
    sight, chunk = last.sight, last.chunk
    pan, sliding = sight.pan[-chunk:], sight.sliding[-chunk:]
    asked, reader = course.reader.look(pan[None], sliding[None], np.array([before.state[6:]]))
    acceleration, states, (after,) = govern([room.inside(before)], asked)
    states[..., :2] += room.centre
    motion = predict(before, asked[0], acceleration[0], states[0], sliding[-1], sight.friction)
    return motion, room.outside(after), reader
