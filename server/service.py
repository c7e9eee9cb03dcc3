"""What stands behind the routes: the planner, made ready in the background, and how the server is doing."""

from __future__ import annotations

import asyncio
import gc
import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from runtime import Planner, SlideError
from server.metrics import Metrics
from server.planning.dispatcher import Dispatcher
from server.planning.messages import PlannerOptions
from server.planning.process import PLANNING_COMMAND
from server.planning.reader import Reader
from server.problems import Problem
from server.settings import Settings
from server.shares import AGAIN, Few, Gate, Lease, Shares

log = logging.getLogger("slide-serve")

PIECES = 8
"""Pieces of answers that are sent in one turn of the event loop: a tenth of a millisecond each."""


class Service:
    """One server's planners and state; lives as long as the application.

    Args:
        settings: what the server was told.
        command: how the planning process is run.

    Attributes:
        settings: what the server was told.
        metrics: what is counted.
        held: bytes of requests that are held.
        steps: by turns, the steps of streams.
        sending: a few in each turn of the event loop, the pieces of answers.
        metrics_port: the port for figures only, if there is one.
        stopping: whether the server takes no new work.
        failure: why no plans can be made; None while there is hope.
        on_failure: called then.
    """

    def __init__(self, settings: Settings, command: Sequence[str] = PLANNING_COMMAND) -> None:
        share = settings.client_share
        self.settings = settings
        self.metrics = Metrics()
        self.held = Shares("bytes of requests", settings.max_held, share)
        self._requests = Shares("requests", settings.max_queue + settings.max_batch, share)
        self._streams = Shares("streams", settings.max_streams, share)
        self.metrics.in_flight.set_function(lambda: self.in_flight)
        self.metrics.streams.set_function(lambda: self.streams)
        self.steps = Gate()
        self.sending = Few(PIECES)
        self.metrics_port: int | None = None
        self.stopping = False
        self.failure: Exception | None = None
        self.on_failure: Callable[[], None] = lambda: None
        self._command = command
        self._ready: tuple[Planner, Reader, Dispatcher] | None = None

    async def run(self) -> None:
        """Load the bundle, for the streams, and keep processes that read and plan with it, until cancelled."""
        settings = self.settings
        try:
            planner = await asyncio.to_thread(Planner, settings.model, sha256=settings.bundle_sha256)
            manifest = planner.bundle.manifest
            options = PlannerOptions(settings.model, planner.bundle.sha256, settings.max_refine_ms > 0.0)
            gc.freeze()  # what is loaded stays: it need not be looked through again and again
            reader = Reader(manifest, settings)
            dispatcher = Dispatcher(options, manifest, settings, self.metrics, self._command)
            self._ready = planner, reader, dispatcher
            async with asyncio.TaskGroup() as both:
                both.create_task(reader.run())
                both.create_task(dispatcher.run())
        except* (SlideError, OSError) as errors:
            log.error("error: %s", errors.exceptions[0])
            self.failure = errors.exceptions[0]
            self.on_failure()

    @property
    def in_flight(self) -> int:
        """Requests being answered."""
        return self._requests.held

    @property
    def streams(self) -> int:
        """Streams open."""
        return self._streams.held

    @property
    def planner(self) -> Planner:
        """What streams are followed with; raises as `dispatcher`."""
        return self._when_ready()[0]

    @property
    def reader(self) -> Reader:
        """What reads outside the event loop; raises as `dispatcher`."""
        return self._when_ready()[1]

    @property
    def dispatcher(self) -> Dispatcher:
        """What plans outside the event loop.

        Raises:
            Problem: `not-ready` or `stopping`.
        """
        return self._when_ready()[2]

    def _when_ready(self) -> tuple[Planner, Reader, Dispatcher]:
        """Return what plans, if new work can be taken.

        Raises:
            Problem: `not-ready` or `stopping`.
        """
        if self.stopping:
            raise Problem("stopping", headers=AGAIN)
        if self._ready is None or self._ready[1].process is None or self._ready[2].process is None:
            raise Problem("not-ready", "the model is being loaded", headers=AGAIN)
        return self._ready

    def check_room(self, client: str) -> None:
        """Check that one request more of a client can be planned.

        Raises:
            Problem: `overloaded`, `too-many`, `not-ready` or `stopping`.
        """
        self.dispatcher.check_room(client)
        self._requests.take(client).release()

    def admit(self, client: str) -> Lease:
        """Count a request as in flight, before anything of its body is read, until it is released.

        Raises:
            Problem: as `check_room`.
        """
        self.dispatcher.check_room(client)
        return self._requests.take(client)

    @contextmanager
    def streaming(self, client: str) -> Iterator[None]:
        """Count a stream as open.

        Raises:
            Problem: `overloaded` or `too-many`: there are too many.
        """
        place = self._streams.take(client)
        try:
            yield
        finally:
            place.release()
