"""The command line: `slide-bench`, or `python -m benchmarks`.

Exit codes: 0 every target is met, 1 one is not (said in one line), 2 bad input or usage, or nothing can be measured.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import Field, asdict, dataclass, field, fields, make_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, get_origin, get_type_hints

import typer

from benchmarks.harness.machine import Machine, this_machine, versions
from benchmarks.harness.markdown import write_into
from benchmarks.harness.section import NAME, Section, Subject
from benchmarks.harness.tables import machine_table, print_tables
from benchmarks.harness.targets import Verdict, judge
from benchmarks.sections import (
    accuracy,
    arm,
    best,
    bulk,
    control,
    joints,
    long,
    page,
    peers,
    refine,
    server,
    site,
    speed,
    training,
)
from runtime.cli.console import DONE_BUT_MISSED, AsJson, print_json, run, say
from runtime.documents.writing import check_writable, write_whole
from runtime.errors import InputError, MissingExtraError

FORMAT = "slide-bench/2"

SECTIONS: dict[str, Section[Any, Any]] = {
    module.SECTION.name: module.SECTION
    for module in (accuracy, speed, control, refine, long, training, peers, best, arm, joints, bulk, server, site, page)
}
"""The sections by their names, in the order in which they are measured."""

USUAL = tuple(name for name, section in SECTIONS.items() if section.usual)
"""Those that are measured where none is named."""


@dataclass(frozen=True)
class Results:
    """What was measured of one bundle.

    Attributes:
        subject: the bundle.
        machine: what it was measured on.
        figures: of each section that was not left out, by its name.
        verdicts: on these, by the section's name.
        notes: what was left out, and what spoils the figures.
    """

    subject: Subject
    machine: Machine
    figures: Mapping[str, Any]
    verdicts: Mapping[str, Sequence[Verdict]]
    notes: Sequence[str]

    @property
    def model(self) -> dict[str, Any]:
        """What the bundle says of itself."""
        bundle = self.subject.planner.bundle
        names = ("name", "layers", "units", "precision")
        return {name: getattr(bundle.manifest, name) for name in names} | {"sha256": bundle.sha256}

    @property
    def judged(self) -> list[Verdict]:
        """The figures for which a target is set."""
        return [each for verdicts in self.verdicts.values() for each in verdicts if each.met is not None]

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON document, SI units throughout; a section that was not measured is absent."""
        return {
            "format": FORMAT,
            "model": self.model,
            "machine": asdict(self.machine),
            "versions": versions(),
            **{name: asdict(figures) for name, figures in self.figures.items()},
            "notes": list(self.notes),
            "targets": [
                each.to_dict() | {"figure": f"{name}.{each.target.figure}"}
                for name, verdicts in self.verdicts.items()
                for each in verdicts
                if each.met is not None
            ],
        }


def measure_sections(
    subject: Subject, settings: Mapping[str, Any], report: Callable[[str], None] = lambda _: None
) -> Results:
    """Measure sections of one bundle, one after the other.

    Args:
        subject: the bundle.
        settings: of each section to measure, by its name.
        report: told the name of each section as it begins.

    Raises:
        MissingExtraError: every section needs what is not installed.
    """
    machine = this_machine()
    figures: dict[str, Any] = {}
    verdicts: dict[str, list[Verdict]] = {}
    notes: list[str] = []
    for name in (name for name in SECTIONS if name in settings):
        section = SECTIONS[name]
        report(name)
        try:
            measured = section.measure(subject, settings[name])
        except MissingExtraError as error:
            notes.append(f"{name} is left out: {error}")
            continue
        figures[name] = measured.figures
        verdicts[name] = judge(section.targets, asdict(measured.figures))
        notes.extend(measured.notes)
    if not figures:
        raise MissingExtraError("; ".join(notes))
    timed = [name for name in figures if SECTIONS[name].timed]
    if machine.busy and timed:
        load = f"the load was {machine.load:.1f} when this began"
        notes.append(f"{load}: timings of {', '.join(timed)} on a busy machine say little")
    return Results(subject, machine, figures, verdicts, notes)


def _option_fields(settings: Any) -> list[Field[Any]]:
    """Return the settings that are options of the program."""
    return [each for each in fields(settings) if "help" in each.metadata]


