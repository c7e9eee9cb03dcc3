"""The training loop: batches from the curriculum, the two losses, checkpoints that resume bit for bit."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from torch import nn
from torch.nn.parallel import DistributedDataParallel
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn
from torch.utils.tensorboard import SummaryWriter

from runtime.errors import InputError, OutputError, SlideError
from runtime.physics.law import DT
from train.batches.batches import Drawn, draw
from train.batches.mid_course import disturb, last_acceleration
from train.config import Precision, TrainConfig
from train.curriculum import CURRICULA, Task, task_at
from train.learn.losses import Weights, loss_object, loss_pan
from train.learn.optimizer import Optimizer
from train.learn.parallel import mean_over_processes, processes, rank, share
from train.learn.validation import tracking, validate
from train.network.checkpoint import CHECKPOINT, CHECKPOINT_FORMAT, build_model
from train.network.model import Seq2Seq
from train.physics.closed_loop import Prediction, decode

SKIP_WINDOW = 100
"""Number of recent steps over which skipped ones are counted."""

SKIP_LIMIT = 20
"""More skipped steps than this in the window end the run: the weights are beyond recovery."""

OF_THE_MACHINE = {"threads", "precision"}
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


class Decoding(nn.Module):
    """`decode` as a module's forward(), around which DistributedDataParallel averages the gradients."""

    def __init__(self, model: Seq2Seq) -> None:
        super().__init__()
        self.model = model

    def forward(self, *arguments: Any) -> Prediction:
        """Decode in closed loop; see `decode`."""
        return decode(self.model, *arguments)


