"""How fast many commands are planned by `slide-plan-many`, in how much memory, what a second process brings, and what
is left of a run whose processes are killed."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
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
from runtime.many.records import SHARD_COMMANDS

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

SMALL_SHARD = 100
"""Commands in a shard of the runs that are killed: there are enough of them to be killed amid the work each time."""

KIB = 1024
"""Bytes in the unit in which Linux gives a process's memory."""

MINUTES = Unit("min", 1.0 / 60.0, "{:.1f}")


@dataclass(frozen=True)
class BulkSettings:
    """How much is planned.

    Attributes:
        total: commands of the larger input.
        workers: processes whose speed is held against that of one.
        kills: times that a run is killed and goes on.
    """

    total: int = option("Commands that are planned.", 20_000, "N")
    workers: int = 2
    kills: int = 10


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
        killed: times that the run was killed amid its work.
        resumed: 1 if the run that was killed so often ended with the same files to the last bit, 0 if not.
        worker: the same of a run whose planning processes were killed.
    """

    million: float
    million_cpu: float
    command_cpu: float
    peak: float
    growth: float
    speedup: float | None
    equal: int | None
    killed: int
    resumed: int
    worker: int


TARGETS = (
    Target("million", "a million commands, one process", MINUTES, "<=", 25 * 60.0),
    Target("million_cpu", "  of the processor", MINUTES),
    Target("command_cpu", "  of the processor, each", MILLISECONDS),
    Target("speedup", "two processes over one", TIMES, ">=", 1.8),
    Target("equal", "equal files (1: all)", COUNT, ">=", 1.0),
    Target("killed", "killed at a random moment, and gone on", COUNT, ">=", 10.0),
    Target("resumed", "  equal files (1: all)", COUNT, ">=", 1.0),
    Target("worker", "processes that plan killed: equal files", COUNT, ">=", 1.0),
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
        killed, resumed = kill_and_go_on(subject.folder, folder, settings.kills)
        start = few.duration - (one.duration - few.duration) * smaller / more
        command, command_cpu = ((getattr(one, each) - getattr(few, each)) / more for each in ("duration", "cpu"))
        figures = Bulk(
            million=start + MILLION * command,
            million_cpu=MILLION * command_cpu,
            command_cpu=command_cpu,
            peak=one.peak,
            growth=one.peak - few.peak,
            speedup=speedup,
            equal=equal,
            killed=killed,
            resumed=int(resumed),
            worker=int(kill_workers(subject.folder, folder)),
        )
        return Measured(figures, notes)


def kill_and_go_on(model: Path, folder: Path, kills: int) -> tuple[int, bool]:
    """Plan the smaller input, kill the run again and again at a random moment, and let it go on.

    Args:
        model: the bundle.
        folder: of the input.
        kills: times.

    Returns:
        How often it was killed before its end, and whether its files are those of a run that was left alone.
    """
    rng, arguments = random.Random(0), (model, folder / "few.parquet", folder / "killed", 1, SMALL_SHARD)
    alone = plan_many(model, folder / "few.parquet", folder / "alone", 1, SMALL_SHARD)
    of_shard = alone.duration / len(shards_of(folder / "alone"))
    killed = 0
    for _ in range(kills):
        with started(*arguments) as process:
            if wait_for_more(process, folder / "killed"):
                time.sleep(rng.uniform(0.0, of_shard))
            process.kill()
            killed += process.wait() == -signal.SIGKILL
    plan_many(*arguments)
    return killed, _content(folder / "killed") == _content(folder / "alone")


def kill_workers(model: Path, folder: Path) -> bool:
    """Plan the smaller input in two processes, kill both amid it, and return whether the files are as they must be."""
    with started(model, folder / "few.parquet", folder / "orphaned", 2, SMALL_SHARD) as process:
        wait_for_more(process, folder / "orphaned")
        for child in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split():
            if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                os.kill(int(child), signal.SIGKILL)
        process.wait()
    return _content(folder / "orphaned") == _content(folder / "alone")


def wait_for_more(process: subprocess.Popen[bytes], folder: Path) -> bool:
    """Wait until a run has written a shard more than there is, and return whether it goes on still."""
    before = len(shards_of(folder))
    while process.poll() is None:
        if len(shards_of(folder)) > before:
            return True
        time.sleep(0.005)
    return False


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


def plan_many(model: Path, source: Path, folder: Path, workers: int, shard: int = SHARD_COMMANDS) -> Run:
    """Run `slide-plan-many` to its end.

    Raises:
        SlideError: it failed.
    """
    begin = time.perf_counter()
    with started(model, source, folder, workers, shard) as process:
        _, status, used = os.wait4(process.pid, 0)
        duration = time.perf_counter() - begin
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in (0, 1):
        said = _said(folder).read_text().strip()
        raise SlideError(f"slide-plan-many failed with exit code {process.returncode}: {said}")
    return Run(duration, used.ru_utime + used.ru_stime, float(used.ru_maxrss * KIB))


@contextmanager
def started(model: Path, source: Path, folder: Path, workers: int, shard: int) -> Iterator[subprocess.Popen[bytes]]:
    """Start `slide-plan-many`."""
    arguments = [source, "-o", folder, "--model", model, "--workers", workers, "--shard", shard]
    with (
        _said(folder).open("wb") as said,
        subprocess.Popen(
            [sys.executable, "-c", PLAN_MANY, *map(str, arguments)],
            env=environment_with_runtime(),
            stdout=subprocess.DEVNULL,
            stderr=said,
        ) as process,
    ):
        yield process


def _said(folder: Path) -> Path:
    return folder.with_suffix(".said")


def _content(folder: Path) -> list[bytes]:
    return [file.read_bytes() for file in shards_of(folder)]


def shards_of(folder: Path) -> list[Path]:
    """Return the files of plans and failures, in order."""
    return sorted(folder.glob("*.parquet"))


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
