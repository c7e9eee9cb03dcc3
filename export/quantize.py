"""Makes an int8 bundle of an fp32 one, and accepts it only if it plans nearly as well.

The weights of LSTMs and linear layers become 8-bit integers, per channel; activations are quantized as they come.
Where a processor has no 8-bit dot product, products of full-range weights overflow in pairs, so the weights keep to
seven bits ("reduced range"): without that the output is wrong by a third of its spread.
"""

from __future__ import annotations

import logging
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from export.bundle import bundle_folder, write_graph, write_manifest
from runtime import Planner
from runtime.bundle import Manifest
from runtime.documents import FloatArray
from runtime.errors import SlideError
from train.commands import FAMILIES
from train.evaluate import commands_of

COMMANDS = 16
"""Commands of each family that both bundles plan."""

MAX_GROWTH = 0.05
"""Share by which the mean tracking RMSE over all of these commands may grow."""


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


def quantize_bundle(source: Path, folder: Path) -> Quantized:
    """Write the int8 form of the fp32 bundle `source` to `folder`, whole or not at all.

    Raises:
        BundleError: `source` is no bundle.
        QuantizationError: `source` is not fp32, or the error grows by MAX_GROWTH or more; nothing is written.
        OutputError: `folder` holds something that is no bundle, or cannot be written.
    """
    planner = Planner(source)
    manifest = planner.bundle.manifest
    if manifest.precision != "fp32":
        raise QuantizationError(f"{source} is {manifest.precision} already; int8 is made of fp32")
    with bundle_folder(folder) as temporary:
        graphs = {
            name: write_graph(temporary, graph.file, quantize_graph((source / graph.file).read_bytes()))
            for name, graph in manifest.graphs.items()
        }
        manifest = replace(manifest, precision="int8", graphs=graphs)
        write_manifest(temporary, manifest)
        comparison = compare(planner, Planner(temporary))
        if not comparison.growth < MAX_GROWTH:
            raise QuantizationError(
                f"the mean tracking RMSE grows by {comparison.growth:.1%}, from {comparison.fp32 * 1e3:.3g} to "
                f"{comparison.int8 * 1e3:.3g} mm over {comparison.commands} commands; less than {MAX_GROWTH:.0%} is "
                "accepted"
            )
        manifest = replace(manifest, evaluation={**manifest.evaluation, "int8_growth": round(comparison.growth, 5)})
        write_manifest(temporary, manifest)
    return Quantized(manifest, comparison)


def quantize_graph(graph: bytes) -> bytes:
    """Return a serialized graph with 8-bit weights."""
    from onnxruntime.quantization import QuantType, quantize_dynamic  # takes a second to load

    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "fp32.onnx", Path(folder) / "int8.onnx"
        source.write_bytes(graph)
        root = logging.getLogger()
        level = root.level
        root.setLevel(logging.ERROR)  # it recommends a preparation that these graphs, shapes and all, do not need
        try:
            quantize_dynamic(source, target, per_channel=True, reduce_range=True, weight_type=QuantType.QInt8)
        finally:
            root.setLevel(level)
        return target.read_bytes()


def compare(fp32: Planner, int8: Planner) -> Comparison:
    """Plan the evaluation's commands of every family with both."""
    positions = [position for family in FAMILIES for position in commands_of(family, COMMANDS)]
    first, second = (_mean_rmse(planner, positions) for planner in (fp32, int8))
    return Comparison(len(positions), first, second, second / first - 1.0)


def _mean_rmse(planner: Planner, positions: list[FloatArray]) -> float:
    return float(np.mean([plan.quality.tracking_rmse for plan in planner.plan_batch(positions)]))
