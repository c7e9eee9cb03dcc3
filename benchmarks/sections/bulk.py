"""How fast many commands are planned by `slide-plan-many`, in how much memory, and what a second process brings."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.table import Table

from benchmarks.harness.section import Measured, Section, Subject, at_least
from benchmarks.harness.tables import targets_table
from benchmarks.harness.targets import COUNT, MEGABYTES, MILLISECONDS, TIMES, Target, Unit, Verdict
from benchmarks.harness.timing import environment_with_runtime
from benchmarks.suite.families import SAMPLES, spline
from runtime.cli.plan_many import COMPILED_FROM
from runtime.documents.options import option
from runtime.errors import SlideError, extra

PLAN_MANY = (
    "import sys; sys.argv[0] = 'slide-plan-many'; from runtime.cli.plan_many import plan_many_main; plan_many_main()"
)
"""What the installed script `slide-plan-many` runs."""

MILLION = 1_000_000

SMALLER = 5
"""Times that the smaller input has fewer commands: what the two take more or less is what commands take."""

SIZES = (0.6, 1.0)
"""Smallest and largest factor by which a command of the suite is made smaller."""

WRITTEN_AT_ONCE = 1000

KIB = 1024
"""Bytes in the unit in which Linux gives a process's memory."""

MINUTES = Unit("min", 1.0 / 60.0, "{:.1f}")


@dataclass(frozen=True)
class BulkSettings:
    """How much is planned.

    Attributes:
        total: commands of the larger input.
        workers: processes whose speed is held against that of one.
    """

    total: int = option("Commands that are planned.", 20_000, "N")
    workers: int = 2


@dataclass(frozen=True)
class Bulk:
    """Everything this section measures, of commands of 1.2 s.

    Attributes:
        million: time of a million commands in one process, projected (s).
        million_cpu: the same of the processor (s), which says more where other programs run.
        command_cpu: time of the processor for one command (s).
        peak: memory of one process at its most (bytes).
        growth: by how much it is more than with SMALLER times fewer commands (bytes).
        speedup: of several processes over one; None if there are not as many processors.
        equal: 1 if all files are the same to the last bit, 0 if not; None as before.
    """

    million: float
    million_cpu: float
    command_cpu: float
    peak: float
    growth: float
    speedup: float | None
    equal: int | None


TARGETS = (
    Target("million", "a million commands, one process", MINUTES, "<=", 25 * 60.0),
    Target("million_cpu", "  of the processor", MINUTES),
    Target("command_cpu", "  of the processor, each", MILLISECONDS),
    Target("speedup", "two processes over one", TIMES, ">=", 1.8),
    Target("equal", "equal files (1: all)", COUNT, ">=", 1.0),
    Target("growth", "memory more than with a fifth", MEGABYTES, "<=", 50e6),
    Target("peak", "memory at its most", MEGABYTES),
)


class Run(NamedTuple):
    """One run: how long it took, how long the processor was at it (s), and its memory at its most (bytes)."""

    duration: float
    cpu: float
    peak: float


def measure_bulk(subject: Subject, settings: BulkSettings) -> Measured:
    """Measure many commands.

    Raises:
        InputError: there are so few commands that not both inputs are planned with numba's law.
        MissingExtraError: pyarrow is not installed.
        SlideError: `slide-plan-many` failed.
    """
    at_least(SMALLER * COMPILED_FROM, total=settings.total)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        smaller = settings.total // SMALLER
        write_commands(folder / "few.parquet", smaller)
        write_commands(folder / "all.parquet", settings.total)
        few = plan_many(subject.folder, folder / "few.parquet", folder / "few", 1)
        one = plan_many(subject.folder, folder / "all.parquet", folder / "one", 1)
        more = settings.total - smaller
        speedup, equal, notes = None, None, []
        if (os.cpu_count() or 1) >= settings.workers:
            several = plan_many(subject.folder, folder / "all.parquet", folder / "several", settings.workers)
            speedup = one.duration / several.duration
            equal = int(_content(folder / "one") == _content(folder / "several"))
        else:
            notes.append(f"{settings.workers} processes are left out: there are fewer processors")
        start = few.duration - (one.duration - few.duration) * smaller / more
        command, command_cpu = ((getattr(one, each) - getattr(few, each)) / more for each in ("duration", "cpu"))
        figures = Bulk(
            start + MILLION * command, MILLION * command_cpu, command_cpu, one.peak, one.peak - few.peak, speedup, equal
        )
        return Measured(figures, notes)


def write_commands(path: Path, count: int) -> None:
    """Write commands of 1.2 s as a Parquet data set: those of the suite, turned and made smaller.

    Raises:
        MissingExtraError: pyarrow is not installed.
    """
    with extra("parquet"):
        import pyarrow
        from pyarrow import parquet
    rng, base = np.random.default_rng(0), np.stack(spline().positions)
    pairs = pyarrow.list_(pyarrow.list_(pyarrow.float64(), 2))
    with parquet.ParquetWriter(path, pyarrow.schema({"position": pairs}), compression="zstd") as writer:
        for first in range(0, count, WRITTEN_AT_ONCE):
            many = min(WRITTEN_AT_ONCE, count - first)
            turned = np.exp(1j * rng.uniform(0.0, 2.0 * np.pi, many)) * rng.uniform(*SIZES, many)
            positions = base[rng.integers(len(base), size=many)] @ [1.0, 1.0j] * turned[:, None]
            values = np.stack([positions.real, positions.imag], axis=-1).ravel()
            offsets = np.arange(0, many * SAMPLES + 1, SAMPLES, dtype=np.int32)
            column = pyarrow.ListArray.from_arrays(offsets, pyarrow.FixedSizeListArray.from_arrays(values, 2))
            writer.write_table(pyarrow.table({"position": column}))


def plan_many(model: Path, source: Path, folder: Path, workers: int) -> Run:
    """Run `slide-plan-many`.

    Raises:
        SlideError: it failed.
    """
    arguments = [source, "-o", folder, "--model", model, "--workers", workers]
    begin = time.perf_counter()
    with (folder.parent / "said").open("w+") as said:
        process = subprocess.Popen(
            [sys.executable, "-c", PLAN_MANY, *map(str, arguments)],
            env=environment_with_runtime(),
            stdout=subprocess.DEVNULL,
            stderr=said,
        )
        _, status, used = os.wait4(process.pid, 0)
        duration = time.perf_counter() - begin
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode not in (0, 1):
            said.seek(0)
            raise SlideError(f"slide-plan-many failed with exit code {process.returncode}: {said.read().strip()}")
    return Run(duration, used.ru_utime + used.ru_stime, float(used.ru_maxrss * KIB))


def _content(folder: Path) -> list[bytes]:
    return [file.read_bytes() for file in sorted(folder.glob("*.parquet"))]


def bulk_tables(bulk: Bulk, verdicts: Sequence[Verdict]) -> list[Table]:
    """Return the figures, beside their targets."""
    return targets_table("Many commands of 1.2 s", verdicts, {})


SECTION = Section(
    "bulk",
    "a million commands: time, memory, two processes over one",
    BulkSettings(),
    measure_bulk,
    TARGETS,
    bulk_tables,
    timed=True,
    usual=False,
)
