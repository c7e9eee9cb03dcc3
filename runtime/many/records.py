"""Many commands as they are found, before anything of them is read: in files, in lines of JSON, or in Parquet rows.

Their order is that of the input, files by name, and so is the way they are cut into shards: it does not depend on how
many processes plan them.
"""

from __future__ import annotations

import hashlib
import os
import reprlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from runtime.command import Command
from runtime.commands.reading import Reading
from runtime.documents.files import parse_json
from runtime.documents.parameters import Parameters
from runtime.errors import InputError, plain
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.many.json_lines import check_lines, is_lines, lines
from runtime.many.parquet_rows import check_schema, count_rows, is_data_set, rows
from runtime.physics.law import DT

SHARD_COMMANDS = 1000
"""Commands in a shard, at most, where nothing else is said."""

SHARD_BYTES = 1 << 26
"""Bytes of a shard's commands, as they are in the input, from which on it takes no further one."""

HIDDEN = (".", "_")
"""How the names of files and folders begin that are no input."""

LABELS = ("id", "name")
"""Keys of a line of JSON that say which command it is; they are passed by."""


@dataclass(frozen=True, slots=True)
class Record:
    """A command as it was found.

    Attributes:
        index: its place in the input, from 0.
        place: the file, and the line or the row in it.
        content: a file's path, a line's text, or a row's columns.
        size: of it in the input (bytes).
    """

    index: int
    place: str
    content: Path | str | Mapping[str, Any]
    size: int


class Ask(NamedTuple):
    """A command, with the friction and the limits that it brings itself; None where it brings none."""

    command: Command
    friction: Friction | None
    limits: Limits | None


class Shard(NamedTuple):
    """Consecutive records that are planned by one process and written to one file.

    Attributes:
        number: its place among the shards, from 0.
        records: at least one.
    """

    number: int
    records: list[Record]

    def __str__(self) -> str:
        return f"shard {self.number}"


@dataclass(frozen=True)
class Source:
    """An input.

    Attributes:
        path: of it.
        kind: what it is, in a word or two.
        files: its files, in their order.
        count: its commands.
        passed: columns that are passed by.
        contents: yields each file's places, contents and sizes.
    """

    path: Path
    kind: str
    files: tuple[Path, ...]
    count: int
    passed: tuple[str, ...]
    contents: Callable[[Path], Iterable[tuple[str, Any, int]]]

    def fingerprint(self) -> str:
        """Return a sha256 over the files' names, sizes and times of change: whether it is the same input still."""
        digest = hashlib.sha256()
        for file in self.files:
            size, changed = _state(file)
            digest.update(f"{self._name(file)}\t{size}\t{changed}\n".encode())
        return digest.hexdigest()

    def records(self) -> Iterator[Record]:
        """Yield every command, in order.

        Raises:
            InputError: a file can no longer be read.
        """
        index = 0
        for file in self.files:
            for place, content, size in self.contents(file):
                yield Record(index, f"{self._name(file)}{place}", content, size)
                index += 1

    def shards(self, commands: int = SHARD_COMMANDS) -> Iterator[Shard]:
        """Yield the commands cut into shards of so many, or of fewer that have SHARD_BYTES."""
        number, size, records = 0, 0, []
        for record in self.records():
            records.append(record)
            size += record.size
            if len(records) == commands or size >= SHARD_BYTES:
                yield Shard(number, records)
                number, size, records = number + 1, 0, []
        if records:
            yield Shard(number, records)

    def _name(self, file: Path) -> str:
        return plain(file.name if file == self.path else file.relative_to(self.path).as_posix())


