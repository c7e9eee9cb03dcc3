"""`slide-plan-many`: all commands planned once, whatever happens on the way."""

from __future__ import annotations

import json
import os
import random
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime import Limits, Planner, Quality
from runtime.cli.plan_many import plan_many_main

pyarrow = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")

COMMANDS = 40
SHARD = 4
PROGRAM = (
    "import sys; sys.argv[0] = 'slide-plan-many'; from runtime.cli.plan_many import plan_many_main; plan_many_main()"
)

Many = Callable[..., tuple[int, str, str]]


@pytest.fixture
def many(program: Callable[..., Many]) -> Many:
    return program(plan_many_main, "slide-plan-many")


def curve(number: int) -> np.ndarray:
    t = np.linspace(0.0, 2.0, 260 + 37 * (number % 7))
    return (0.01 + 0.0005 * number) * np.stack([1.0 - np.cos(t), np.sin(t)], axis=1)


@pytest.fixture(scope="module")
def commands(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Commands of several lengths, two of which are none."""
    path = tmp_path_factory.mktemp("many") / "commands.ndjson"
    lines = [json.dumps({"dt": 0.001, "position": curve(n).tolist()}) for n in range(COMMANDS)]
    lines[7] = '{"dt": 0.001, "position": [[0, 0], [0.1, 0.1]]}'
    lines[13] = "no JSON"
    path.write_text("\n".join(lines))
    return path


def rows(folder: Path, kind: str = "plans") -> list[dict[str, Any]]:
    return [row for file in sorted(folder.glob(f"{kind}-*.parquet")) for row in parquet.read_table(file).to_pylist()]


def content(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in sorted(folder.iterdir())}


def start(commands: Path, bundle: Path, folder: Path, *more: object, **options: Any) -> subprocess.Popen[str]:
    arguments = [commands, "-o", folder, "--model", bundle, "--shard", SHARD, *more]
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *map(str, arguments)], text=True, stderr=subprocess.PIPE, **options
    )


@pytest.fixture(scope="module")
def whole(commands: Path, bundle_path: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """What one undisturbed run writes."""
    folder = tmp_path_factory.mktemp("whole") / "plans"
    assert start(commands, bundle_path, folder, stdout=subprocess.DEVNULL).wait() == 1
    return content(folder)


def test_plans_are_those_of_the_planner_and_failures_have_place_and_reason(
    many: Many, commands: Path, planner: Planner, bundle_path: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "plans"
    code, out, err = many(commands, "-o", folder, "--model", bundle_path, "--states", "--json")
    assert code == 1
    assert f"2 of {COMMANDS} are no commands: see {folder}/failures-*.parquet" in err
    assert json.loads(out)["failures"] == 2
    failed = rows(folder, "failures")
    assert [(row["index"], row["place"]) for row in failed] == [
        (7, "commands.ndjson, line 8"),
        (13, "commands.ndjson, line 14"),
    ]
    assert failed[0]["reason"].startswith("position jumps by 0.1414 m")
    assert failed[1]["reason"].startswith("not JSON")
    good = [n for n in range(COMMANDS) if n not in (7, 13)]
    plans = planner.plan_batch([curve(n) for n in good])
    found = rows(folder)
    assert [row["index"] for row in found] == good
    for row, plan in zip(found, plans, strict=True):
        for name in ("pan_acceleration", "stop_acceleration", "pan_position", "object_velocity", "command_position"):
            np.testing.assert_array_equal(np.array(row[name]), getattr(plan, name))
        assert Quality.from_dict(json.loads(row["quality"])) == plan.quality
        assert (row["status"], row["tracking_rmse"]) == (plan.quality.status, plan.quality.tracking_rmse)


def test_finished_run_is_not_run_again_and_another_one_is_refused(
    many: Many, commands: Path, bundle_path: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "plans"
    arguments = (commands, "-o", folder, "--model", bundle_path)
    assert many(*arguments)[0] == 1
    before = content(folder), (folder / "plans-00000.parquet").stat().st_mtime_ns
    code, _, err = many(*arguments)
    assert code == 1
    assert "going on: 1 shards are written" in err
    assert before == (content(folder), (folder / "plans-00000.parquet").stat().st_mtime_ns)
    code, _, err = many(*arguments, "--reach", 0.1)
    assert code == 2
    assert f"{folder} was begun otherwise: limits.pan_reach was " in err
    assert " and is 0.1; give the same again" in err
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.tex").touch()
    assert many(commands, "-o", tmp_path / "other")[0] == 2
    assert [file.name for file in (tmp_path / "other").iterdir()] == ["thesis.tex"]
    shard = folder / "plans-00000.parquet"
    shard.write_bytes(shard.read_bytes()[:-9])
    code, _, err = many(*arguments)
    assert code == 2
    assert f"{shard}: is damaged: remove plans-00000.parquet, and the same command makes it again" in err


def test_plans_are_not_written_among_the_commands(many: Many, commands: Path, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,x,y\n0,0,0\n0.1,0.01,0\n")
    for folder in (tmp_path, tmp_path / "plans"):
        code, _, err = many(tmp_path, "-o", folder)
        assert code == 2
        assert f"{folder}: is in the folder of the commands" in err
    (tmp_path / "file").touch()
    assert "is no folder, and the plans need one" in many(commands, "-o", tmp_path / "file")[2]
    assert [file.name for file in sorted(tmp_path.iterdir())] == ["a.csv", "file"]


def test_limits_of_a_row_hold_for_its_plan(many: Many, bundle_path: Path, tmp_path: Path) -> None:
    tight = Limits().to_dict() | {"acceleration": 5.0}
    parquet.write_table(
        pyarrow.table({"position": [curve(1).tolist()] * 2, "limits": [None, tight]}), tmp_path / "a.parquet"
    )
    many(tmp_path / "a.parquet", "-o", tmp_path / "plans", "--model", bundle_path)
    loose, held = rows(tmp_path / "plans")
    assert held["acceleration_max"] <= 5.0 + 1e-9 < loose["acceleration_max"]


def test_each_row_is_planned_by_the_shipped_network_for_its_limits(many: Many, tmp_path: Path) -> None:
    path, named = tmp_path / "a.parquet", [None, "panda"]
    parquet.write_table(pyarrow.table({"position": [curve(1).tolist()] * 2, "limits": named}), path)
    many(path, "-o", tmp_path / "plans")
    planner = Planner()
    made = [planner.plan(curve(1), limits=name and Limits.named(name), candidates=1) for name in named]
    assert made[0].quality.acceleration_max > 13.0 >= made[1].quality.acceleration_max - 1e-9
    for row, plan in zip(rows(tmp_path / "plans"), made, strict=True):
        np.testing.assert_allclose(row["pan_acceleration"], plan.pan_acceleration, atol=1e-3)


def test_schema_that_does_not_fit_leaves_no_folder(many: Many, tmp_path: Path) -> None:
    parquet.write_table(pyarrow.table({"pose": [1.0]}), tmp_path / "a.parquet")
    code, _, err = many(tmp_path / "a.parquet", "-o", tmp_path / "plans")
    assert code == 2
    assert "there is no column 'position'" in err
    assert not (tmp_path / "plans").exists()


def test_number_of_processes_changes_no_bit(
    commands: Path, bundle_path: Path, whole: dict[str, bytes], tmp_path: Path
) -> None:
    assert start(commands, bundle_path, tmp_path / "plans", "--workers", 2).wait() == 1
    assert content(tmp_path / "plans") == whole


def test_run_killed_at_ten_random_moments_ends_with_the_same_bits(
    commands: Path, bundle_path: Path, whole: dict[str, bytes], tmp_path: Path
) -> None:
    folder, rng = tmp_path / "plans", random.Random(1)
    progress = []
    for _ in range(10):
        process = start(commands, bundle_path, folder, stdout=subprocess.DEVNULL)
        written = len(list(folder.glob("plans-*.parquet")))
        wait_for(lambda: process.poll() is not None or len(list(folder.glob("plans-*.parquet"))) > written)  # noqa: B023
        time.sleep(rng.uniform(0.0, 0.02))
        process.kill()
        process.wait()
        progress.append(len(list(folder.glob("plans-*.parquet"))))
    assert progress[0] < len([name for name in whole if name.startswith("plans-")])
    assert start(commands, bundle_path, folder, stdout=subprocess.DEVNULL).wait() == 1
    assert content(folder) == whole


def test_killed_process_loses_nothing(
    commands: Path, bundle_path: Path, whole: dict[str, bytes], tmp_path: Path
) -> None:
    folder = tmp_path / "plans"
    process = start(commands, bundle_path, folder, "--workers", 2, stdout=subprocess.DEVNULL)
    wait_for(lambda: any(folder.glob("plans-*.parquet")))
    for child in children(process.pid):
        child.kill()
    assert process.wait() == 1
    assert content(folder) == whole


def test_processes_end_with_the_run_that_is_killed(commands: Path, bundle_path: Path, tmp_path: Path) -> None:
    process = start(commands, bundle_path, tmp_path / "plans", "--workers", 2, stdout=subprocess.DEVNULL)
    wait_for(lambda: any((tmp_path / "plans").glob("plans-*.parquet")))
    left = children(process.pid)
    process.kill()
    process.wait()
    wait_for(lambda: not any(child.alive() for child in left))


@pytest.mark.parametrize("workers", [1, 2])
def test_interrupted_run_says_how_to_go_on(commands: Path, bundle_path: Path, workers: int, tmp_path: Path) -> None:
    process = start(
        commands,
        bundle_path,
        tmp_path / "plans",
        "--workers",
        workers,
        stdout=subprocess.DEVNULL,
        start_new_session=True,
    )
    wait_for(lambda: any((tmp_path / "plans").glob("plans-*.parquet")))
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    _, err = process.communicate()
    assert process.returncode == 130
    assert "commands are done; the same command goes on from here" in err
    assert "Traceback" not in err


def test_full_disc_leaves_whole_shards_and_says_how_to_go_on(
    commands: Path, bundle_path: Path, whole: dict[str, bytes], tmp_path: Path
) -> None:
    folder = tmp_path / "plans"
    sizes = [len(whole[f"plans-{number:05d}.parquet"]) for number in range(COMMANDS // SHARD)]
    largest = max(sizes)
    first = sizes.index(largest)

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (largest - 1, largest - 1))

    process = start(commands, bundle_path, folder, preexec_fn=limit, stdout=subprocess.DEVNULL)
    _, err = process.communicate()
    assert process.returncode == 2
    assert f"plans-{first:05d}.parquet: cannot be written: File too large" in err
    assert "which are whole. Once it can be written, the same command goes on from here" in err
    assert content(folder) == {name: data for name, data in whole.items() if name in content(folder)}
    assert len(list(folder.glob("plans-*.parquet"))) == first
    assert start(commands, bundle_path, folder, stdout=subprocess.DEVNULL).wait() == 1
    assert content(folder) == whole


def wait_for(what: Callable[[], bool], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end
        time.sleep(0.002)


class Child:
    """A process that another one has started."""

    def __init__(self, number: int) -> None:
        self.number = number

    def alive(self) -> bool:
        state = Path(f"/proc/{self.number}/stat")
        return state.exists() and state.read_text().rpartition(")")[2].split()[0] != "Z"

    def kill(self) -> None:
        with suppress(ProcessLookupError):
            os.kill(self.number, signal.SIGKILL)


def children(number: int) -> list[Child]:
    """Return the processes that plan, of a run."""
    found = Path(f"/proc/{number}/task/{number}/children").read_text().split()
    return [Child(int(child)) for child in found if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]
