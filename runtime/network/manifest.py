"""The manifest: what a bundle says of itself, read strictly."""

from __future__ import annotations

import re
import reprlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple, Self

from runtime.documents.checks import check_format, fields, number, text
from runtime.errors import BundleError, InputError
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.network.units import Constants
from runtime.physics.law import DT
from runtime.sizes import Sizes

BUNDLE_FORMAT = "slide-bundle/2"

HOW_TO_EXPORT = "train a network with  slide-train default  and export it with  slide-export RUN -o BUNDLE"
"""What makes a bundle of this format; those of slide-bundle/1 know one pan, and cannot be converted."""

MANIFEST_FILE = "manifest.json"

PRECISIONS = ("fp32", "int8")

ENCODER = "encoder"
DECODER_STEP = "decoder_step"

TRAINED_ON = {
    "static": "",
    "kinetic": "",
    "push": "of the acceleration limit",
    "pan_reach": "m",
    "height": "m",
    "pan_speed": "m/s",
    "acceleration": "m/s^2",
    "jerk": "m/s^3",
    "reach": "of the pan's",
    "speed": "m/s of the network's",
    "start_speed": "m/s of the network's",
    "corner": "m/s of the network's",
    "samples": "of the network's time",
}
"""What the manifest gives the range of, and the unit.

Coefficients of friction, and the share of its acceleration that the pan takes to break the object away; the limits; in
the network's units, of the command the distance from its first position, the speed, the sharpest corner, as a change of
velocity, and the number of samples, and the speed of the pan at the start.
"""

LARGEST = {"layers": 16, "units": 8192}
"""Largest of each number in a manifest that memory is allocated by."""

DEFAULT_LIMITS = Limits()
DEFAULT_SIZES = Sizes()


@contextmanager
def bundle_errors(source: str) -> Iterator[None]:
    """Turn an InputError raised inside into a BundleError that names its source."""
    try:
        yield
    except InputError as error:
        raise BundleError(f"{source}: {error}") from error


class GraphFile(NamedTuple):
    """A graph's file name within the bundle, and the sha256 of its bytes in hexadecimal."""

    file: str
    sha256: str


