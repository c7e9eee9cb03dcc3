"""The training loop: it learns, resumes bit for bit, survives bad gradients and a full disk."""

from __future__ import annotations

import multiprocessing
import os
import shutil

import pytest
import torch

from runtime.errors import FormatError, InputError, OutputError
from train.config import load_config
from train.learn.checkpoint import CHECKPOINT, load_checkpoint
from train.learn.recipe import cosine_decay
from train.learn.trainer import SKIP_LIMIT, Trainer, TrainingError, moving_average
from train.network.recipe import NetworkRecipe


@pytest.fixture(scope="module")
def smoke_run(tmp_path_factory):
    """A finished run of the smoke configuration, and the folder it stood in after two of its ten epochs."""
    folder = tmp_path_factory.mktemp("runs")
    steps = []
    trainer = Trainer(load_config("smoke"), folder / "whole")
    save = trainer.save

    def save_and_keep():
        save()
        if trainer.epoch == 2:
            shutil.copytree(folder / "whole", folder / "half")

    trainer.save = save_and_keep
    trainer.train(steps.append)
    return folder, steps


def test_run_reports_every_step_and_leaves_a_checkpoint_and_scalars(smoke_run):
    folder, steps = smoke_run
    config = load_config("smoke")
    assert [step.step for step in steps] == list(range(1, config.epochs * (config.trajectories // config.batch) + 1))
    assert [steps[i].stage for i in (0, -1)] == [1, 4]
    checkpoint = load_checkpoint(folder / "whole")
    assert checkpoint["epoch"] == config.epochs
    assert any(path.name.startswith("events") for path in (folder / "whole" / "tensorboard").iterdir())


def test_resumed_run_is_the_same_to_the_last_bit(smoke_run):
    folder, _ = smoke_run
    resumed = Trainer(load_config("smoke"), folder / "half")
    resumed.resume(load_checkpoint(folder / "half"))
    assert resumed.epoch == 2
    resumed.train()
    whole, again = load_checkpoint(folder / "whole"), load_checkpoint(folder / "half")
    assert again["epoch"] == whole["epoch"]
    for part in ("model", "average"):
        for name, tensor in whole[part].items():
            assert torch.equal(tensor, again[part][name]), (part, name)


def test_several_workers_draw_what_one_draws(smoke_run, tmp_path):
    folder, _ = smoke_run
    shutil.copytree(folder / "half", tmp_path / "run")
    trainer = Trainer(load_config("smoke").model_copy(update={"workers": 3}), tmp_path / "run")
    trainer.resume(load_checkpoint(tmp_path / "run"))
    trainer.train()
    whole, again = load_checkpoint(folder / "whole"), load_checkpoint(tmp_path / "run")
    assert all(torch.equal(tensor, again["model"][name]) for name, tensor in whole["model"].items())


def test_run_whose_worker_is_killed_ends_in_one_line_and_can_be_resumed(tmp_path, capfd):
    config = load_config("smoke").model_copy(update={"workers": 3})
    trainer = Trainer(config, tmp_path / "run")

    def kill_a_worker(progress):
        if progress.epoch == 3:
            multiprocessing.active_children()[0].kill()

    with pytest.raises(TrainingError, match=r"drawing batches ended in epoch \d+ \(.*3 workers") as raised:
        trainer.train(kill_a_worker)
    assert "\n" not in str(raised.value)
    assert capfd.readouterr().err == ""
    assert load_checkpoint(tmp_path / "run")["epoch"] >= 2


def test_what_a_worker_cannot_draw_is_told_in_one_line(tmp_path):
    trainer = Trainer(load_config("smoke"), tmp_path / "run")
    trainer.share = slice(0, 3)
    with pytest.raises(InputError, match=r"^batch: its 8 groups cannot be shared evenly by this many processes$"):
        trainer.train()


def test_resume_of_another_configuration_is_refused_and_the_difference_named(smoke_run):
    folder, _ = smoke_run
    other = Trainer(load_config("smoke", seed=5), folder / "half")
    with pytest.raises(InputError, match="seed: 0 -> 5"):
        other.resume(load_checkpoint(folder / "half"))


class Poisoned(NetworkRecipe):
    """The recipe of a configuration, with losses that are not finite in the given steps."""

    def __init__(self, config, steps):
        super().__init__(config)
        self.steps, self.calls = steps, 0

    def outcome(self, decoding, drawn, device):
        self.calls += 1
        found = super().outcome(decoding, drawn, device)
        return found._replace(loss=found.loss * float("nan")) if self.calls in self.steps else found


def test_step_with_a_gradient_that_is_not_finite_is_skipped_and_counted(tmp_path):
    config = load_config("smoke").model_copy(update={"epochs": 1, "trajectories": 64})
    trainer = Trainer(config, tmp_path, recipe=Poisoned(config, {1, 3}))
    steps = []
    trainer.train(steps.append)
    assert [step.skipped for step in steps] == [1, 1, 2, 2]
    assert all(torch.isfinite(weight).all() for weight in trainer.model.parameters())
    assert load_checkpoint(tmp_path)["skipped"] == 2


def test_too_many_bad_gradients_end_the_run(tmp_path):
    config = load_config("smoke", epochs=20)
    trainer = Trainer(config, tmp_path, recipe=Poisoned(config, set(range(1000))))
    with pytest.raises(TrainingError, match=f"{SKIP_LIMIT + 1} of the last 100 steps"):
        trainer.train()


def test_failed_write_leaves_the_checkpoint_before_whole(smoke_run, tmp_path, monkeypatch):
    folder, _ = smoke_run
    shutil.copytree(folder / "half", tmp_path / "run")
    before = (tmp_path / "run" / CHECKPOINT).read_bytes()
    trainer = Trainer(load_config("smoke"), tmp_path / "run")

    def full(state, path):
        path.write_bytes(b"half a checkpoint")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(torch, "save", full)
    with pytest.raises(OutputError, match="No space left"):
        trainer.save()
    assert (tmp_path / "run" / CHECKPOINT).read_bytes() == before
    assert not [path for path in (tmp_path / "run").iterdir() if path.suffix == ".tmp"]


def test_checkpoint_that_is_none_is_refused(tmp_path):
    with pytest.raises(FormatError, match="no such checkpoint"):
        load_checkpoint(tmp_path)
    (tmp_path / CHECKPOINT).write_bytes(b"not a checkpoint")
    with pytest.raises(FormatError, match="not a readable checkpoint"):
        load_checkpoint(tmp_path)
    torch.save({"format": "slide-checkpoint/0"}, tmp_path / CHECKPOINT)
    with pytest.raises(FormatError, match="slide-checkpoint/2"):
        load_checkpoint(tmp_path)


def test_checkpoint_cannot_run_code(tmp_path):
    class Evil:
        def __reduce__(self):
            return os.system, (f"touch {tmp_path}/ran",)

    torch.save({"format": "slide-checkpoint/2", "config": Evil()}, tmp_path / CHECKPOINT)
    with pytest.raises(FormatError):
        load_checkpoint(tmp_path)
    assert not (tmp_path / "ran").exists()


def test_average_forgets_the_weights_that_a_run_began_with():
    averages, weights = [torch.tensor([100.0])], [torch.tensor([1.0])]
    move = moving_average(0.998)
    for count in range(1, 100):
        move(averages, weights, count)
    assert averages[0].item() == pytest.approx(1.0, abs=0.01)
    weights[0] += 1.0
    move(averages, weights, 100_000)
    assert averages[0].item() == pytest.approx(1.002, abs=0.01)


def test_learning_rate_falls_along_a_cosine():
    rates = [cosine_decay(1e-3, 1e-5, progress) for progress in (0.0, 0.5, 1.0)]
    assert rates == pytest.approx([1e-3, 0.5 * (1e-3 + 1e-5), 1e-5])
