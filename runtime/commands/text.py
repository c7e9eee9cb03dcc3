"""Tables of numbers in text: CSV as many programs write it, TUM trajectories, `np.savetxt`."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np

from runtime.commands.columns import (
    METRES,
    PIXELS,
    SECONDS,
    TUM,
    Choice,
    choose,
    choose_unnamed,
    may_be_header,
    told,
)
from runtime.commands.points import Points
from runtime.commands.questions import ask_time
from runtime.commands.reading import Reading
from runtime.documents.checks import FloatArray
from runtime.errors import InputError

DELIMITERS = (";", "\t", ",", "|", None)
"""What cells may be parted by; None is any number of spaces."""

COMMENTS = ("#", "%", "//")

UNITS = {"", *SECONDS, *METRES, *PIXELS}
"""What a second line may say of the columns."""

LONG = 5000
"""Rows from which on a table is first tried as nothing but numbers, which is ten times as fast."""

MOST_COLUMNS, LONGEST_NAME = 10_000, 1000
"""Most columns of a table, and most characters of a name: beyond, to look for x and y takes seconds."""

SAMPLED = 10
"""Lines of numbers that the delimiter is found from."""


BEFORE_HEADER = 50
"""Lines among which a header is looked for."""

EMPTY = ' \t,;|"'
"""What rows without a value are made of; programs leave such at a table's end."""


class Line(NamedTuple):
    """A line of a file and its number, from 1."""

    number: int
    text: str


def text_of(data: bytes) -> str:
    """Return the text of a file, which is UTF-8 or UTF-16, or what its XML declares; beside the numbers of a table it
    may be Windows-1252.

    Raises:
        InputError: it is neither, or no text.
    """
    encoding = "utf-8-sig"
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encoding = "utf-16"
    elif 4 * data[:400].count(0) > len(data[:400]):  # every other byte of plain text
        encoding = "utf-16-be" if data[0] == 0 else "utf-16-le"
    elif declared := re.match(rb"<\?xml[^>]*encoding=[\"'](iso-8859-1|iso-8859-15|windows-1252|us-ascii)", data, re.I):
        encoding = declared[1].decode("ascii")
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError as error:
        if any(re.search(rb"[\x80-\xff]", line) and re.search(rb"[0-9\0]", line) for line in data.splitlines()):
            raise InputError(f"not UTF-8 text (byte {error.start})") from error
        text = data.decode("cp1252", "replace")  # a letter of a name or a comment, as Excel writes it in Europe
    zero = text.find("\0")
    if zero >= 0 or (encoding.startswith("utf-16-") and not text[:100].isascii()):
        where = f": line {text.count(chr(10), 0, zero) + 1} holds zero bytes" if zero >= 0 else ""
        raise InputError(f"not text{where}")
    return text


