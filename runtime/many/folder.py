"""The folder of many plans: what it was begun with, what of it is done, and what came of it."""

from __future__ import annotations

import fcntl
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from runtime.documents.files import parse_json, read_bytes, read_text, reading
from runtime.documents.writing import write_whole
from runtime.errors import InputError, OutputError
from runtime.many.records import SHARD_BYTES, Source
from runtime.many.shard import BATCH_COMMANDS, BATCH_SAMPLES, TEMPORARY, Task
from runtime.quality import Status
from runtime.version import __version__

FORMAT = "slide-plans/1"

DESCRIPTION = "plans.json"
"""File that says what a folder was begun with."""

LOCK = ".lock"

PACKAGES = ("numpy", "onnxruntime", "pyarrow", "numba")
"""What the last bits of a plan depend on, besides the processor."""

SHOWN = 5
"""Failures that are shown; all of them are in the failures' files."""


NOTHING = "nothing"
"""What is said of what is not there."""

HASH_LENGTH, HASH_SHOWN = 64, 12
"""Letters of a sha256, and those of it that are shown."""


class Outcome(NamedTuple):
    """How many plans have a status, and the median of their tracking RMSE (m)."""

    status: Status
    plans: int
    tracking_rmse: float


def describe(source: Source, task: Task, commands: int) -> dict[str, Any]:
    """Return what plans are made of and how, in shards of so many commands: where it is the same, so are they."""
    return {
        "format": FORMAT,
        "input": {"kind": source.kind, "commands": source.count, "sha256": source.fingerprint()},
        "model": {"name": None if task.bundle is None else task.bundle.name, "sha256": task.sha256},
        "reading": {name: value for name, value in vars(task.reading).items() if value is not None},
        "friction": task.friction.to_dict(),
        "limits": task.limits.to_dict(),
        "sizes": task.sizes.to_dict(),
        "tolerance": task.tolerance,
        "states": task.states,
        "compiled": task.compiled,
        "shards": {"commands": commands, "bytes": SHARD_BYTES},
        "batches": {"commands": BATCH_COMMANDS, "samples": BATCH_SAMPLES},
        "versions": {"slide-planner": __version__, **{name: _version(name) for name in PACKAGES}},
    }


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Make a folder and hold it against other runs; what killed processes left half written is removed.

    Raises:
        InputError: it holds other files.
        OutputError: it cannot be made, or another run writes it.
    """
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder}: is no folder, and the plans need one")
    try:
        if folder.exists() and not (folder / DESCRIPTION).exists() and any(map(_is_other, folder.iterdir())):
            raise InputError(f"{folder}: there are files in it, and no {DESCRIPTION}: give another folder")
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / LOCK).open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise OutputError(f"{folder}: another run is writing it") from None
            _sweep(folder)
            yield
            _sweep(folder)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written: {error.strerror or error}") from error


def _sweep(folder: Path) -> None:
    for left in folder.glob(f".*{TEMPORARY}"):
        left.unlink(missing_ok=True)


def begin(folder: Path, description: Mapping[str, Any]) -> bool:
    """Write down what a folder is begun with, or compare it with what it was begun with.

    Returns:
        Whether it was begun before.

    Raises:
        InputError: it was begun with something else, which is named.
        OutputError: it cannot be written.
    """
    path = folder / DESCRIPTION
    description = json.loads(json.dumps(description))
    if path.exists():
        with reading(str(path)):
            before = parse_json(read_text(read_bytes(path)))
        was, now = _leaves(before), _leaves(description)
        other = [
            f"{name} was {was.get(name, NOTHING)} and is {now.get(name, NOTHING)}"
            for name in {**now, **was}
            if was.get(name) != now.get(name)
        ]
        if other:
            raise InputError(
                f"{folder} was begun otherwise: {', '.join(other)}; give the same again, or another folder"
            )
        return True
    write_whole(path, json.dumps(description, indent=2).encode() + b"\n")
    return False


def _leaves(document: Any, place: str = "") -> dict[str, str]:
    """Return what a document says, by the text of its place, as JSON; of a hash the beginning."""
    if isinstance(document, dict):
        found: dict[str, str] = {}
        for name, value in document.items():
            found |= _leaves(value, f"{place}.{name}" if place else name)
        return found
    if isinstance(document, list):
        return {place: ", ".join(map(_shown, document))}
    return {place: _shown(document)}


def _shown(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    return f"{text[:HASH_SHOWN]}..." if len(text) == HASH_LENGTH else text


def _is_other(file: Path) -> bool:
    return not file.name.startswith(".")


def plan_files(folder: Path) -> list[Path]:
    """Return the files of plans, in order."""
    return sorted(folder.glob("plans-[0-9]*.parquet"), key=_number)


def done_shards(folder: Path) -> set[int]:
    """Return the numbers of the shards that are written.

    Raises:
        InputError: one of them has been damaged since.
    """
    from pyarrow import parquet

    for file in [*plan_files(folder), *_failure_files(folder)]:
        with _undamaged(file):
            parquet.read_metadata(file)
    return {_number(file) for file in plan_files(folder)}


@contextmanager
def _undamaged(file: Path) -> Iterator[None]:
    """Say of a shard that cannot be read how to make it again."""
    from pyarrow import ArrowException

    try:
        yield
    except (ArrowException, OSError) as error:
        again = f"remove {file.name.replace('failures', 'plans')}, and the same command makes it again"
        raise InputError(f"{file}: is damaged: {again} ({' '.join(str(error).split())})") from error


def _failure_files(folder: Path) -> list[Path]:
    return sorted(folder.glob("failures-[0-9]*.parquet"), key=_number)


def _number(file: Path) -> int:
    return int(file.stem.rpartition("-")[2])


def outcomes(folder: Path) -> list[Outcome]:
    """Return what came of all commands that have a plan, best status first."""
    from pyarrow import parquet

    errors: dict[str, list[Any]] = {}
    for file in plan_files(folder):
        with _undamaged(file):
            table = parquet.read_table(file, columns=["status", "tracking_rmse"])
        statuses, values = np.array(table["status"].to_pylist()), table["tracking_rmse"].to_numpy()
        for status in set(statuses.tolist()):
            errors.setdefault(status, []).append(values[statuses == status])
    found = {name: np.concatenate(parts) for name, parts in errors.items()}
    return [
        Outcome(status, len(found[status]), float(np.median(found[status]))) for status in Status if status in found
    ]


def failures(folder: Path) -> tuple[int, list[str]]:
    """Return how many commands have no plan, and the place and reason of the first few."""
    from pyarrow import parquet

    count, first = 0, list[str]()
    for file in _failure_files(folder):
        with _undamaged(file):
            table = parquet.read_table(file)
        count += len(table)
        rows = table.slice(0, max(0, SHOWN - len(first))).to_pylist()
        first += [f"{row['place']}: {row['reason']}" for row in rows]
    return count, first
