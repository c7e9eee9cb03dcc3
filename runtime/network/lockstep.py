"""The decode loop by numba: groups of commands take their chunks in step, and the network is asked for all at once.

It does what `runtime.network.decode.decode` does with each group, to the last bit. A question costs little more for 48
commands than for one, so groups whose chunks last differently are asked together too. Between two questions, one
function does all that follows an answer, and one makes what the network sees next: they are those that the plain loop
is made of.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
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
from runtime.safety.free import Free, Pans, keep_limits
from runtime.safety.governor import govern_each
from runtime.safety.pan import Pan
from runtime.start import Start


def go_on(
    answer: Float32Array,
    rows: NDArray[np.intp],
    shares: FloatArray,
    unit: FloatArray,
    before: FloatArray,
    bounds: FloatArray,
    static: FloatArray,
    kinetic: FloatArray,
    gravity: float,
    dt: float,
    asked: FloatArray,
    free: NDArray[np.bool_],
    states: FloatArray,
    brakes: FloatArray,
    ramps: NDArray[np.int64],
    object_before: FloatArray,
    sliding: FloatArray,
) -> bool:
    """Fill in what an answer asks for and where it leads, to be compiled: `free` tells which pans are free to go there.

    Returns:
        Whether all numbers are finite.
    """
    finite = bool(fill_answer(answer, before[:, 6:].copy(), rows, shares, unit, asked))
    if finite:
        keep_limits(before, asked, bounds, free, states, brakes, ramps)
        slide_along(object_before, asked, static, kinetic, gravity, dt, sliding)
    return finite


class Group(NamedTuple):
    """Commands of one group (`group_of`) on their way.

    Attributes:
        indices: which of the jobs they are.
        frame: what the network reads of them.
        frictions: of each; static, kinetic: (B,) the same in numbers.
        pans: before the next chunk.
        pan, sliding: (B, C, 6) and (B, C, 4), the last C states.
        now: the sample at which they are asked next.
        next_read: the sample from which they are read anew.
        moved: what has been of their motions.
    """

    indices: Sequence[int]
    frame: Frame
    frictions: Sequence[Friction]
    static: FloatArray
    kinetic: FloatArray
    pans: Pans
    pan: FloatArray
    sliding: FloatArray
    now: int
    next_read: int
    moved: list[Motion]

    @classmethod
    def of(cls, indices: Sequence[int], jobs: Sequence[Job]) -> Self:
        """Return these jobs at their start."""
        frame = Frame.of(jobs)
        static, kinetic = (np.array([getattr(job.friction, name) for job in jobs]) for name in ("static", "kinetic"))
        pan = np.stack([job.start.pan_state() for job in jobs])[:, None]
        sliding = np.stack([job.start.object_state(job.command.position[0]) for job in jobs])[:, None]
        return cls(
            indices,
            frame,
            [job.friction for job in jobs],
            static,
            kinetic,
            Pans.of([Pan.at_start(job.start, job.limits) for job in jobs]),
            np.repeat(pan, frame.chunk, axis=1),  # it has been there
            np.repeat(sliding, frame.chunk, axis=1),
            0,
            frame.next_read(0),
            [Motion(pan[:, :0, :3], pan[:, :0, :3], pan, sliding)],
        )

    @property
    def questions(self) -> int:
        """How often they are asked, from the start on."""
        return -(-self.frame.samples // self.frame.chunk)

    @property
    def over(self) -> bool:
        """Whether they are at their ends."""
        return self.now >= self.frame.samples

    def told(self) -> Told:
        """Return what the network is told of them next."""
        elapsed = self.frame.chunk / self.frame.step / CHUNK if self.now else 1.0
        return self.frame.told(self.pan, self.sliding, self.pans.states[:, 6:], self.now, elapsed)

    def decoded(self) -> dict[int, tuple[Motion, Pan]]:
        """Return the motion of each job and the pan at its end, by its index."""
        whole = Motion(*(np.concatenate(each, axis=1) for each in zip(*self.moved, strict=True)))
        return {index: (whole.one(row), self.pans[row]) for row, index in enumerate(self.indices)}


class Lockstep:
    """Decodes commands.

    Args:
        compile_one: compiles a function.
        known: what it is made of, compiled, by name.
    """

    def __init__(self, compile_one: Compiler, known: Mapping[str, Any]) -> None:
        self._go_on = compile_together([go_on], compile_one, known)["go_on"]
        group = Group.of([0], [Job(Command(np.zeros((2, 2))), Friction(), Limits(), Start())])
        self._moved(group, np.zeros((1, CHUNK, 3), dtype=np.float32), "")  # compiles

    def decode(self, bundle: Bundle, jobs: Sequence[Job]) -> list[tuple[Motion, Pan]]:
        """Decode commands of any lengths and limits; see `runtime.network.decode.decode_all`."""
        found: dict[int, tuple[Motion, Pan]] = {}
        together: list[Group] = []
        groups = groups_of(jobs)
        for indices, following in zip(groups, [*groups[1:], None], strict=True):
            together.append(Group.of(indices, [jobs[index] for index in indices]))
            rows = sum(len(group.indices) for group in together)
            if following is None or rows + len(following) > MOST_AT_ONCE:
                for group in self._run(bundle, together):
                    found |= group.decoded()
                together = []
        return [found[index] for index in range(len(jobs))]

    def _run(self, bundle: Bundle, groups: Sequence[Group]) -> Iterator[Group]:
        """Take groups to their ends, and yield each there.

        Raises:
            BundleError: an acceleration is no finite number.
        """
        going = sorted(groups, key=lambda group: -group.questions)  # those that are over first come last
        read = [bundle.encode(group.frame.window(0)) for group in going]
        memory = LstmState(*(np.concatenate(parts, axis=1) for parts in zip(*read, strict=True)))
        while going:
            ends = np.cumsum([len(group.indices) for group in going]).tolist()
            rows = [slice(end - len(group.indices), end) for group, end in zip(going, ends, strict=True)]
            memory = LstmState(*(np.ascontiguousarray(each[:, : ends[-1]]) for each in memory))
            going = [_read_again(bundle, group, memory, part) for group, part in zip(going, rows, strict=True)]
            observation = np.empty((ends[-1], OBSERVED), dtype=np.float32)
            for group, part in zip(going, rows, strict=True):
                observe(group.told(), observation[part])
            answer, memory = bundle.decode_step(observation, memory)
            name = bundle.manifest.name
            going = [self._moved(group, answer[part], name) for group, part in zip(going, rows, strict=True)]
            while going and going[-1].over:
                yield going.pop()

    def _moved(self, group: Group, answer: Float32Array, name: str) -> Group:
        """Let governor and law do what an answer of the bundle of this name asks for.

        Raises:
            BundleError: an acceleration is no finite number.
        """
        frame, pans, count = group.frame, group.pans, len(group.indices)
        asked, free = np.empty((count, frame.chunk, 3)), Free.of(count, frame.chunk)
        before = np.ascontiguousarray(group.sliding[:, -1])
        sliding = np.empty((count, frame.chunk, 4))
        if not self._go_on(
            answer,
            *frame.answer,
            frame.acceleration,
            pans.states,
            pans.bounds,
            group.static,
            group.kinetic,
            GRAVITY,
            DT,
            asked,
            *free,
            before,
            sliding,
        ):
            raise BundleError(f"the network of bundle {name!r} gave no finite number at sample {group.now}")
        u, held = asked, dict[int, Pan]()
        if not free.rows.all():
            rows = np.flatnonzero(~free.rows).tolist()
            limits = [pans.limits[row] for row in rows]
            kept, states, after = govern_each([pans[row] for row in rows], pans.states[rows], limits, asked[rows])
            u = asked.copy()
            u[rows], free.states[rows] = kept, states
            sliding[rows] = slide(before[rows], kept, [group.frictions[row] for row in rows])
            held = dict(zip(rows, after, strict=True))
        group.moved.append(Motion(u, asked, free.states, sliding))
        return group._replace(
            pans=pans.after(u, free, held), pan=free.states, sliding=sliding, now=group.now + frame.chunk
        )


def _read_again(bundle: Bundle, group: Group, memory: LstmState, rows: slice) -> Group:
    """Read commands anew where the last window ends; their rows of the memory are filled with it."""
    if group.now < group.next_read or group.over:
        return group
    for whole, part in zip(memory, bundle.encode(group.frame.window(group.now)), strict=True):
        whole[:, rows] = part
    return group._replace(next_read=group.frame.next_read(group.now))
