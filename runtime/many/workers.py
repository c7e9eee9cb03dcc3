"""Who plans the shards: this process, several processes, or Ray. The shards and what is made of them stay the same."""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Protocol

from runtime.errors import SlideError, extra
from runtime.many.records import Shard
from runtime.many.shard import Done, Task, plan_shard

ENDED = 1
"""Exit code of a worker whose parent has ended."""

DEATHS = 3
"""Times that processes may end without a shard being done in between: then it is not by chance."""

Result = Done | SlideError
"""What came of a shard; an error is handed over as a value, as Ray would wrap one that is raised."""


class Workers(Protocol):
    """Processes that plan, as many shards at once as `count` says."""

    count: int

    def submit(self, shard: Shard) -> Future[Result]:
        """Begin to plan a shard; its future raises ProcessEnded if its process ends."""

    def renew(self) -> None:
        """Start again after a process has ended."""

    def close(self) -> None:
        """Let the processes go."""


class ProcessEnded(Exception):
    """A process ended while it planned, killed or for want of memory."""


def plan_shards(shards: Iterable[Shard], task: Task, count: int, ray: str | None) -> Iterator[Done]:
    """Plan shards, and yield each as it is written, in the order in which they are done.

    Args:
        shards: to plan; no more of them are held than are planned, and one that waits.
        task: what is the same for all.
        count: of processes.
        ray: the address of a Ray cluster that plans, "local" for one on this machine; None for none.

    Raises:
        OutputError: a shard cannot be written; those that are, are whole.
        SlideError: the processes end again and again.
        MissingExtraError: Ray is not installed.
    """
    if count == 1 and ray is None:
        for shard in shards:
            yield plan_shard(task, shard)
        return
    workers: Workers = Processes(task, count) if ray is None else RayTasks(task, ray)
    try:
        yield from _spread(iter(shards), workers)
    finally:
        workers.close()


def _spread(shards: Iterator[Shard], workers: Workers) -> Iterator[Done]:
    """Keep every process at a shard; what one was at when it ended is planned again."""
    again: deque[Shard] = deque()
    planned: dict[Future[Result], Shard] = {}
    deaths = 0
    while True:
        while len(planned) <= workers.count:
            shard = again.popleft() if again else next(shards, None)
            if shard is None:
                break
            planned[workers.submit(shard)] = shard
        if not planned:
            return
        done, _ = wait(planned, return_when=FIRST_COMPLETED)
        ended = False
        for future in done:
            shard = planned.pop(future)
            try:
                result = future.result()
            except (BrokenProcessPool, ProcessEnded):
                again.append(shard)
                ended = True
                continue
            if isinstance(result, SlideError):
                raise result
            deaths = 0
            yield result
        if ended:
            again.extend(planned.values())
            planned.clear()
            deaths += 1
            if deaths == DEATHS:
                numbers = ", ".join(str(number) for number in sorted(shard.number for shard in again))
                raise SlideError(
                    f"processes ended {deaths} times before any shard was done, of shards {numbers}: is there enough "
                    "memory?"
                )
            workers.renew()


def result_of(task: Task, shard: Shard) -> Result:
    """Plan a shard; see `plan_shard`."""
    try:
        return plan_shard(task, shard)
    except SlideError as error:
        return error


class Processes:
    """Processes of this machine; they end when their parent does, however that ends."""

    def __init__(self, task: Task, count: int) -> None:
        self.count = count
        self._task = task
        self._pool = self._started()

    def _started(self) -> ProcessPoolExecutor:
        spawn = multiprocessing.get_context("spawn")  # onnxruntime has threads: a fork would copy their locks
        return ProcessPoolExecutor(self.count, mp_context=spawn, initializer=end_with_parent)

    def submit(self, shard: Shard) -> Future[Result]:
        try:
            return self._pool.submit(result_of, self._task, shard)
        except BrokenProcessPool as error:  # of a process that ended since
            future: Future[Result] = Future()
            future.set_exception(error)
            return future

    def renew(self) -> None:
        self.close()
        self._pool = self._started()

    def close(self) -> None:
        self._pool.shutdown(wait=False, cancel_futures=True)


def end_with_parent() -> None:
    """Let this process end when its parent does, which cannot say so when it is killed."""
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(ENDED)

    threading.Thread(target=watch, daemon=True).start()


def check_ray() -> None:
    """Check that Ray is installed.

    Raises:
        MissingExtraError: it is not.
    """
    with extra("ray"):
        import ray  # noqa: F401


class RayTasks:
    """Tasks of a Ray cluster, one for each of its processors."""

    def __init__(self, task: Task, address: str) -> None:
        with extra("ray"):
            import ray
        ray.init(address=address, log_to_driver=False, include_dashboard=False)
        self.count = max(1, int(ray.cluster_resources().get("CPU", 1)))
        self._task = ray.put(task)
        self._plan = ray.remote(num_cpus=1, max_retries=DEATHS)(result_of)  # Ray begins a task again itself
        self._close = ray.shutdown

    def submit(self, shard: Shard) -> Future[Result]:
        future: Future[Result] = self._plan.remote(self._task, shard).future()
        return future

    def renew(self) -> None:
        """Do nothing: Ray does."""

    def close(self) -> None:
        self._close()
