"""`slide-train` and `slide-eval` as a person types them."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest


def call(program, *arguments, folder):
    """Run an installed program in `folder`."""
    path = Path(sys.executable).with_name(program)
    return subprocess.run([path, *arguments], capture_output=True, text=True, check=False, cwd=folder)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder in which the smoke configuration was trained."""
    folder = tmp_path_factory.mktemp("user")
    done = call("slide-train", "smoke", "--device", "cpu", folder=folder)
    assert done.returncode == 0, done.stderr
    assert "slide-export runs/smoke" in done.stdout
    assert "epoch 5, stage 5" in done.stderr
    return folder


def test_second_run_does_not_overwrite_the_first(folder):
    done = call("slide-train", "smoke", folder=folder)
    assert done.returncode == 2
    words = "slide-train: error: runs/smoke holds a run already: continue it with --resume runs/smoke"
    assert done.stderr.startswith(words)
    assert done.stderr.count("\n") == 1


def test_finished_run_resumes_to_the_same_answer(folder):
    done = call("slide-train", "smoke", "--resume", "runs/smoke", "--json", folder=folder)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["epochs"] == 5


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["smok"], "unknown configuration 'smok'"),
        (["smoke", "--epochs", "0", "--run", "x"], "epochs"),
        (["smoke", "--resume", "runs/absent"], "no such checkpoint"),
        (["smoke", "--seed", "7", "--resume", "runs/smoke"], "seed: 0 -> 7"),
        (["smoke", "--device", "cuda", "--run", "x"], "--device cpu"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(folder, arguments, words):
    done = call("slide-train", *arguments, folder=folder)
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert words in done.stderr
    assert not (folder / "x").exists()


def test_evaluation_reproduces_the_papers_figures(folder):
    done = call("slide-eval", "runs/smoke", "runs/smoke", "--reproduce", "docs", "--json", folder=folder)
    assert done.returncode == 0, done.stderr
    row = json.loads(done.stdout)["smoke"]["moves"]
    assert 0 < row["rmse_median"] <= row["rmse_worst"]
    document = (folder / "docs" / "reproduction.md").read_text()
    for picture in ("reproduction-trajectories.png", "reproduction-friction.png"):
        assert picture in document
        assert (folder / "docs" / picture).read_bytes().startswith(b"\x89PNG")


def test_evaluation_of_nothing_is_refused(folder):
    done = call("slide-eval", "runs/nowhere", folder=folder)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
