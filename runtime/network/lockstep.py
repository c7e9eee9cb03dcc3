"""The decode loop by numba: groups of commands take their chunks in step, and the network is asked for all at once.

It does what `runtime.network.decode.decode` does with each group, to the last bit. A question costs little more for 48
commands than for one, so groups whose chunks last differently are asked together too. Between two questions, one
function does all that follows an answer, and fills in what the network sees next. It is made of those that the plain
loop is made of.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from runtime.command import Command
from runtime.documents.checks import FloatArray
from runtime.errors import BundleError
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.network.bundle import Bundle, Float32Array, LstmState
from runtime.network.job import Job
from runtime.network.reader import MOST_AT_ONCE, Frame, groups_of
from runtime.network.taps import fill_answer, fill_observation
from runtime.network.units import CHUNK, OBSERVED
from runtime.physics.compiled import Compiler, compile_together
from runtime.physics.law import DT, GRAVITY, slide, slide_along
from runtime.physics.motion import Motion
from runtime.safety.free import Pans, keep_limits
from runtime.safety.governor import govern_others
from runtime.safety.pan import Pan
from runtime.start import Start

NOT_FINITE = -1
"""Returned in the place of a number of pans."""


class Course(NamedTuple):
    """What B commands are planned with, in numbers, and their motions, which are filled in question by question.

    Attributes:
        frame: what the network reads of them.
        elapsed: what is told of the time since the question before.
        static, kinetic: (B,) coefficients of friction.
        bounds, pans, brakes, ramps, free: of `Pans`, before the next chunk.
        asked, u: (n, B, C, 3) what each of the n answers asks for, and what is done (m/s^2).
        states, sliding: (n + 1, B, C, 6) and (n + 1, B, C, 4), the last C states before each question, and at the end.
    """

    frame: Frame
    elapsed: float
    static: FloatArray
    kinetic: FloatArray
    bounds: FloatArray
    pans: FloatArray
    brakes: FloatArray
    ramps: NDArray[np.int64]
    free: NDArray[np.bool_]
    asked: FloatArray
    u: FloatArray
    states: FloatArray
    sliding: FloatArray

    @classmethod
    def of(cls, frame: Frame, jobs: Sequence[Job], pans: Pans) -> Self:
        """Return the course of jobs at their start."""
        shape = -(-frame.samples // frame.chunk), len(jobs), frame.chunk
        asked, u = np.empty((2, *shape, 3))
        states, sliding = (np.empty((shape[0] + 1, *shape[1:], columns)) for columns in (6, 4))
        states[0] = np.stack([job.start.pan_state() for job in jobs])[:, None]  # it has been there
        sliding[0] = np.stack([job.start.object_state(job.command.position[0]) for job in jobs])[:, None]
        return cls(
            frame,
            min(1.0, frame.chunk / frame.step / CHUNK),
            np.array([job.friction.static for job in jobs]),
            np.array([job.friction.kinetic for job in jobs]),
            pans.bounds,
            pans.states,
            pans.brakes,
            pans.ramps,
            pans.free,
            asked,
            u,
            states,
            sliding,
        )


def look(course: Course, question: int, out: Float32Array) -> None:
    """Fill in what the network sees with a question, to be compiled."""
    frame = course.frame
    fill_observation(
        course.states[question],
        course.sliding[question],
        course.pans[:, 6:].copy(),
        frame.command,
        min(question * frame.chunk, frame.samples),
        frame.seen.rows,
        frame.seen.shares,
        frame.ahead.rows,
        frame.ahead.shares,
        frame.scale,
        frame.acceleration,
        frame.conditions,
        course.elapsed if question > 0 else 1.0,
        out,
    )


def go_on(course: Course, question: int, answer: Float32Array, gravity: float, dt: float, out: Float32Array) -> int:
    """Fill in what an answer asks for, where it leads, and what the network sees there, to be compiled.

    Returns:
        How many pans may not go there, as `Pans.free` tells; NOT_FINITE if the answer is no finite numbers.
    """
    frame, after = course.frame, question + 1
    asked, u = course.asked[question], course.u[question]
    last = course.pans[:, 6:].copy()
    if not fill_answer(answer, last, frame.answer.rows, frame.answer.shares, frame.acceleration, asked):
        return NOT_FINITE
    for row in range(len(u)):  # numba takes 3 s to compile `u[:] = asked`
        for k in range(u.shape[1]):
            u[row, k, 0], u[row, k, 1], u[row, k, 2] = asked[row, k, 0], asked[row, k, 1], asked[row, k, 2]
    others = keep_limits(u, course.bounds, course.pans, course.brakes, course.ramps, course.free, course.states[after])
    before = course.sliding[question, :, -1].copy()
    slide_along(before, u, course.static, course.kinetic, gravity, dt, course.sliding[after])
    look(course, after, out)
    return int(others)


class Group(NamedTuple):
    """Commands of one group (`group_of`) on their way.

    Attributes:
        indices: which of the jobs they are.
        frictions: of each.
        pans: before the next chunk.
        course: where they go.
        read_again: the questions before which they are read anew.
    """

    indices: Sequence[int]
    frictions: Sequence[Friction]
    pans: Pans
    course: Course
    read_again: Set[int]

    @classmethod
    def of(cls, indices: Sequence[int], jobs: Sequence[Job]) -> Self:
        """Return these jobs at their start."""
        frame, pans = Frame.of(jobs), Pans([Pan.at_start(job.start, job.limits) for job in jobs])
        frictions, course = [job.friction for job in jobs], Course.of(frame, jobs, pans)
        return cls(indices, frictions, pans, course, set(_readings(frame)))

    @property
    def questions(self) -> int:
        """How often they are asked."""
        return len(self.course.u)

    def decoded(self) -> dict[int, tuple[Motion, Pan]]:
        """Return the motion of each job and the pan at its end, by its index."""
        course, before = self.course, self.course.frame.chunk - 1
        u, asked, states, sliding = (
            part.swapaxes(0, 1).reshape(len(self.indices), -1, part.shape[-1])
            for part in (course.u, course.asked, course.states, course.sliding)
        )
        whole = Motion(u, asked, states[:, before:], sliding[:, before:])
        return {index: (whole.one(row), self.pans[row]) for row, index in enumerate(self.indices)}


def _readings(frame: Frame) -> Iterator[int]:
    """Yield the questions before which commands are read anew."""
    following = frame.next_read(0)
    for question, now in enumerate(range(0, frame.samples, frame.chunk)):
        if now >= following:
            following = frame.next_read(now)
            yield question


class Lockstep:
    """Decodes commands.

    Args:
        compile_one: compiles a function.
        known: what it is made of, compiled, by name.
    """

    def __init__(self, compile_one: Compiler, known: Mapping[str, Any]) -> None:
        functions = compile_together([look, go_on], compile_one, known)
        self._look, self._go_on = functions["look"], functions["go_on"]
        group = Group.of([0], [Job(Command(np.zeros((2, 2))), Friction(), Limits(), Start())])
        answer, observation = (np.zeros((1, *shape), dtype=np.float32) for shape in ((CHUNK, 3), (OBSERVED,)))
        self._look(group.course, 0, observation)  # compiles
        self._move(group, 0, answer, "", observation)  # compiles

    def decode(self, bundle: Bundle, jobs: Sequence[Job]) -> list[tuple[Motion, Pan]]:
        """Decode commands of any lengths and limits; see `runtime.network.decode.decode_all`."""
        found: dict[int, tuple[Motion, Pan]] = {}
        together: list[Group] = []
        groups = groups_of(jobs)
        for indices, following in zip(groups, [*groups[1:], None], strict=True):
            together.append(Group.of(indices, [jobs[index] for index in indices]))
            rows = sum(len(group.indices) for group in together)
            if following is None or rows + len(following) > MOST_AT_ONCE:
                self._run(bundle, together)
                for group in together:
                    found |= group.decoded()
                together = []
        return [found[index] for index in range(len(jobs))]

    def _run(self, bundle: Bundle, groups: Sequence[Group]) -> None:
        """Take groups to their ends.

        Raises:
            BundleError: an acceleration is no finite number.
        """
        going = sorted(groups, key=lambda group: -group.questions)  # those that are over first come last
        read = [bundle.encode(group.course.frame.window(0)) for group in going]
        memory = LstmState(*(np.concatenate(parts, axis=1) for parts in zip(*read, strict=True)))
        observation = np.empty((memory.hidden.shape[1], OBSERVED), dtype=np.float32)
        parts = _side_by_side(going)
        for group, rows in parts:
            self._look(group.course, 0, observation[rows])
        question, name = 0, bundle.manifest.name
        while going:
            for group, rows in parts:
                if question in group.read_again:
                    again = bundle.encode(group.course.frame.window(question * group.course.frame.chunk))
                    for whole, part in zip(memory, again, strict=True):
                        whole[:, rows] = part
            answer, memory = bundle.decode_step(observation, memory)
            for group, rows in parts:
                self._move(group, question, answer[rows], name, observation[rows])
            question += 1
            if going[-1].questions == question:
                going = [group for group in going if group.questions > question]
                parts = _side_by_side(going)
                count = sum(len(group.indices) for group in going)
                observation = observation[:count]
                memory = LstmState(*(np.ascontiguousarray(each[:, :count]) for each in memory))

    def _move(self, group: Group, question: int, answer: Float32Array, name: str, observation: Float32Array) -> None:
        """Let governor and law do what an answer of the bundle of this name asks for, and fill in what is seen then.

        Raises:
            BundleError: an acceleration is no finite number.
        """
        others = self._go_on(group.course, question, answer, GRAVITY, DT, observation)
        if others == NOT_FINITE:
            now = question * group.course.frame.chunk
            raise BundleError(f"the network of bundle {name!r} gave no finite number at sample {now}")
        if not others:
            group.pans.held.clear()
            return
        u, sliding = group.course.u[question], group.course.sliding
        rows = govern_others(group.pans, u, group.course.states[question + 1])
        frictions = [group.frictions[row] for row in rows]
        sliding[question + 1, rows] = slide(sliding[question, rows, -1], u[rows], frictions)
        self._look(group.course, question + 1, observation)


def _side_by_side(groups: Sequence[Group]) -> list[tuple[Group, slice]]:
    """Return groups with the rows that they have of what the network is given."""
    ends = np.cumsum([len(group.indices) for group in groups]).tolist()
    return [(group, slice(end - len(group.indices), end)) for group, end in zip(groups, ends, strict=True)]
