"""The command line: `slide-bench`.

Exit codes: 0 every figure measured is what is asked for, 1 one is missed (said in one line), 2 bad input or usage.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks.harness.machine import Machine, this_machine, versions
from benchmarks.harness.targets import Verdict, judge
from benchmarks.sections import accuracy, control, speed
from benchmarks.sections import long as endurance
from benchmarks.sections import refine as refinement
from runtime.cli.console import DONE_BUT_MISSED, AsJson, print_json, run, say
from runtime.documents.files import check_writable, write_whole
from runtime.errors import install_line
from runtime.friction import Friction
from runtime.planner import Planner

NAME = "slide-bench"
FORMAT = "slide-bench/1"

TRAIN_EXTRA = install_line("train")


class Section(StrEnum):
    """What can be measured by itself."""

    ACCURACY = "accuracy"
    SPEED = "speed"
    CONTROL = "control"
    REFINE = "refine"
    LONG = "long"
    TRAINING = "training"


TIMED = {Section.SPEED, Section.CONTROL, Section.REFINE, Section.TRAINING}
"""What a busy machine spoils."""


def bench_main() -> None:
    """Entry point of `slide-bench`."""
    # OpenMP reads this when torch loads it. With threads that spin while they wait, torch is slower by a multiple as
    # soon as anything else runs, and a comparison with it would be a straw man.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    run(NAME, slide_bench)


def slide_bench(
    model: Annotated[
        Path | None, typer.Option("--model", help="Bundle folder; the shipped one if not given.", metavar="DIR")
    ] = None,
    only: Annotated[
        list[Section] | None,
        typer.Option(
            "--only", help="accuracy, speed, control, refine, long or training; may be repeated.", metavar="SECTION"
        ),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File to write the JSON object to.", metavar="FILE")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Measure accuracy on the suite, speed beside torch eager, a controller's deadlines, refinement beside the
    optimizer, long and disturbed commands, and a training step."""
    if output is not None:
        check_writable(output)
    machine, planner = this_machine(), Planner(model)
    sections, notes = measure(only or list(Section), planner, model)
    if machine.busy and TIMED & set(sections):
        notes.append(f"the load was {machine.load:.1f} when this began: timings on a busy machine say little")
    results = document(machine, planner, sections, notes)
    verdicts = judge(results)
    results["targets"] = [verdict.to_dict() for verdict in verdicts]
    if output is not None:
        write_whole(output, json.dumps(results, indent=2, allow_nan=False).encode() + b"\n")
    if as_json:
        print_json(results)
    else:
        _print_results(machine, results["model"], sections, verdicts)
    for note in notes:
        say(NAME, f"note: {note}")
    _conclude(verdicts)


def measure(chosen: list[Section], planner: Planner, model: Path | None) -> tuple[dict[Section, Any], list[str]]:
    """Measure the chosen sections, in their own order.

    Returns:
        The figures of each section, and what is to be said of those that were left out.
    """
    sections: dict[Section, Any] = {}
    notes: list[str] = []
    if Section.ACCURACY in chosen:
        _progress("accuracy on the suite")
        sections[Section.ACCURACY] = accuracy.measure_suite(accuracy.network(planner))
    if Section.LONG in chosen:
        _progress("long commands")
        try:
            sections[Section.LONG] = endurance.measure(planner)
        except ModuleNotFoundError as error:
            notes.append(f"long is left out: {error.name} is not installed; {TRAIN_EXTRA}")
    if not TIMED & set(chosen):
        return sections, notes
    with one_torch_thread() as missing:
        if Section.SPEED in chosen:
            _progress("speed")
            eager = None if missing else _eager_planner(model)
            sections[Section.SPEED] = speed.measure(planner, eager, model)
            if missing:
                notes.append(f"torch eager is left out: {missing} is not installed; {TRAIN_EXTRA}")
        if Section.CONTROL in chosen:
            _progress("a controller's figures")
            sections[Section.CONTROL] = control.measure(planner, model)
        if Section.REFINE in chosen:
            _progress("refinement")
            peer = None if missing else _optimizer()
            sections[Section.REFINE] = refinement.measure_refinement(planner, peer)
            if missing:
                notes.append(f"the optimizer is left out: {missing} is not installed; {TRAIN_EXTRA}")
        if Section.TRAINING in chosen and missing:
            notes.append(f"training is left out: {missing} is not installed; {TRAIN_EXTRA}")
        elif Section.TRAINING in chosen:
            _progress("training step")
            from benchmarks.sections import training

            sections[Section.TRAINING] = training.measure()
    return sections, notes


@contextmanager
def one_torch_thread() -> Iterator[str]:
    """Run torch on one thread; yields the name of the package that is missing for it, "" if none is."""
    try:
        import torch

        import benchmarks.peers.torch_eager
        import benchmarks.sections.training  # noqa: F401
    except ModuleNotFoundError as error:
        yield error.name or "torch"
        return
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    with suppress(RuntimeError):  # can be set once, before the first of them starts; then nothing here uses them
        torch.set_num_interop_threads(1)
    try:
        yield ""
    finally:
        torch.set_num_threads(threads)


def _eager_planner(model: Path | None) -> Planner:
    from benchmarks.peers.torch_eager import EagerPlanner

    return EagerPlanner(model)


def _optimizer() -> accuracy.PlanFunction:
    from benchmarks.peers.cross_entropy import CrossEntropy

    optimizer = CrossEntropy()
    position = np.zeros((10, 2))
    optimizer([position], [Friction()])  # compiles
    return optimizer


def document(machine: Machine, planner: Planner, sections: Mapping[Section, Any], notes: list[str]) -> dict[str, Any]:
    """Return the results as a JSON document, SI units throughout; a section that was not measured is absent."""
    manifest = planner.bundle.manifest
    return {
        "format": FORMAT,
        "model": {
            "name": manifest.name,
            "sha256": planner.bundle.sha256,
            "layers": manifest.layers,
            "units": manifest.units,
            "precision": manifest.precision,
        },
        "machine": asdict(machine),
        "versions": versions(),
        **{section.value: asdict(figures) for section, figures in sections.items()},
        "notes": notes,
    }


def _print_results(
    machine: Machine, model: Mapping[str, object], sections: Mapping[Section, Any], verdicts: list[Verdict]
) -> None:
    from benchmarks.harness import tables

    print_section: dict[Section, Callable[..., list[Any]]] = {
        Section.ACCURACY: tables.accuracy_tables,
        Section.SPEED: tables.speed_tables,
        Section.CONTROL: tables.control_tables,
        Section.REFINE: tables.refine_tables,
        Section.LONG: tables.long_tables,
        Section.TRAINING: tables.training_tables,
    }
    tables.print_tables([tables.machine_table(machine, versions(), model)])
    for section, figures in sections.items():
        own = [verdict for verdict in verdicts if verdict.target.figure.startswith(f"{section.value}.")]
        tables.print_tables(print_section[section](figures, own))


def _progress(what: str) -> None:
    """Say on a terminal what is being measured; no bar, whose drawing would be measured too."""
    if sys.stderr.isatty():
        say(NAME, f"measuring {what} ...")


def _conclude(verdicts: list[Verdict]) -> None:
    """Say which figures were missed; one makes the exit code 1."""
    missed = [str(verdict) for verdict in verdicts if not verdict.met]
    if missed:
        say(NAME, f"missed {len(missed)} of {len(verdicts)}: {'; '.join(missed)}")
        raise typer.Exit(DONE_BUT_MISSED)
