"""The decode loop by numba: groups of commands take their chunks in step, and the network is asked for all at once.

It does what `runtime.network.decode.decode` does with each group, to the last bit. A question costs little more for 48
commands than for one, so groups whose chunks last differently are asked together too. Between two questions, one
function does all that follows an answer, and one makes what the network sees next: they are those that the plain loop
is made of.
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
from runtime.network.taps import Told, fill_answer, observe
from runtime.network.units import CHUNK, OBSERVED
from runtime.physics.compiled import Compiler, compile_together
from runtime.physics.law import DT, GRAVITY, slide, slide_along
from runtime.physics.motion import Motion
from runtime.safety.free import Pans, keep_limits
from runtime.safety.governor import govern_others
from runtime.safety.pan import Pan
from runtime.start import Start

NOT_FINITE = -1


def go_on(
    question: int,
    answer: Float32Array,
    rows: NDArray[np.intp],
    shares: FloatArray,
    unit: FloatArray,
    static: FloatArray,
    kinetic: FloatArray,
    gravity: float,
    dt: float,
    bounds: FloatArray,
    pans: FloatArray,
    brakes: FloatArray,
    ramps: NDArray[np.int64],
    free: NDArray[np.bool_],
    asked: FloatArray,
    u: FloatArray,
    states: FloatArray,
    sliding: FloatArray,
) -> int:
    """Fill in what an answer asks for and where it leads, to be compiled: `Pans.free` tells which pans may go there.

    Returns:
        How many may not, NOT_FINITE if the answer is no finite numbers.
    """
    after = question + 1
    if not fill_answer(answer, pans[:, 6:].copy(), rows, shares, unit, asked[question]):
        return NOT_FINITE
    u[question] = asked[question]
    others = keep_limits(u[question], bounds, pans, brakes, ramps, free, states[after])
    slide_along(sliding[question, :, -1].copy(), u[question], static, kinetic, gravity, dt, sliding[after])
    return others


class Group(NamedTuple):
    """Commands of one group (`group_of`) on their way, which is filled in question by question.

    Attributes:
        indices: which of the jobs they are.
        frame: what the network reads of them.
        frictions: of each; static, kinetic: (B,) the same in numbers.
        pans: before the next chunk.
        read_again: the questions before which they are read anew.
        asked, u: (n, B, C, 3) what each of the n answers asks for, and what is done (m/s^2).
        pan, sliding: (n + 1, B, C, 6) and (n + 1, B, C, 4), the last C states before each question, and at the end.
    """

    indices: Sequence[int]
    frame: Frame
    frictions: Sequence[Friction]
    static: FloatArray
    kinetic: FloatArray
    pans: Pans
    read_again: Set[int]
    asked: FloatArray
    u: FloatArray
    pan: FloatArray
    sliding: FloatArray

    @classmethod
    def of(cls, indices: Sequence[int], jobs: Sequence[Job]) -> Self:
        """Return these jobs at their start."""
        frame, count = Frame.of(jobs), len(jobs)
        questions, chunk = -(-frame.samples // frame.chunk), frame.chunk
        static, kinetic = (np.array([getattr(job.friction, name) for job in jobs]) for name in ("static", "kinetic"))
        pan, sliding = np.empty((questions + 1, count, chunk, 6)), np.empty((questions + 1, count, chunk, 4))
        pan[0] = np.stack([job.start.pan_state() for job in jobs])[:, None]  # it has been there
        sliding[0] = np.stack([job.start.object_state(job.command.position[0]) for job in jobs])[:, None]
        return cls(
            indices,
            frame,
            [job.friction for job in jobs],
            static,
            kinetic,
            Pans([Pan.at_start(job.start, job.limits) for job in jobs]),
            set(_readings(frame)),
            *np.empty((2, questions, count, chunk, 3)),
            pan,
            sliding,
        )

    @property
    def questions(self) -> int:
        """How often they are asked."""
        return len(self.u)

    def told(self, question: int) -> Told:
        """Return what the network is told with a question."""
        frame, last = self.frame, self.pans.states[:, 6:]
        elapsed = frame.chunk / frame.step / CHUNK if question else 1.0
        return frame.told(self.pan[question], self.sliding[question], last, question * frame.chunk, elapsed)

    def decoded(self) -> dict[int, tuple[Motion, Pan]]:
        """Return the motion of each job and the pan at its end, by its index."""
        before = self.frame.chunk - 1
        u, asked, pan, sliding = (
            part.swapaxes(0, 1).reshape(len(self.indices), -1, part.shape[-1])
            for part in (self.u, self.asked, self.pan, self.sliding)
        )
        whole = Motion(u, asked, pan[:, before:], sliding[:, before:])
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
        self._go_on = compile_together([go_on], compile_one, known)["go_on"]
        group = Group.of([0], [Job(Command(np.zeros((2, 2))), Friction(), Limits(), Start())])
        self._move(group, 0, np.zeros((1, CHUNK, 3), dtype=np.float32), "")  # compiles

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
        read = [bundle.encode(group.frame.window(0)) for group in going]
        memory = LstmState(*(np.concatenate(parts, axis=1) for parts in zip(*read, strict=True)))
        begin = 0
        while going:
            ends = np.cumsum([len(group.indices) for group in going]).tolist()
            parts = [(group, slice(end - len(group.indices), end)) for group, end in zip(going, ends, strict=True)]
            memory = LstmState(*(np.ascontiguousarray(each[:, : ends[-1]]) for each in memory))
            observation = np.empty((ends[-1], OBSERVED), dtype=np.float32)
            for question in range(begin, going[-1].questions):
                for group, rows in parts:
                    if question in group.read_again:
                        again = bundle.encode(group.frame.window(question * group.frame.chunk))
                        for whole, part in zip(memory, again, strict=True):
                            whole[:, rows] = part
                    observe(group.told(question), observation[rows])
                answer, memory = bundle.decode_step(observation, memory)
                for group, rows in parts:
                    self._move(group, question, answer[rows], bundle.manifest.name)
            begin = going[-1].questions
            going = [group for group in going if group.questions > begin]

    def _move(self, group: Group, question: int, answer: Float32Array, name: str) -> None:
        """Let governor and law do what an answer of the bundle of this name asks for.

        Raises:
            BundleError: an acceleration is no finite number.
        """
        frame, pans, sliding = group.frame, group.pans, group.sliding
        others = self._go_on(
            question,
            answer,
            *frame.answer,
            frame.acceleration,
            group.static,
            group.kinetic,
            GRAVITY,
            DT,
            pans.bounds,
            pans.states,
            pans.brakes,
            pans.ramps,
            pans.free,
            group.asked,
            group.u,
            group.pan,
            sliding,
        )
        if others == NOT_FINITE:
            raise BundleError(
                f"the network of bundle {name!r} gave no finite number at sample {question * frame.chunk}"
            )
        u = group.u[question]
        rows = govern_others(pans, others, u, group.pan[question + 1])
        if rows:
            frictions = [group.frictions[row] for row in rows]
            sliding[question + 1, rows] = slide(sliding[question, rows, -1], u[rows], frictions)
