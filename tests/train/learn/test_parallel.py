"""Two processes train as one: the same losses, the same weights, one checkpoint that either can go on from."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from torch import distributed as dist

from runtime.errors import InputError
from train.config import load_config
from train.learn.checkpoint import load_checkpoint
from train.learn.parallel import share
from train.learn.trainer import Trainer

ROOT = Path(__file__).parents[3]

TOGETHER = """
import json, sys
from pathlib import Path
from train.config import load_config
from train.learn.parallel import process_group, rank
from train.learn.trainer import Trainer

folder, losses = Path(sys.argv[1]), []
with process_group("cpu"):
    trainer = Trainer(load_config(sys.argv[2]), folder)
    trainer.train(lambda step: losses.append(step.loss))
    assert (len(losses) > 0) == (rank() == 0), "process 0 reports, and no other"
    if rank() == 0:
        Path(folder, "losses.json").write_text(json.dumps(losses))
"""


def torchrun(*arguments, folder):
    """Start two processes with torchrun in `folder`."""
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    return subprocess.run(
        [*command, *map(str, arguments)], capture_output=True, text=True, check=False, cwd=folder, env=environment
    )


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A configuration trained by one process in `one`, as it stood half-way in `half`; its losses, and its name."""
    folder = tmp_path_factory.mktemp("runs")
    losses = []
    trainer = Trainer(load_config("smoke"), folder / "one")
    save = trainer.save

    def save_and_keep():
        save()
        if trainer.epoch == 5:
            shutil.copytree(folder / "one", folder / "half")

    trainer.save = save_and_keep
    trainer.train(lambda step: losses.append(step.loss))
    return folder, losses, "smoke"


def assert_same_weights(one, other):
    for part in ("model", "average"):
        for name, tensor in load_checkpoint(one)[part].items():
            torch.testing.assert_close(load_checkpoint(other)[part][name], tensor, rtol=0.0, atol=1e-4)


def test_two_processes_have_the_losses_and_weights_of_one(runs):
    folder, losses, name = runs
    (folder / "together.py").write_text(TOGETHER)
    done = torchrun("together.py", folder / "two", name, folder=folder)
    assert done.returncode == 0, done.stderr
    both = json.loads((folder / "two" / "losses.json").read_text())
    assert both == pytest.approx(losses, rel=1e-4)
    assert_same_weights(folder / "one", folder / "two")
    assert len([path for path in (folder / "two" / "tensorboard").iterdir() if path.name.startswith("events")]) == 1


def test_two_processes_go_on_from_a_run_of_one_by_the_command_line(runs):
    folder, _, name = runs
    done = torchrun("-m", "train", name, "--resume", "half", "--device", "cpu", "--json", folder=folder)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["epochs"] == 10  # one object: one process speaks
    assert_same_weights(folder / "one", folder / "half")


def test_torchrun_leaves_the_short_name_of_the_runs_folder_to_us(tmp_path):
    done = torchrun("-m", "train", "smoke", "-o", "mine", "--epochs", "1", "--device", "cpu", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert load_checkpoint(tmp_path / "mine")["epoch"] == 1


def test_batch_that_cannot_be_shared_is_refused():
    with pytest.raises(InputError, match="batch: 8 trajectories cannot be shared evenly by 3 processes"):
        share(8, process=0, of=3)


def test_shares_cover_the_batch():
    rows = [row for process in range(4) for row in range(8)[share(8, process, of=4)]]
    assert rows == list(range(8))


def test_alone_nothing_is_joined():
    assert not dist.is_initialized()
    assert share(8) == slice(0, 8)
