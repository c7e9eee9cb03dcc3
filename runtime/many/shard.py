"""One shard: its commands planned in batches that depend on the input alone, and its files written whole.

A shard is done when its plans' file is there, which is written last. Its failures are in a file of their own.
"""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from runtime.commands.reading import Reading
from runtime.compilation import compile_law
from runtime.documents.checks import FloatArray
from runtime.errors import BundleError, InputError, OutputError, extra
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.many.records import Ask, Record, Shard, read, reason
from runtime.plan import Plan
from runtime.planner import Planner
from runtime.sizes import Sizes

BATCH_COMMANDS = 256
BATCH_SAMPLES = 1 << 19
"""Commands, and their samples, that are planned at once: more of either do not make it quicker."""

MOTION = ("pan_acceleration", "stop_acceleration")
"""The arrays of a plan from which the others follow, by the law."""

STATES = ("command_position", "pan_position", "pan_velocity", "object_position", "object_velocity")
"""The others."""

TEMPORARY = ".tmp"
"""How a file's name ends while it is being written."""

PAN = {"pan_acceleration", "stop_acceleration", "pan_position", "pan_velocity"}

PAN_AXES = 3
"""Columns of the pan's arrays."""

FIGURES = (
    "tracking_rmse",
    "tracking_max",
    "pan_reach",
    "height_max",
    "speed_max",
    "acceleration_max",
    "jerk_max",
    "sliding_share",
    "friction_off_rmse",
    "rest_error",
)
"""What of a plan's quality has a column; all of it is in the column `quality`."""


@dataclass(frozen=True)
class Task:
    """What is the same for all commands.

    Attributes:
        folder: where the shards are written.
        bundle: the bundle's folder; None for the shipped one.
        sha256: of its manifest.
        reading: what the commands' numbers mean.
        friction, limits, sizes: where a command brings none of its own.
        tolerance: as for `Planner.plan`.
        states: whether STATES are written too.
        compiled: whether numba runs the law; see `compile_law`.
    """

    folder: Path
    bundle: Path | None
    sha256: str
    reading: Reading
    friction: Friction
    limits: Limits
    sizes: Sizes
    tolerance: float | None
    states: bool
    compiled: bool

    def plans_file(self, number: int) -> Path:
        """Return the file of a shard's plans, which is there when the shard is done."""
        return self.folder / f"plans-{number:05d}.parquet"

    def failures_file(self, number: int) -> Path:
        """Return the file of a shard's failures, which is there if it has some."""
        return self.folder / f"failures-{number:05d}.parquet"


class Done(NamedTuple):
    """A shard that is written: its number, its plans, its failures, and its plans' samples."""

    number: int
    plans: int
    failures: int
    samples: int


@dataclass(frozen=True, slots=True)
class Failure:
    """A record of which there is no plan."""

    index: int
    place: str
    reason: str


@lru_cache(maxsize=1)
def planner_of(bundle: Path | None, sha256: str, compiled: bool) -> Planner:
    """Return this process's planner; loads it at the first call, and compiles the law where that is asked for.

    Raises:
        BundleError: it is not of this hash.
    """
    compile_law(compiled)
    return Planner(bundle, sha256=sha256)


def plan_shard(task: Task, shard: Shard) -> Done:
    """Plan a shard's commands and write its files.

    Raises:
        OutputError: they cannot be written; what was written before is whole.
        BundleError: the bundle is no longer the one of the task.
    """
    planner = planner_of(task.bundle, task.sha256, task.compiled)
    failures: list[Failure] = []
    plans = samples = 0
    with _whole_table(task.plans_file(shard.number)) as write:
        for batch in _batches(task, shard.records, failures):
            planned = _planned(planner, task, batch, failures)
            write(plans_table(planned, task.states))
            plans += len(planned)
            samples += sum(len(plan) for _, plan in planned)
        if not plans:
            write(plans_table([], task.states))
        if failures:  # before the plans' file, which says that all is there
            with _whole_table(task.failures_file(shard.number)) as write_failures:
                write_failures(_failures_table(sorted(failures, key=lambda failure: failure.index)))
    return Done(shard.number, plans, len(failures), samples)


def _batches(task: Task, records: Sequence[Record], failures: list[Failure]) -> Iterator[list[tuple[Record, Ask]]]:
    """Yield commands to plan at once, in their order; what is no command goes to the failures."""
    batch: list[tuple[Record, Ask]] = []
    samples = 0
    for record in records:
        try:
            ask = read(record, task.reading)
        except InputError as error:
            failures.append(Failure(record.index, record.place, reason(record, error)))
            continue
        batch.append((record, ask))
        samples += len(ask.command)
        if len(batch) == BATCH_COMMANDS or samples >= BATCH_SAMPLES:
            yield batch
            batch, samples = [], 0
    if batch:
        yield batch


