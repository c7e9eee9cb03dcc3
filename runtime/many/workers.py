"""Who does a work item by item: this process, several processes, or Ray. What is made of each stays the same."""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Protocol, TypeVar

from runtime.errors import SlideError, extra

ENDED = 1
"""Exit code of a worker whose parent has ended."""

DEATHS = 3
"""Times that processes may end without an item being done in between: then it is not by chance."""

Item = TypeVar("Item")
Made = TypeVar("Made")

Work = Callable[[Any], Any]
"""What is done with each item; it is sent to other processes, and so are the items and what is made of them."""


class Workers(Protocol):
    """Processes that are at as many items at once as `count` says."""

    count: int

    def submit(self, item: Any) -> Future[Any]:
        """Begin with an item; its future raises ProcessEnded if its process ends.

        An error of ours is its value: Ray would wrap one that is raised.
        """

    def renew(self) -> None:
        """Start again after a process has ended."""

    def close(self) -> None:
        """Let the processes go."""


class ProcessEnded(Exception):
    """A process ended while it worked, killed or for want of memory."""


def work_through(
    items: Iterable[Item], work: Callable[[Item], Made], count: int = 1, ray: str | None = None
) -> Iterator[Made]:
    """Do a work with each item, and yield what is made of it, in the order in which they are done.

    Args:
        items: no more of them are held than are worked at, and one that waits; `str` of one names it in an error.
        work: what is done with each.
        count: of processes.
        ray: the address of a Ray cluster that works, "local" for one on this machine; None for none.

    Raises:
        SlideError: the work raised it, or the processes end again and again.
        MissingExtraError: Ray is not installed.
    """
    if count == 1 and ray is None:
        for item in items:
            yield work(item)
        return
    workers: Workers = Processes(work, count) if ray is None else RayTasks(work, ray)
    try:
        yield from _spread(iter(items), workers)
    finally:
        workers.close()


def _spread(items: Iterator[Any], workers: Workers) -> Iterator[Any]:
    """Keep every process at an item; what one was at when it ended is done again."""
    again: deque[Any] = deque()
    begun: dict[Future[Any], Any] = {}
    deaths = 0
    while True:
        while len(begun) <= workers.count:
            item = again.popleft() if again else next(items, None)
            if item is None:
                break
            begun[workers.submit(item)] = item
        if not begun:
            return
        done, _ = wait(begun, return_when=FIRST_COMPLETED)
        ended = False
        for future in done:
            item = begun.pop(future)
            try:
                result = future.result()
            except (BrokenProcessPool, ProcessEnded):
                again.append(item)
                ended = True
                continue
            if isinstance(result, SlideError):
                raise result
            deaths = 0
            yield result
        if ended:
            again.extend(begun.values())
            begun.clear()
            deaths += 1
            if deaths == DEATHS:
                raise SlideError(
                    f"processes ended {deaths} times before any of {', '.join(sorted(map(str, again)))} was done: is "
                    "there enough memory?"
                )
            workers.renew()


def attempt(work: Callable[[Item], Made], item: Item) -> Made | SlideError:
    """Do the work with an item; an error of ours is returned."""
    try:
        return work(item)
    except SlideError as error:
        return error


class Processes:
    """Processes of this machine; they end when their parent does, however that ends."""

    def __init__(self, work: Work, count: int) -> None:
        self.count = count
        self._work = work
        self._pool = self._started()

    def _started(self) -> ProcessPoolExecutor:
        spawn = multiprocessing.get_context("spawn")  # onnxruntime has threads: a fork would copy their locks
        return ProcessPoolExecutor(self.count, mp_context=spawn, initializer=end_with_parent)

    def submit(self, item: Any) -> Future[Any]:
        try:
            return self._pool.submit(attempt, self._work, item)
        except BrokenProcessPool as error:  # of a process that ended since
            future: Future[Any] = Future()
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

    def __init__(self, work: Work, address: str) -> None:
        with extra("ray"):
            import ray
        ray.init(address=address, log_to_driver=False, include_dashboard=False)
        self.count = max(1, int(ray.cluster_resources().get("CPU", 1)))
        self._work = ray.put(work)
        self._attempt = ray.remote(num_cpus=1, max_retries=DEATHS)(attempt)  # Ray begins a task again itself
        self._close = ray.shutdown

    def submit(self, item: Any) -> Future[Any]:
        future: Future[Any] = self._attempt.remote(self._work, item).future()
        return future

    def renew(self) -> None:
        """Do nothing: Ray does."""

    def close(self) -> None:
        self._close()
