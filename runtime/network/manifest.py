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

FIRST_FORMAT = "slide-bundle/1"
"""The format before, of networks for one pan only, whose constants stood beside the others; it is read too."""

ONE_PAN, GENERAL = "one-pan", "general"
"""Kinds of networks: in SI for one pan, and in the law's units for every pan."""

MANIFEST_FILE = "manifest.json"

PRECISIONS = ("fp32", "int8")

ENCODER = "encoder"
DECODER_STEP = "decoder_step"

TRAINED_ON = {
    ONE_PAN: {
        "static": "",
        "kinetic": "",
        "reach": "m",
        "speed": "m/s",
        "samples": "",
        "start_speed": "m/s",
        "corner": "m/s",
    },
    GENERAL: {
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
    },
}
"""What the manifest gives the range of, and the unit, by the kind of network.

Of one for one pan: coefficients of friction; of the command the distance from its first position, the speed, the number
of samples and the sharpest corner, as a change of velocity; the speed of the pan at the start. Of one for every pan,
besides: the share of its acceleration that the pan takes to break the object away, and the limits; what is of the
command in the network's units.
"""

USUAL_RANGES = {"start_speed": (0.0, 1.0), "corner": (0.0, 1.2)}
"""Ranges where a manifest does not say: what a network is taken through in mid-course, and still follows."""

LARGEST = {"chunk": 10_000, "layers": 16, "units": 8192, "command_ahead": 100}
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
class OnePan:
    """A network in SI units for one pan.

    Attributes:
        chunk: samples in a chunk, C.
        command_ahead: command chunks the decoder sees in each iteration.
        acceleration_bound: bound on the pan acceleration inside the network (m/s^2); None if it has none.
        pan_limit: largest distance of the pan from where it began that was trained for (m).
    """

    chunk: int
    command_ahead: int
    acceleration_bound: float | None
    pan_limit: float


Kind = OnePan | Constants
"""What sets a network apart: its own numbers, or those that all networks for every pan have in common."""