def open_source(path: Path) -> Source:
    """Look an input over: what it is, how many commands it has, and whether its columns fit.

    Args:
        path: a folder of command files; a Parquet file of commands, or a folder of such; or a file with a JSON document
            a line.

    Raises:
        InputError: there is nothing, a column does not fit, or it is none of these.
        MissingExtraError: it is Parquet, and pyarrow is not installed.
    """
    if path.is_dir():
        files = tuple(sorted(_files(path)))
        if not files:
            raise InputError(f"{path}: there are no files in this folder")
        tables = [file for file in files if file.suffix.lower() == ".parquet"]
        if tables and is_data_set(tables[0]):
            for file in set(files) - set(tables):
                raise InputError(f"{file}: is no Parquet file, and the others in its folder are a data set")
            return _data_set(path, files)
        return Source(path, "command files", files, len(files), (), _whole)
    if not path.exists():
        raise InputError(f"{path}: there is no such file or folder")
    if is_lines(path):
        return Source(path, "lines of JSON", (path,), check_lines(path), (), lines)
    if path.suffix.lower() == ".parquet":
        return _data_set(path, (path,))
    raise InputError(
        f"{path}: many commands are a folder, a Parquet file with a row for each, or a file .ndjson or .ndjson.gz with "
        "a line for each; a single command is planned by slide-plan"
    )


def _files(folder: Path) -> Iterator[Path]:
    """Yield the files of a folder and of those in it, links to files too; what is hidden is passed by.

    Raises:
        InputError: a folder cannot be read.
    """

    def refuse(error: OSError) -> NoReturn:
        raise InputError(f"{error.filename}: cannot be read: {error.strerror}") from error

    for root, folders, names in os.walk(folder, onerror=refuse):
        folders[:] = [name for name in folders if not name.startswith(HIDDEN)]
        files = [Path(root, name) for name in names if not name.startswith(HIDDEN)]
        yield from (file for file in files if file.is_file() or not file.exists())  # a broken link is a failure


def _state(file: Path) -> tuple[int, int]:
    """Return a file's size (bytes) and the time of its last change (ns), zeros if it is gone."""
    try:
        found = file.stat()
    except OSError:
        return 0, 0
    return found.st_size, found.st_mtime_ns


def _data_set(path: Path, files: tuple[Path, ...]) -> Source:
    passed: dict[str, None] = {}
    for file in files:
        passed |= dict.fromkeys(check_schema(file))
    count = sum(count_rows(file) for file in files)
    if not count:
        raise InputError(f"{path}: there are no rows")
    return Source(path, "Parquet rows", files, count, tuple(passed), rows)


def _whole(file: Path) -> Iterator[tuple[str, Path, int]]:
    yield "", file, _state(file)[0]


def read(record: Record, options: Reading) -> Ask:
    """Read one record's command.

    Raises:
        InputError: it is no command.
        MissingExtraError: it is a Parquet file, and pyarrow is not installed.
    """
    content = record.content
    if isinstance(content, Path):
        return Ask(Command.load(content, options), None, None)
    if isinstance(content, Mapping):
        document = {name: value for name, value in content.items() if value is not None}
    else:
        document = {name: value for name, value in _document(content).items() if name not in LABELS}
    friction, limits = document.pop("friction", None), document.pop("limits", None)
    if isinstance(content, Mapping) and options.rate is None and options.speed is None and "t" not in document:
        document["dt"] = DT  # as an array is read: a row has no place for its interval
    return Ask(
        Command.from_dict(document, record.place, options),
        None if friction is None else Friction.from_dict(_named(friction, Friction)),
        None if limits is None else _limits(limits),
    )


def reason(record: Record, error: Exception) -> str:
    """Return what is wrong with a record, without its place."""
    text = " ".join(str(error).split())
    for place in (str(record.content), record.place):
        text = text.removeprefix(f"{place}: ")
    return text


def _document(line: str) -> dict[str, Any]:
    document = parse_json(line)
    if not isinstance(document, dict):
        raise InputError(f"must be a JSON object, got {reprlib.repr(document)}")
    return document


def _limits(value: Any) -> Limits:
    return Limits.named(value) if isinstance(value, str) else Limits.from_dict(_named(value, Limits))


def _named(value: Any, kind: type[Parameters]) -> Any:
    """Return a list of numbers under the names of the fields that it gives in their order."""
    names = [each.name for each in fields(kind)]
    if isinstance(value, list) and len(value) == len(names):
        return dict(zip(names, value, strict=True))
    return value
