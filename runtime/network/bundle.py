"""A bundle: the folder that carries a trained network as two ONNX graphs and a manifest that says what they are.

Nothing of a bundle is believed: the manifest is read strictly, each graph's bytes are compared with the manifest's
sha256 and looked through (`runtime.network.onnx_check`) before onnxruntime sees them, and what the graphs take and give
is compared with the manifest's numbers.

The graphs, row by row (normalization is inside them):

    encoder:       command (B, chunks, READ)               -> hidden, cell (layers, B, units)
    decoder_step:  observation (B, OBSERVED), hidden, cell -> pan_acceleration (B, CHUNK, 3), hidden_out, cell_out

All of it is in the network's units; `runtime.network.units` says what READ and OBSERVED numbers are given.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from runtime.documents.files import parse_json, read_bytes, read_text
from runtime.errors import BundleError, InputError
from runtime.network.hub import fetch, is_on_hub
from runtime.network.manifest import (
    DECODER_STEP,
    ENCODER,
    MANIFEST_FILE,
    Manifest,
    bundle_errors,
)
from runtime.network.onnx_check import check_graph
from runtime.network.units import CHUNK, OBSERVED, READ

SHIPPED = Path(__file__).parents[1] / "models"
"""Folder of the bundles that are shipped, which are known by their names too."""
ENCODER_OUTPUTS = ("hidden", "cell")
DECODER_STEP_OUTPUTS = ("pan_acceleration", "hidden_out", "cell_out")

Float32Array = NDArray[np.float32]


def bundle_path(path: str | PathLike[str]) -> Path:
    """Return the folder of a bundle: `path` itself, or that of the shipped bundle `path` names if there is no such.

    One on the Hugging Face hub, hf://user/name, is fetched.

    Raises:
        BundleError: it cannot be fetched.
        MissingExtraError: it is on the hub, and huggingface-hub is not installed.
    """
    if is_on_hub(path):
        return fetch(path)
    path = Path(path)
    named = not path.exists() and len(path.parts) == 1 and (SHIPPED / path).is_dir()
    return SHIPPED / path if named else path


class LstmState(NamedTuple):
    """State of an LSTM between two chunks: hidden and cell, each (layers, B, units) float32."""

    hidden: Float32Array
    cell: Float32Array


@dataclass(frozen=True, eq=False)
class Bundle:
    """A loaded bundle; its two methods may be called from several threads.

    It is pickled and copied as its path and its hash: whoever unpickles it loads it anew, and refuses one that changed.

    Attributes:
        path: its folder, absolute.
        manifest: what the bundle says of itself, checked.
        sha256: of the manifest's bytes, and so of everything: it carries the hashes of the graphs.
        sizes: of the graphs (bytes).
        sessions: of the graphs, by name.
    """

    path: Path
    manifest: Manifest
    sha256: str
    sizes: Mapping[str, int]
    sessions: Mapping[str, Any]

    @classmethod
    def load(cls, path: str | PathLike[str], sha256: str | None = None) -> Self:
        """Load a bundle from its folder.

        Args:
            path: the folder, the name of a shipped bundle where there is no such folder, or hf://user/name.
            sha256: what the manifest's must be, in hexadecimal; any if None.

        Raises:
            BundleError: the manifest or a graph is missing, a hash does not fit, a graph has what no graph of ours
                has (`runtime.network.onnx_check`), or the graphs are not what the manifest says: names, shapes,
                or results; or it is on the Hugging Face hub and cannot be fetched.
            MissingExtraError: it is there, and huggingface-hub is not installed.
        """
        path = bundle_path(path)
        if not path.exists():
            shipped = ", ".join(sorted(folder.name for folder in SHIPPED.iterdir()))
            raise BundleError(f"{path}: there is no such bundle: give its folder, or a shipped one's name: {shipped}")
        source = str(path / MANIFEST_FILE)
        with bundle_errors(source):
            data = _read(path / MANIFEST_FILE)
            loaded = hashlib.sha256(data).hexdigest()
            if sha256 is not None and loaded != sha256:
                raise BundleError(f"{source}: sha256 is {loaded}, it must be {sha256}")
            manifest = Manifest.from_dict(parse_json(read_text(data)), source)
        sizes, sessions = {}, {}
        for name, graph in manifest.graphs.items():
            source = str(path / graph.file)
            with bundle_errors(source):
                model = _read(path / graph.file)
            found = hashlib.sha256(model).hexdigest()
            if found != graph.sha256:
                raise BundleError(f"{source}: sha256 is {found}, the manifest says {graph.sha256}")
            with bundle_errors(source):
                check_graph(model)
            sizes[name] = len(model)
            sessions[name] = _session(model, source)
            _check_inputs_and_outputs(sessions[name], name, manifest, source)
        bundle = cls(path.absolute(), manifest, loaded, sizes, sessions)
        bundle._try_out(str(path))
        return bundle

    def __reduce__(self) -> tuple[Callable[..., Self], tuple[str, str]]:
        return type(self).load, (str(self.path), self.sha256)

    def encode(self, command: Float32Array) -> LstmState:
        """Read commands, (B, chunks, READ); the decoder starts from the state it leaves."""
        return LstmState(*self.sessions[ENCODER].run(ENCODER_OUTPUTS, {"command": command}))

    def decode_step(self, observation: Float32Array, state: LstmState) -> tuple[Float32Array, LstmState]:
        """Produce the next pan accelerations (B, CHUNK, 3) from the observation, (B, OBSERVED)."""
        inputs = {"observation": observation, "hidden": state.hidden, "cell": state.cell}
        acceleration, hidden, cell = self.sessions[DECODER_STEP].run(DECODER_STEP_OUTPUTS, inputs)
        return acceleration, LstmState(hidden, cell)

    def _try_out(self, source: str) -> None:
        """Run both graphs once with two commands of three chunks and look at the shapes that come out.

        Raises:
            BundleError: a graph fails, or gives another shape than the manifest's numbers ask for.
        """
        try:
            state = self.encode(np.zeros((2, 3, READ), dtype=np.float32))
            observation = np.zeros((2, OBSERVED), dtype=np.float32)
            acceleration, after = self.decode_step(observation, state)
        except Exception as error:  # onnxruntime's own exceptions share no base class of theirs
            raise BundleError(f"{source}: a graph does not run: {_first_line(error)}") from error
        memory = (self.manifest.layers, 2, self.manifest.units)
        expected = {"pan_acceleration": (2, CHUNK, 3)} | dict.fromkeys(
            (*ENCODER_OUTPUTS, "hidden_out", "cell_out"), memory
        )
        given = zip((*ENCODER_OUTPUTS, *DECODER_STEP_OUTPUTS), (*state, acceleration, *after), strict=True)
        for name, array in given:
            if array.shape != expected[name]:
                raise BundleError(f"{source}: output {name} has the shape {array.shape}, must be {expected[name]}")


def _read(path: Path) -> bytes:
    """Read a file of a bundle.

    Raises:
        InputError: it cannot be read, or is a pipe or a device, which might never end.
    """
    if path.exists() and not path.is_file():
        raise InputError("cannot be read: is no file")
    return read_bytes(path)


def _session(model: bytes, source: str) -> Any:
    """Open a graph for one thread that never spins: spinning costs 2-3 times as soon as anything else runs.

    Raises:
        BundleError: onnxruntime does not understand the bytes.
    """
    # Otherwise onnxruntime keeps an identifier of the machine in the home folder. Whoever wants that sets 0.
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime  # here: a client of a server, who loads no bundle, saves 17 MB and 50 ms

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.add_session_config_entry("session.inter_op.allow_spinning", "0")
    options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_ALL
    options.log_severity_level = 4  # fatal only: what goes wrong is raised, and said once
    try:
        return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's own exceptions share no base class of theirs
        raise BundleError(f"{source}: not a graph onnxruntime can load: {_first_line(error)}") from error


def _check_inputs_and_outputs(session: Any, name: str, manifest: Manifest, source: str) -> None:
    """Compare a graph's inputs and outputs with the manifest.

    Raises:
        BundleError: a name, a type or a size differs, or an axis that must be free is fixed.
    """
    memory = (manifest.layers, "batch", manifest.units)
    expected: dict[str, tuple[int | str, ...]]
    outputs: tuple[str, ...]
    if name == ENCODER:
        expected, outputs = {"command": ("batch", "chunks", READ)}, ENCODER_OUTPUTS
    else:
        expected = {"observation": ("batch", OBSERVED), "hidden": memory, "cell": memory}
        outputs = DECODER_STEP_OUTPUTS
    given = {tensor.name: tensor for tensor in session.get_inputs()}
    given_outputs = {tensor.name for tensor in session.get_outputs()}
    if set(given) != set(expected):
        raise BundleError(f"{source}: inputs must be {', '.join(expected)}, got {', '.join(given)}")
    if given_outputs != set(outputs):
        raise BundleError(f"{source}: outputs must be {', '.join(outputs)}, got {', '.join(sorted(given_outputs))}")
    for tensor_name, shape in expected.items():
        tensor = given[tensor_name]
        fits = len(tensor.shape) == len(shape) and all(
            have == want if isinstance(want, int) else not isinstance(have, int)
            for have, want in zip(tensor.shape, shape, strict=True)
        )
        if tensor.type != "tensor(float)" or not fits:
            have, want = (", ".join(map(str, sizes)) for sizes in (tensor.shape, shape))
            raise BundleError(
                f"{source}: input {tensor_name} must be tensor(float) [{want}], got {tensor.type} [{have}]"
            )


def _first_line(error: Exception) -> str:
    return str(error).partition("\n")[0]
