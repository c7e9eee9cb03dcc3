"""The command line: `slide-export`."""

from __future__ import annotations

import tempfile
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from runtime.cli.console import MM, AsJson, print_json, print_table, run
from runtime.errors import InputError, extra
from runtime.network.bundle import Bundle, bundle_path
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
            help="Checkpoint, folder of a run, or a bundle, a shipped one by its name.",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Bundle folder to write.", metavar="DIR")
    ] = None,
    hub: Annotated[
        Path | None,
        typer.Option("--hub", help="Write it as a repository of the Hugging Face hub, with a card.", metavar="DIR"),
    ] = None,
    precision: Annotated[Precision, typer.Option(help="Of the exported weights.")] = Precision.FP32,
    as_json: AsJson = False,
) -> None:
    """Export a trained network as a bundle, after comparing the two in closed loop; int8 also by its error.

    A bundle is published as it is, by --hub, or made another of, by --precision int8.
    """
    with extra("train"):
        from export.hub import float_weights, publish
        from export.quantize import Quantized, quantize_bundle
        from export.write_bundle import Exported, export_bundle

    if output is None and hub is None:
        raise InputError("give the folder of the bundle, -o, or that of a repository, --hub, or both")
    source = bundle_path(source)
    exported: Exported | None = None
    quantized: Quantized | None = None
    is_bundle = (source / MANIFEST_FILE).exists()
    if is_bundle and precision is Precision.FP32 and output is not None:
        raise InputError(f"{source} is a bundle already: --precision int8 makes another of it, --hub publishes it")
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "bundle" if output is None else output
        if is_bundle and precision is Precision.FP32:
            target = source
        elif precision is Precision.FP32:
            exported = export_bundle(source, target)
        elif is_bundle:
            quantized = quantize_bundle(source, target)
        else:
            exported = export_bundle(source, Path(folder) / "fp32")
            quantized = quantize_bundle(Path(folder) / "fp32", target)
        published = [] if hub is None else publish(target, hub, float_weights(source))
        manifest = Bundle.load(target).manifest
    if as_json:
        parts = {
            "agreement": None if exported is None else exported.agreement._asdict(),
            "comparison": None if quantized is None else quantized.comparison._asdict(),
        }
        where = {"bundle": None if output is None else str(output), "hub": None if hub is None else str(hub)}
        print_json({**where, "files": published, "precision": manifest.precision, **parts})
        return
    rows = [] if exported is None else exported.agreement.rows()
    rows += [] if quantized is None else _comparison_rows(quantized.comparison)
    rows += [("published", ", ".join(published))] if published else []
    places = " and ".join(str(place) for place in (output, hub) if place is not None)
    print_table(f"{places}: {manifest.name}, {manifest.units} units, {manifest.precision}", rows)


def _comparison_rows(comparison: Comparison) -> list[tuple[str, str]]:
    return [
        ("commands planned by fp32 and int8", str(comparison.commands)),
        ("mean tracking RMSE, fp32", f"{comparison.fp32 * MM:.3f} mm"),
        ("mean tracking RMSE, int8", f"{comparison.int8 * MM:.3f} mm ({comparison.growth:+.1%})"),
    ]
