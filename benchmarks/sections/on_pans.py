"""How well a network plans within the limits of arms, level and lifting, and where it is disturbed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rich.table import Table

from benchmarks.harness.section import Subject
from benchmarks.harness.tables import table
from benchmarks.harness.targets import MILLIMETRES, MILLISECONDS, Target
from benchmarks.sections.parts import Part, measure_parts
from benchmarks.suite.pans import DRAWINGS, TASKS, WAYS, Disturbed, Followed, Task, disturb, follow
from runtime.cli.console import MM

DISTURBED = TASKS[0]
"""The task that is disturbed too."""


@dataclass(frozen=True)
class OnPan:
    """A task of `benchmarks.suite.pans`, with a level pan and with one that lifts; None where it cannot slide."""

    level: Followed | None
    lifting: Followed | None


@dataclass(frozen=True)
class OnPans:
    """Tasks in figures.

    Attributes:
        tasks: by their names.
        level, lifting: DISTURBED, disturbed, on such pans; None if it was not measured.
    """

    tasks: Mapping[str, OnPan]
    level: Disturbed | None
    lifting: Disturbed | None


PAN_TARGETS = (
    *(
        Target(f"pans.tasks.{task.name}.{way}.tracking_mean", f"{task.title}, {way}", MILLIMETRES, "<=", limit)
        for task in (*TASKS, DRAWINGS)
        for way, limit in zip(WAYS, task.targets, strict=True)
        if limit is not None
    ),
    *(
        Target(f"pans.{way}.{figure}", f"{what}, {way}", unit, comparison, limit)
        for figure, what, unit, limits in (
            ("friction_off", "default, friction 10 % off", MILLIMETRES, (3.4e-3, 2.0e-3)),
            ("best_of_24", "default, best of 24", MILLIMETRES, (None, None)),
            ("robust", "default, best of 24 by friction 10 % off, then", MILLIMETRES, (None, None)),
            ("refined", "default, the same, refined by it", MILLIMETRES, (None, 1.3e-3)),
            ("friction_worst", "default, worst friction of 14", MILLIMETRES, (1.35e-3, 0.8e-3)),
            ("asked", "default, asked every 50 ms", MILLIMETRES, (2.5e-3, 1.0e-3)),
            ("back", "default, back after a push of 20 mm", MILLISECONDS, (0.13, 0.11)),
        )
        for way, limit in zip(WAYS, limits, strict=True)
        for comparison in ("<=" if limit is not None else "",)
    ),
)


def on_pans(subject: Subject, chosen: Sequence[Task], commands: int | None, ray: str | None = None) -> OnPans:
    """Plan the tasks of pans, told the friction.

    Args:
        subject: the bundle.
        chosen: the tasks, of level pans.
        commands: so many of each, spread over its family; all if None.
        ray: address of the cluster that measures; None for none.

    Raises:
        MissingExtraError: Ray is asked for, and not installed.
    """
    parts = [Part(follow, each, commands) for task in chosen for each in (task, task.lifting())]
    if DISTURBED in chosen:
        parts += [Part(disturb, each, commands) for each in (DISTURBED, DISTURBED.lifting())]
    found = measure_parts(subject, parts, ray)
    rows = {task.name: OnPan(*found[2 * row : 2 * row + 2]) for row, task in enumerate(chosen)}
    return OnPans(rows, *(found[2 * len(chosen) :] or (None, None)))


def pans_tables(pans: OnPans) -> list[Table]:
    """Return what became of each task."""
    titles, rows = {task.name: task.title for task in (*TASKS, DRAWINGS)}, []
    for name, task in pans.tasks.items():
        for title, found in ((titles[name], task.level), ("  lifting", task.lifting)):
            rows.append((title, *(["cannot slide", *[""] * 6] if found is None else _cells_of_pan(found))))
    header = ("limits, friction, family", "RMSE", "worst", "reach", "height", "m/s", "m/s^2", "governed")
    return [table("Tracking RMSE, and what pans came to at most (mm); samples governed", header, rows)]


def _cells_of_pan(found: Followed) -> list[str]:
    errors = (f"{length * MM:.2f}" for length in (found.tracking_mean, found.tracking_max))
    lengths = (f"{length * MM:.0f}" for length in (found.pan_reach, found.height))
    return [*errors, *lengths, f"{found.speed:.2f}", f"{found.acceleration:.1f}", f"{found.governed:.1%}"]
