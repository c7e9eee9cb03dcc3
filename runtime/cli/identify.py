"""`slide-identify`: the friction of a pan and an object, from a log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from runtime.cli.console import DONE_BUT_MISSED, AsJson, print_json, print_table, run, say
from runtime.documents.writing import check_writable
from runtime.identify.fit import fit
from runtime.identify.log import read_log
from runtime.identify.report import notes, rows, write_report


def identify_main() -> None:
    """Entry point of `slide-identify`."""
    run("slide-identify", slide_identify)


def slide_identify(
    log: Annotated[
        Path,
        typer.Argument(
            help="CSV: t, pan_ax and pan_ay or pan_x and pan_y, object_x and object_y; SI units.", show_default=False
        ),
    ],
    noise: Annotated[
        float | None,
        typer.Option(
            "--noise", help="Spread of the object's positions (m); found in the log if not given.", metavar="M"
        ),
    ] = None,
    report: Annotated[
        Path | None, typer.Option("--report", help="Page to write, with pictures.", metavar="HTML")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Find static and kinetic friction in a log of how the pan moved and the object slid, with intervals, and say
    whether Coulomb's law explains it.
    """
    if report is not None:
        check_writable(report)
    found = fit(read_log(log), noise)
    if report is not None:
        write_report(report, log.name, found)
    if as_json:
        print_json({"log": str(log), **found.to_dict(), "report": None if report is None else str(report)})
    else:
        written = [] if report is None else [("report", str(report))]
        print_table(f"friction in {log}", [*rows(found), *written])
    missed = notes(found)
    if missed:
        say("slide-identify", "; ".join(missed))
        raise typer.Exit(DONE_BUT_MISSED)
