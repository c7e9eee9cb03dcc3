"""The training loop, whatever the recipe: steps, checkpoints that resume bit for bit, several processes as one."""

from __future__ import annotations

import math
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.parallel import DistributedDataParallel
from torch.optim.swa_utils import AveragedModel
from torch.utils.data import DataLoader, Dataset
from torch.utils.tensorboard import SummaryWriter

from runtime.errors import InputError, OutputError, SlideError
from train.config import AnyConfig
from train.learn.checkpoint import CHECKPOINT, CHECKPOINT_FORMAT
from train.learn.optimizer import Optimizer
from train.learn.parallel import mean_over_processes, processes, rank, share
from train.learn.recipe import Recipe
from train.recipes import recipe_of
from train.run_config import Precision

# torch warns of more processes than there are cores: how many there are is the configuration's to say.
warnings.filterwarnings("ignore", message="This DataLoader will create")

SKIP_WINDOW = 100
"""Number of recent steps over which skipped ones are counted."""

SKIP_LIMIT = 20
"""More skipped steps than this in the window end the run: the weights are beyond recovery."""

OF_THE_MACHINE = {"threads", "precision", "workers"}
"""Keys of a configuration that a resumed run may change: they say how it is computed, not what is learned."""


class TrainingError(SlideError):
    """Training cannot go on."""


class Progress(NamedTuple):
    """What a run reports after each step; errors and reach in metres."""

    epoch: int
    step: int
    steps: int
    stage: int
    loss: float
    tracking: float
    pan_reach: float
    skipped: int


class Draws(Dataset[tuple[int, Any]]):
    """What a process draws, by the number of the step."""

    def __init__(self, recipe: Recipe, steps: int, rows: slice) -> None:
        self.recipe, self.steps, self.rows = recipe, steps, rows

    def __getitem__(self, step: int) -> tuple[int, Any]:
        """Return the number and this process's share of the step's batch, or what is wrong with it.

        If that were raised here, torch would make many lines of it.
        """
        try:
            return step, self.recipe.draw(step, self.steps, self.rows)
        except SlideError as error:
            return step, error


def _draw_quietly(worker: int) -> None:
    """Begin a process that draws: it does not tell of batches that nobody took, for the run has ended then."""
    sys.excepthook = lambda *_: None  # only the thread that hands them over comes here; all else goes to the run


