"""What stands behind the routes: the planner, made ready in the background, and how the server is doing."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

import numpy as np

from runtime import BundleError, Planner, SlideError, Status
from server.batching import Dispatcher, overloaded
from server.metrics import Metrics
from server.problems import Problem
from server.settings import Settings

log = logging.getLogger("slide-serve")

GOLDEN_REACH = 0.05
GOLDEN_SAMPLES = 777
"""The golden command: a minimum-jerk move of this length (m) in so many samples, which is no multiple of a chunk."""

STREAM_THREADS = 2

Result = TypeVar("Result")

AGREEMENT = 1e-6
"""Largest distance (m) between a plan made alone and the same one made in a batch."""


class Service:
    """One server's planner and state; lives as long as the application.

    Attributes:
        settings: what the server was told.
        metrics: what is counted.
        in_flight: requests being answered.
        streams: streams open.
        stopping: whether the server takes no new work.
        failure: why the planner could not be made ready; None while there is hope.
        on_failure: called then.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.metrics = Metrics()
        self.in_flight = 0
        self.streams = 0
        self.stopping = False
        self.failure: SlideError | None = None
        self.on_failure: Callable[[], None] = lambda: None
        self._planner: Planner | None = None
        self._dispatcher: Dispatcher | None = None
        # Steps take no turns with plans: a controller waits for them.
        self._stream_threads = ThreadPoolExecutor(STREAM_THREADS, thread_name_prefix="stream")

    async def make_ready(self) -> None:
        """Load the bundle and try it out; from then on the server is ready."""
        try:
            self._planner = await asyncio.to_thread(checked_planner, self.settings)
        except SlideError as error:
            log.error("error: %s", error)
            self.failure = error
            self.on_failure()
            return
        self._dispatcher = Dispatcher(self._planner, self.settings, self.metrics)
        log.info("ready: model %s", self._planner.bundle.manifest.name)

    def stop(self) -> None:
        """End the planning thread."""
        self.stopping = True
        if self._dispatcher is not None:
            self._dispatcher.stop()
        self._stream_threads.shutdown(wait=False, cancel_futures=True)

    @property
    def planner(self) -> Planner:
        """The planner.

        Raises:
            Problem: `not-ready` or `stopping`.
        """
        self.check_ready()
        assert self._planner is not None
        return self._planner

    @property
    def dispatcher(self) -> Dispatcher:
        """What plans outside the event loop.

        Raises:
            Problem: `not-ready` or `stopping`.
        """
        self.check_ready()
        assert self._dispatcher is not None
        return self._dispatcher

    def check_ready(self) -> None:
        """Check that new work can be taken.

        Raises:
            Problem: `not-ready` or `stopping`.
        """
        if self.stopping:
            raise Problem("stopping", headers={"Retry-After": "1"})
        if self._dispatcher is None:
            raise Problem("not-ready", headers={"Retry-After": "1"})

    @contextmanager
    def admitted(self) -> Iterator[Dispatcher]:
        """Count a request as in flight, before anything of its body is read.

        Raises:
            Problem: `overloaded`, `not-ready` or `stopping`.
        """
        dispatcher = self.dispatcher
        if dispatcher.full or self.in_flight >= self.settings.max_queue + self.settings.max_batch:
            raise overloaded()
        self.in_flight += 1
        self.metrics.in_flight.inc()
        try:
            yield dispatcher
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

    async def in_stream_thread(self, work: Callable[[], Result]) -> Result:
        """Run a stream's work outside the event loop."""
        return await asyncio.get_running_loop().run_in_executor(self._stream_threads, work)


def checked_planner(settings: Settings) -> Planner:
    """Load the bundle, whose hashes are checked, and make the golden plan: alone, in a batch, and replayed.

    Raises:
        BundleError: the bundle cannot be trusted, or the plans do not agree.
    """
    planner = Planner(settings.model, sha256=settings.bundle_sha256)
    s = np.linspace(0.0, 1.0, GOLDEN_SAMPLES)
    position = GOLDEN_REACH * np.stack([s**3 * (10.0 - 15.0 * s + 6.0 * s**2), np.zeros_like(s)], axis=1)
    plan = planner.plan(position)
    batch = planner.plan_batch([position, 0.5 * position, position])
    replayed = plan.replay()[:, :2]
    differences = [plan.object_position - other for other in (batch[0].object_position, replayed)]
    differences += [plan.pan_position - batch[2].pan_position]
    largest = max(float(np.abs(difference).max()) for difference in differences)
    if not largest <= AGREEMENT:
        raise BundleError(f"the golden plan differs from itself by {largest:.3g} m, more than {AGREEMENT:g} m")
    if plan.quality.status is Status.LIMIT_EXCEEDED:
        raise BundleError(f"the golden plan does not keep its limits: {'; '.join(plan.quality.notes)}")
    if settings.max_refine_ms > 0.0:
        planner.plan(position, refine_iterations=1)  # compiles, which takes longer than any deadline
    return planner
