"""The planning process: it plans, judges and writes, so that the server's event loop has only bytes to move.

The server starts it with one end of a socket and sends PlannerOptions; the answer is what is wrong, or nothing, "".
From then on each job of a Batch is answered by a PlanReply and the plan, or a PlanFailure, as soon as it is written.
There is a thread for the short jobs and one for the long ones, so that a plan of some milliseconds never waits for one
of some hundred. The process ends when the socket does.
"""

from __future__ import annotations

import gc
import logging
import os
import pickle
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue

import numpy as np
import orjson

from runtime import BundleError, InputError, Limits, MissingExtraError, Plan, Planner, SlideError, Status
from runtime.assess.several import follows_badly
from runtime.compilation import compile_law
from runtime.documents.checks import FloatArray
from runtime.network.bundle import Bundle, Float32Array, LstmState
from runtime.physics.compiled import CACHE
from server import logs
from server.planning.messages import LANES, Batch, Channel, Lane, PlanFailure, PlanJob, PlannerOptions, PlanReply

log = logging.getLogger("slide-serve")

GOLDEN_REACH = 0.05
GOLDEN_SAMPLES = 777
"""The golden command: a minimum-jerk move of this length (m) in so many samples, which is no multiple of a chunk."""

PLAN_OPTIONS = ("limits", "start", "sizes", "tolerance", "candidates", "robust", "refine_ms")
"""What of a job `Planner.plan` takes by name."""

AGREEMENT = 1e-6
"""Largest distance (m) between a plan made alone and the same one made in a batch."""

SWITCH = 5e-4
"""Longest time (s) that one thread runs Python while the other wants to: a short plan has to ask some ten times."""


class Spent(threading.local):
    """Time (s) that a thread has spent."""

    seconds = 0.0


@dataclass(frozen=True, eq=False)
class TimedBundle(Bundle):
    """A bundle that adds up the time that its encoder takes of each thread."""

    spent: Spent = field(default_factory=Spent)

    def encode(self, command: Float32Array) -> LstmState:
        """Read commands, as every bundle does."""
        begin = time.perf_counter()
        try:
            return super().encode(command)
        finally:
            self.spent.seconds += time.perf_counter() - begin


class Worker:
    """The process's side of the socket.

    Args:
        channel: its end.
        load: gives the planner, with a TimedBundle, or says in a SlideError why there is none.
    """

    def __init__(self, channel: Channel, load: Callable[[PlannerOptions], Planner]) -> None:
        self._channel, self._load = channel, load

    def run(self) -> None:
        """Plan until the server hangs up."""
        options: PlannerOptions = self._channel.receive()
        try:
            planner = self._load(options)
        except SlideError as error:
            self._channel.send(str(error))
            return
        assert isinstance(planner.bundle, TimedBundle)
        self._planner, self._bundle = planner, planner.bundle
        gc.freeze()  # what is loaded stays: it need not be looked through again and again
        self._channel.send("")
        waiting: dict[Lane, SimpleQueue[list[bytes] | None]] = {lane: SimpleQueue() for lane in LANES}
        threads = [threading.Thread(target=self._serve, args=each) for each in waiting.items()]
        for thread in threads:
            thread.start()
        try:
            while True:
                batch: Batch = self._channel.receive()
                waiting[batch.lane].put(batch.jobs)
        finally:
            for queue in waiting.values():
                queue.put(None)
            for thread in threads:
                thread.join()

    def _serve(self, lane: Lane, waiting: SimpleQueue[list[bytes] | None]) -> None:
        """Plan what comes in a lane, until there is None."""
        with suppress(ConnectionError):
            while (jobs := waiting.get()) is not None:
                batch = [pickle.loads(data) for data in jobs]
                self._plan(lane, batch, range(len(batch)))

    def _plan(self, lane: Lane, batch: list[PlanJob], indices: range) -> None:
        """Plan some of a batch together; if that fails, each by itself, so that one does not fail the others."""
        begin, self._bundle.spent.seconds = time.perf_counter(), 0.0
        try:
            plans = self._plans(lane, [batch[index] for index in indices])
        except Exception as error:
            if len(indices) > 1:
                for index in indices:
                    self._plan(lane, batch, range(index, index + 1))
                return
            if isinstance(error, MissingExtraError):
                error = InputError(f"the server cannot refine a plan: {error}", "refine_ms")
            elif not isinstance(error, InputError):
                log.exception("planning failed")
            self._channel.send(PlanFailure(lane, indices[0], error if isinstance(error, InputError) else None))
            return
        encode, together = self._bundle.spent.seconds, len(indices)
        decode = time.perf_counter() - begin - encode
        for index, plan in zip(indices, plans, strict=True):
            begin = time.perf_counter()
            body = plan.to_npz() if batch[index].npz else as_json(plan)
            write = time.perf_counter() - begin
            bad = lane == "short" and batch[index].several and is_bad(plan, batch[index].limits)
            status = plan.quality.status.value
            self._channel.send(PlanReply(lane, index, status, together, encode, decode, write, bad), body)
            together = 0

    def _plans(self, lane: Lane, jobs: list[PlanJob]) -> list[Plan]:
        """Plan jobs; among the short ones a job that may be planned several ways is planned once."""
        if len(jobs) == 1:
            options = jobs[0]._asdict()
            if options["refine_ms"] is None and (lane == "short" or not options["several"]):
                options["candidates"] = options["candidates"] or 1
            command = jobs[0].given.command()
            return [self._planner.plan(command, jobs[0].friction, **{name: options[name] for name in PLAN_OPTIONS})]
        return self._planner.plan_batch(
            [job.given.command() for job in jobs],
            [job.friction for job in jobs],
            limits=[job.limits for job in jobs],
            start=[job.start for job in jobs],
            sizes=[job.sizes for job in jobs],
            tolerance=jobs[0].tolerance,
        )


