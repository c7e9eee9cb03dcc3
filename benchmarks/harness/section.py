"""What a section of `slide-bench` is, and how sections are measured.

A section is one file in `benchmarks/sections/`. It holds, in this order:

- a frozen dataclass of its settings: rounds, commands, windows and whatever else decides what is measured. Each has a
  default. A field made by `runtime.documents.options.option` is an option of `slide-bench` too;
- frozen dataclasses of its figures, in SI units;
- `TARGETS`: a line for each figure that is shown, and what it should be;
- a function that measures: a `Subject` and the settings to a `Measured`;
- a function that makes tables of the figures and of the verdicts on them;
- `SECTION`, which names all of these.

`benchmarks/cli.py` has the list of the sections. So a new figure is a field of the dataclass and a line in `TARGETS`, a
new option is a field of the settings, and a new section is a file and a line in that list.

What needs a package of an extra is imported inside the function that needs it, under `runtime.errors.extra`. Where that
raises, the section is left out, with the line that installs the package; a part of a section is left out by a note in
`Measured`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Generic, NamedTuple, Self, TypeVar

from rich.table import Table

from benchmarks.harness.targets import Target, Verdict
from runtime.errors import InputError
from runtime.network.bundle import bundle_path
from runtime.planner import DEFAULT_BUNDLE, Planner

NAME = "slide-bench"
"""The program that measures sections, for its messages."""

Settings = TypeVar("Settings")
Figures = TypeVar("Figures")


@dataclass(frozen=True)
class Subject:
    """The bundle that is measured.

    Attributes:
        folder: where it is.
        planner: plans with it.
    """

    folder: Path
    planner: Planner

    @classmethod
    def load(cls, model: str | PathLike[str] | None = None) -> Self:
        """Load a bundle from its folder or by the name of a shipped one; `default` if None.

        Raises:
            BundleError: the bundle cannot be trusted or understood.
        """
        folder = bundle_path(DEFAULT_BUNDLE if model is None else model).resolve()
        return cls(folder, Planner(folder))


class Measured(NamedTuple):
    """A section's figures, a dataclass, and one line for each part of it that was left out."""

    figures: Any
    notes: Sequence[str] = ()


@dataclass(frozen=True)
class Section(Generic[Settings, Figures]):
    """One section.

    Attributes:
        name: what it is called on the command line.
        what: what it measures, in some words.
        settings: the ones it has by default.
        measure: measures it.
        targets: its figures, and what they should be.
        tables: shows the figures.
        timed: whether a busy machine spoils it.
        usual: whether it is measured where no section is named.
    """

    name: str
    what: str
    settings: Settings
    measure: Callable[[Subject, Settings], Measured]
    targets: Sequence[Target]
    tables: Callable[[Figures, Sequence[Verdict]], Sequence[Table]]
    timed: bool = False
    usual: bool = True


def at_least(lowest: float, **values: float | None) -> None:
    """Check settings that were given, each under its name.

    Raises:
        InputError: one is below `lowest`, infinite or no number.
    """
    for name, value in values.items():
        if value is not None and not (math.isfinite(value) and value >= lowest):
            raise InputError(f"--{name.replace('_', '-')} must be at least {lowest:g}, got {value:g}")
