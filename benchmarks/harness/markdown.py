"""Tables in a page of the documentation, written there by the program that measured them.

A page has a place for the tables of a section, between two comments:

    <!-- slide-bench: peers -->
    <!-- end -->
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from rich.table import Table

from runtime.errors import InputError

ASKED = ("target", "met", "asked for")
"""Headers of the columns, and names of the rows, that hold a figure against what is aimed at."""


def write_into(page: str, name: str, sections: Mapping[str, Iterable[Table]]) -> str:
    """Return a page with the tables of sections in the place of what stood there.

    Args:
        page: the text.
        name: of the page, for errors.
        sections: tables by the names of their sections.

    Raises:
        InputError: the page has no place for a section.
    """
    for section, tables in sections.items():
        place = re.compile(rf"(<!-- slide-bench: {re.escape(section)} -->\n).*?(<!-- end -->)", re.DOTALL)
        text = "\n".join(markdown(each) for each in tables)
        page, count = place.subn(lambda found, text=text: f"{found[1]}\n{text}\n{found[2]}", page)  # type: ignore[misc]
        if not count:
            raise InputError(f"{name} has no place for {section}: <!-- slide-bench: {section} -->, <!-- end -->")
    return page


def markdown(table: Table) -> str:
    """Return a table as markdown, under its title in bold.

    A page tells what is, not what was aimed at: columns and rows of ASKED are left out. Rows under another are set in.
    """
    shown = [column for column in table.columns if str(column.header) not in ASKED]
    columns = [[str(column.header), *map(str, column.cells)] for column in shown]
    header, *rows = (row for row in zip(*columns, strict=True) if row[0] not in ASKED)
    marks = ["---:" if column.justify == "right" else "---" for column in shown]
    lines = [f"| {' | '.join(_set_in(cell) for cell in row)} |" for row in (header, marks, *rows)]
    return "\n".join([f"**{table.title}**", "", *lines, ""])


def _set_in(cell: str) -> str:
    text = cell.strip().replace("|", "\\|")
    return f"{(len(cell) - len(cell.lstrip())) * '&nbsp;'}{text}" if text else ""
