"""The command line: `slide-export`."""

from __future__ import annotations

import tempfile
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from runtime.cli.console import MM, AsJson, print_json, print_table, run
from runtime.errors import InputError, extra
from runtime.network.bundle import bundle_path
from runtime.network.manifest import MANIFEST_FILE

if TYPE_CHECKING:  # they import torch, which takes seconds and may not be installed
    from export.quantize import Comparison


class Precision(StrEnum):
    """Of the exported weights."""

    FP32 = "fp32"
    INT8 = "int8"


def export_main() -> None:
    """Entry point of `slide-export`."""
    run("slide-export", slide_export)


def slide_export(
    source: Annotated[
        Path,
        typer.Argument(
            help="Checkpoint, folder of a run, or for int8 an fp32 bundle, a shipped one by its name.",
            show_default=False,
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Bundle folder to write.", show_default=False)],
    precision: Annotated[Precision, typer.Option(help="Of the exported weights.")] = Precision.FP32,
    as_json: AsJson = False,
) -> None:
    """Export a trained network as a bundle, after comparing the two in closed loop; int8 also by its error."""
    with extra("train"):
        from export.quantize import Quantized, quantize_bundle
        from export.write_bundle import Exported, export_bundle

    source = bundle_path(source)
    exported: Exported | None = None
    quantized: Quantized | None = None
    made: Exported | Quantized
    is_bundle = (source / MANIFEST_FILE).exists()
    if precision is Precision.FP32:
        if is_bundle:
            raise InputError(f"{source} is a bundle already: --precision int8 makes another of it")
        made = exported = export_bundle(source, output)
    elif is_bundle:
        made = quantized = quantize_bundle(source, output)
    else:
        with tempfile.TemporaryDirectory() as folder:
            exported = export_bundle(source, Path(folder) / "fp32")
            made = quantized = quantize_bundle(Path(folder) / "fp32", output)
    if as_json:
        parts = {
            "agreement": None if exported is None else exported.agreement._asdict(),
            "comparison": None if quantized is None else quantized.comparison._asdict(),
        }
        print_json({"bundle": str(output), "precision": precision.value, **parts})
        return
    rows = [] if exported is None else exported.agreement.rows()
    rows += [] if quantized is None else _comparison_rows(quantized.comparison)
    manifest = made.manifest
    print_table(f"{output}: {manifest.name}, {manifest.units} units, {manifest.precision}", rows)


def _comparison_rows(comparison: Comparison) -> list[tuple[str, str]]:
    return [
        ("commands planned by fp32 and int8", str(comparison.commands)),
        ("mean tracking RMSE, fp32", f"{comparison.fp32 * MM:.3f} mm"),
        ("mean tracking RMSE, int8", f"{comparison.int8 * MM:.3f} mm ({comparison.growth:+.1%})"),
    ]
