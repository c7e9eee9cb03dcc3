"""The results as tables of at most 80 columns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

from rich import box
from rich.console import Console
from rich.table import Table

from benchmarks.harness.machine import Machine
from benchmarks.harness.targets import Verdict
from benchmarks.harness.timing import Spread
from benchmarks.sections.accuracy import PAN_REACH, Accuracy, Figures
from benchmarks.sections.control import Control
from benchmarks.sections.long import Endurance
from benchmarks.sections.refine import BUDGET, Refinement
from benchmarks.sections.speed import LAW_BATCHES, PlanningSpeed, Speed
from runtime.cli.console import MM
from runtime.cli.plan import PAPER_SAMPLES_PER_SECOND

if TYPE_CHECKING:  # it imports torch, which may not be installed
    from benchmarks.sections.training import Training

WIDTH = 80

Rows = Iterable[Sequence[str]]


def print_tables(tables: Iterable[Table]) -> None:
    """Print tables on standard output, WIDTH columns wide."""
    console = Console(width=WIDTH, markup=False, highlight=False)
    for table in tables:
        console.print(table)


def machine_table(machine: Machine, versions: Mapping[str, str | None], model: Mapping[str, object]) -> Table:
    """Return what was measured, on what."""
    load = "" if machine.load is None else f", load {machine.load:.1f}"
    rows = [
        ("model", "{name}, {layers} x {units} units, {precision}, sha256 {sha256:.12}".format(**model)),
        ("processor", f"{machine.cpu}, {machine.cores} cores{load}"),
        ("flags", " ".join(machine.flags) or "unknown"),
        ("system", f"{machine.system} {machine.architecture}"),
        ("versions", ", ".join(f"{name} {version}" for name, version in versions.items() if version)),
    ]
    return table("slide-bench", ("", ""), rows, numbers=False)


def accuracy_tables(accuracy: Accuracy, verdicts: Sequence[Verdict]) -> list[Table]:
    """Return the accuracy of each family, and what is asked of it."""
    rows = {name: each for name, each in accuracy.families.items() if name != "friction"}
    rows["together"] = accuracy.total
    if "friction" in accuracy.families:
        rows["friction"] = accuracy.families["friction"]
    tables = [
        table(
            "Tracking RMSE (mm)",
            ("family", "commands", "mean", "median", "95 %", "worst", "worst command"),
            [_tracking_row(name, each) for name, each in rows.items()],
        ),
        table(
            "Pan reach (mm), pan acceleration u (m/s^2), planning speed",
            ("family", "mean", "worst", f"<= {PAN_REACH * MM:.0f}", "max |u|", "mean |u|", "mean |du|", "samples/s"),
            [_pan_row(name, each) for name, each in rows.items()],
        ),
    ]
    if accuracy.friction:
        tables.append(_friction_table(accuracy))
    return [*tables, *_figures_tables("Asked of the accuracy", verdicts)]


def _tracking_row(name: str, figures: Figures) -> tuple[str, ...]:
    lengths = (figures.tracking_mean, figures.tracking_median, figures.tracking_p95, figures.tracking_max)
    return (name, f"{figures.commands}", *(f"{length * MM:.2f}" for length in lengths), figures.worst)


def _pan_row(name: str, figures: Figures) -> tuple[str, ...]:
    return (
        name,
        f"{figures.pan_reach_mean * MM:.0f}",
        f"{figures.pan_reach_max * MM:.0f}",
        f"{figures.pan_reach_share:.0%}",
        f"{figures.acceleration_max:.1f}",
        f"{figures.acceleration_mean:.2f}",
        f"{figures.change_mean:.3f}",
        f"{figures.samples_per_second:,.0f}",
    )


def _friction_table(accuracy: Accuracy) -> Table:
    static = sorted({cell.static for cell in accuracy.friction})
    kinetic = sorted({cell.kinetic for cell in accuracy.friction})
    means = {(cell.static, cell.kinetic): f"{cell.tracking_mean * MM:.2f}" for cell in accuracy.friction}
    return table(
        "Mean tracking RMSE (mm) of `spline` by friction",
        ("kinetic \\ static", *(f"{each:g}" for each in static)),
        [(f"{row:g}", *(means.get((column, row), "") for column in static)) for row in kinetic],
    )


def speed_tables(speed: Speed, verdicts: Sequence[Verdict]) -> list[Table]:
    """Return the speed of planning, beside what is asked of it."""
    law = speed.law
    details = {
        "speed.single.samples_per_second.median": _planning_rows(speed.single),
        "speed.batch.samples_per_second.median": _planning_rows(speed.batch),
        **({"speed.compiled.samples_per_second.median": _planning_rows(speed.compiled)} if speed.compiled else {}),
        **({"speed.large.samples_per_second.median": _planning_rows(speed.large)} if speed.large else {}),
        "speed.slide_plan.median": [("  10 % to 90 %", _span(speed.slide_plan, "{:.2f}"))],
    }
    network = speed.network
    extra = (
        []
        if network is None
        else [
            ("decoder step (ms)", f"{network.step.median * 1e3:.3f}"),
            ("  over torch eager", f"{network.step_ratio_to_torch:.2f} x"),
            ("  the encoder included", f"{network.ratio_to_torch:.2f} x"),
        ]
    )
    extra += [
        (f"law of {law.samples} samples, scalar (ms)", f"{law.scalar * 1e3:.3f}"),
        (f"  batched, {LAW_BATCHES[-1]} at once, each", f"{law.batched * 1e3:.3f}"),
        ("  batched wins from", f"> {LAW_BATCHES[-1]}" if law.crossover is None else f"{law.crossover}"),
    ]
    return _figures_tables("Speed, one thread", verdicts, details, extra)


def _planning_rows(speed: PlanningSpeed) -> list[tuple[str, str]]:
    ours, torch = speed.samples_per_second, speed.torch_samples_per_second
    rows = [
        ("  10 % to 90 %", _span(ours, "{:,.0f}")),
        (f"  over the paper's {PAPER_SAMPLES_PER_SECOND:g}", f"{ours.median / PAPER_SAMPLES_PER_SECOND:,.0f} x"),
    ]
    if torch is not None:
        rows += [("  torch eager", f"{torch.median:,.0f}"), ("  over torch eager", f"{speed.ratio_to_torch:.2f} x")]
    return rows


def control_tables(control: Control, verdicts: Sequence[Verdict]) -> list[Table]:
    """Return what a controller has to count on, beside what is asked of it."""
    details = {
        "control.step.p99": [(f"  99.9 % of {control.step.count:,}", f"{control.step.p999 * 1e3:.2f}")],
        "control.first_plan.median": [("  10 % to 90 %", _span(control.first_plan, "{:.2f}"))],
    }
    return _figures_tables("In a controller, one thread", verdicts, details)


def refine_tables(refinement: Refinement, verdicts: Sequence[Verdict]) -> list[Table]:
    """Return what refinement does to each family, beside what is asked of it."""
    rows = [
        (
            name,
            f"{each.commands}",
            f"{each.before * MM:.2f}",
            f"{each.after * MM:.2f}",
            f"{each.after / each.before - 1.0:+.0%}",
            "" if each.optimizer is None else f"{each.optimizer * MM:.2f}",
            f"{each.pan_reach_max * MM:.0f}",
        )
        for name, each in refinement.families.items()
    ]
    title = f"Refinement in {BUDGET:g} ms ({refinement.time * 1e3:.0f} ms a plan), mean tracking RMSE (mm)"
    header = ("family", "commands", "before", "after", "change", "optimizer", "reach")
    return [table(title, header, rows), *_figures_tables("Asked of refinement", verdicts)]


def long_tables(endurance: Endurance, verdicts: Sequence[Verdict]) -> list[Table]:
    """Return the error of long commands by window, the memory, and how a disturbed loop recovers."""
    names = list(endurance.short)
    rows = [("short commands", "", *(f"{endurance.short[name] * MM:.2f}" for name in names), "")]
    for each in endurance.windows:
        errors = (f"{each.families[name] * MM:.2f}" for name in names)
        chunks = "trained on" if each.chunks is None else f"{each.chunks}"
        rows.append((chunks, f"{each.unread}", *errors, f"{each.ratio:.2f}"))
    loop = endurance.recovery
    details = {
        "long.windows.0.ratio": [
            (f"  memory for {endurance.seconds / 3:g} s (MB)", f"{endurance.memory_third * 1e-6:.1f}"),
            (f"  memory for {endurance.seconds:g} s (MB)", f"{endurance.memory * 1e-6:.1f}"),
        ],
        "long.recovery.ratio": [
            ("  undisturbed, a chunk (mm)", f"{loop.nominal * MM:.2f}"),
            ("  under noise (mm)", f"{loop.noisy * MM:.2f}"),
            ("  third chunk after the push (mm)", f"{loop.after * MM:.2f}"),
            ("  runs back under 2 x within 3 chunks (%)", f"{loop.recovered * 100:.0f}"),
        ],
    }
    title = f"Commands of {endurance.seconds:g} s: mean tracking RMSE of each 1.2 s (mm)"
    header = ("window (chunks)", "unread", *names, "worst")
    return [table(title, header, rows), *_figures_tables("Asked of long commands", verdicts, details)]


def training_tables(training: Training, verdicts: Sequence[Verdict]) -> list[Table]:
    """Return the cost of a training step, beside what is asked of it."""
    steps = [("  10 % to 90 %", _span(training.step, "{:.3f}"))]
    if training.step_float32 is not None:
        steps.append(("  in float32", f"{training.step_float32.median:.3f}"))
    details = {
        "training.step.median": steps,
        "training.friction_share": [("  friction and its adjoint (s)", f"{training.friction.median:.4f}")],
    }
    size = f"{training.batch} x {training.samples} samples, {training.units} units"
    title = f"Training step, one thread: {size}, {training.precision}"
    rows = [
        (
            each.configuration,
            f"{each.units}",
            f"{each.batch} x {each.samples}, {each.precision}",
            f"{each.step:.2f}",
            f"{each.epoch / 60.0:.1f}",
            f"{each.steps:,}",
            f"{each.duration / 3600.0:.1f}",
        )
        for each in training.projections
    ]
    header = ("configuration", "units", "step", "s/step", "min/epoch", "steps", "hours")
    whole = table("Whole trainings on one thread, projected from a few steps", header, rows)
    return [*_figures_tables(title, verdicts, details), whole]


def _figures_tables(
    title: str, verdicts: Sequence[Verdict], details: Mapping[str, Rows] = MappingProxyType({}), extra: Rows = ()
) -> list[Table]:
    """Return a table of figures with what is asked of them, each followed by its details; none if it were empty."""
    rows: list[Sequence[str]] = []
    for verdict in verdicts:
        target = verdict.target
        unit = f" ({target.unit})" if target.unit else ""
        mark = "met" if verdict.met else "MISSED"
        rows.append((target.what + unit, target.text(verdict.value), target.asked, mark))
        rows += [(*row, "", "") for row in details.get(target.figure, ())]
    rows += [(*row, "", "") for row in extra]
    return [table(title, ("", "measured", "asked", ""), rows)] if rows else []


def _span(spread: Spread, show: str) -> str:
    return f"{show.format(spread.p10)} to {show.format(spread.p90)}"


def table(title: str, header: Sequence[str], rows: Rows, numbers: bool = True) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE, show_header=any(header))
    for index, name in enumerate(header):
        table.add_column(name, justify="right" if numbers and index else "left", overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table
