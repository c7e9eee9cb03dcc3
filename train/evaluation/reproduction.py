"""The paper's evaluation, drawn again: Fig. 8 (trajectories) and Fig. 11 (errors over friction), and their table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime import Friction
from runtime.cli.console import MM
from runtime.errors import MissingExtraError, OutputError, install_line
from train.commands.families import FloatArray
from train.evaluation import arm
from train.evaluation.arm import ArmRow
from train.evaluation.evaluate import Subject, commands_of, evaluate, still_rmse

ArmRows = Mapping[str, Mapping[str, ArmRow]]
"""By a model's name, then by the way it was executed."""

STATIC = (0.4, 0.6, 0.8, 1.0, 1.2, 1.4)
KINETIC = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
TRAJECTORIES_PER_CELL = 10

FAMILY = "spline_acceleration"
"""The paper's own kind of command: B-spline accelerations (Section IV-B)."""

SHOWN = 3
"""The command of the family that the trajectories and snapshots are of."""

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
LOWEST, STILL_PANS = 1.0, 1.5
"""Errors at which the colours of the friction table begin (mm) and end (in errors of a pan that never moves)."""


def reproduce(subjects: Sequence[Subject], folder: Path, arm_rows: ArmRows | None = None) -> list[Path]:
    """Write `reproduction.md` and its pictures into `folder`.

    Args:
        subjects: the models to compare, in the order in which they are shown.
        folder: made if need be.
        arm_rows: what `evaluate_on_arm` gave for each model; without it the arm in pybullet is left out.

    Returns:
        The files written.

    Raises:
        MissingExtraError: matplotlib, or for the arm pybullet, is not installed.
        OutputError: a file could not be written.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingExtraError(f"pictures need matplotlib: {install_line('report')}") from error
    try:
        folder.mkdir(parents=True, exist_ok=True)
        figures = {
            "reproduction-trajectories.png": _trajectories(Figure, subjects),
            "reproduction-friction.png": _friction(Figure, subjects),
        }
        arm_section = ""
        if arm_rows:
            arm_figures, arm_section = _arm(Figure, subjects, arm_rows)
            figures |= arm_figures
        for name, figure in figures.items():
            figure.savefig(folder / name, dpi=110)
        text = folder / "reproduction.md"
        text.write_text(_document(subjects) + arm_section, encoding="utf-8")
    except OSError as error:
        raise OutputError(f"cannot write to {folder}: {error.strerror}") from error
    return [text, *(folder / name for name in figures)]


def _trajectories(figure_class: Any, subjects: Sequence[Subject]) -> Any:
    """Fig. 8: object and pan positions of every model for one command of K = 1200."""
    position = commands_of(FAMILY)[SHOWN : SHOWN + 1]
    drawn = []
    for subject in subjects:
        (plan,) = subject.plan(position, Friction())
        drawn.append((subject.name, plan.object_position, plan.pan_position))
    return _draw_models(figure_class, position[0], drawn)


def _draw_models(figure_class: Any, position: FloatArray, drawn: Sequence[tuple[str, FloatArray, FloatArray]]) -> Any:
    """Draw a (K, 2) command with the name, object positions and pan positions of each model, (K, 2) (m)."""
    time = np.arange(len(position)) * 1e-3
    figure = figure_class(figsize=(10, 7), layout="constrained")
    axes = figure.subplots(2, 3, width_ratios=(1.1, 1.1, 1))
    for row, what in enumerate(("Object, relative to the pan", "Pan")):
        for column, coordinate in enumerate("xy"):
            axes[row, column].set(xlabel="time (s)", ylabel=f"{coordinate} (mm)", title=f"{what}: {coordinate}")
        axes[row, 2].set(xlabel="x (mm)", ylabel="y (mm)", title=f"{what.split(',')[0]}, from above", aspect="equal")
        axes[row, 2].set_adjustable("datalim")
    _draw(axes[0], time, position, color="black", linestyle="--", label="command")
    for (name, object_position, pan_position), colour in zip(drawn, cycle(COLOURS), strict=False):
        _draw(axes[0], time, object_position, color=colour, label=name)
        _draw(axes[1], time, pan_position, color=colour, label=name)
    angle = np.linspace(0, 2 * np.pi, 200)
    axes[1, 2].plot(200 * np.cos(angle), 200 * np.sin(angle), color="gray", linewidth=0.8, label="0.2 m")
    axes[0, 0].legend(loc="best", fontsize=8)
    axes[1, 2].legend(loc="best", fontsize=8)
    return figure


def _draw(axes: Any, time: NDArray[np.floating[Any]], position: FloatArray, **style: object) -> None:
    millimetres = MM * position
    axes[0].plot(time, millimetres[:, 0], **style)
    axes[1].plot(time, millimetres[:, 1], **style)
    axes[2].plot(millimetres[:, 0], millimetres[:, 1], **style)


def _friction(figure_class: Any, subjects: Sequence[Subject]) -> Any:
    """Fig. 11: mean reproduction error over static x kinetic friction, the same trajectories in every cell."""
    from matplotlib.colors import LogNorm

    position = commands_of(FAMILY, TRAJECTORIES_PER_CELL)
    tables = [_friction_table(subject, position) for subject in subjects]
    figure = figure_class(figsize=(3.6 * len(subjects) + 1.2, 4.2), layout="constrained")
    # Logarithmic, for models are apart by more than ten times; a still pan's error is the yardstick, far beyond which
    # there is nothing to tell.
    still = still_rmse(position).mean()
    highest = STILL_PANS * MM * float(still)
    for axes, subject, table in zip(np.atleast_1d(figure.subplots(1, len(subjects))), subjects, tables, strict=True):
        image = axes.imshow(table, origin="lower", norm=LogNorm(LOWEST, highest, clip=True), cmap="viridis")
        axes.set(title=f"{subject.name}: RMS error (mm)", xlabel="static friction", ylabel="kinetic friction")
        axes.set_xticks(range(len(STATIC)), [f"{value:g}" for value in STATIC])
        axes.set_yticks(range(len(KINETIC)), [f"{value:g}" for value in KINETIC])
        for (row, column), value in np.ndenumerate(table):
            if np.isfinite(value):
                colour = "black" if image.norm(value) > 0.6 else "white"
                axes.text(column, row, f"{value:.1f}", ha="center", va="center", color=colour, fontsize=8)
    figure.colorbar(image, ax=figure.axes, shrink=0.8, label="mm", extend="max")
    return figure


def _friction_table(subject: Subject, position: FloatArray) -> FloatArray:
    """Mean tracking RMSE (mm), kinetic by static; not a number where kinetic friction would exceed static."""
    table = np.full((len(KINETIC), len(STATIC)), np.nan)
    for row, kinetic in enumerate(KINETIC):
        for column, static in enumerate(STATIC):
            if kinetic <= static:
                plans = subject.plan(position, Friction(static, kinetic))
                table[row, column] = MM * np.mean([plan.quality.tracking_rmse for plan in plans])
    return table


def _arm(figure_class: Any, subjects: Sequence[Subject], arm_rows: ArmRows) -> tuple[dict[str, Any], str]:
    """Figs. 9 and 10, and a table: what the arm in pybullet makes of the models."""
    runs = [arm.photograph(subject, commands_of(FAMILY)[SHOWN]) for subject in subjects]
    drawn = [(each.name, each.object_position, each.pan_position) for each in runs]
    figures = {
        "reproduction-arm-trajectories.png": _draw_models(figure_class, commands_of(FAMILY)[SHOWN], drawn),
        "reproduction-arm-snapshots.png": arm.draw_snapshots(figure_class, runs),
    }
    return (
        figures,
        f"""