def _planned(
    planner: Planner, task: Task, batch: Sequence[tuple[Record, Ask]], failures: list[Failure]
) -> list[tuple[Record, Plan]]:
    """Return the plans of a batch; if one cannot be made, each is made by itself."""
    asks = [ask for _, ask in batch]
    try:
        plans = planner.plan_batch(
            [ask.command for ask in asks],
            [ask.friction or task.friction for ask in asks],
            limits=[ask.limits or task.limits for ask in asks],
            sizes=task.sizes,
            tolerance=task.tolerance,
        )
    except (InputError, BundleError) as error:
        if len(batch) > 1:
            return [made for one in batch for made in _planned(planner, task, [one], failures)]
        record, _ = batch[0]
        failures.append(Failure(record.index, record.place, reason(record, error)))
        return []
    return [(record, plan) for (record, _), plan in zip(batch, plans, strict=True)]


def plans_table(planned: Sequence[tuple[Record, Plan]], states: bool) -> Any:
    """Return the table of plans, a row for each."""
    import pyarrow

    records, plans = [record for record, _ in planned], [plan for _, plan in planned]
    qualities = [plan.quality for plan in plans]
    texts = pyarrow.string()
    columns = {
        "index": pyarrow.array([record.index for record in records], pyarrow.int64()),
        "place": pyarrow.array([record.place for record in records], texts),
        "status": pyarrow.array([quality.status.value for quality in qualities], texts),
        "samples": pyarrow.array([len(plan) for plan in plans], pyarrow.int32()),
        **{
            name: pyarrow.array([getattr(quality, name) for quality in qualities], pyarrow.float64())
            for name in FIGURES
        },
        "static": pyarrow.array([plan.friction.static for plan in plans], pyarrow.float64()),
        "kinetic": pyarrow.array([plan.friction.kinetic for plan in plans], pyarrow.float64()),
        "quality": pyarrow.array([json.dumps(quality.to_dict()) for quality in qualities], texts),
        **{name: _vectors([getattr(plan, name) for plan in plans], name) for name in MOTION + STATES * states},
    }
    return pyarrow.table(columns)


def _vectors(arrays: Sequence[FloatArray], name: str) -> Any:
    """Return the arrays (K, 2) as a column of lists of pairs, those of the pan (K, 3) as one of triples."""
    import pyarrow

    axes = PAN_AXES if name in PAN else 2
    offsets = np.cumsum([0, *map(len, arrays)], dtype=np.int32)
    flat = np.concatenate(arrays).ravel() if arrays else np.zeros(0)
    return pyarrow.ListArray.from_arrays(offsets, pyarrow.FixedSizeListArray.from_arrays(flat, axes))


def _failures_table(failures: Sequence[Failure]) -> Any:
    import pyarrow

    kinds = (pyarrow.int64(), pyarrow.string(), pyarrow.string())
    return pyarrow.table(
        {
            name: pyarrow.array([getattr(each, name) for each in failures], kind)
            for name, kind in zip(("index", "place", "reason"), kinds, strict=True)
        }
    )


@contextmanager
def _whole_table(path: Path) -> Iterator[Callable[[Any], None]]:
    """Write a Parquet file table by table; it appears when all of them are written, or not at all.

    Doubles are split into the bytes of equal weight, which are packed the better and the faster for it.

    Raises:
        OutputError: it cannot be written, and is not there.
        MissingExtraError: pyarrow is not installed.
    """
    with extra("parquet"):
        import pyarrow
        from pyarrow import parquet

    temporary = path.with_name(f".{secrets.token_hex(8)}{TEMPORARY}")
    writer: Any = None

    def write(table: Any) -> None:
        nonlocal writer
        if writer is None:
            doubles = [name for name in table.schema.names if pyarrow.types.is_list(table.schema.field(name).type)]
            doubles = [f"{name}.list.element.list.element" for name in doubles]
            others = [name for name in table.schema.names if pyarrow.types.is_string(table.schema.field(name).type)]
            writer = parquet.ParquetWriter(
                file,
                table.schema,
                compression="zstd",
                compression_level=1,
                use_dictionary=others,
                use_byte_stream_split=doubles,
                write_statistics=others,
            )
        writer.write_table(table)

    try:
        with temporary.open("xb") as file:
            yield write
            writer.close()
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
