"""Plans outside the event loop, together what can be planned together.

A process of its own plans; see `server.worker`. While it does, requests gather, and what has gathered is planned next
through the batch axis: a lone request never waits, and under load the batches grow by themselves. Clients that were
answered together come back together, a moment apart; so after a batch of several the next one waits for the window.

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
from server.planning.messages import Failed, Made, Order, PlanJob
from server.planning.process import Process
from server.problems import Problem, for_input
from server.settings import Settings

log = logging.getLogger("slide-serve")

HANGING = 6.0
"""Deadlines after which a batch will not be finished any more, and the process is replaced."""

WATCH = 0.25
"""How often it is looked, while nothing is planned, whether the process is there (s)."""


class Planned(NamedTuple):
    """A plan as it is sent, and the time it took (s): waiting, in the encoder, in the rest of the planning, written."""

    body: bytes
    queue: float
    encode: float
    decode: float
    write: float


@dataclass(eq=False)
class Ticket:
    """A command that waits to be planned.

    Attributes:
        asked: what is to be planned.
        chunks: chunks the command fills; equally many can be planned together.
        ready: what comes of it.
        entered: when it began to wait (s, of the monotonic clock).
        started: whether the process has it.
    """

    asked: PlanJob
    chunks: int
    ready: asyncio.Future[Planned]
    entered: float = field(default_factory=time.perf_counter)
    started: bool = False

    def fits(self, other: Ticket) -> bool:
        """Whether both can be planned in one batch."""
        mine, its = self.asked, other.asked
        together = mine.refine_ms is None and its.refine_ms is None and mine.tolerance == its.tolerance
        return together and self.chunks == other.chunks

    def settle(self, result: Planned | Problem) -> None:
        """Say what came of it, unless that is known, or nobody waits for it any more."""
        if self.ready.done():
            return
        if isinstance(result, Problem):
            self.ready.set_exception(result)
            self.ready.exception()  # is seen: a client that has left does not come for it
        else:
            self.ready.set_result(result)

    def turn_over(self) -> None:
        """Send it away if its turn has not come."""
        if not self.started:
            self.settle(overloaded())


class Dispatcher:
    """Takes commands, gives them to a planning process batch by batch, and hands the plans back.

    Args:
        order: what the process plans with.
        manifest: of the bundle.
        settings: bounds of the queue and of a batch.
        metrics: what is counted.

    Attributes:
        manifest: of the bundle.
        process: the number of the planning process; None while there is none that is ready.
    """

    def __init__(self, order: Order, manifest: Manifest, settings: Settings, metrics: Metrics) -> None:
        self.manifest = manifest
        self.process: int | None = None
        self._order, self._settings, self._metrics = order, settings, metrics
        self._waiting: deque[Ticket] = deque()
        self._arrived = asyncio.Event()
        self._busy_since: float | None = None

    @property
    def full(self) -> bool:
        """Whether no command more is taken."""
        return len(self._waiting) >= self._settings.max_queue

    @property
    def busy(self) -> float:
        """How long the process has been at its present batch (s)."""
        since = self._busy_since
        return 0.0 if since is None else time.perf_counter() - since

    def submit(self, many: Sequence[PlanJob]) -> list[Ticket]:
        """Let commands wait to be planned; a ticket that is cancelled is passed over.

        Raises:
            Problem: `overloaded`: there is no room for all of them.
        """
        if len(self._waiting) + len(many) > self._settings.max_queue:
            raise overloaded()
        loop = asyncio.get_running_loop()
        tickets = [Ticket(one, chunk_count(one.command, self.manifest), loop.create_future()) for one in many]
        for ticket in tickets:
            ticket.ready.add_done_callback(partial(self._leave, ticket))
        self._wait(*self._waiting, *tickets)
        return tickets

    async def run(self) -> None:
        """Plan, until cancelled, with one process after another.

        Raises:
            BundleError: a process is not ready to plan.
        """
        while True:
            process = await Process.start(self._order)
            try:
                self.process = process.number
                log.info("ready: model %s, planned with in process %d", self.manifest.name, process.number)
                await self._work(process)
            except EOFError:
                said = "has ended"
            except TimeoutError:
                said = "hung"
                process.kill()
            finally:
                self.process = self._busy_since = None
                code = await process.end()
            log.error("the planning process %s (%d): a new one is started", said, code)
            for ticket in self._waiting:
                ticket.settle(Problem("not-ready", headers={"Retry-After": "1"}))
            self._wait()

    async def _work(self, process: Process) -> None:
        """Plan with one process.

        Raises:
            EOFError: it has ended.
            TimeoutError: it is at one batch for too long.
        """
        last = 1
        while True:
            batch = await self._take(process, last)
            last = len(batch)
            try:
                async with asyncio.timeout(HANGING * self._settings.deadline):
                    await self._plan(process, batch)
            finally:
                for ticket in batch:
                    ticket.settle(Problem("failed", "the planning process ended"))

    async def _take(self, process: Process, last: int) -> list[Ticket]:
        """Wait for commands and return the oldest with all that fit it.

        Raises:
            EOFError: the process has ended.
        """
        while not self._waiting:
            self._arrived.clear()
            with suppress(TimeoutError):
                async with asyncio.timeout(WATCH):
                    await self._arrived.wait()
            process.check()
        if last > 1 and len(self._waiting) < last:
            await asyncio.sleep(self._settings.batch_window_ms * 1e-3)
        batch: list[Ticket] = []
        waiting = [ticket for ticket in self._waiting if not ticket.ready.done()]
        for ticket in waiting:
            if not batch or (ticket.fits(batch[0]) and len(batch) < self._settings.max_batch):
                ticket.started = True
                batch.append(ticket)
        self._wait(*(ticket for ticket in waiting if not ticket.started))
        return batch or await self._take(process, 1)  # all were cancelled in the window

    async def _plan(self, process: Process, batch: list[Ticket]) -> None:
        begin = self._busy_since = time.perf_counter()
        process.send([ticket.asked for ticket in batch])
        for _ in batch:
            answer: Made | Failed
            answer, body = await process.receive()
            ticket = batch[answer.number]
            queue = begin - ticket.entered
            self._metrics.queue_time.observe(queue)
            if isinstance(answer, Made):
                self._metrics.plan(answer, len(ticket.asked.command))
                ticket.settle(Planned(body, queue, answer.encode, answer.decode, answer.write))
            elif answer.error is not None:
                ticket.settle(for_input(answer.error))
            else:
                ticket.settle(Problem("failed", "the plan could not be made"))
        self._busy_since = None

    def _wait(self, *tickets: Ticket) -> None:
        """Let these tickets wait, and no others."""
        self._waiting = deque(tickets)
        self._metrics.queue_depth.set(len(tickets))
        self._arrived.set()

    def _leave(self, ticket: Ticket, _: asyncio.Future[Planned]) -> None:
        """Give up the place of a ticket that was cancelled before its turn."""
        if not ticket.started:
            with suppress(ValueError):
                self._waiting.remove(ticket)
                self._metrics.queue_depth.set(len(self._waiting))


def overloaded() -> Problem:
    """Return what a client is told that should come back a second later."""
    return Problem("overloaded", "try again later", headers={"Retry-After": "1"})
