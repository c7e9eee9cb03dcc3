"""Plans outside the event loop, together what can be planned together.

One thread plans. While it does, requests gather, and what has gathered is planned next through the batch axis: a lone
request never waits, and under load the batches grow by themselves. Clients that were answered together come back
together, a moment apart; so after a batch of several the thread waits for as many again, but no longer than the window.
"""

from __future__ import annotations

import asyncio
import copy
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

from runtime import InputError, Plan, Planner
from runtime.bundle import Bundle, DecoderState, Float32Array, Manifest
from runtime.decoding import chunk_count
from server.metrics import Metrics
from server.problems import Problem
from server.schemas import Asked
from server.settings import Settings

log = logging.getLogger("slide-serve")


class Planned(NamedTuple):
    """A plan as it is sent, and the time it took (s): waiting, in the encoder, and in all the rest of the planning."""

    body: bytes
    queue: float
    encode: float
    decode: float

    def timing(self) -> str:
        """Return the value of the header `Server-Timing`."""
        return ", ".join(f"{name};dur={getattr(self, name) * 1e3:.2f}" for name in ("queue", "encode", "decode"))


@dataclass(eq=False)
class Ticket:
    """A command that waits to be planned.

    Attributes:
        asked: what is to be planned.
        chunks: chunks the command fills; equally many can be planned together.
        write: what makes the plan into what is sent; called in the planning thread.
        ready: what comes of it.
        entered: when it began to wait (s, of the monotonic clock).
        started: whether the thread has taken it.
    """

    asked: Asked
    chunks: int
    write: Callable[[Plan], bytes]
    ready: asyncio.Future[Planned]
    entered: float = field(default_factory=time.perf_counter)
    started: bool = False

    def fits(self, other: Ticket) -> bool:
        """Whether both can be planned in one batch."""
        mine, its = self.asked, other.asked
        together = mine.refine_ms is None and its.refine_ms is None and mine.tolerance == its.tolerance
        return together and self.chunks == other.chunks


@dataclass(frozen=True, eq=False)
class TimedBundle(Bundle):
    """A bundle that adds up the time its encoder takes (s); for one thread."""

    spent: list[float] = field(default_factory=lambda: [0.0])

    def encode(self, command: Float32Array) -> DecoderState:
        """Read commands, as every bundle does."""
        begin = time.perf_counter()
        try:
            return super().encode(command)
        finally:
            self.spent[0] += time.perf_counter() - begin


