"""What is measured in parts, each by itself: here, or on a Ray cluster."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.harness.section import Subject
from benchmarks.suite.pans import Task
from runtime.many.workers import work_through
from runtime.planner import Planner


class Part(NamedTuple):
    """What is measured by itself.

    Attributes:
        measure: measures it: a planner, `what`, and the number of commands.
        what: the name of a family, or a task.
        commands: the first ones of it; all if None.
    """

    measure: Callable[[Planner, Any, int | None], Any]
    what: str | Task
    commands: int | None


def measure_parts(subject: Subject, parts: Sequence[Part], ray: str | None) -> list[Any]:
    """Return what is measured of each part, in their order; on a Ray cluster if there is an address of one."""
    if ray is None:
        return [part.measure(subject.planner, part.what, part.commands) for part in parts]
    measured = dict(work_through(enumerate(parts), partial(_measured, subject.folder), ray=ray))
    return [measured[number] for number in range(len(parts))]


def _measured(folder: Path, numbered: tuple[int, Part]) -> tuple[int, Any]:
    number, part = numbered
    return number, part.measure(_planner_at(folder), part.what, part.commands)


@lru_cache(maxsize=1)
def _planner_at(folder: Path) -> Planner:
    return Planner(folder)
