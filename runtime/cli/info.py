"""`slide-info`: what a bundle is."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated

import typer

from runtime.cli.console import AsJson, print_json, print_table, run
from runtime.limits import UNITS, Limits
from runtime.network.bundle import Bundle
from runtime.network.manifest import BUNDLE_FORMAT, TRAINED_ON
from runtime.planner import DEFAULT_BUNDLE


def info_main() -> None:
    """Entry point of `slide-info`."""
    run("slide-info", slide_info)


def slide_info(
    bundle: Annotated[Path | None, typer.Argument(help="Bundle folder; the shipped one if not given.")] = None,
    as_json: AsJson = False,
) -> None:
    """Say what a bundle is: its network, what it was trained for and how it did."""
    path = DEFAULT_BUNDLE if bundle is None else bundle
    loaded = Bundle.load(path)
    manifest = loaded.manifest
    if as_json:
        print_json({"path": str(path), "sha256": loaded.sha256, "sizes": loaded.sizes, **manifest.to_dict()})
        return
    rows = [
        ("name", manifest.name),
        ("format", BUNDLE_FORMAT),
        ("network", f"{manifest.layers} x {manifest.units} LSTM units, {manifest.precision}, opset {manifest.opset}"),
        ("chunk", f"{manifest.network.chunk} samples of the network's time"),
        ("friction, static/kinetic", f"{manifest.friction.static:g}/{manifest.friction.kinetic:g}"),
        ("pan, object radius", f"{manifest.sizes.pan_radius:g} m, {manifest.sizes.object_radius:g} m"),
        *((f"limit on {name.replace('_', ' ')}", _limit(manifest.limits, name)) for name in UNITS),
    ]
    for name, unit in TRAINED_ON.items():
        low, high = manifest.trained_on[name]
        rows.append((f"trained on {name.replace('_', ' ')}", f"{low:g} to {high:g} {unit}".rstrip()))
    rows += [(f"{name} size", f"{size / 1e6:.2f} MB") for name, size in loaded.sizes.items()]
    rows.append(("sha256", loaded.sha256))
    rows += [(name.replace("_", " "), _brief(value) + _unit(name)) for name, value in manifest.evaluation.items()]
    print_table(str(path), rows)


def _limit(limits: Limits, name: str) -> str:
    value = getattr(limits, name)
    if name == "height" and limits.level:
        return "0 m: a level pan"
    return "none" if math.isinf(value) else f"{value:g} {UNITS[name]}"


def _unit(name: str) -> str:
    """Return the unit of an evaluation figure that the exporter writes; of others it is not known."""
    return " m" if name.endswith(("_tracking", "_reach")) else ""


def _brief(value: object) -> str:
    """Lay out one free-form evaluation figure on few lines."""
    if isinstance(value, dict):
        return "\n".join(f"{name.replace('_', ' ')} {_brief(part)}" for name, part in value.items())
    if isinstance(value, float):
        return f"{value:.4g}"
    return value if isinstance(value, str) else json.dumps(value)