def _options() -> type[Any]:
    """Return a dataclass of every section's options; what is None or empty was not given."""
    found: dict[str, tuple[Any, Field[Any], list[str]]] = {}
    for name, section in SECTIONS.items():
        hints = get_type_hints(type(section.settings))
        for each in _option_fields(section.settings):
            found.setdefault(each.name, (hints[each.name], each, []))[2].append(name)
    made = []
    for name, (hint, each, sections) in found.items():
        several = get_origin(hint) is tuple
        metadata = {**each.metadata, "help": f"{each.metadata['help']} [{', '.join(sections)}]"}
        default: Any = () if several else None
        made.append((name, hint if several else hint | None, field(default=default, metadata=metadata)))
    return make_dataclass("Options", made, frozen=True)


Options = _options()
"""The options of all sections: one that several sections have is the same for all of them."""


def settings_of(chosen: Sequence[str], options: Any) -> dict[str, Any]:
    """Return the settings of the chosen sections, with the options in the place of what they have by default.

    Raises:
        InputError: there is no section of that name, or none of the chosen ones has an option that was given.
    """
    for name in chosen:
        if name not in SECTIONS:
            raise InputError(f"unknown section {name!r}: known are {', '.join(SECTIONS)}")
    given = {
        name: value
        for name, value in asdict(options).items()
        if value is not None and value is not False and value != ()
    }
    settings, used = {}, set()
    for name in chosen or USUAL:
        default = SECTIONS[name].settings
        own = {each.name: given[each.name] for each in _option_fields(default) if each.name in given}
        settings[name] = replace(default, **own)
        used |= set(own)
    for name in given:
        if name not in used:
            having = [each for each in SECTIONS if hasattr(SECTIONS[each].settings, name)]
            raise InputError(
                f"--{name.replace('_', '-')} is an option of {', '.join(having)}: name it, or leave the option out"
            )
    return settings


def slide_bench(
    options: Options,  # type: ignore[valid-type]
    sections: Annotated[
        list[str] | None, typer.Argument(metavar="SECTION", help="What to measure.", show_default=False)
    ] = None,
    model: Annotated[
        str | None, typer.Option("--model", help="Bundle: a folder, or a shipped one.", metavar="DIR")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File to write the JSON object to.", metavar="FILE")
    ] = None,
    into: Annotated[
        Path | None, typer.Option("--page", help="Page of the documents to write the tables into.", metavar="FILE")
    ] = None,
    as_json: AsJson = False,
) -> None:
    if output is not None:
        check_writable(output)
    settings = settings_of(sections or (), options)
    if into is not None:
        write_into(_read(into), str(into), dict.fromkeys(settings, ()))  # refused before hours of measuring
    results = measure_sections(Subject.load(model), settings, _report)
    document = results.to_dict()
    if output is not None:
        write_whole(output, json.dumps(document, indent=2, allow_nan=False).encode() + b"\n")
    tables = {name: SECTIONS[name].tables(each, results.verdicts[name]) for name, each in results.figures.items()}
    if into is not None:
        write_whole(into, write_into(_read(into), str(into), tables).encode())
    if as_json:
        print_json(document)
    else:
        print_tables([machine_table(results.machine, versions(), results.model)])
        for each in tables.values():
            print_tables(each)
    for note in results.notes:
        say(NAME, f"note: {note}")
    unmet = [str(verdict) for verdict in results.judged if not verdict.met]
    if unmet:
        say(NAME, f"{len(unmet)} of {len(results.judged)} targets are not met: {'; '.join(unmet)}")
        raise typer.Exit(DONE_BUT_MISSED)


slide_bench.__doc__ = "\n".join(
    [
        "Measure the planner, and compare the figures with their targets.",
        "",
        "\b",
        "Sections:",
        *(f"  {name:9} {section.what}" for name, section in SECTIONS.items()),
        "",
        f"Without a section: {', '.join(USUAL)}. An option goes to every section that has it, named in brackets.",
    ]
)


def _read(page: Path) -> str:
    """Return a page of the documents.

    Raises:
        InputError: it cannot be read.
    """
    try:
        return page.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"--page: cannot read {page}: {error}") from error


def _report(section: str) -> None:
    """Say on a terminal what is being measured; no bar, whose drawing would be measured too."""
    if sys.stderr.isatty():
        say(NAME, f"measuring {section} ...")


def bench_main() -> None:
    """Entry point of `slide-bench` in a checkout."""
    # OpenMP reads this when torch loads it. With threads that spin while they wait, torch is slower by a multiple as
    # soon as anything else runs, and a comparison with it would be a straw man.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    run(NAME, slide_bench)
