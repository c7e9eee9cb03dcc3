"""Where `slide-plan` writes: every format, standard output, links, pipes; nothing half-written."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from runtime import Plan

ROOT = Path(__file__).parents[3]
EXAMPLE = ROOT / "examples" / "figure_eight.csv"
PLAN = "import sys; sys.argv[0] = 'slide-plan'; from runtime.cli.plan import plan_main; plan_main()"

Shell = Callable[[str], subprocess.CompletedProcess[str]]


@pytest.fixture
def shell(tmp_path: Path) -> Shell:
    """Run a line of bash in an empty folder, in which `plan` plans the example."""

    def call(line: str) -> subprocess.CompletedProcess[str]:
        command = shlex.join([sys.executable, "-c", PLAN, str(EXAMPLE)])
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
        environment["PYTHONPATH"] = str(ROOT)
        return subprocess.run(
            ["bash", "-c", f'plan() {{ {command} "$@"; }}; {line}'],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=120,
        )

    return call


@pytest.mark.parametrize("output", ["-", "/dev/stdout", "/dev/fd/1"])
def test_the_plan_goes_to_standard_output_and_the_table_to_standard_error(shell: Shell, output: str) -> None:
    done = shell(f"plan -o {output}")
    assert done.returncode == 0
    assert len(Plan.from_dict(json.loads(done.stdout))) == 1200
    assert "tracking RMSE" in done.stderr
    done = shell(f"plan -o {output} --json > plan.json")
    assert json.loads(done.stderr)["samples"] == 1200


def test_a_pipe_takes_the_plan(shell: Shell, tmp_path: Path) -> None:
    done = shell(
        "plan -o >(gzip > plan.json.gz; echo > done) && until [ -e done ]; do sleep 0.05; done; gunzip -c plan.json.gz"
    )
    assert done.returncode == 0
    assert '{"format": "slide-plan/' in done.stdout
    assert "tracking RMSE" in done.stdout


def test_a_reader_of_the_plan_that_goes_away_is_no_traceback(shell: Shell) -> None:
    done = shell("plan -o - 2> said | head -c 10; code=${PIPESTATUS[0]}; echo; echo $code; cat said")
    assert done.stdout.splitlines()[:2] == ['{"format":', "141"]
    assert "Traceback" not in done.stdout


@pytest.mark.parametrize("suffix", [".json", ".npz", ".csv", ".parquet"])
def test_every_format_is_written(shell: Shell, tmp_path: Path, suffix: str) -> None:
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    assert shell(f"plan -o plan{suffix}").returncode == 0
    assert [each.name for each in tmp_path.iterdir()] == [f"plan{suffix}"]
    if suffix in (".json", ".npz"):
        assert len(Plan.load(tmp_path / f"plan{suffix}")) == 1200


@pytest.mark.parametrize(
    ("output", "message"),
    [
        ("plan.yaml", "a plan is written as .json, .npz, .csv or .parquet, got the suffix '.yaml'"),
        ("absent/plan.json", "there is no folder absent"),
        ("/dev/full", "No space left on device"),
        ("a", "Too many levels of symbolic links"),
    ],
)
def test_what_cannot_be_written_is_one_line(shell: Shell, tmp_path: Path, output: str, message: str) -> None:
    done = shell(f"ln -s b a; ln -s a b; plan -o {output}")
    assert done.returncode == 2
    assert done.stderr.startswith("slide-plan: error: ")
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert sorted(each.name for each in tmp_path.iterdir()) == ["a", "b"]


def test_links_and_modes_stay(shell: Shell, tmp_path: Path) -> None:
    assert (
        shell(
            "umask 027; plan -o real.json; chmod 604 real.json; ln -s real.json link.json; plan -o link.json"
        ).returncode
        == 0
    )
    assert (tmp_path / "link.json").is_symlink()
    assert oct((tmp_path / "real.json").stat().st_mode)[-3:] == "604"
    assert len(Plan.load(tmp_path / "real.json")) == 1200
