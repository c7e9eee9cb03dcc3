"""A plan: how the pan is to move so that the object slides along the command, and what to expect of it.

Time line: row k of every array belongs to t_k = k dt, k = 0..K-1; row k of the pan acceleration acts from t_k to
t_(k+1), so that the last one leads out of the command. A plan's JSON document is the planner's file, the server's
answer and the input of every replay, all the same.
"""

from __future__ import annotations

import io
import json
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from os import PathLike
from pathlib import Path
from typing import Any, Self

import numpy as np

from runtime.documents import (
    FloatArray,
    check_format,
    fields,
    number,
    parse_json,
    parse_npz,
    read_bytes,
    read_text,
    reading,
    table,
    text,
    write_whole,
)
from runtime.errors import InputError, OutputError
from runtime.friction import Friction, rollout

PLAN_FORMAT = "slide-plan/1"

LIMITED = {"pan_reach": ("pan_reach", "m"), "acceleration": ("acceleration_max", "m/s^2")}
"""Each limit's name, the figure of `Quality` it bounds, and the unit."""

LIMIT_ROUNDING = 1e-6
"""A limit may be passed by this share of itself: the network bounds its accelerations in float32."""


class Status(StrEnum):
    """What is to be said of a plan as a whole; the worst thing that holds."""

    OK = "ok"
    """Within every limit, and the command is of the kind the model was trained on."""

    BEYOND_TRAINING_RANGE = "beyond_training_range"
    """Within every limit, but the command or the friction is outside the range the model was trained on."""

    LIMIT_EXCEEDED = "limit_exceeded"
    """A limit is passed: the plan must not be executed as it is."""


