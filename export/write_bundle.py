"""Writes a bundle: both graphs and the manifest, checked against the network, whole or not at all."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import secrets
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import torch

from export.float_graphs import decoder_step_graph, encoder_graph
from export.graph_builder import OPSET
from export.verify import Agreement, verify
from runtime.errors import OutputError
from runtime.friction import Friction
from runtime.network.manifest import (
    DECODER_STEP,
    DEFAULT_LIMITS,
    ENCODER,
    MANIFEST_FILE,
    GraphFile,
    Manifest,
)
from runtime.network.units import REACH, Constants
from runtime.physics.law import DT
from train.learn.checkpoint import load_checkpoint
from train.network.config import TrainConfig
from train.network.network import Network
from train.network.recipe import NetworkRecipe, load_network

BEGUN_WITH = {"start_speed": (0.0, 1.0), "corner": (0.0, 1.2)}
"""Speed of the pan at the start and sharpest corner that networks are taken through in mid-course, in their units."""


class Exported(NamedTuple):
    """What an export gives back: the manifest written and how well the bundle agrees with the network."""

    manifest: Manifest
    agreement: Agreement


def export_bundle(checkpoint: Path, folder: Path) -> Exported:
    """Export the network of a checkpoint, or of a run's folder, as a bundle.

    Raises:
        FormatError: the checkpoint cannot be read.
        InputError: it is of the paper's own network.
        VerificationError: the bundle does not do what the network does; nothing is written.
        OutputError: `folder` holds something that is no bundle, or cannot be written.
    """
    saved = load_checkpoint(checkpoint)
    config, network = load_network(saved)
    with bundle_folder(folder) as temporary:
        graphs = write_graphs(temporary, {ENCODER: encoder_graph(network), DECODER_STEP: decoder_step_graph(network)})
        manifest = describe(network, config, saved["epoch"], saved["began_with"], graphs)
        write_manifest(temporary, manifest)
        agreement = verify(network, temporary)
    return Exported(manifest, agreement)


@contextmanager
def bundle_folder(folder: Path) -> Iterator[Path]:
    """Give a temporary folder to write a bundle into; it takes the place of `folder` unless something is raised.

    A link stays a link: the folder it leads to is replaced.

    Raises:
        OutputError: `folder` holds something that is no bundle, or cannot be written.
    """
    _check_replaceable(folder)
    target = Path(os.path.realpath(folder))
    temporary = target.parent / f".{target.name}.{secrets.token_hex(4)}.tmp"
    try:
        temporary.mkdir(parents=True)
        yield temporary
        _replace_folder(target, temporary)
    except OSError as error:
        raise OutputError(f"cannot write the bundle {folder}: {error.strerror or error}") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def write_graphs(folder: Path, graphs: Mapping[str, bytes]) -> dict[str, GraphFile]:
    """Write serialized graphs by their names, and return their entries in the manifest."""
    entries = {}
    for name, graph in graphs.items():
        file = f"{name}.onnx"
        (folder / file).write_bytes(graph)
        entries[name] = GraphFile(file, hashlib.sha256(graph).hexdigest())
    return entries


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write a bundle's manifest."""
    (folder / MANIFEST_FILE).write_text(json.dumps(manifest.to_dict(), indent=2) + "\n", encoding="utf-8")


def describe(
    network: Network,
    config: TrainConfig,
    epochs: int,
    began_with: Mapping[str, str] | None,
    graphs: dict[str, GraphFile],
) -> Manifest:
    """Return the manifest of a network.

    Args:
        network: the network.
        config: what it was trained by.
        epochs: for how many epochs.
        began_with: `name` and `sha256` of the run's checkpoint or the bundle whose weights it began with (`--init`);
            None if it began with drawn ones.
        graphs: as written.
    """
    figures = NetworkRecipe(config).validate(network, torch.device("cpu"))
    (least, static), (share, kinetic) = config.static, config.kinetic
    return Manifest(
        name=config.name,
        precision="fp32",
        opset=OPSET,
        graphs=graphs,
        network=Constants(),
        dt=DT,
        layers=config.layers,
        units=config.units,
        friction=Friction(),
        trained_on={
            "static": config.static,
            "kinetic": (round(share * least, 6), kinetic * static),
            "push": (0.0, config.drive),
            "pan_reach": config.pan_reach,
            "height": (0.0, config.height[1]),
            "pan_speed": config.pan_speed,
            "acceleration": config.acceleration,
            "jerk": config.jerk,
            "reach": (0.0, round(config.far[1] / REACH, 6)),
            "speed": (0.0, config.speed[1]),
            "samples": config.samples,
            **BEGUN_WITH,
        },
        training={
            "command": f"slide-train {config.name}" + (f" --init {began_with['name']}" if began_with else ""),
            "began_with": None if began_with is None else dict(began_with),
            "epochs": epochs,
            "configuration": config.model_dump(mode="json"),
            "versions": {"python": platform.python_version(), "torch": str(torch.__version__)},
        },
        evaluation={name: round(value, 5) for name, value in figures.items()},
        limits=DEFAULT_LIMITS,
    )


def _check_replaceable(folder: Path) -> None:
    """Refuse to replace a folder that is not a bundle.

    Raises:
        OutputError: `folder` is a file, or a folder with something else in it.
    """
    if folder.exists() and not (folder / MANIFEST_FILE).exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise OutputError(f"{folder} exists and is not a bundle; it is left as it is")


def _replace_folder(folder: Path, temporary: Path) -> None:
    """Put `temporary` in the place of `folder`; what was there is removed last."""
    old: Path | None = None
    if folder.exists():
        old = folder.with_name(f".{folder.name}.{secrets.token_hex(4)}.old")
        os.replace(folder, old)
    os.replace(temporary, folder)
    if old is not None:
        shutil.rmtree(old, ignore_errors=True)
