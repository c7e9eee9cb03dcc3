"""The command line: `slide-train` and `slide-eval`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from runtime.cli.console import MM, AsJson, print_json, run, say
from runtime.errors import InputError, OutputError, extra
from runtime.interrupt import interrupted
from runtime.network.bundle import bundle_path

if TYPE_CHECKING:
    from train.config import AnyConfig
    from train.evaluation.arm import ArmRow
    from train.evaluation.evaluate import Row, Subject
    from train.learn.trainer import Trainer


class Device(StrEnum):
    """Where to train."""

    AUTO = "auto"
    CPU = "cpu"
    CUDA = "cuda"


class PrecisionName(StrEnum):
    """Of the network's matrix products while training; auto takes bfloat16 where the hardware has it."""

    AUTO = "auto"
    FLOAT32 = "float32"
    BFLOAT16 = "bfloat16"


class ModelName(StrEnum):
    """The models of Section V-B."""

    A = "A"
    B = "B"
    C = "C"


def train_main() -> None:
    """Entry point of `slide-train`."""
    run("slide-train", slide_train)


def eval_main() -> None:
    """Entry point of `slide-eval`."""
    run("slide-eval", slide_eval)


def slide_train(
    config: Annotated[str, typer.Argument(help="default, smoke, paper, or a .json file.", show_default=False)],
    run_folder: Annotated[
        Path | None,
        typer.Option("--run", "-o", help="Folder of the run; runs/CONFIG[-MODEL] if not given.", metavar="DIR"),
    ] = None,
    resume: Annotated[
        Path | None, typer.Option("--resume", help="Continue the run in this folder.", metavar="RUN")
    ] = None,
    init: Annotated[
        Path | None,
        typer.Option(
            "--init", help="Begin with the weights of this run, or of a bundle that has them.", metavar="RUN_OR_BUNDLE"
        ),
    ] = None,
    model: Annotated[ModelName | None, typer.Option(help="Of paper: model A, B or C of its Section V-B.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the weights and of all that is drawn.")] = None,
    epochs: Annotated[int | None, typer.Option(help="Epochs over which the curriculum is stretched.")] = None,
    threads: Annotated[int | None, typer.Option(help="CPU threads.")] = None,
    precision: Annotated[PrecisionName | None, typer.Option(help="Of the network's matrix products.")] = None,
    device: Annotated[Device, typer.Option(help="Where to train.")] = Device.AUTO,
    as_json: AsJson = False,
) -> None:
    """Train a network; each epoch leaves a checkpoint from which --resume continues."""
    with extra("train"):
        from train.config import load_config
    settings = load_config(
        config,
        model=None if model is None else model.value,
        seed=seed,
        epochs=epochs,
        threads=threads,
        precision=None if precision is None else precision.value,
    )
    if resume is not None and run_folder is not None:
        raise InputError("--run and --resume both name the run's folder: give one of them")
    if resume is not None and init is not None:
        raise InputError("--init and --resume both say what to begin with: give one of them")
    folder = resume or run_folder or Path("runs") / _run_name(settings)

    with extra("train"):
        from train.learn.checkpoint import CHECKPOINT, load_checkpoint
        from train.learn.parallel import process_group
        from train.learn.trainer import Trainer
        from train.learn.warm_start import begin_with

    if resume is None and (folder / CHECKPOINT).exists():
        raise OutputError(f"{folder} holds a run already: continue it with --resume {folder}, or give another --run")
    checkpoint = None if resume is None else load_checkpoint(resume)
    if checkpoint is not None and settings.precision == "auto":
        settings = settings.model_copy(update={"precision": checkpoint["config"].get("precision", "auto")})
    where = _device(device)
    with process_group(where):
        trainer = Trainer(settings, folder, where)
        if checkpoint is not None:
            trainer.resume(checkpoint)
        elif init is not None:
            begin_with(trainer, bundle_path(init))
        _train(trainer, folder, as_json)


def _train(trainer: Trainer, folder: Path, as_json: bool) -> None:
    """Train, and say what came of it; process 0 speaks for all."""
    from train.learn.checkpoint import CHECKPOINT
    from train.learn.parallel import rank
    from train.paper.config import PaperConfig

    try:
        with _progress(trainer, quiet=as_json or rank() > 0) as report:
            trainer.train(_until_interrupted(report))
    except KeyboardInterrupt:
        then = f"continue with --resume {folder}" if trainer.epoch else "there is no checkpoint yet"
        if rank() == 0:
            say("slide-train", f"interrupted after epoch {trainer.epoch}; {then}")
        raise
    summary = {
        "checkpoint": str(folder / CHECKPOINT),
        "epochs": trainer.epoch,
        "steps_skipped": trainer.skipped,
        "validation": trainer.validation,
    }
    if rank() > 0:
        return
    if as_json:
        print_json(summary)
    else:
        paper = isinstance(trainer.config, PaperConfig)
        then = f"evaluate it with  slide-eval {folder}" if paper else f"export it with  slide-export {folder} -o BUNDLE"
        print(f"{summary['checkpoint']}: {then}")


def _until_interrupted(report: Callable[[Any], None]) -> Callable[[Any], None]:
    """Return what shows a step, and ends the training if Ctrl-C was dropped during it."""

    def checked(step: Any) -> None:
        if interrupted():
            raise KeyboardInterrupt
        report(step)

    return checked


def _run_name(config: AnyConfig) -> str:
    model = getattr(config, "model", "A")
    return config.name if model == "A" else f"{config.name}-{model}"


