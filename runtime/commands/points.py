"""What was found in a file or a document, before it is a command."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from runtime.documents.checks import FloatArray


class Points(NamedTuple):
    """Positions as they were given, in whatever unit, with or without times.

    Attributes:
        position: (n, 2).
        t: (n,) times; None if there are none.
        dt: time from one to the next, in seconds; None if that is not known.
        unit: metres a unit of position, where the source says it.
        time_unit: seconds a unit of time, where the source says it.
        lines: where each position stands in its file, counted from 1; None if it has no lines.
        drawing: a figure in units of its own, which is no place on the pan.
        found: what was taken from where, if that is not plain; for the person who asked.
    """

    position: FloatArray
    t: FloatArray | None = None
    dt: float | None = None
    unit: float | None = None
    time_unit: float | None = None
    lines: Sequence[int] | None = None
    drawing: bool = False
    found: tuple[str, ...] = ()

    def place(self, row: int) -> str:
        """Return the line of a row, for a message: empty if there are no lines."""
        return "" if self.lines is None else f" (line {self.lines[row]})"
