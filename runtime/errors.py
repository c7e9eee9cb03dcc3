"""The errors a caller can meet, all under one base class.

Each message names the thing, its value and the limit, so that it can be shown to a person as it is: the
command line prints it in one line and exits with 2, a server maps the class to a status code.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

Place = tuple[str | int, ...]
"""A path into a document, as in ("command", "position", 3): names of keys and, from 0, indices of lists."""


class SlideError(Exception):
    """Base class of every error this project raises on purpose."""


class InputError(SlideError, ValueError):
    """A value that was handed in is not usable: a command, a friction coefficient, a shape, a number.

    Args:
        message: the thing, its value and the limit, in one line.
        place: where the value stands, as a path or as the text of one; "" if it is not known, or all is meant.

    Attributes:
        place: the path, () if there is none.
    """

    def __init__(self, message: str, place: Place | str = "") -> None:
        super().__init__(message)
        self.place = parse_place(place) if isinstance(place, str) else place


class FormatError(InputError):
    """A file is not what its format promises: truncated, another version, a missing key or column."""


class BundleError(SlideError):
    """A model bundle cannot be trusted or understood: a hash, a graph or the manifest does not fit."""


class OutputError(SlideError):
    """A result could not be written; what was there before is untouched."""


class MissingExtraError(SlideError):
    """An optional package is needed; the message says which `pip install` line brings it."""


class ConcurrentUseError(SlideError, RuntimeError):
    """Something that belongs to one thread at a time was used from two at once."""


class ServerError(SlideError):
    """A server cannot be reached, refuses, or does not answer as agreed; what it says is passed on."""


def install_line(name: str) -> str:
    """Return what to type for an extra, in a checkout and with a wheel."""
    return f"pip install './[{name}]' in a checkout, 'FILE.whl[{name}]' with a wheel"


@contextmanager
def extra(name: str) -> Iterator[None]:
    """Import inside this what an extra brings.

    Raises:
        MissingExtraError: a package is not installed; the message says what to install.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        package = str(error.name).partition(".")[0]
        raise MissingExtraError(f"{package} is not installed: {install_line(name)}") from error


@contextmanager
def within(place: str) -> Iterator[None]:
    """Say of an InputError that is raised inside that its place is below this one; the message stays.

    Args:
        place: the text of a path, as in commands[3].
    """
    try:
        yield
    except InputError as error:
        error.place = (*parse_place(place), *error.place)
        raise


def parse_place(text: str) -> Place:
    """Read the text of a path: command.position[3] is ("command", "position", 3)."""
    return tuple(int(part) if part.isdecimal() else part for part in re.findall(r"[^.\[\]]+", text))


def place_text(place: Place) -> str:
    """Return the text of a path: ("command", "position", 3) is command.position[3]."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in place).removeprefix(".")


def plain(text: str) -> str:
    """Return a text with every character escaped that is not printable: none of it can move a terminal's cursor."""
    return "".join(letter if letter.isprintable() else letter.encode("unicode_escape").decode() for letter in text)
