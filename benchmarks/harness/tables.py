"""Tables of at most 80 columns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

from rich import box
from rich.console import Console
from rich.table import Table

from benchmarks.harness.machine import Machine
from benchmarks.harness.targets import Unit, Verdict
from benchmarks.harness.timing import Spread

WIDTH = 80

MARKS = {True: "yes", False: "NO", None: ""}

Rows = Iterable[Sequence[str]]


def print_tables(tables: Iterable[Table]) -> None:
    """Print tables on standard output, WIDTH columns wide."""
    console = Console(width=WIDTH, markup=False, highlight=False)
    for each in tables:
        console.print(each)


def table(title: str, header: Sequence[str], rows: Rows, numbers: bool = True) -> Table:
    """Return a table; all columns but the first are set to the right if they hold numbers."""
    made = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE, show_header=any(header))
    for index, name in enumerate(header):
        made.add_column(name, justify="right" if numbers and index else "left", overflow="fold")
    for row in rows:
        made.add_row(*row)
    return made


def targets_table(
    title: str, verdicts: Sequence[Verdict], details: Mapping[str, Rows] = MappingProxyType({}), extra: Rows = ()
) -> list[Table]:
    """Return a table of figures beside their targets; none if it were empty.

    Args:
        title: of the table.
        verdicts: the figures.
        details: rows of (what, measured) that follow a figure, by the figure's name.
        extra: the same at the end.
    """
    rows: list[Sequence[str]] = []
    for verdict in verdicts:
        target = verdict.target
        unit = f" ({target.unit.name})" if target.unit.name else ""
        rows.append((target.what + unit, target.unit.text(verdict.value), target.text, MARKS[verdict.met]))
        rows += [(*row, "", "") for row in details.get(target.figure, ())]
    rows += [(*row, "", "") for row in extra]
    return [table(title, ("", "measured", "target", "met"), rows)] if rows else []


def span(spread: Spread, unit: Unit) -> tuple[str, str]:
    """Return the row that says between what four fifths of the measurements lie."""
    return "  10 % to 90 %", f"{unit.text(spread.p10)} to {unit.text(spread.p90)}"


def machine_table(machine: Machine, versions: Mapping[str, str | None], model: Mapping[str, object]) -> Table:
    """Return what was measured, on what."""
    load = "" if machine.load is None else f", load {machine.load:.1f}"
    rows = [
        ("model", "{name}, {layers} x {units} units, {precision}, sha256 {sha256:.12}".format(**model)),
        ("processor", f"{machine.cpu}, {machine.cores} cores{load}"),
        ("flags", " ".join(machine.flags) or "unknown"),
        ("system", f"{machine.system} {machine.architecture}"),
        ("versions", ", ".join(f"{name} {version}" for name, version in versions.items() if version)),
    ]
    return table("slide-bench", ("", ""), rows, numbers=False)
