"""Lines of JSON, each a command, as they are or packed by gzip."""

from __future__ import annotations

import gzip
import json
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from runtime.documents.files import parse_json
from runtime.errors import InputError

NAMES = (".ndjson", ".jsonl")
"""How files of lines are called; packed ones have PACKED behind it."""

PACKED = ".gz"

MARK = b"\xef\xbb\xbf"
"""Byte order mark of UTF-8, which some programs write at a file's beginning."""

GZIP = b"\x1f\x8b"
"""How a file that gzip has packed begins, whatever its name."""

IN_LINES = 'a line must be a JSON object like {"t": [...], "position": [[x, y], ...]}'


def is_lines(path: Path) -> bool:
    """Return whether a file's name is that of lines of JSON."""
    return path.name.lower().removesuffix(PACKED).endswith(NAMES)


def lines(file: Path) -> Iterator[tuple[str, str, int]]:
    """Yield each line's place, text and size (bytes); empty ones are passed by.

    Raises:
        InputError: it cannot be read, or is damaged.
    """
    for number, line in _numbered(file):
        yield f", line {number}", line.decode("utf-8", "backslashreplace"), len(line)


def check_lines(file: Path) -> int:
    """Return how many lines there are.

    Raises:
        InputError: there are none, the first is no JSON object, or it cannot be read.
    """
    first, count = b"", 0
    for _, line in _numbered(file):
        first = first or line
        count += 1
    if not count:
        raise InputError(f"{file}: there are no lines")
    try:
        document = parse_json(first.decode())
    except UnicodeDecodeError:
        raise InputError(f"{file}: is not UTF-8 text; {IN_LINES}") from None
    except InputError as error:
        raise InputError(f"{file}: the first line is {error}; {IN_LINES}") from error
    if not isinstance(document, Mapping):
        raise InputError(f"{file}: {IN_LINES}, the first is {json.dumps(document)[:40]}")
    return count


def _numbered(file: Path) -> Iterator[tuple[int, bytes]]:
    """Yield the lines that are not empty, and their numbers from 1."""
    with _opened(file) as opened:
        for number, line in enumerate(opened, 1):
            content = (line.removeprefix(MARK) if number == 1 else line).strip()
            if content:
                yield number, content


@contextmanager
def _opened(file: Path) -> Iterator[Iterable[bytes]]:
    try:
        with file.open("rb") as opened:
            packed = opened.peek(len(GZIP)).startswith(GZIP)
            yield gzip.GzipFile(fileobj=opened) if packed else opened
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{file}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