@dataclass(frozen=True)
class Quality:
    """How good a plan is, by its own prediction under the friction it was made for.

    Attributes:
        tracking_rmse: root of the mean squared distance between object and command (m).
        tracking_max: largest distance between object and command (m).
        pan_reach: largest distance of the pan from where it began (m).
        acceleration_max: largest pan acceleration (m/s^2).
        jerk_max: largest change of the pan acceleration from one sample to the next, over dt (m/s^3).
        sliding_share: share of the samples at which the object slides (0 to 1).
        limits: the limits that hold, by the names in LIMITED and in its units; None where there is none.
        margins: limit minus figure, negative when the limit is passed; None where there is no limit.
        status: the worst thing to be said.
        notes: one line for each thing that led to the status, with value, range and unit.
    """

    tracking_rmse: float
    tracking_max: float
    pan_reach: float
    acceleration_max: float
    jerk_max: float
    sliding_share: float
    limits: Mapping[str, float | None]
    margins: Mapping[str, float | None]
    status: Status
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON document."""
        return {
            **{name: getattr(self, name) for name in _FIGURES},
            "limits": dict(self.limits),
            "margins": dict(self.margins),
            "status": self.status.value,
            "notes": list(self.notes),
        }

    @classmethod
    def from_dict(cls, document: object, where: str = "quality") -> Self:
        """Read the JSON document; `where` is its key in the plan.

        Raises:
            InputError: a key is missing or unknown, or a value is not what it must be.
        """
        parts = fields(document, where, (*_FIGURES, "limits", "margins", "status", "notes"))
        status = text(parts["status"], f"{where}.status")
        if status not in tuple(Status):
            raise InputError(f"{where}.status must be one of {', '.join(Status)}, got {status!r}")
        if not isinstance(parts["notes"], list):
            raise InputError(f"{where}.notes must be a list of texts, got {reprlib.repr(parts['notes'])}")
        return cls(
            **{name: number(parts[name], f"{where}.{name}") for name in _FIGURES},
            limits=_optional_numbers(parts["limits"], f"{where}.limits"),
            margins=_optional_numbers(parts["margins"], f"{where}.margins"),
            status=Status(status),
            notes=tuple(text(note, f"{where}.notes[{index}]") for index, note in enumerate(parts["notes"])),
        )


_FIGURES = ("tracking_rmse", "tracking_max", "pan_reach", "acceleration_max", "jerk_max", "sliding_share")


def _optional_numbers(value: object, where: str) -> dict[str, float | None]:
    parts = fields(value, where, tuple(LIMITED))
    return {name: None if part is None else number(part, f"{where}.{name}") for name, part in parts.items()}


def assess(
    command_position: FloatArray,
    pan_acceleration: FloatArray,
    pan_position: FloatArray,
    object_velocity: FloatArray,
    object_position: FloatArray,
    dt: float,
    limits: Mapping[str, float | None],
    found: Mapping[str, tuple[float, str]],
    trained_on: Mapping[str, tuple[float, float]],
) -> Quality:
    """Judge a plan.

    Args:
        command_position: (K, 2) where the object should be (m).
        pan_acceleration: (K, 2) (m/s^2).
        pan_position: (K, 2) relative to where the pan began (m).
        object_velocity: (K, 2) predicted (m/s).
        object_position: (K, 2) predicted (m).
        dt: sampling interval (s).
        limits: the limits that hold, by the names in LIMITED; None where there is none.
        found: by the names in `trained_on`, what the command and the friction are, and the unit.
        trained_on: the lowest and highest value the model was trained on.
    """
    rmse, worst = tracking_error(object_position, command_position)
    figures = {
        "tracking_rmse": rmse,
        "tracking_max": worst,
        "pan_reach": float(_lengths(pan_position).max()),
        "acceleration_max": float(_lengths(pan_acceleration).max()),
        "jerk_max": float(_lengths(np.diff(pan_acceleration, axis=0)).max(initial=0.0)) / dt,
        "sliding_share": float(np.mean(object_velocity.any(axis=1))),
    }
    margins: dict[str, float | None] = {}
    exceeded = []
    for name, (figure, unit) in LIMITED.items():
        limit, value = limits[name], figures[figure]
        margins[name] = None if limit is None else limit - value
        if limit is not None and value > limit * (1.0 + LIMIT_ROUNDING):
            exceeded.append(f"{name.replace('_', ' ')} {value:.4g} {unit} exceeds the limit of {limit:g} {unit}")
    beyond = []
    for name, (low, high) in trained_on.items():
        value, unit = found[name]
        if not low <= value <= high:
            unit = f" {unit}" if unit else ""
            beyond.append(f"{name} {value:.4g}{unit} is outside the range trained on, {low:g} to {high:g}{unit}")
    status = Status.LIMIT_EXCEEDED if exceeded else Status.BEYOND_TRAINING_RANGE if beyond else Status.OK
    return Quality(**figures, limits=dict(limits), margins=margins, status=status, notes=(*exceeded, *beyond))


def tracking_error(object_position: FloatArray, command_position: FloatArray) -> tuple[float, float]:
    """Return the root mean square and the largest distance (m) between object and command, each (K, 2) (m)."""
    error = _lengths(object_position - command_position)
    return float(np.sqrt(np.mean(error * error))), float(error.max())


def _lengths(vectors: FloatArray) -> FloatArray:
    """Return the Euclidean lengths (n,) of (n, 2) vectors."""
    return np.hypot(vectors[:, 0], vectors[:, 1])


@dataclass(frozen=True, eq=False)
class Plan:
    """The pan's motion for one command, and the object's motion it predicts.

    Attributes:
        dt: sampling interval (s).
        model_name: name of the bundle that made the plan.
        model_sha256: sha256 of that bundle's manifest, which carries the hashes of its graphs.
        friction: the coefficients the plan was made for.
        command_position: (K, 2) where the object should be, relative to the pan (m).
        pan_acceleration: (K, 2) in the world (m/s^2); row k acts from t_k to t_(k+1).
        pan_velocity: (K, 2) in the world (m/s).
        pan_position: (K, 2) in the world, relative to where the pan began (m).
        object_velocity: (K, 2) predicted, relative to the pan (m/s).
        object_position: (K, 2) predicted, relative to the pan (m).
        quality: figures, limits and status.
    """

    dt: float
    model_name: str
    model_sha256: str
    friction: Friction
    command_position: FloatArray
    pan_acceleration: FloatArray
    pan_velocity: FloatArray
    pan_position: FloatArray
    object_velocity: FloatArray
    object_position: FloatArray
    quality: Quality

    def __len__(self) -> int:
        """Return the number of samples, K."""
        return len(self.command_position)

    def replay(self, friction: Friction | None = None) -> FloatArray:
        """Slide the object again along the plan's pan accelerations, maybe under another friction (Eqs. 4 and 9).

        Args:
            friction: coefficients; the plan's own if None, which gives the plan's prediction again, bit for bit.

        Returns:
            (K, 4) object position (m) and velocity (m/s) relative to the pan at t_0..t_(K-1).
        """
        start = np.concatenate([self.object_position[0], self.object_velocity[0]])
        # The last acceleration leads out of the time line: nothing of it is seen.
        after = rollout(start, self.pan_acceleration[:-1], friction or self.friction, self.dt)
        return np.concatenate([start[None], after])

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON document; every float keeps all its digits."""
        return {
            "format": PLAN_FORMAT,
            "dt": self.dt,
            "model": {"name": self.model_name, "sha256": self.model_sha256},
            "friction": {"static": self.friction.static, "kinetic": self.friction.kinetic},
            "command": {"position": self.command_position.tolist()},
            "pan": {
                "acceleration": self.pan_acceleration.tolist(),
                "velocity": self.pan_velocity.tolist(),
                "position": self.pan_position.tolist(),
            },
            "object": {"velocity": self.object_velocity.tolist(), "position": self.object_position.tolist()},
            "quality": self.quality.to_dict(),
        }

    @classmethod
    def from_dict(cls, document: object, source: str = "plan") -> Self:
        """Read the JSON document.

        Args:
            document: the parsed document.
            source: where it came from, for the message.

        Raises:
            FormatError: another format version, a key missing or unknown, a wrong shape, a value that is no finite
                number; the message names the key.
        """
        with reading(source):
            check_format(document, PLAN_FORMAT)
            parts = fields(document, "", ("format", "dt", "model", "friction", "command", "pan", "object", "quality"))
            model = fields(parts["model"], "model", ("name", "sha256"))
            friction = fields(parts["friction"], "friction", ("static", "kinetic"))
            command = fields(parts["command"], "command", ("position",))
            pan = fields(parts["pan"], "pan", ("acceleration", "velocity", "position"))
            sliding = fields(parts["object"], "object", ("velocity", "position"))
            dt = number(parts["dt"], "dt")
            if dt <= 0.0:
                raise InputError(f"dt must be greater than 0 s, got {dt:g}")
            position = table(command["position"], "command.position")
            if not len(position):
                raise InputError("command.position must have at least one row")

            def rows(value: object, key: str) -> FloatArray:
                result = table(value, key)
                if len(result) != len(position):
                    raise InputError(f"{key} has {len(result)} rows, command.position has {len(position)}")
                return result

            return cls(
                dt=dt,
                model_name=text(model["name"], "model.name"),
                model_sha256=text(model["sha256"], "model.sha256"),
                friction=Friction(friction["static"], friction["kinetic"]),
                command_position=position,
                pan_acceleration=rows(pan["acceleration"], "pan.acceleration"),
                pan_velocity=rows(pan["velocity"], "pan.velocity"),
                pan_position=rows(pan["position"], "pan.position"),
                object_velocity=rows(sliding["velocity"], "object.velocity"),
                object_position=rows(sliding["position"], "object.position"),
                quality=Quality.from_dict(parts["quality"]),
            )

    def save(self, path: str | PathLike[str]) -> None:
        """Write the plan as `.json` or `.npz`, by the suffix; the file appears whole or not at all.

        Raises:
            OutputError: another suffix, or the file cannot be written.
        """
        path = Path(path)
        check_suffix(path)
        if path.suffix.lower() == ".json":
            data = json.dumps(self.to_dict(), allow_nan=False).encode("ascii") + b"\n"
        else:
            buffer = io.BytesIO()
            np.savez(buffer, allow_pickle=False, **_flatten(self.to_dict()))
            data = buffer.getvalue()
        write_whole(path, data)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Read a plan from `.json` or `.npz`, by the suffix.

        Raises:
            FormatError: the file cannot be read, or is no plan of this format version; see `from_dict`.
        """
        path = Path(path)
        with reading(str(path)):
            if path.suffix.lower() == ".json":
                document = parse_json(read_text(read_bytes(path)))
            elif path.suffix.lower() == ".npz":
                document = _unflatten(parse_npz(read_bytes(path)))
            else:
                raise InputError(f"a plan is a .json or .npz file, got the suffix {path.suffix!r}")
        return cls.from_dict(document, str(path))


def check_suffix(path: Path) -> None:
    """Check that a plan can be written under this name.

    Raises:
        OutputError: the suffix is neither .json nor .npz.
    """
    if path.suffix.lower() not in (".json", ".npz"):
        raise OutputError(f"{path}: a plan is written as .json or .npz, got the suffix {path.suffix!r}")


def _flatten(document: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Lay a document out as arrays with dotted names, for npz; null, which no array can hold, becomes NaN."""
    arrays: dict[str, Any] = {}
    for name, value in document.items():
        if isinstance(value, Mapping):
            arrays.update(_flatten(value, f"{prefix}{name}."))
        elif value == []:  # the only lists that may be empty are those of texts
            arrays[prefix + name] = np.array([], dtype=np.str_)
        else:
            arrays[prefix + name] = np.array(np.nan if value is None else value)
    return arrays


def _unflatten(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """Undo `_flatten`.

    Raises:
        InputError: a name is both a value and a group.
    """
    document: dict[str, Any] = {}
    for dotted, array in arrays.items():
        *groups, name = dotted.split(".")
        place = document
        for group in groups:
            place = place.setdefault(group, {})
            if not isinstance(place, dict):
                raise InputError(f"{dotted!r} is below a value")
        if name in place:
            raise InputError(f"{dotted!r} is both a value and a group")
        value = array.tolist() if array.ndim == 0 or array.dtype.kind == "U" else array
        place[name] = None if isinstance(value, float) and np.isnan(value) else value
    return document