@dataclass(frozen=True)
class Manifest:
    """What a bundle says of itself; the keys of manifest.json are these names, with `format` before them.

    Attributes:
        name: the bundle's name.
        precision: "fp32" or "int8".
        opset: of the graphs' operators.
        graphs: file and hash of `encoder` and `decoder_step`.
        network: its constants.
        dt: sampling interval (s).
        layers: LSTM layers in the encoder and in the decoder.
        units: LSTM units in a layer.
        friction: what plans are made for unless something else is said.
        trained_on: lowest and highest value of each of TRAINED_ON in the training.
        training: how the network was made; free-form.
        evaluation: figures; free-form.
        limits: what plans keep to unless something else is said. May be absent in the file.
        sizes: of pan and object, unless something else is said. May be absent in the file.
    """

    name: str
    precision: str
    opset: int
    graphs: Mapping[str, GraphFile]
    network: Constants
    dt: float
    layers: int
    units: int
    friction: Friction
    trained_on: Mapping[str, tuple[float, float]]
    training: Mapping[str, Any]
    evaluation: Mapping[str, Any]
    limits: Limits = DEFAULT_LIMITS
    sizes: Sizes = DEFAULT_SIZES

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON document.

        Raises:
            BundleError: a value is not what it must be: no manifest is written that could not be read.
        """
        document = {
            "format": BUNDLE_FORMAT,
            **vars(self),
            "graphs": {name: graph._asdict() for name, graph in self.graphs.items()},
            "network": asdict(self.network),
            "friction": self.friction.to_dict(),
            "trained_on": {name: list(limits) for name, limits in self.trained_on.items()},
            "training": dict(self.training),
            "evaluation": dict(self.evaluation),
            "limits": self.limits.to_dict(),
            "sizes": self.sizes.to_dict(),
        }
        type(self).from_dict(document)
        return document

    @classmethod
    def from_dict(cls, document: object, source: str = "manifest") -> Self:
        """Read the JSON document.

        Args:
            document: the parsed document.
            source: where it came from, for the message.

        Raises:
            BundleError: another format version, a key missing or unknown, or a value that is not what it must be.
        """
        with bundle_errors(source):
            check_format(document, BUNDLE_FORMAT, HOW_TO_EXPORT)
            optional = ("limits", "sizes")
            needed = [name for name in cls.__dataclass_fields__ if name not in optional]
            parts = fields(document, "", ("format", *needed), optional)
            precision = text(parts["precision"], "precision")
            if precision not in PRECISIONS:
                raise InputError(f"precision must be one of {', '.join(PRECISIONS)}, got {precision!r}")
            graphs = fields(parts["graphs"], "graphs", (ENCODER, DECODER_STEP))
            trained_on = fields(parts["trained_on"], "trained_on", tuple(TRAINED_ON))
            for name in ("training", "evaluation"):
                if not isinstance(parts[name], Mapping):
                    raise InputError(f"{name} must be an object, got {parts[name]!r}")
            dt = number(parts["dt"], "dt")
            if dt != DT:
                raise InputError(f"dt must be {DT:g} s, the sampling interval of commands and plans, got {dt:g} s")
            return cls(
                name=text(parts["name"], "name"),
                precision=precision,
                opset=_integer(parts["opset"], "opset", 1),
                graphs={name: _graph_file(value, f"graphs.{name}") for name, value in graphs.items()},
                network=_network(parts["network"]),
                dt=dt,
                layers=_integer(parts["layers"], "layers", 1),
                units=_integer(parts["units"], "units", 1),
                friction=Friction.from_dict(parts["friction"]),
                trained_on={name: _range(trained_on[name], f"trained_on.{name}") for name in TRAINED_ON},
                training=parts["training"],
                evaluation=parts["evaluation"],
                limits=Limits.from_dict(parts["limits"]) if "limits" in parts else DEFAULT_LIMITS,
                sizes=Sizes.from_dict(parts["sizes"]) if "sizes" in parts else DEFAULT_SIZES,
            )


def _network(value: object) -> Constants:
    known = asdict(Constants())
    parts = fields(value, "network", tuple(known))
    for name, own in known.items():
        given = tuple(parts[name]) if isinstance(parts[name], list) else parts[name]
        if given != own or isinstance(given, bool):
            raise InputError(
                f"network.{name} must be {own}, which this version works with, got {reprlib.repr(given)}: train the "
                "network again, or use the version that it was exported with"
            )
    return Constants()


def _integer(value: object, key: str, smallest: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < smallest:
        raise InputError(f"{key} must be a whole number of at least {smallest}, got {reprlib.repr(value)}")
    most = LARGEST.get(key.rpartition(".")[2])
    if most is not None and value > most:
        raise InputError(f"{key} must be at most {most}, got {reprlib.repr(value)}")
    return value


def _range(value: object, key: str) -> tuple[float, float]:
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise InputError(f"{key} must be [lowest, highest], got {value!r}")
    low, high = (number(item, key) for item in value)
    if low > high:
        raise InputError(f"{key}: the lowest, {low:g}, exceeds the highest, {high:g}")
    return low, high


def _graph_file(value: object, key: str) -> GraphFile:
    parts = fields(value, key, GraphFile._fields)
    file, sha256 = text(parts["file"], f"{key}.file"), text(parts["sha256"], f"{key}.sha256")
    if not re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9._-]*", file):  # no separator: it cannot leave the folder
        raise InputError(f"{key}.file must be a plain file name, got {file!r}")
    if not re.fullmatch(r"[0-9a-f]{64}", sha256):
        raise InputError(f"{key}.sha256 must be 64 hexadecimal digits, got {sha256!r}")
    return GraphFile(file, sha256)