def _device(device: Device) -> str:
    """Return where to train: on a GPU only if the law runs there.

    Raises:
        InputError: it was asked for, and there is none or the law does not run on it.
    """
    import torch

    if device is Device.AUTO:
        device = Device.CUDA if torch.cuda.is_available() else Device.CPU
    elif device is Device.CUDA and not torch.cuda.is_available():
        raise InputError("--device cuda: torch finds no CUDA device here; use --device cpu")
    if device is Device.CUDA:
        from train.physics.rollout import STATE, rollout

        try:
            one = torch.ones(1, dtype=torch.float64, device="cuda")
            rollout(one.new_zeros(1, STATE), one.new_zeros(1, 1, 3), one, one)
        except Exception as error:  # of torch, of numba, or of whatever numba compiles with
            told = f"{type(error).__name__}: {str(error).partition(chr(10))[0]}"
            raise InputError(
                f"--device cuda: the law of friction does not run on the GPU ({told}); numba's part for it is the "
                "package numba-cuda, which may want an older NumPy. Or use --device cpu"
            ) from error
    return device.value


@contextmanager
def _progress(trainer: Trainer, quiet: bool) -> Iterator[Any]:
    """Give a function that shows a step: a progress bar on a terminal, a line an epoch elsewhere."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True, highlight=False)
    if quiet:
        yield lambda step: None
    elif not console.is_terminal:
        yield lambda step: None if step.step % trainer.steps_per_epoch else print(_figures(step), file=sys.stderr)
    else:
        columns = (TextColumn("{task.description}"), BarColumn(None), MofNCompleteColumn(), TimeRemainingColumn())
        with Progress(*columns, console=console) as bar:
            task = bar.add_task("", total=trainer.steps, completed=trainer.epoch * trainer.steps_per_epoch)
            yield lambda step: bar.update(task, completed=step.step, description=_figures(step))


def _figures(step: Any) -> str:
    skipped = f", {step.skipped} skipped" if step.skipped else ""
    return (
        f"epoch {step.epoch}, stage {step.stage}: loss {step.loss:.2f}, "
        f"error {step.tracking * MM:.1f} mm, reach {step.pan_reach * MM:.0f} mm{skipped}"
    )


def slide_eval(
    sources: Annotated[
        list[str],
        typer.Argument(
            help="Runs, checkpoints or bundles, each with a name if you like: A=runs/paper, default.",
            show_default=False,
        ),
    ],
    reproduce: Annotated[
        Path | None, typer.Option(help="Write the paper's evaluation into this folder.", metavar="DIR")
    ] = None,
    pybullet: Annotated[
        bool, typer.Option("--pybullet", help="Execute on the simulated arm too; takes minutes.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Evaluate networks on every family of commands they may be given, under nominal friction."""
    with extra("train"):
        from train.commands.families import FAMILIES
        from train.evaluation.evaluate import evaluate, load_subjects
    subjects = [each for name, path in map(name_and_path, sources) for each in load_subjects(path, name)]
    names = [subject.name for subject in subjects]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"two of the models are called {twice!r}: give one another name, as in best=FOLDER")
    arm_tables = _on_arm(subjects) if pybullet else {}
    if reproduce is not None:
        from train.evaluation.reproduction import reproduce as write_reproduction

        for path in write_reproduction(subjects, reproduce, arm_tables):
            say("slide-eval", f"wrote {path}")
    tables = {subject.name: {family: evaluate(subject, family) for family in FAMILIES} for subject in subjects}
    if as_json:
        document = {name: {family: row._asdict() for family, row in table.items()} for name, table in tables.items()}
        for name, rows in arm_tables.items():
            document[name] |= {way: row._asdict() for way, row in rows.items()}
        print_json(document)
        return
    for name, table in tables.items():
        _print_rows(name, table)
        if pybullet:
            _print_arm_rows(name, arm_tables[name])


def name_and_path(source: str) -> tuple[str, Path]:
    """Take NAME=PATH apart; a path alone may hold the sign in its folders."""
    name, sign, path = source.partition("=")
    return (name, bundle_path(path)) if sign and "/" not in name else ("", bundle_path(source))


def _on_arm(subjects: Sequence[Subject]) -> dict[str, dict[str, ArmRow]]:
    from train.evaluation.arm import COMMANDS, evaluate_on_arm
    from train.evaluation.evaluate import commands_of

    position = commands_of("spline_acceleration", COMMANDS)
    return {subject.name: evaluate_on_arm(subject, position) for subject in subjects}


def _print_rows(name: str, rows: Mapping[str, Row]) -> None:
    lines = []
    for family, row in rows.items():
        figures = (row.rmse_mean, row.rmse_median, row.rmse_worst, row.still_mean, row.reach_mean, row.reach_worst)
        lines.append([family, *(f"{figure * MM:.1f}" for figure in figures)])
    columns = ["commands", "RMSE mean", "median", "worst", "still pan", "reach mean", "worst"]
    _print_columns(f"{name} (mm)", columns, lines)


def _print_arm_rows(name: str, rows: Mapping[str, ArmRow]) -> None:
    lines = []
    for way, row in rows.items():
        figures = (row.rmse_mean, row.rmse_median, row.rmse_worst, row.pan_worst)
        lines.append([way, *(f"{figure * MM:.2f}" for figure in figures), str(row.lost), str(row.held_back)])
    columns = ["spline_acceleration", "RMSE mean", "median", "worst", "pan worst", "lost", "at limits"]
    _print_columns(f"{name} on the simulated arm (mm, runs)", columns, lines)


def _print_columns(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE)
    table.add_column(columns[0], no_wrap=True)
    for column in columns[1:]:
        table.add_column(column, justify="right")
    for row in rows:
        table.add_row(*row)
    Console(markup=False, highlight=False).print(table)
