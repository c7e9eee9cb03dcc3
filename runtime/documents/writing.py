"""Whole-or-nothing writing: a file appears whole or not at all; links, pipes, modes and owners stay what they are."""

from __future__ import annotations

import errno
import os
import re
import secrets
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from runtime.errors import OutputError

STANDARD_OUTPUT = 1
STANDARD_ERROR = 2

DESCRIPTOR = re.compile(r"/dev/(stdout|stderr)|/(?:dev|proc/self)/fd/([0-9]+)")
"""Paths that are no files but something this process has open already."""

MAX_LINKS = 40
"""Most links followed from one to the next, as by Linux."""


def check_writable(path: Path) -> None:
    """Check before the work is done that its result can be written.

    Raises:
        OutputError: the folder is absent, no folder, or not writable, the file is protected against writing, or the
            path is itself a folder.
    """
    with _writing(path):
        target = _followed(path)
        if isinstance(target, int):
            os.fstat(target)
            return
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, "is a directory")
        if not target.parent.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, f"there is no folder {target.parent}")
        if target.exists() and not os.access(target, os.W_OK):
            raise PermissionError(errno.EACCES, "the file is protected against writing")
        if not _is_stream(target) and not os.access(target.parent, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, f"no permission to write in {target.parent}")


def write_whole(path: Path, data: bytes) -> None:
    """Write a file so that it appears whole or not at all, replacing an older one.

    A link stays a link: the file it leads to is replaced. An older file's mode and owner stay. Into a pipe, a device
    or a descriptor (/dev/stdout, /dev/fd/N) the data are written as they are.

    Raises:
        OutputError: it cannot be written; what was there before is untouched and nothing is left beside it.
        BrokenPipeError: nobody reads standard output any more.
    """
    check_writable(path)
    with _writing(path):
        target = _followed(path)
        if isinstance(target, int):
            _write_into_descriptor(target, data)
        elif _is_stream(target):
            with target.open("wb") as file:
                file.write(data)
        else:
            _replace(target, data)


def is_stream(path: Path) -> bool:
    """Whether a path is a pipe, a device or a descriptor: something to write into, and no file to replace."""
    with _writing(path):
        target = _followed(path)
        return isinstance(target, int) or _is_stream(target)


def is_standard_output(path: Path) -> bool:
    """Whether a path is standard output, under any of its names."""
    return _descriptor(path) == STANDARD_OUTPUT


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Turn what the system says into an OutputError.

    Raises:
        OutputError: an OSError was raised inside, or the path has a character that none may have.
        BrokenPipeError: of standard output, which is nobody's mistake.
    """
    try:
        yield
    except (OSError, ValueError) as error:
        if isinstance(error, BrokenPipeError) and is_standard_output(path):
            raise
        raise OutputError(f"{path}: cannot be written: {getattr(error, 'strerror', None) or error}") from error


def _descriptor(path: Path) -> int | None:
    """Return the number of the descriptor that a path names, None if it names none."""
    match = DESCRIPTOR.fullmatch(str(path))
    if match is None:
        return None
    name, number = match.groups()
    return int(number) if name is None else {"stdout": STANDARD_OUTPUT, "stderr": STANDARD_ERROR}[name]


def _followed(path: Path) -> Path | int:
    """Return what a chain of links leads to, a path that is no link or the number of a descriptor.

    Raises:
        OSError: the links lead in a circle.
    """
    for _ in range(MAX_LINKS):
        descriptor = _descriptor(path)
        if descriptor is not None:
            return descriptor
        if not path.is_symlink():
            return path
        path = path.parent / path.readlink()
    raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))


def _is_stream(target: Path) -> bool:
    return target.exists() and not target.is_file() and not target.is_dir()


def _write_into_descriptor(descriptor: int, data: bytes) -> None:
    for stream in (sys.stdout, sys.stderr):  # what was printed before comes before
        if stream is not None:
            stream.flush()
    with os.fdopen(os.dup(descriptor), "wb") as file:
        file.write(data)


def _replace(target: Path, data: bytes) -> None:
    temporary = target.with_name(f".{secrets.token_hex(8)}.tmp")  # short: the target's name may be as long as any
    try:
        with temporary.open("xb") as file:
            if target.exists():
                _keep_owner_and_mode(file.fileno(), target.stat())
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, target)
    finally:
        with suppress(OSError, ValueError):
            temporary.unlink(missing_ok=True)


def _keep_owner_and_mode(descriptor: int, before: os.stat_result) -> None:
    with suppress(OSError):  # only root may give a file away; the mode counts for anybody
        os.fchown(descriptor, before.st_uid, before.st_gid)
    os.fchmod(descriptor, stat.S_IMODE(before.st_mode))
