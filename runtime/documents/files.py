"""Strict reading of the project's files: JSON and npz documents of numbers.

What is read was written by somebody else, so nothing is guessed: a key that is missing or unknown, a number that
is a string or a boolean, NaN and Infinity, a ragged table are refused with a message that names the place.
"""

from __future__ import annotations

import io
import json
import reprlib
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from runtime.errors import FormatError, InputError

MAX_FILE_BYTES = 1 << 28
"""Largest file read (bytes): a plan of ten minutes takes 160 MB as JSON; more is not a file of ours."""


@contextmanager
def reading(source: str) -> Iterator[None]:
    """Turn what is wrong with a value into what is wrong with the file it came from.

    Args:
        source: the file's path, or the name of the document when it came over a wire.

    Raises:
        FormatError: an InputError was raised inside; the message is preceded by `source`, the place is the same.
    """
    try:
        yield
    except InputError as error:
        raise FormatError(f"{source}: {error}", error.place) from error


def read_bytes(path: Path) -> bytes:
    """Read a file whole.

    Raises:
        InputError: the file is absent, a directory, not readable, empty or larger than MAX_FILE_BYTES.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
    except (OSError, ValueError) as error:  # ValueError: a path with a NUL character
        raise InputError(f"cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if not data:
        raise InputError("the file is empty")
    if len(data) > MAX_FILE_BYTES:
        raise InputError(f"the file is larger than {MAX_FILE_BYTES >> 20} MiB")
    return data


def read_text(data: bytes) -> str:
    """Decode a file's bytes as UTF-8; a byte order mark is skipped.

    Raises:
        InputError: not UTF-8.
    """
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"not UTF-8 text (byte {error.start})") from error


def parse_json(text: str) -> Any:
    """Parse a JSON document; NaN, Infinity and a key given twice are refused.

    Raises:
        InputError: not JSON, or truncated; the message carries line and column.
    """
    try:
        return json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=_unique_keys)
    except json.JSONDecodeError as error:
        end = "truncated or " if error.pos >= len(text.rstrip()) else ""
        raise InputError(f"{end}not JSON: {error.msg} (line {error.lineno}, column {error.colno})") from error
    except RecursionError as error:
        raise InputError("not a document of ours: nested too deeply") from error
    except InputError:
        raise
    except ValueError as error:  # an integer of thousands of digits
        raise InputError(f"not JSON: {error}") from error


def _refuse_constant(name: str) -> NoReturn:
    raise InputError(f"{name} is not a finite number")


def _unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    document = dict(pairs)
    if len(document) != len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"key {reprlib.repr(twice)} is given twice")
    return document


def parse_npz(data: bytes) -> dict[str, NDArray[Any]]:
    """Read the arrays of an npz file; pickled objects are never loaded.

    Raises:
        InputError: not an npz file, truncated, holding pickled objects, or unpacking to more than MAX_FILE_BYTES.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            unpacked = sum(member.file_size for member in archive.infolist())
        if unpacked > MAX_FILE_BYTES:
            raise InputError(f"the arrays unpack to more than {MAX_FILE_BYTES >> 20} MiB")
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            content = {name: arrays[name] for name in arrays.files}
        for name, array in content.items():
            if not isinstance(array, np.ndarray):  # bytes of whatever was packed
                raise InputError(f"not an npz file: {reprlib.repr(name)} in it is no array of numpy")
        return content
    except InputError:
        raise
    except Exception as error:  # a broken archive makes zipfile, zlib and numpy raise nearly anything
        raise InputError(f"not a readable npz file: {str(error)[:100]}") from error