class Trainer:
    """A training run in a folder: `checkpoint.pt` after every epoch, TensorBoard scalars beside it.

    Several processes (`train.learn.parallel`) train as one: each has its own trainer, and process 0 writes.

    Args:
        config: what to train.
        run: folder of the run; made if need be.
        device: "cpu" or "cuda".

    Raises:
        InputError: the batch cannot be shared evenly by the processes.
    """

    def __init__(self, config: TrainConfig, run: Path, device: str = "cpu") -> None:
        torch.set_num_threads(config.threads)
        self.run, self.device = run, torch.device(device)
        self.config = config.model_copy(update={"precision": settle_precision(config.precision, self.device)})
        self.share = share(config.batch)
        self.model = build_model(config).to(self.device)
        self.decoding: nn.Module = Decoding(self.model)
        if processes() > 1:
            self.decoding = DistributedDataParallel(self.decoding)
        self.average = AveragedModel(self.model, multi_avg_fn=get_ema_multi_avg_fn(config.average))  # type: ignore[no-untyped-call]
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
            TrainingError: too many steps in a row had a gradient that is not finite.
            OutputError: a checkpoint could not be written; the one before is untouched.
        """
        purge = self.epoch * self.steps_per_epoch
        scalars = SummaryWriter(str(self.run / "tensorboard"), purge_step=purge) if rank() == 0 else nullcontext()
        with scalars as writer, ThreadPoolExecutor(1) as pool:
            while self.epoch < self.config.epochs:
                for step, task, drawn in self._batches(pool):
                    progress = self.step(step, task, drawn)
                    if writer is not None:
                        report(progress)
                        if step % 10 == 0:
                            self._log(writer, progress)
                self.epoch += 1
                if writer is not None:
                    self._end_epoch(writer)

    def _end_epoch(self, writer: SummaryWriter) -> None:
        self.validation = validate(self.evaluated_model(), self.config, self.device)
        for name, value in self.validation.items():
            writer.add_scalar(f"validation/{name}", value, self.epoch * self.steps_per_epoch)
        self.save()

    def _batches(self, pool: ThreadPoolExecutor) -> Iterator[tuple[int, Task, Drawn]]:
        """Yield one epoch's steps; the next batch is drawn in another thread while the network works on this one.

        Everything random about a step follows from (seed, step), so a resumed run draws what it would have drawn.
        """
        task = task_at(CURRICULA[self.config.curriculum], self.config.model, self.epoch + 1, self.config.epochs)

        def draw_step(step: int) -> tuple[int, Task, Drawn]:
            drawn = draw(self.config, task, np.random.default_rng([self.config.seed, step]))
            return step, task, drawn.rows(self.share)

        first = self.epoch * self.steps_per_epoch
        pending = pool.submit(draw_step, first)
        for step in range(first, first + self.steps_per_epoch):
            drawn = pending.result()
            if step + 1 < first + self.steps_per_epoch:
                pending = pool.submit(draw_step, step + 1)
            yield drawn

    def step(self, step: int, task: Task, drawn: Drawn) -> Progress:
        """Take one step of the optimizer; a gradient that is not finite skips it.

        Args:
            step: its number in the whole run.
            task: what this epoch trains on.
            drawn: this process's share of the batch.

        Raises:
            TrainingError: too many recent steps were skipped.
        """
        config = self.config
        batch = drawn.batch.to(self.device)
        self.optimizer.set_rate(learning_rate(config, step / self.steps))

        with torch.autocast(self.device.type, torch.bfloat16, enabled=config.precision == "bfloat16"):
            if drawn.disturbance is not None:
                batch = disturb(self.model, batch, drawn.disturbance)
            law = batch.static, batch.kinetic
            motion = self.decoding(batch.command, *law, not drawn.pan_loss, batch.before, batch.noise)
        if drawn.pan_loss:
            assert batch.pan_position is not None
            loss = loss_pan(motion.states, motion.covariance, batch.pan_position, batch.mask)
        else:
            loss = loss_object(
                motion.states,
                motion.u,
                motion.covariance,
                batch.object_position,
                batch.mask,
                loss_weights(config, task),
                None if batch.before is None else last_acceleration(batch.before),
            )

        self.optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        norm = torch.nn.utils.clip_grad_norm_(self.model.parameters(), config.gradient_clip)
        # What is decided on is the same in every process, or their weights would part.
        whole = torch.stack([loss.detach(), *tracking(motion.states.detach(), batch)])
        value, error, reach = mean_over_processes(whole).tolist()
        if bool(torch.isfinite(norm)) and math.isfinite(value):
            self.optimizer.step()
            self.average.update_parameters(self.model)
        else:
            self._count_skip(step)

        return Progress(self.epoch + 1, step + 1, self.steps, task.stage, value, error, reach, self.skipped)

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

    def evaluated_model(self) -> Seq2Seq:
        """Return the network to use: the moving average of the weights where the configuration asks for one."""
        return cast(Seq2Seq, self.average.module) if self.config.average > 0 else self.model

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
        self.began_with = checkpoint.get("began_with")  # older checkpoints lack it


def loss_weights(config: TrainConfig, task: Task) -> Weights:
    """Return the weights of the loss L in `task`."""
    gamma = config.late_gamma if task.late and config.late_gamma is not None else config.gamma
    return Weights(
        alpha=config.alpha,
        beta=config.beta,
        gamma=gamma,
        pan_limit=config.pan_limit - config.pan_margin,
        tracking=config.tracking,
        jerk=config.jerk,
        largest_change=config.jerk_limit * DT,
        braking=config.braking,
    )


def settle_precision(precision: Precision, device: torch.device) -> Precision:
    """Return bfloat16 for "auto" where the hardware multiplies it natively, else float32: emulated it is 6 x slower."""
    if precision != "auto":
        return precision
    if device.type == "cuda":
        native = torch.cuda.is_bf16_supported(including_emulation=False)
    else:
        native = bool(torch.cpu.get_capabilities().get("avx512_bf16"))
    return "bfloat16" if native else "float32"


def learning_rate(config: TrainConfig, progress: float) -> float:
    """Cosine decay from `learning_rate` to `final_learning_rate` over progress in [0, 1]."""
    share = 0.5 * (1.0 + math.cos(math.pi * progress))
    return config.final_learning_rate + (config.learning_rate - config.final_learning_rate) * share
