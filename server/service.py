"""What stands behind the routes: the planner, made ready in the background, and how the server is doing."""

from __future__ import annotations

import asyncio
import gc
import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from runtime import Planner, SlideError
from server.metrics import Metrics
from server.planning.dispatcher import Dispatcher, overloaded
from server.planning.messages import PlannerOptions
from server.planning.process import PLANNING_COMMAND
from server.problems import Problem
from server.settings import Settings

log = logging.getLogger("slide-serve")


class Service:
    """One server's planners and state; lives as long as the application.

    Args:
        settings: what the server was told.
        command: how the planning process is run.

    Attributes:
        settings: what the server was told.
        metrics: what is counted.
        in_flight: requests being answered.
        streams: streams open.
        stopping: whether the server takes no new work.
        failure: why no plans can be made; None while there is hope.
        on_failure: called then.
    """

    def __init__(self, settings: Settings, command: Sequence[str] = PLANNING_COMMAND) -> None:
        self.settings = settings
        self.metrics = Metrics()
        self.in_flight = 0
        self.streams = 0
        self.stopping = False
        self.failure: Exception | None = None
        self.on_failure: Callable[[], None] = lambda: None
        self._command = command
        self._planner: Planner | None = None
        self._dispatcher: Dispatcher | None = None

    async def run(self) -> None:
        """Load the bundle, for the streams, and keep a process that plans with it, until cancelled."""
        settings = self.settings
        try:
            self._planner = await asyncio.to_thread(Planner, settings.model, sha256=settings.bundle_sha256)
            bundle = self._planner.bundle
            options = PlannerOptions(settings.model, bundle.sha256, settings.max_refine_ms > 0.0)
            gc.freeze()  # what is loaded stays: it need not be looked through again and again
            self._dispatcher = Dispatcher(options, bundle.manifest, settings, self.metrics, self._command)
            await self._dispatcher.run()
        except (SlideError, OSError) as error:
            log.error("error: %s", error)
            self.failure = error
            self.on_failure()

    @property
    def planner(self) -> Planner:
        """What streams are followed with; raises as `dispatcher`."""
        return self._when_ready()[0]

    @property
    def dispatcher(self) -> Dispatcher:
        """What plans outside the event loop.

        Raises:
            Problem: `not-ready` or `stopping`.
        """
        return self._when_ready()[1]

    def _when_ready(self) -> tuple[Planner, Dispatcher]:
        """Return what plans, if new work can be taken.

        Raises:
            Problem: `not-ready` or `stopping`.
        """
        if self.stopping:
            raise Problem("stopping", headers={"Retry-After": "1"})
        if self._planner is None or self._dispatcher is None or self._dispatcher.process is None:
            raise Problem("not-ready", "the model is being loaded", headers={"Retry-After": "1"})
        return self._planner, self._dispatcher

    def check_room(self) -> None:
        """Check that one request more can be planned.

        Raises:
            Problem: `overloaded`, `not-ready` or `stopping`.
        """
        if self.dispatcher.full or self.in_flight >= self.settings.max_queue + self.settings.max_batch:
            raise overloaded()

    @contextmanager
    def admitted(self) -> Iterator[Dispatcher]:
        """Count a request as in flight, before anything of its body is read.

        Raises:
            Problem: as `check_room`.
        """
        self.check_room()
        self.in_flight += 1
        self.metrics.in_flight.inc()
        try:
            yield self.dispatcher
        finally:
            self.in_flight -= 1
            self.metrics.in_flight.dec()

    @contextmanager
    def streaming(self) -> Iterator[None]:
        """Count a stream as open."""
        self.streams += 1
        self.metrics.streams.inc()
        try:
            yield
        finally:
            self.streams -= 1
            self.metrics.streams.dec()
