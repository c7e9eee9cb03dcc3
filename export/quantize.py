"""Makes an int8 bundle of an fp32 one (`export.integer_graphs`), and accepts it only if it plans nearly as well."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from export.integer_graphs import integer_decoder_step, integer_encoder, weights_of
from export.write_bundle import bundle_folder, write_graphs, write_manifest
from runtime import Planner
from runtime.documents.checks import FloatArray
from runtime.errors import SlideError
from runtime.limits import Limits
from runtime.network.manifest import DECODER_STEP, ENCODER, Manifest
from train.commands.families import FAMILIES
from train.evaluation.evaluate import commands_of

COMMANDS = 16
"""Commands of each family that both bundles plan."""

PANS = (Limits(), Limits(height=0.1), Limits.named("panda"))
"""Pans that both are compared on: a level one, one that lifts, and a weaker one that does."""

MAX_GROWTH = 0.05
"""Share by which the mean tracking RMSE over all of these commands may grow, unless something else is said."""


class QuantizationError(SlideError):
    """The int8 network plans worse than is accepted, or there is no fp32 network to make it of."""


class Comparison(NamedTuple):
    """Mean tracking RMSE (m) over the same commands, and the share by which the int8 bundle's is larger."""

    commands: int
    fp32: float
    int8: float
    growth: float


class Quantized(NamedTuple):
    """What a quantization gives back."""

    manifest: Manifest
    comparison: Comparison


def quantize_bundle(source: Path, folder: Path, max_growth: float = MAX_GROWTH) -> Quantized:
    """Write the int8 form of the fp32 bundle `source` to `folder`, whole or not at all.

    Raises:
        BundleError: `source` is no bundle.
        QuantizationError: `source` is not fp32, was trained on nothing that moves, or the error grows by the share
            `max_growth` or more; nothing is written.
        OutputError: `folder` holds something that is no bundle, or cannot be written.
    """
    planner = Planner(source)
    manifest = planner.bundle.manifest
    if manifest.precision != "fp32":
        raise QuantizationError(f"{source} is {manifest.precision} already; int8 is made of fp32")
    for name in ("reach", "speed"):
        if manifest.trained_on[name][1] <= 0.0:
            raise QuantizationError(f"{source} was trained on a {name} of 0: there is no range for its inputs")
    with bundle_folder(folder) as temporary:
        fp32 = {name: (source / graph.file).read_bytes() for name, graph in manifest.graphs.items()}
        graphs = write_graphs(temporary, integer_graphs(fp32, manifest))
        manifest = replace(manifest, precision="int8", graphs=graphs)
        write_manifest(temporary, manifest)
        comparison = compare(planner, Planner(temporary))
        if not comparison.growth < max_growth:
            raise QuantizationError(
                f"the mean tracking RMSE grows by {comparison.growth:.1%}, from {comparison.fp32 * 1e3:.3g} to "
                f"{comparison.int8 * 1e3:.3g} mm over {comparison.commands} commands; less than {max_growth:.0%} is "
                "accepted"
            )
        manifest = replace(manifest, evaluation={**manifest.evaluation, "int8_growth": round(comparison.growth, 5)})
        write_manifest(temporary, manifest)
    return Quantized(manifest, comparison)


def integer_graphs(fp32: Mapping[str, bytes], manifest: Manifest) -> dict[str, bytes]:
    """Return the serialized graphs in integers, by name, of a bundle's fp32 ones."""
    weights = {name: weights_of(graph) for name, graph in fp32.items()}
    return {
        ENCODER: integer_encoder(weights[ENCODER], manifest),
        DECODER_STEP: integer_decoder_step(weights[DECODER_STEP], manifest),
    }


def compare(fp32: Planner, int8: Planner) -> Comparison:
    """Plan the evaluation's commands of every family with both, for all of PANS."""
    positions = [position for family in FAMILIES for position in commands_of(family, COMMANDS)]
    first, second = (_mean_rmse(planner, positions) for planner in (fp32, int8))
    return Comparison(len(PANS) * len(positions), first, second, second / first - 1.0)


def _mean_rmse(planner: Planner, positions: list[FloatArray]) -> float:
    plans = [plan for limits in PANS for plan in planner.plan_batch(positions, limits=limits)]
    return float(np.mean([plan.quality.tracking_rmse for plan in plans]))
