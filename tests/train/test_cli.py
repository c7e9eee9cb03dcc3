"""`slide-train` and `slide-eval` as a person types them."""

from __future__ import annotations

import functools
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch

from runtime.network.bundle import SHIPPED
from train.cli import name_and_path, train_main


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
    assert "epoch 10, stage 4" in done.stderr
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
    assert json.loads(done.stdout)["epochs"] == 10


@pytest.mark.skipif(torch.version.cuda is not None, reason="torch could use a GPU")
def test_gpu_on_which_the_law_does_not_run_is_refused(program, monkeypatch, tmp_path):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    for device in ("cuda", "auto"):
        code, _, said = program(train_main, "slide-train")("smoke", "--device", device, "-o", tmp_path / "run")
        assert (code, len(said.strip().splitlines())) == (2, 1)
        assert "does not run on the GPU" in said
        assert "--device cpu" in said
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["smok"], "unknown configuration 'smok'"),
        (["smoke", "--epochs", "0", "--run", "x"], "epochs"),
        (["smoke", "--resume", "runs/absent"], "no such checkpoint"),
        (["smoke", "--seed", "7", "--resume", "runs/smoke"], "seed: 0 -> 7"),
        (["smoke", "--device", "cuda", "--run", "x"], "--device cpu"),
        (["paper", "--run", "x", "--init", "runs/smoke"], "its decoder_lstm.bias_hh_l0 is of shape (64,)"),
        (["default", "--run", "x", "--init", "default"], "models/default: it has no model.safetensors"),
        (["default", "--model", "B"], "model: Extra inputs are not permitted"),
        (["smoke", "--resume", "runs/smoke", "--init", "runs/smoke"], "give one of them"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(folder, arguments, words):
    done = call("slide-train", *arguments, folder=folder)
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert words in done.stderr
    assert not (folder / "x").exists()


def test_evaluation_reproduces_the_papers_figures(folder):
    done = call("slide-eval", "runs/smoke", "B=runs/smoke", "--reproduce", "docs", "--json", folder=folder)
    assert done.returncode == 0, done.stderr
    tables = json.loads(done.stdout)
    assert set(tables) == {"smoke", "smoke, lifting", "B", "B, lifting"}
    assert tables["smoke"] == tables["B"]
    row = tables["smoke"]["moves"]
    assert 0 < row["rmse_median"] <= row["rmse_worst"]
    document = (folder / "docs" / "reproduction.md").read_text()
    assert "| B | 320 trajectories; acceleration, jerk and speed held |" in document
    for picture in ("reproduction-trajectories.png", "reproduction-friction.png"):
        assert picture in document
        assert (folder / "docs" / picture).read_bytes().startswith(b"\x89PNG")


def test_two_models_of_one_name_are_refused(folder):
    done = call("slide-eval", "runs/smoke", "runs/smoke", folder=folder)
    assert done.returncode == 2
    assert "two of the models are called 'smoke'" in done.stderr


def test_shipped_bundles_go_by_their_names():
    assert name_and_path("default") == ("", SHIPPED / "default")
    assert name_and_path("best=default") == ("best", SHIPPED / "default")
    assert name_and_path("runs/a=b") == ("", Path("runs/a=b"))


def test_evaluation_of_nothing_is_refused(folder):
    done = call("slide-eval", "runs/nowhere", folder=folder)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)


@pytest.mark.parametrize(
    ("main", "arguments"),
    [
        ("train.cli.train_main", ["smoke"]),
        ("train.cli.eval_main", ["runs/smoke"]),
        ("export.cli.export_main", ["runs/smoke", "-o", "x"]),
    ],
)
@pytest.mark.parametrize("package", ["torch", "numba"])
def test_missing_extra_is_one_line_that_says_what_to_install(folder, main, arguments, package):
    module, _, function = main.rpartition(".")
    code = f"import sys; sys.modules['{package}'] = None; import {module} as m; m.{function}()"
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False, cwd=folder
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert f"{package} is not installed: pip install './[train]' in a checkout" in done.stderr


def test_interrupted_run_says_how_to_go_on(folder):
    program = Path(sys.executable).with_name("slide-train")
    arguments = ["default", "--run", "interrupted", "--device", "cpu"]
    # Python would not listen to SIGINT where a shell that started the tests in the background had it ignored.
    obey = functools.partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    with subprocess.Popen(
        [program, *arguments], cwd=folder, stderr=subprocess.PIPE, text=True, preexec_fn=obey
    ) as process:
        deadline = time.monotonic() + 120
        while not (folder / "interrupted").exists() and time.monotonic() < deadline:
            time.sleep(0.1)
        time.sleep(1)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors.strip().splitlines() == ["slide-train: interrupted after epoch 0; there is no checkpoint yet"]