def is_bad(plan: Plan, limits: Limits) -> bool:
    """Whether a plan is so bad that it pays to plan its command several ways."""
    start = np.concatenate([plan.object_position[0], plan.object_velocity[0]])
    return follows_badly(plan.quality.tracking_rmse, start, plan.command_position, plan.friction, limits)


def as_json(plan: Plan) -> bytes:
    """Return the plan's JSON document; every float keeps all its digits."""
    return orjson.dumps(plan.document(), option=orjson.OPT_SERIALIZE_NUMPY)


def golden_move() -> FloatArray:
    """Return the golden command, (GOLDEN_SAMPLES, 2) (m)."""
    s = np.linspace(0.0, 1.0, GOLDEN_SAMPLES)
    return GOLDEN_REACH * np.stack([s**3 * (10.0 - 15.0 * s + 6.0 * s**2), np.zeros_like(s)], axis=1)


def load_planner(options: PlannerOptions) -> Planner:
    """Load the bundle, whose hashes are checked, and make the golden plan: alone, in a batch, and replayed.

    Raises:
        BundleError: the bundle cannot be trusted, or the plans do not agree.
    """
    planner = Planner(options.model, sha256=options.sha256)
    planner.bundle = TimedBundle(**vars(planner.bundle))
    position = golden_move()
    if options.compile:
        compile_all(planner, position, options.compiled)
    plan = planner.plan(position, candidates=1)
    batch = planner.plan_batch([position, 0.5 * position, position])
    replayed = plan.replay()[:, :2]
    differences = [plan.object_position - other for other in (batch[0].object_position, replayed)]
    differences += [plan.pan_position - batch[2].pan_position]
    largest = max(float(np.abs(difference).max()) for difference in differences)
    if not largest <= AGREEMENT:
        raise BundleError(f"the golden plan differs from itself by {largest:.3g} m, more than {AGREEMENT:g} m")
    if plan.quality.status is Status.LIMIT_EXCEEDED:
        raise BundleError(f"the golden plan does not keep its limits: {'; '.join(plan.quality.notes)}")
    return planner


def compile_all(planner: Planner, position: FloatArray, kept: Path | None) -> None:
    """Compile the law, and what refines; or load it from where an earlier process has kept it."""
    if kept is not None:
        os.environ[CACHE] = str(kept)
    try:
        compile_law()
        planner.plan(position, refine_iterations=1)
    except OSError as error:
        os.environ.pop(CACHE)
        log.warning("what is compiled cannot be kept: %s", error)
        compile_all(planner, position, None)


def main(load: Callable[[PlannerOptions], Planner] = load_planner) -> None:
    """Run the process; its last argument is the number of its end of the socket, which it inherits."""
    for stop in (signal.SIGINT, signal.SIGTERM):  # sent to all processes of a terminal or a service: the server stops
        signal.signal(stop, signal.SIG_IGN)
    logs.set_up("text")
    sys.setswitchinterval(SWITCH)
    with socket.socket(fileno=int(sys.argv[-1])) as connection, suppress(EOFError, ConnectionError):
        Worker(Channel(connection), load).run()