## Fig. 9: reproduced trajectories on the arm in pybullet

Written by `slide-eval RUN ... --reproduce docs/results --pybullet`. The friction in pybullet is 0.5, static and
kinetic, and the models are not told; they plan for 1.0/0.5. The trajectories are executed open loop, as in the paper;
an object's line ends where it falls off the pan or topples.

![Object and pan positions of each model on the arm](reproduction-arm-trajectories.png)

## Fig. 10: snapshots

The blue line on the pan is the command, the green dot where the object should be.

![Snapshots of each model on the arm](reproduction-arm-snapshots.png)

## The arm over {arm.COMMANDS} commands

Root of the mean squared distance between object and command, over {arm.COMMANDS} commands. In closed loop the network
sees the measured states every 100 ms; paper control is the controller of Fig. 7 without feed-forward and gravity terms.

{arm.arm_table(arm_rows)}
""",
    )


def _document(subjects: Sequence[Subject]) -> str:
    rows = [
        "| | trained | tracking RMSE, mean | median | worst | pan reach, mean | worst | mean change of u per sample |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for subject in subjects:
        row = evaluate(subject, FAMILY)
        rows.append(
            f"| {subject.name} | {subject.origin} | {MM * row.rmse_mean:.1f} mm | {MM * row.rmse_median:.1f} mm "
            f"| {MM * row.rmse_worst:.1f} mm | {row.reach_mean:.3f} m | {row.reach_worst:.3f} m "
            f"| {row.change_mean:.2f} m/s² |"
        )
    position = commands_of(FAMILY)
    still = float(still_rmse(position).mean())
    return f"""# The paper's evaluation, reproduced

Written by `slide-eval RUN ... --reproduce docs/results`; figures over 64 commands whose acceleration is a B-spline
(Section IV-B), K = 1200, friction 1.0/0.5. A pan that never moves has an error of {MM * still:.1f} mm on them.

{chr(10).join(rows)}

Model A is trained by the whole curriculum, model B by stage 3 alone, model C by stage 1 alone (Section V-B). A bundle
plans with its limits in force, a run's checkpoint without any.

## Fig. 8: reproduced trajectories

In the paper B moves neither pan nor object, C moves the object and its pan over one metre, and A moves the object
within a small range of the pan.

![Object and pan positions of each model](reproduction-trajectories.png)

## Fig. 11: errors over friction

Each cell is the mean over {TRAJECTORIES_PER_CELL} trajectories, the same in every cell. The paper's networks are not
told the friction, a bundle is. Cells in which kinetic friction would exceed static friction are empty. In the paper the
errors of A are as small as those of C and hardly change with the friction, and those of B are large.

![Tracking error over static and kinetic friction](reproduction-friction.png)
"""
