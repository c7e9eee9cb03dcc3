"""The command line: `slide-export`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from runtime.cli import AsJson, extra, print_json, print_table, run


class Precision(StrEnum):
    """Of the exported weights."""

    FP32 = "fp32"


def export_main() -> None:
    """Entry point of `slide-export`."""
    run("slide-export", slide_export)


def slide_export(
    checkpoint: Annotated[Path, typer.Argument(help="Checkpoint, or the folder of a run.", show_default=False)],
    output: Annotated[Path, typer.Option("--output", "-o", help="Bundle folder to write.", show_default=False)],
    precision: Annotated[Precision, typer.Option(help="Of the exported weights.")] = Precision.FP32,
    as_json: AsJson = False,
) -> None:
    """Export a trained network as a bundle, after comparing the two in closed loop."""
    with extra("train"):
        from export.bundle import export_bundle  # torch takes seconds to load

    exported = export_bundle(checkpoint, output)
    agreement = exported.agreement
    if as_json:
        print_json({"bundle": str(output), "precision": precision.value, "agreement": agreement._asdict()})
        return
    print_table(
        f"{output}: {exported.manifest.name}, {exported.manifest.units} units, {precision.value}",
        [
            ("commands replayed through torch and onnxruntime", str(agreement.commands)),
            ("samples until a branch parted, or the end", f"{agreement.samples} ({agreement.parted} parted)"),
            ("largest difference of pan acceleration", f"{agreement.acceleration:.2g} m/s^2"),
            ("largest difference of position", f"{agreement.position:.2g} m"),
        ],
    )
