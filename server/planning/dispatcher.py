"""Plans outside the event loop, together what can be planned together.

A process of its own plans; see `server.planning.worker`. While it does, requests gather, and what has gathered is
planned next through the batch axis: a lone request never waits, and under load the batches grow by themselves. Clients
that were answered together come back together, a moment apart; so after a batch of several the next one waits for the
window.

A process that ends, or is at one batch for too long, is replaced. What it was planning then has failed, and what waits
is sent away: a new one takes seconds to be ready.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

from runtime.network.manifest import Manifest
from runtime.network.reader import chunk_count
from server.metrics import Metrics
from server.planning.messages import PlanFailure, PlanJob, PlannerOptions, PlanReply
from server.planning.process import PLANNING_COMMAND, PlanningProcess
from server.problems import Problem, for_input
from server.settings import Settings

log = logging.getLogger("slide-serve")


class WrittenPlan(NamedTuple):
    """A plan as it is sent, and the time it took (s): waiting, in the encoder, in the rest of the planning, written."""

    body: bytes
    queue: float
    encode: float
    decode: float
    write: float


@dataclass(eq=False)
class QueuedJob:
    """A job that waits to be planned, or is being planned.

    Attributes:
        job: what is to be planned.
        chunks: chunks the command fills; equally many can be planned together.
        result: what comes of it.
        entered: when it began to wait (s, of the monotonic clock).
        started: whether the process has it.
    """

    job: PlanJob
    chunks: int
    result: asyncio.Future[WrittenPlan]
    entered: float = field(default_factory=time.perf_counter)
    started: bool = False

    def fits(self, other: QueuedJob) -> bool:
        """Whether both can be planned in one batch."""
        mine, its = self.job, other.job
        return not mine.alone and not its.alone and mine.tolerance == its.tolerance and self.chunks == other.chunks

    def finish(self, result: WrittenPlan | Problem) -> None:
        """Give the result, unless there is one, or nobody waits for it any more."""
        if self.result.done():
            return
        if isinstance(result, Problem):
            self.result.set_exception(result)
            self.result.exception()  # is seen: a client that has left does not come for it
        else:
            self.result.set_result(result)

    def refuse_unless_started(self) -> None:
        """Send the job away if its turn has not come."""
        if not self.started:
            self.finish(overloaded())


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
        self._arrived = asyncio.Event()
        self._busy_since: float | None = None

    @property
    def full(self) -> bool:
        """Whether no job more is taken."""
        return len(self._queue) >= self._settings.max_queue

    @property
    def busy(self) -> float:
        """How long the process has been at its present batch (s)."""
        since = self._busy_since
        return 0.0 if since is None else time.perf_counter() - since

    def submit(self, jobs: Sequence[PlanJob]) -> list[QueuedJob]:
        """Queue jobs; one whose result is cancelled is passed over.

        Raises:
            Problem: `overloaded`: there is no room for all of them.
        """
        if len(self._queue) + len(jobs) > self._settings.max_queue:
            raise overloaded()
        loop = asyncio.get_running_loop()
        queued = [QueuedJob(job, chunk_count(job.command, self.manifest), loop.create_future()) for job in jobs]
        for one in queued:
            one.result.add_done_callback(partial(self._leave_queue, one))
        self._set_queue(*self._queue, *queued)
        return queued

    async def run(self) -> None:
        """Plan, until cancelled, with one process after another.

        Raises:
            BundleError: a process is not ready to plan.
        """
        while True:
            process = await PlanningProcess.start(self._options, self._command)
            hung = False
            try:
                self.process = process.number
                log.info("ready: model %s, in process %d", self.manifest.name, process.number)
                await process.work(self._plan_batches(process))
            except EOFError:
                pass
            except TimeoutError:
                hung = True
            finally:
                self.process = self._busy_since = None
                code = await (process.stop(0.0) if hung else process.stop())
            log.error("the planning process %s (%d): a new one is started", "hung" if hung else "has ended", code)
            ended = "the planning process ended before the plan was made"
            for one in self._queue:
                one.finish(Problem("not-ready", ended, headers={"Retry-After": "1"}))
            self._set_queue()

    async def _plan_batches(self, process: PlanningProcess) -> None:
        """Plan with one process.

        Raises:
            EOFError: it has ended.
            TimeoutError: it is at one batch for too long.
        """
        last = 1
        while True:
            batch = await self._next_batch(last)
            last = len(batch)
            try:
                async with asyncio.timeout(self._settings.hang_deadlines * self._settings.deadline):
                    await self._plan(process, batch)
            finally:
                for one in batch:
                    one.finish(Problem("failed", "the planning process ended"))

    async def _next_batch(self, last: int) -> list[QueuedJob]:
        """Wait for jobs and return the oldest with all that fit it; `last` were in the batch before."""
        while not self._queue:
            self._arrived.clear()
            await self._arrived.wait()
        if last > 1 and len(self._queue) < last:
            await asyncio.sleep(self._settings.batch_window_ms * 1e-3)
        batch: list[QueuedJob] = []
        waiting = [one for one in self._queue if not one.result.done()]
        for one in waiting:
            if not batch or (one.fits(batch[0]) and len(batch) < self._settings.max_batch):
                one.started = True
                batch.append(one)
        self._set_queue(*(one for one in waiting if not one.started))
        return batch or await self._next_batch(1)  # all were cancelled in the window

    async def _plan(self, process: PlanningProcess, batch: list[QueuedJob]) -> None:
        begin = self._busy_since = time.perf_counter()
        process.send([one.job for one in batch])
        for _ in batch:
            reply: PlanReply | PlanFailure
            reply, body = await process.receive()
            one = batch[reply.number]
            waited = begin - one.entered
            self._metrics.queue_time.observe(waited)
            if isinstance(reply, PlanReply):
                self._metrics.plan(reply, len(one.job.command))
                one.finish(WrittenPlan(body, waited, reply.encode, reply.decode, reply.write))
            elif reply.error is not None:
                one.finish(for_input(reply.error))
            else:
                one.finish(Problem("failed", "the plan could not be made"))
        self._busy_since = None

    def _set_queue(self, *jobs: QueuedJob) -> None:
        """Let these jobs wait, and no others."""
        self._queue = deque(jobs)
        self._metrics.queue_depth.set(len(jobs))
        self._arrived.set()

    def _leave_queue(self, one: QueuedJob, _: asyncio.Future[WrittenPlan]) -> None:
        """Give up the place of a job that was cancelled before its turn."""
        if not one.started:
            with suppress(ValueError):
                self._queue.remove(one)
                self._metrics.queue_depth.set(len(self._queue))


def overloaded() -> Problem:
    """Return what a client is told that should come back a second later."""
    return Problem("overloaded", "try again later", headers={"Retry-After": "1"})