def parse_table(content: str, reading: Reading) -> Points:
    """Read positions, and times if there are any, from a table.

    Lines that begin with #, % or // are comments; the last before the numbers may be the header.

    Raises:
        InputError: columns are not found, a row has another number of cells, or a cell is no finite number; the line of
            the file (from 1) and the column are named.
    """
    lines, comments = _lines(content)
    if not lines:
        raise InputError("there are no rows")
    middle = max(len(lines) // 2, min(1, len(lines) - 1))  # past what a program writes before the header
    delimiter = _delimiter([line.text for line in lines[middle : middle + SAMPLED]])
    before = _before_header(lines, delimiter)
    lines = lines[before:]
    first = _fitting(lines, delimiter)
    if len(first) > MOST_COLUMNS:
        raise InputError(f"line {lines[0].number}: has {len(first)} columns, at most {MOST_COLUMNS} are read")
    if (longest := max(map(len, first))) > LONGEST_NAME:
        raise InputError(f"line {lines[0].number}: has a cell of {longest} characters, at most {LONGEST_NAME} are read")
    names: Sequence[str] | None = None
    if all(_number(cell, delimiter) is None for cell in first):
        header, names, lines = lines[0], first, lines[1:]
        units = [cell.strip(" []()").lower() for cell in _trimmed(_split(lines[0], delimiter))] if lines else []
        if len(units) == len(names) and UNITS.issuperset(units):  # a second line, of units
            names, lines = [f"{name} [{unit}]" for name, unit in zip(names, units, strict=True)], lines[1:]
        try:
            choice = choose(names, reading.columns)
        except InputError as error:
            raise InputError(f"line {header.number}: {error}") from None
    else:
        names = _commented_header(comments, delimiter, len(first), reading)
        if names is None and _is_tum(first, delimiter):
            names = TUM
        if names is not None and not (reading.columns and {"x", "y"} <= set(reading.columns) - set(names)):
            choice = choose(names, reading.columns)
        else:
            names = None
            choice = choose_unnamed(len(first), reading.columns)
    titles = [str(index + 1) for index in range(len(first))] if names is None else names
    parsed = _parsed(lines, delimiter, len(first))
    whose = "the first row" if names is None else "the header"
    rows = _rows(lines, delimiter, len(first), whose) if parsed is None else []
    cells = _Cells(rows, [line.number for line in lines], titles, delimiter, parsed)
    position = np.column_stack([cells.numbers(choice.x), cells.numbers(choice.y)])
    if names is not None and not choice.t and reading.needs_times:
        choice = choice._replace(t=cells.dated())
        if not choice.t:
            ask_time(names, cells.others(choice), choice.x, choice.y)
    t, time_unit = cells.times(choice)
    passed = (f"passed {before} line{'s' * (before > 1)} by, before the header",) if before else ()
    found = (*passed, *told(titles, choice))
    return Points(position, t, unit=choice.unit, time_unit=time_unit, lines=cells.lines, found=found)


def _lines(content: str) -> tuple[list[Line], list[Line]]:
    """Return the lines that are neither blank nor comments, and the comments before them."""
    kept: list[Line] = []
    comments: list[Line] = []
    for number, text in enumerate(re.split(r"\r\n|\n|\r", content), 1):
        if not text.strip() or (number == 1 and text.strip('"').lower().startswith("sep=")):  # Excel's delimiter
            continue
        if not text.lstrip().startswith(COMMENTS):
            kept.append(Line(number, text))
        elif not kept:
            comments.append(Line(number, text.strip().lstrip("#%/")))
    while kept and not kept[-1].text.strip(EMPTY):
        kept.pop()
    return kept, comments


def _before_header(lines: list[Line], delimiter: str | None) -> int:
    """Return how many lines a program wrote before the header: titles, who measured and with what."""
    for index, line in enumerate(lines[: min(BEFORE_HEADER, len(lines) - 1)]):
        cells = _split(line, delimiter)
        found = [_number(cell, delimiter) for cell in _trimmed(cells)]
        if None not in found and len(found) > 1:
            return 0  # numbers already
        if not any(found) and may_be_header(cells) and len(_fitting(lines[index:], delimiter)) > 1:
            return index
    return 0


def _fitting(lines: list[Line], delimiter: str | None) -> list[str]:
    """Return the cells of the first line; one without a name at its end counts if the next line has it too."""
    cells = _split(lines[0], delimiter)
    if len(lines) > 1 and len(_trimmed(_split(lines[1], delimiter))) == len(cells):
        return cells
    return _trimmed(cells)


def _delimiter(sample: list[str]) -> str | None:
    """Return what parts most cells of the sample into numbers."""

    def share(delimiter: str | None) -> float:
        rows = [_trimmed(_split(Line(0, text), delimiter)) for text in sample]
        cells = [cell for row in rows for cell in row]
        if min(map(len, rows)) < 2:
            return -1.0
        return sum(_number(cell, delimiter) is not None for cell in cells) / len(cells)

    return max(DELIMITERS, key=share)


def _split(line: Line, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.text.split()
    if '"' not in line.text:
        return line.text.split(delimiter)
    try:
        return next(csv.reader([line.text], delimiter=delimiter, skipinitialspace=True), [])
    except csv.Error as error:
        raise InputError(f"line {line.number}: not CSV: {error}") from error


def _trimmed(cells: list[str]) -> list[str]:
    """Return the cells without an empty last one, which a delimiter at the end of the line makes."""
    return cells[:-1] if len(cells) > 2 and not cells[-1].strip() else cells


def _commented_header(comments: list[Line], delimiter: str | None, width: int, reading: Reading) -> list[str] | None:
    """Return the names in the last of the comments before the numbers that is a header."""
    for comment in reversed(comments):
        for each in (delimiter, *DELIMITERS):
            names = _trimmed(_split(comment, each))
            asked = reading.columns is not None and set(reading.columns) <= {name.strip() for name in names}
            if len(names) == width and (asked or may_be_header(names)):
                return names
    return None


def _is_tum(row: list[str], delimiter: str | None) -> bool:
    """Return whether a row may be of a TUM trajectory: time, position and a quaternion of length 1."""
    values = [_number(cell, delimiter) for cell in row]
    if len(values) != len(TUM):
        return False
    return abs(sum(math.nan if value is None else value * value for value in values[4:]) - 1.0) < 0.01


def _parsed(lines: list[Line], delimiter: str | None, width: int) -> FloatArray | None:
    """Return all cells of a long table at once, (n, width), if they are numbers; None if they have to be looked at."""
    if len(lines) < LONG:
        return None
    try:
        values = np.loadtxt((line.text for line in lines), delimiter=delimiter, comments=None, ndmin=2)
    except ValueError:
        return None
    return values if values.shape[1] == width and np.isfinite(values).all() else None


def _rows(lines: list[Line], delimiter: str | None, width: int, whose: str) -> list[list[str]]:
    """Split lines into `width` cells each.

    Raises:
        InputError: a line has another number; it is named.
    """
    rows = []
    for line in lines:
        row = _split(line, delimiter)
        if len(row) != width and len(row := _trimmed(row)) != width:
            raise InputError(f"line {line.number}: has {len(row)} cells, {whose} has {width}")
        rows.append(row)
    return rows


def _number(cell: str, delimiter: str | None) -> float | None:
    """Return the number in a cell, None if it is none; where commas part no cells, one may be a decimal point."""
    if "_" in cell:  # Python's 1_000 is no number in a file
        return None
    try:
        return float(cell)
    except ValueError:
        pass
    try:
        return float(cell.replace("\u2212", "-").replace(",", "." if delimiter != "," else ","))
    except ValueError:
        return None


def _date(cell: str) -> float | None:
    """Return the seconds of 01:02:03.5 or 0 days 01:02:03.5, or since 1970 of a date and time; None if it is none."""
    if match := re.fullmatch(r"\s*(?:(\d+) days? )?(\d+:\d\d(?::\d\d)?(?:\.\d+)?)\s*", cell):
        days = 86_400.0 * float(match[1] or 0)
        return days + sum(float(part) * 60.0**power for power, part in enumerate(reversed(match[2].split(":"))))
    try:
        date = datetime.fromisoformat(cell.strip())
    except ValueError:
        return None
    return (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()


class _Cells(NamedTuple):
    """The cells of a table, the number of each row's line, the names of its columns, and its numbers if it is long."""

    rows: list[list[str]]
    lines: list[int]
    titles: Sequence[str]
    delimiter: str | None
    parsed: FloatArray | None

    def numbers(self, column: int) -> FloatArray:
        """Return a column (n,).

        Raises:
            InputError: a cell is no finite number; its line and column are named.
        """
        if self.parsed is not None:
            return self.parsed[:, column]
        values = [_number(row[column], self.delimiter) for row in self.rows]
        for row, value in enumerate(values):
            if value is None or not math.isfinite(value):
                title = self.titles[column].strip()
                said = "is not a finite number" if value is not None else "is not a number"
                found = value if value is not None else repr(self.rows[row][column].strip()[:20])
                raise InputError(
                    f"line {self.lines[row]}, column {title}: {found} {said}", f"line[{self.lines[row]}].{title}"
                )
        return np.array(values, dtype=np.float64)

    def others(self, choice: Choice) -> Iterator[tuple[int, FloatArray]]:
        """Yield index and numbers of each column that is neither x nor y and has nothing but numbers."""
        for column in set(range(len(self.titles))) - {choice.x, choice.y}:
            with suppress(InputError):
                yield column, self.numbers(column)

    def dated(self) -> tuple[tuple[int, float | None], ...]:
        """Return the column that begins with a date or a clock's time, as `Choice` has it; empty if none or more do."""
        found = [
            (column, None)
            for row in self.rows[:1]
            for column, cell in enumerate(row)
            if _date(cell) is not None and _number(cell, self.delimiter) is None
        ]
        return tuple(found) if len(found) == 1 else ()

    def times(self, choice: Choice) -> tuple[FloatArray | None, float | None]:
        """Return the times (n,) and their unit in seconds where it is known; None if there are none."""
        if not choice.t:
            return None, None
        (column, unit), *rest = choice.t
        if rest:
            return np.sum([each * self.numbers(index) for index, each in choice.t if each], axis=0), 1.0
        dates = [_date(row[column]) for row in self.rows[:1]]
        if dates and dates[0] is not None and _number(self.rows[0][column], self.delimiter) is None:
            return self._dates(column), 1.0
        return self.numbers(column), unit

    def _dates(self, column: int) -> FloatArray:
        dates = [_date(row[column]) for row in self.rows]
        for row, date in enumerate(dates):
            if date is None:
                cell = self.rows[row][column][:40]
                raise InputError(f"line {self.lines[row]}, column {self.titles[column]}: {cell!r} is no date and time")
        return np.array(dates, dtype=np.float64)
