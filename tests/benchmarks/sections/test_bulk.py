"""The section on many commands: runs that are killed, and what is left of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.harness.section import Subject
from benchmarks.sections.bulk import (
    SMALL_SHARD,
    BulkSettings,
    kill_and_go_on,
    kill_workers,
    measure_bulk,
    plan_many,
    write_commands,
)
from runtime.errors import InputError, SlideError

pytest.importorskip("pyarrow")


def test_killed_runs_end_with_the_files_of_one_that_was_left_alone(tiny_bundle: Path, tmp_path: Path) -> None:
    write_commands(tmp_path / "few.parquet", 4 * SMALL_SHARD)
    killed, equal = kill_and_go_on(tiny_bundle, tmp_path, 2)
    assert 1 <= killed <= 2
    assert equal
    assert len(list((tmp_path / "alone").glob("plans-*.parquet"))) == 4
    assert kill_workers(tiny_bundle, tmp_path)


def test_failing_run_and_too_few_commands_are_refused(tiny_bundle: Path, tmp_path: Path) -> None:
    with pytest.raises(SlideError, match=r"exit code 2: .*there is no such file"):
        plan_many(tiny_bundle, tmp_path / "none.parquet", tmp_path / "plans", 1)
    with pytest.raises(InputError, match="--total must be at least 10000"):
        measure_bulk(Subject.load(tiny_bundle), BulkSettings(total=9_999))
