"""Plans outside the event loop, together what can be planned together.

A process of its own plans; see `server.planning.worker`. While it does, requests gather, and what has gathered is
planned next through the batch axis: a lone request never waits, and under load the batches grow by themselves. Clients
that were answered together come back together, a moment apart; so after a batch of several the next one waits for the
window.

Short jobs and long ones wait in lanes of their own and are planned side by side. In each lane next is the client that
has had the least time. What a batch takes is bounded by its chunks, and what its plans take by the bytes that finished
ones may hold until they are read: the process waits for those who read, each client for itself.

A job of `POST /plan` whose plan is bad is planned once more, several ways, among the long jobs.

A process that ends, or is at one batch for too long, is replaced. What it was planning then has failed, and what waits
is sent away: a new one takes a second to be ready, for it loads what the first one has compiled. That one does nothing
else, and gives back the memory that compiling takes.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import defaultdict, deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from runtime.network.manifest import Manifest
from server.metrics import Metrics
from server.planning.bounds import NPZ_ROW_BYTES, PLAN_BYTES, ROW_BYTES
from server.planning.messages import LANES, Batch, Lane, PlanFailure, PlannerOptions, PlanReply, ReadJob
from server.planning.process import PLANNING_COMMAND, Child, keep, once
from server.problems import Problem, for_input
from server.settings import Settings
from server.shares import AGAIN, Lease, Shares, Turns

log = logging.getLogger("slide-serve")


class WrittenPlan(NamedTuple):
    """A plan as it is sent, in pieces, and the time it took (s): waiting, in the encoder, in the rest of the planning,
    written."""

    body: list[bytes]
    queue: float
    encode: float
    decode: float
    write: float

    @property
    def size(self) -> int:
        """Bytes of the plan."""
        return sum(map(len, self.body))

    def after(self, first: WrittenPlan) -> WrittenPlan:
        """Return this plan with the time that the one before it took, too."""
        times = (before + own for before, own in zip(first[1:], self[1:], strict=True))
        return WrittenPlan(self.body, *times)


@dataclass(eq=False)
class QueuedJob:
    """A job that waits to be planned, is being planned, or whose plan waits to be read.

    Attributes:
        client: who asked for it.
        job: what is to be planned.
        npz: whether the plan is written as npz.
        size: of the plan, at most (bytes).
        place: in the queue.
        result: what comes of it.
        unread: the bytes that the plan holds, from its turn until it is read.
        entered: when it began to wait (s, of the monotonic clock).
        lone: its plan, if that is bad and it is being planned several ways.
    """

    client: str
    job: ReadJob
    npz: bool
    size: int
    place: Lease
    result: asyncio.Future[WrittenPlan]
    unread: Lease | None = None
    entered: float = field(default_factory=time.perf_counter)
    lone: WrittenPlan | None = None

    @property
    def started(self) -> bool:
        """Whether the process has it."""
        return self.unread is not None

    def finish(self, result: WrittenPlan | Problem) -> None:
        """Give the result, unless there is one, or nobody waits for it any more."""
        if self.result.done():
            self.drop()
        elif isinstance(result, Problem):
            self.drop(result)
        else:
            assert self.unread is not None
            self.unread.resize(result.size)
            self.result.set_result(result)

    def drop(self, why: Problem | None = None) -> None:
        """Nobody needs it, any more or ever: give back what it holds."""
        self.place.release()
        if self.unread is not None:
            self.unread.release()
        if self.result.done():
            return
        if why is None:
            self.result.cancel()
        else:
            self.result.set_exception(why)
            self.result.exception()  # is seen: a client that has left does not come for it

    def refuse_unless_started(self) -> None:
        """Send the job away if its turn has not come."""
        if not self.started:
            self.drop(overloaded())


class LaneState:
    """One lane: whose turn is next in it, since when it has been at its present batch, and what has come of that.

    Args:
        name: of the lane.
        turns: of its clients.
    """

    def __init__(self, name: Lane, turns: Turns) -> None:
        self.name, self.turns = name, turns
        self.begin()

    def begin(self) -> None:
        """Begin with a process that knows of nothing."""
        self.busy_since: float | None = None
        self.replies: asyncio.Queue[tuple[PlanReply | PlanFailure, list[bytes]]] = asyncio.Queue()


class Dispatcher:
    """Queues jobs, gives them to a planning process batch by batch, and hands the plans back.

    Args:
        options: what the process plans with.
        manifest: of the bundle.
        settings: bounds of the queue and of a batch.
        metrics: what is counted.
        command: how the process is run.

    Attributes:
        manifest: of the bundle.
        process: the number of the planning process; None while there is none that is ready.
    """

    def __init__(
        self,
        options: PlannerOptions,
        manifest: Manifest,
        settings: Settings,
        metrics: Metrics,
        command: Sequence[str] = PLANNING_COMMAND,
    ) -> None:
        self.manifest = manifest
        self.process: int | None = None
        self._options, self._settings, self._metrics, self._command = options, settings, metrics, command
        self._queue: deque[QueuedJob] = deque()
        self._changed = asyncio.Event()
        self._places = Shares("places in the queue", settings.max_queue, settings.client_share)
        self._unread = Shares("bytes of plans", settings.max_unread, settings.client_share, self._changed.set)
        self._lanes = {name: LaneState(name, Turns(settings.shares_of_time)) for name in LANES}

    @property
    def full(self) -> bool:
        """Whether no job more is taken."""
        return self._places.full

    @property
    def busy(self) -> float:
        """How long the process has been at its present batch, of both lanes the older one (s)."""
        began = [lane.busy_since for lane in self._lanes.values() if lane.busy_since is not None]
        return time.perf_counter() - min(began) if began else 0.0

    def check_room(self, client: str) -> None:
        """Check that a client's job would be taken.

        Raises:
            Problem: as `submit`.
        """
        self._places.take(client).release()

    def submit(self, client: str, job: ReadJob, npz: bool = False) -> QueuedJob:
        """Queue a job; one that is dropped is passed over.

        Raises:
            Problem: `overloaded` or `too-many`: there is no room for it.
        """
        place = self._places.take(client)
        size = PLAN_BYTES + job.rows * (NPZ_ROW_BYTES if npz else ROW_BYTES)
        queued = QueuedJob(client, job, npz, size, place, asyncio.get_running_loop().create_future())
        queued.result.add_done_callback(partial(self._leave_queue, queued))
        self._set_queue(*self._queue, queued)
        return queued

    async def run(self) -> None:
        """Plan, until cancelled, with one process after another.

        Raises:
            BundleError: a process is not ready to plan.
        """
        if not self._options.compile:
            await self._plan_with(self._options)
            return
        with temporary_folder() as folder:
            options = self._options._replace(compiled=folder)
            if folder is not None:
                await once("planning", options, self._command)
            await self._plan_with(options)

    async def _plan_with(self, options: PlannerOptions) -> None:
        await keep("planning", options, self._command, self._use, self._lost)

    async def _use(self, child: Child) -> None:
        """Plan with one process.

        Raises:
            EOFError: it has ended.
            TimeoutError: it is at one batch for too long.
        """
        self.process = child.number
        log.info("ready: model %s, in process %d", self.manifest.name, child.number)
        try:
            async with asyncio.TaskGroup() as work:
                work.create_task(self._sort_replies(child))
                for lane in self._lanes.values():
                    lane.begin()
                    work.create_task(self._serve(child, lane))
        except ExceptionGroup as errors:
            raise errors.exceptions[0] from None

    async def _sort_replies(self, child: Child) -> None:
        """Give each lane what comes for it.

        Raises:
            EOFError: the process has ended.
        """
        while True:
            reply, body = await child.receive()
            self._lanes[reply.lane].replies.put_nowait((reply, body))

    async def _serve(self, child: Child, lane: LaneState) -> None:
        """Let the process plan what waits in a lane, batch after batch.

        Raises:
            TimeoutError: it is at one for too long.
        """
        last = 1
        while True:
            batch = await self._next_batch(lane, last)
            last = len(batch)
            try:
                async with asyncio.timeout(self._settings.hang_deadlines * self._settings.deadline):
                    await self._plan(child, lane, batch)
            finally:
                for one in batch:
                    if not one.result.done() and one.lone is None:
                        one.drop(Problem("failed", "the planning process ended"))

    def _lost(self) -> None:
        self.process = None
        for lane in self._lanes.values():
            lane.begin()
        for one in list(self._queue):
            one.drop(Problem("not-ready", "the planning process ended before the plan was made", headers=AGAIN))
        self._set_queue()

    async def _next_batch(self, lane: LaneState, last: int) -> list[QueuedJob]:
        """Wait for jobs and return the next one with all that fit it; `last` were in the batch before."""
        if last > 1 and 0 < len(self._waiting(lane)) < last:
            await asyncio.sleep(self._settings.batch_window_ms * 1e-3)
        while True:
            self._changed.clear()
            batch: list[QueuedJob] = []
            chunks = 0
            for one in self._in_turn(lane):
                more = chunks + one.job.chunks
                if batch and (not _together(one, batch[0]) or more > self._settings.max_chunks):
                    continue
                if self._unread.allows(one.client, one.size):
                    one.unread = self._unread.take(one.client, one.size)
                    batch.append(one)
                    chunks = more
                if len(batch) == self._settings.max_batch or (batch and batch[0].job.key is None):
                    break
            if batch:
                for one in batch:
                    one.place.release()
                self._set_queue(*(one for one in self._queue if not one.started))
                return batch
            await self._changed.wait()

    def _waiting(self, lane: LaneState) -> list[QueuedJob]:
        """Return what waits in a lane."""
        return [one for one in self._queue if one.job.lane == lane.name]

    def _in_turn(self, lane: LaneState) -> Iterator[QueuedJob]:
        """Yield what waits in a lane: of each client the oldest, then of each the next, and so on."""
        waiting: defaultdict[str, deque[QueuedJob]] = defaultdict(deque)
        for one in self._waiting(lane):
            waiting[one.client].append(one)
        order = lane.turns.order(waiting)
        while order:
            for client in order:
                yield waiting[client].popleft()
            order = [client for client in order if waiting[client]]

    async def _plan(self, child: Child, lane: LaneState, batch: list[QueuedJob]) -> None:
        begin = lane.busy_since = time.perf_counter()
        child.send(Batch(lane.name, [one.job.data for one in batch]))
        for _ in batch:
            reply, body = await lane.replies.get()
            one = batch[reply.number]
            waited = begin - one.entered
            self._metrics.queue_time.observe(waited)
            if isinstance(reply, PlanReply):
                self._metrics.plan(reply, one.job.samples)
                written = WrittenPlan(body, waited, reply.encode, reply.decode, reply.write)
                if reply.bad and not one.result.done():
                    self._plan_several_ways(one, written)
                else:
                    one.finish(written)
            elif reply.error is not None:
                one.finish(for_input(reply.error))
            else:
                one.finish(Problem("failed", "the plan could not be made"))
        taken = time.perf_counter() - begin
        for one in batch:
            lane.turns.charge(one.client, taken / len(batch))
        lane.busy_since = None

    def _plan_several_ways(self, one: QueuedJob, lone: WrittenPlan) -> None:
        """Queue a job whose plan is bad among the long ones; that plan is its result where there is no room or time.

        So no request is refused for it, and what it costs was known before: `ReadJob.chunks_of_several`.
        """
        assert one.unread is not None
        one.unread.resize(lone.size)
        one.lone = lone
        try:
            better = self.submit(one.client, one.job.several, one.npz)
        except Problem:
            one.finish(lone)
            return
        timer = asyncio.get_running_loop().call_later(self._settings.max_wait, better.refuse_unless_started)
        one.result.add_done_callback(lambda _: better.drop())

        def finish(result: asyncio.Future[WrittenPlan]) -> None:
            timer.cancel()
            made = not result.cancelled() and result.exception() is None
            one.finish(result.result().after(lone) if made else lone)
            better.drop()

        better.result.add_done_callback(finish)

    def _set_queue(self, *jobs: QueuedJob) -> None:
        """Let these jobs wait, and no others."""
        self._queue = deque(jobs)
        self._metrics.queue_depth.set(len(jobs))
        self._changed.set()

    def _leave_queue(self, one: QueuedJob, _: asyncio.Future[WrittenPlan]) -> None:
        """Give up the place of a job that ended before its turn."""
        if not one.started:
            one.place.release()
            with suppress(ValueError):
                self._queue.remove(one)
                self._metrics.queue_depth.set(len(self._queue))


@contextmanager
def temporary_folder() -> Iterator[Path | None]:
    """Make a folder that goes again; None, and a line says why, where there is no room for one."""
    with ExitStack() as stack:
        folder = None
        try:
            folder = Path(stack.enter_context(TemporaryDirectory(prefix="slide-serve-", ignore_cleanup_errors=True)))
        except OSError as error:
            log.warning("each planning process compiles anew, which takes seconds: %s", error)
        yield folder


def _together(one: QueuedJob, other: QueuedJob) -> bool:
    """Whether both can be planned in one batch."""
    return one.job.key is not None and one.job.key == other.job.key


def overloaded() -> Problem:
    """Return what a client is told that should come back a second later."""
    return Problem("overloaded", "try again later", headers=AGAIN)
