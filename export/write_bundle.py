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
from runtime.network.manifest import DECODER_STEP, ENCODER, MANIFEST_FILE, GraphFile, Manifest, default_limits
from runtime.physics.law import DT
from train.config import TrainConfig, trains_from_scratch
from train.curriculum import CURRICULA
from train.learn.validation import validate
from train.network.checkpoint import load_checkpoint, load_model
from train.network.model import Seq2Seq


class Exported(NamedTuple):
    """What an export gives back: the manifest written and how well the bundle agrees with the network."""

    manifest: Manifest
    agreement: Agreement


def export_bundle(checkpoint: Path, folder: Path) -> Exported:
    """Export the network of a checkpoint, or of a run's folder, as a bundle.

    Raises:
        FormatError: the checkpoint cannot be read.
        VerificationError: the bundle does not do what the network does; nothing is written.
        OutputError: `folder` holds something that is no bundle, or cannot be written.
    """
    saved = load_checkpoint(checkpoint)
    config, model = load_model(saved)
    with bundle_folder(folder) as temporary:
        graphs = {
            ENCODER: write_graph(temporary, f"{ENCODER}.onnx", encoder_graph(model)),
            DECODER_STEP: write_graph(temporary, f"{DECODER_STEP}.onnx", decoder_step_graph(model)),
        }
        manifest = describe(model, config, saved["epoch"], saved.get("began_with"), graphs)
        write_manifest(temporary, manifest)
        agreement = verify(model, config, temporary)
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


def write_graph(folder: Path, file: str, graph: bytes) -> GraphFile:
    """Write a serialized graph, and return its entry in the manifest."""
    (folder / file).write_bytes(graph)
    return GraphFile(file, hashlib.sha256(graph).hexdigest())


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write a bundle's manifest."""
    (folder / MANIFEST_FILE).write_text(json.dumps(manifest.to_dict(), indent=2) + "\n", encoding="utf-8")


def describe(
    model: Seq2Seq,
    config: TrainConfig,
    epochs: int,
    began_with: Mapping[str, str] | None,
    graphs: dict[str, GraphFile],
) -> Manifest:
    """Return the manifest of a network.

    Args:
        model: the network.
        config: what it was trained by.
        epochs: for how many epochs.
        began_with: `name` and `sha256` of the run's checkpoint or the bundle whose weights it began with (`--init`);
            None if it began with drawn ones, or if the checkpoint does not say.
        graphs: as written.
    """
    varied = any(stage.varied_friction for stage in CURRICULA[config.curriculum])
    figures = validate(model, config, torch.device("cpu"))
    return Manifest(
        name=config.name,
        precision="fp32",
        opset=OPSET,
        graphs=graphs,
        chunk=config.chunk,
        dt=DT,
        layers=config.layers,
        units=config.units,
        command_ahead=config.command_ahead,
        acceleration_bound=config.acceleration_bound,
        friction=Friction(config.static, config.kinetic),
        pan_limit=config.pan_limit,
        trained_on={
            "static": config.static_range if varied else (config.static, config.static),
            "kinetic": config.kinetic_range if varied else (config.kinetic, config.kinetic),
            "reach": (0.0, config.reach[1]),
            "speed": (0.0, config.speed),
            "samples": config.samples,
        },
        training={
            "command": training_command(config, began_with),
            "began_with": None if began_with is None else dict(began_with),
            "epochs": epochs,
            "configuration": config.model_dump(mode="json"),
            "versions": {"python": platform.python_version(), "torch": str(torch.__version__)},
        },
        evaluation={name: round(value, 5) for name, value in figures.items()},
        limits=default_limits(config.pan_limit, config.acceleration_bound),
    )


def training_command(config: TrainConfig, began_with: Mapping[str, str] | None) -> str:
    """Return the command that trains such a network; what stands in capitals is not known."""
    model = "" if config.model == "A" else f" --model {config.model}"
    if began_with is not None:
        return f"slide-train {config.name}{model} --init {began_with['name']}"
    return f"slide-train {config.name}{model}{'' if trains_from_scratch(config) else ' --init RUN_OR_BUNDLE'}"


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