class Dispatcher:
    """Takes commands from the event loop, plans them in a thread of its own, and hands the plans back.

    Args:
        planner: what plans.
        settings: bounds of the queue and of a batch.
        metrics: what is counted.
    """

    def __init__(self, planner: Planner, settings: Settings, metrics: Metrics) -> None:
        self._bundle = TimedBundle(**vars(planner.bundle))
        self._planner = copy.copy(planner)
        self._planner.bundle = self._bundle
        self._settings, self._metrics = settings, metrics
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[Ticket] = deque()
        self._changed = threading.Condition()
        self._stopping = False
        self._busy_since: float | None = None
        self._thread = threading.Thread(target=self._work, name="planner", daemon=True)
        self._thread.start()

    @property
    def manifest(self) -> Manifest:
        """What is planned with; also there when no new work is taken."""
        return self._bundle.manifest

    @property
    def full(self) -> bool:
        """Whether no command more is taken."""
        return len(self._waiting) >= self._settings.max_queue

    @property
    def busy(self) -> float:
        """How long the thread has been at its present batch (s)."""
        since = self._busy_since
        return 0.0 if since is None else time.perf_counter() - since

    def submit(self, many: Sequence[Asked], write: Callable[[Plan], bytes]) -> list[Ticket]:
        """Let commands wait to be planned, and the plans to be written; a ticket that is cancelled is passed over.

        Raises:
            Problem: `overloaded`: there is no room for all of them.
        """
        tickets = [
            Ticket(one, chunk_count(one.command, self.manifest), write, self._loop.create_future()) for one in many
        ]
        with self._changed:
            if len(self._waiting) + len(tickets) > self._settings.max_queue:
                raise overloaded()
            self._waiting.extend(tickets)
            self._metrics.queue_depth.set(len(self._waiting))
            self._changed.notify()
        for ticket in tickets:
            ticket.ready.add_done_callback(partial(self._leave, ticket))
        return tickets

    def stop(self) -> None:
        """End the thread once nothing waits; one that hangs is left behind, it ends with the process."""
        with self._changed:
            self._stopping = True
            self._changed.notify()
        self._thread.join(timeout=1.0)

    def _leave(self, ticket: Ticket, _: asyncio.Future[Planned]) -> None:
        """Give up the place of a ticket that was cancelled before its turn."""
        with self._changed, suppress(ValueError):
            if not ticket.started:
                self._waiting.remove(ticket)
                self._metrics.queue_depth.set(len(self._waiting))

    def _work(self) -> None:
        last = 1
        while batch := self._take(last):
            last = len(batch)
            self._busy_since = time.perf_counter()
            try:
                self._plan(batch)
            finally:
                self._busy_since = None

    def _take(self, last: int) -> list[Ticket]:
        """Wait for commands and return the oldest with all that fit it; none when the server stops."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._stopping)
            if last > 1:
                window = self._settings.batch_window_ms * 1e-3
                self._changed.wait_for(lambda: len(self._waiting) >= last or self._stopping, timeout=window)
            waiting = [ticket for ticket in self._waiting if not ticket.ready.done()]
            batch: list[Ticket] = []
            for ticket in waiting:
                if not batch or (ticket.fits(batch[0]) and len(batch) < self._settings.max_batch):
                    ticket.started = True
                    batch.append(ticket)
            self._waiting = deque(ticket for ticket in waiting if not ticket.started)
            self._metrics.queue_depth.set(len(self._waiting))
        if not batch and not self._stopping:  # all were cancelled while they waited
            return self._take(1)
        return batch

    def _plan(self, batch: list[Ticket]) -> None:
        """Plan a batch; if that fails, each by itself, so that one command does not fail the others."""
        begin, self._bundle.spent[0] = time.perf_counter(), 0.0
        try:
            plans = self._plans([ticket.asked for ticket in batch])
        except Exception as error:
            if len(batch) > 1:
                for ticket in batch:
                    self._plan([ticket])
            else:
                self._hand_back(batch[0], _problem(error))
            return
        encode = self._bundle.spent[0]
        decode = time.perf_counter() - begin - encode
        self._metrics.batch(plans, encode, decode)
        for ticket, plan in zip(batch, plans, strict=True):
            queue = begin - ticket.entered
            self._metrics.queue_time.observe(queue)
            if not ticket.ready.done():
                self._hand_back(ticket, Planned(ticket.write(plan), queue, encode, decode))

    def _plans(self, many: list[Asked]) -> list[Plan]:
        if len(many) == 1:
            command, friction, limits, start, refine_ms, tolerance = many[0]
            plan = self._planner.plan(
                command, friction, limits=limits, start=start, refine_ms=refine_ms, tolerance=tolerance
            )
            return [plan]
        commands, frictions, limits_of, starts, _, tolerances = zip(*many, strict=True)
        return self._planner.plan_batch(commands, frictions, limits=limits_of, start=starts, tolerance=tolerances[0])

    def _hand_back(self, ticket: Ticket, result: Planned | Problem) -> None:
        def settle() -> None:
            if ticket.ready.done():  # given up: its deadline passed, or its client left
                return
            if isinstance(result, Problem):
                ticket.ready.set_exception(result)
            else:
                ticket.ready.set_result(result)

        self._loop.call_soon_threadsafe(settle)


def overloaded() -> Problem:
    """Return what a client is told that should come back a second later."""
    return Problem("overloaded", "try again later", headers={"Retry-After": "1"})


def _problem(error: Exception) -> Problem:
    if isinstance(error, InputError):
        return Problem("invalid", str(error), "start")
    log.error("planning failed", exc_info=error)
    return Problem("failed", "the plan could not be made")