class Trainer:
    """A training run in a folder: `checkpoint.pt` after every epoch, TensorBoard scalars beside it.

    Several processes (`train.learn.parallel`) train as one: each has its own trainer, and process 0 writes.

    Args:
        config: what to train.
        run: folder of the run; made if need be.
        device: "cpu" or "cuda".
        recipe: how; the configuration's own if None.

    Raises:
        InputError: the batch cannot be shared evenly by the processes.
    """

    def __init__(self, config: AnyConfig, run: Path, device: str = "cpu", recipe: Recipe | None = None) -> None:
        torch.set_num_threads(config.threads)
        self.run, self.device = run, torch.device(device)
        self.config = config.model_copy(update={"precision": resolve_precision(config.precision, self.device)})
        self.share = share(config.batch)
        self.recipe = recipe or recipe_of(self.config)
        self.model = self.recipe.build().to(self.device)
        self.decoding: nn.Module = self.recipe.decoding(self.model)
        if processes() > 1:
            self.decoding = DistributedDataParallel(self.decoding)
        self.average = AveragedModel(self.model, multi_avg_fn=moving_average(config.average))
        self.optimizer = Optimizer(self.model, config.optimizer, config.learning_rate)
        self.steps_per_epoch = config.trajectories // config.batch
        self.epoch = 0
        self.skipped = 0
        self.recent_skips: list[int] = []
        self.validation: dict[str, float] = {}
        self.began_with: dict[str, str] | None = None
        """Name and sha256 of the run or the bundle whose weights this one began with; None if it drew its own."""

    @property
    def steps(self) -> int:
        """Number of steps of the whole run."""
        return self.steps_per_epoch * self.config.epochs

    def train(self, report: Callable[[Progress], None] = lambda _: None) -> None:
        """Train to the configuration's last epoch, from wherever the run stands.

        Raises:
            TrainingError: too many steps in a row had a gradient that is not finite, or a process that draws ended.
            OutputError: a checkpoint could not be written; the one before is untouched.
        """
        purge = self.epoch * self.steps_per_epoch
        scalars = SummaryWriter(str(self.run / "tensorboard"), purge_step=purge) if rank() == 0 else nullcontext()
        with scalars as writer, self._watching_workers():
            batches = self._batches()
            while self.epoch < self.config.epochs:
                for step, drawn in islice(batches, self.steps_per_epoch):
                    progress = self.step(step, drawn)
                    if writer is not None:
                        report(progress)
                        if step % 10 == 0:
                            self._log(writer, progress)
                self.epoch += 1
                if writer is not None:
                    self._end_epoch(writer)

    def _end_epoch(self, writer: SummaryWriter) -> None:
        self.validation = self.recipe.validate(self.evaluated_model(), self.device)
        for name, value in self.validation.items():
            writer.add_scalar(f"validation/{name}", value, self.epoch * self.steps_per_epoch)
        self.save()

    def _batches(self) -> Iterator[tuple[int, Any]]:
        """Yield the steps to come; batches are drawn ahead in other processes while the network works on this one.

        Everything random about a step follows from (seed, step), so a resumed run draws what it would have drawn.
        """
        steps = range(self.epoch * self.steps_per_epoch, self.steps)
        draws = Draws(self.recipe, self.steps, self.share)
        # A dataset's length is never asked for: the sampler names the steps.
        count = self.config.workers
        batches = DataLoader(draws, sampler=steps, batch_size=None, num_workers=count, worker_init_fn=_draw_quietly)
        for step, drawn in batches:
            if isinstance(drawn, SlideError):
                raise drawn
            yield step, drawn

    @contextmanager
    def _watching_workers(self) -> Iterator[None]:
        """End the run in a TrainingError if a process that draws batches ends before its time.

        torch tells of it by a RuntimeError, wherever the run is at that moment.
        """
        try:
            yield
        except RuntimeError as error:
            if not str(error).startswith("DataLoader worker"):
                raise
            told = str(error).partition("\n")[0].strip(" .")
            raise TrainingError(
                f"a process drawing batches ended in epoch {self.epoch + 1} ({told}), maybe for want of memory: each "
                f"of the {self.config.workers} workers takes some; the last good checkpoint, if any, is in {self.run}"
            ) from error

    def step(self, step: int, drawn: Any) -> Progress:
        """Take one step of the optimizer; a gradient that is not finite skips it.

        Args:
            step: its number in the whole run.
            drawn: this process's share of the batch, as the recipe draws it.

        Raises:
            TrainingError: too many recent steps were skipped.
        """
        self.optimizer.set_rate(self.recipe.learning_rate(step, self.steps))
        loss, *figures = self.recipe.outcome(self.decoding, drawn, self.device)
        self.optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        norm = torch.nn.utils.clip_grad_norm_(self.model.parameters(), self.config.gradient_clip)
        # What is decided on is the same in every process, or their weights would part.
        value, error, reach = mean_over_processes(torch.stack([loss.detach(), *figures])).tolist()
        if bool(torch.isfinite(norm)) and math.isfinite(value):
            self.optimizer.step()
            self.average.update_parameters(self.model)
        else:
            self._count_skip(step)

        stage = self.recipe.stage(step, self.steps)
        return Progress(self.epoch + 1, step + 1, self.steps, stage, value, error, reach, self.skipped)

    def _count_skip(self, step: int) -> None:
        self.skipped += 1
        self.recent_skips = [s for s in self.recent_skips if s > step - SKIP_WINDOW] + [step]
        if len(self.recent_skips) > SKIP_LIMIT:
            raise TrainingError(
                f"{len(self.recent_skips)} of the last {SKIP_WINDOW} steps had a gradient that is not finite (limit "
                f"{SKIP_LIMIT}), at step {step} of epoch {self.epoch + 1}; the last good checkpoint is in {self.run}"
            )

    def _log(self, writer: SummaryWriter, progress: Progress) -> None:
        for name in ("loss", "tracking", "pan_reach", "stage", "skipped"):
            writer.add_scalar(f"train/{name}", getattr(progress, name), progress.step)

    def evaluated_model(self) -> nn.Module:
        """Return the network to use: the moving average of the weights where the configuration asks for one."""
        return self.average.module if self.config.average > 0 else self.model

    def save(self) -> None:
        """Write the run's checkpoint, whole or not at all.

        Raises:
            OutputError: it could not be written.
        """
        path = self.run / CHECKPOINT
        temporary = path.with_suffix(".tmp")
        try:
            self.run.mkdir(parents=True, exist_ok=True)
            torch.save(self._state(), temporary)
            os.replace(temporary, path)
        except (OSError, RuntimeError) as error:
            temporary.unlink(missing_ok=True)
            raise OutputError(f"cannot write the checkpoint {path}: {error}") from error

    def _state(self) -> dict[str, Any]:
        return {
            "format": CHECKPOINT_FORMAT,
            "config": self.config.model_dump(mode="json"),
            "epoch": self.epoch,
            "model": self.model.state_dict(),
            "average": self.average.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "skipped": self.skipped,
            "recent_skips": self.recent_skips,
            "began_with": self.began_with,
        }

    def resume(self, checkpoint: dict[str, Any]) -> None:
        """Continue from `checkpoint`, as read by `load_checkpoint`, on this machine, however many processes.

        Raises:
            InputError: it belongs to another configuration; the differences are named.
        """
        mine, theirs = self.config.model_dump(mode="json"), checkpoint["config"]
        learned = [key for key in mine if key not in OF_THE_MACHINE]
        differences = [
            f"{key}: {theirs.get(key)!r} -> {mine[key]!r}" for key in learned if mine[key] != theirs.get(key)
        ]
        if differences:
            raise InputError(f"the run in {self.run} has another configuration: {'; '.join(differences)}")
        self.model.load_state_dict(checkpoint["model"])
        self.average.load_state_dict(checkpoint["average"])
        self.optimizer.load_state_dict(checkpoint["optimizer"])
        self.epoch, self.skipped = checkpoint["epoch"], checkpoint["skipped"]
        self.recent_skips = checkpoint["recent_skips"]
        self.began_with = checkpoint["began_with"]


def moving_average(decay: float) -> Callable[[Sequence[Tensor], Sequence[Tensor], Tensor | int], None]:
    """Return what moves averages towards weights, by 1 - `decay` a step; faster at first, to forget the beginning."""

    @torch.no_grad()
    def move(averages: Sequence[Tensor], weights: Sequence[Tensor], count: Tensor | int) -> None:
        share = 1.0 - min(decay, (1.0 + float(count)) / (10.0 + float(count)))
        for average, weight in zip(averages, weights, strict=True):
            average.lerp_(weight, share)

    return move


def resolve_precision(precision: Precision, device: torch.device) -> Precision:
    """Return bfloat16 for "auto" where the hardware multiplies it natively, else float32: emulated it is 6 x slower."""
    if precision != "auto":
        return precision
    if device.type == "cuda":
        native = torch.cuda.is_bf16_supported(including_emulation=False)
    else:
        native = bool(torch.cpu.get_capabilities().get("avx512_bf16"))
    return "bfloat16" if native else "float32"