@dataclass(frozen=True)
class Manifest:
    """What a bundle says of itself; the keys of manifest.json are these names, with `format` before them.

    Attributes:
        name: the bundle's name.
        precision: "fp32" or "int8".
        opset: of the graphs' operators.
        graphs: file and hash of `encoder` and `decoder_step`.
        network: which kind it is, with its constants; in the file `kind` stands before these.
        dt: sampling interval (s).
        layers: LSTM layers in the encoder and in the decoder.
        units: LSTM units in a layer.
        friction: what plans are made for unless something else is said.
        trained_on: lowest and highest value of each of TRAINED_ON in the training. Those of USUAL_RANGES may be absent
            in the file.
        training: how the network was made; free-form.
        evaluation: figures; free-form.
        limits: what plans keep to unless something else is said. May be absent in the file: then, of a network for one
            pan, `pan_limit` and the acceleration bound, and the defaults of `Limits`.
        sizes: of pan and object, unless something else is said. May be absent in the file.
    """

    name: str
    precision: str
    opset: int
    graphs: Mapping[str, GraphFile]
    network: Kind
    dt: float
    layers: int
    units: int
    friction: Friction
    trained_on: Mapping[str, tuple[float, float]]
    training: Mapping[str, Any]
    evaluation: Mapping[str, Any]
    limits: Limits = DEFAULT_LIMITS
    sizes: Sizes = DEFAULT_SIZES

    @property
    def kind(self) -> str:
        """The kind of network, ONE_PAN or GENERAL."""
        return ONE_PAN if isinstance(self.network, OnePan) else GENERAL

    @property
    def one_pan(self) -> OnePan:
        """The constants of a network for one pan.

        Raises:
            InputError: it is one for every pan.
        """
        if not isinstance(self.network, OnePan):
            raise InputError(f"{self.name} is a network for every pan, and this works with networks for one pan")
        return self.network

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON document.

        Raises:
            BundleError: a value is not what it must be: no manifest is written that could not be read.
        """
        document = {
            "format": BUNDLE_FORMAT,
            **vars(self),
            "graphs": {name: graph._asdict() for name, graph in self.graphs.items()},
            "network": {"kind": self.kind, **asdict(self.network)},
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
            optional = ("limits", "sizes")
            needed = [name for name in cls.__dataclass_fields__ if name not in optional]
            if isinstance(document, Mapping) and document.get("format") == FIRST_FORMAT:
                needed.remove("network")
                parts = fields(document, "", ("format", *needed, *ONE_PAN_KEYS), optional)
                network: Kind = _one_pan(parts, "")
            else:
                check_format(document, BUNDLE_FORMAT, "export it again with  slide-export RUN -o BUNDLE")
                parts = fields(document, "", ("format", *needed), optional)
                network = _network(parts["network"])
            kind = ONE_PAN if isinstance(network, OnePan) else GENERAL
            precision = text(parts["precision"], "precision")
            if precision not in PRECISIONS:
                raise InputError(f"precision must be one of {', '.join(PRECISIONS)}, got {precision!r}")
            graphs = fields(parts["graphs"], "graphs", (ENCODER, DECODER_STEP))
            usual = USUAL_RANGES if kind == ONE_PAN else {}
            always = tuple(name for name in TRAINED_ON[kind] if name not in usual)
            trained_on = usual | dict(fields(parts["trained_on"], "trained_on", always, tuple(usual)))
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
                network=network,
                dt=dt,
                layers=_integer(parts["layers"], "layers", 1),
                units=_integer(parts["units"], "units", 1),
                friction=Friction.from_dict(parts["friction"]),
                trained_on={name: _range(trained_on[name], f"trained_on.{name}") for name in TRAINED_ON[kind]},
                training=parts["training"],
                evaluation=parts["evaluation"],
                limits=Limits.from_dict(parts["limits"]) if "limits" in parts else default_limits(network),
                sizes=Sizes.from_dict(parts["sizes"]) if "sizes" in parts else DEFAULT_SIZES,
            )


def default_limits(network: Kind) -> Limits:
    """Return the limits of plans by a network of these constants."""
    if not isinstance(network, OnePan):
        return DEFAULT_LIMITS
    if network.acceleration_bound is None:
        return Limits(network.pan_limit)
    return Limits(network.pan_limit, acceleration=network.acceleration_bound)


def _network(value: object) -> Kind:
    kind = value.get("kind") if isinstance(value, Mapping) else None
    if kind == ONE_PAN:
        return _one_pan(fields(value, "network", ("kind", *ONE_PAN_KEYS)), "network.")
    known = asdict(Constants())
    if kind != GENERAL:
        raise InputError(f"network.kind must be {ONE_PAN!r} or {GENERAL!r}, got {reprlib.repr(kind)}", "network.kind")
    parts = fields(value, "network", ("kind", *known))
    for name, own in known.items():
        given = tuple(parts[name]) if isinstance(parts[name], list) else parts[name]
        if given != own or isinstance(given, bool):
            raise InputError(
                f"network.{name} must be {own}, which this version works with, got {reprlib.repr(given)}: train the "
                "network again, or use the version that it was exported with"
            )
    return Constants()


ONE_PAN_KEYS = tuple(OnePan.__dataclass_fields__)


def _one_pan(parts: Mapping[str, Any], where: str) -> OnePan:
    bound = parts["acceleration_bound"]
    return OnePan(
        _integer(parts["chunk"], f"{where}chunk", 1),
        _integer(parts["command_ahead"], f"{where}command_ahead", 0),
        None if bound is None else _positive(bound, f"{where}acceleration_bound"),
        _positive(parts["pan_limit"], f"{where}pan_limit"),
    )


def _integer(value: object, key: str, smallest: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < smallest:
        raise InputError(f"{key} must be a whole number of at least {smallest}, got {reprlib.repr(value)}")
    most = LARGEST.get(key.rpartition(".")[2])
    if most is not None and value > most:
        raise InputError(f"{key} must be at most {most}, got {reprlib.repr(value)}")
    return value


def _positive(value: object, key: str) -> float:
    result = number(value, key)
    if result <= 0.0:
        raise InputError(f"{key} must be greater than 0, got {result:g}")
    return result


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
