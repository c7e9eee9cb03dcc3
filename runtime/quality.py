"""What is to be said of a plan: its figures, what the governor did, its limits and the margin to each, its status."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from dataclasses import fields as fields_of
from enum import StrEnum
from typing import Any, NamedTuple, Self

import numpy as np

from runtime.documents.checks import FloatArray, fields, number, text
from runtime.errors import InputError
from runtime.friction import Friction
from runtime.limits import UNITS, Limits
from runtime.physics.law import DT, rollout_batch
from runtime.physics.motion import Motion, lengths, tracking_error

FIGURES = {"pan_reach": "pan_reach", "acceleration": "acceleration_max", "jerk": "jerk_max"}
"""The figure of `Quality` that each limit bounds."""

ROUNDING = 1e-6
"""Share of a limit by which a figure may pass it, or the governor change it, and nothing is said: the network bounds
its accelerations in float32."""

FRICTION_STEP = 0.05
"""Spacing of the coefficients that a plan is replayed under; a hundredth is less than anyone measures."""


class Status(StrEnum):
    """What is to be said of a plan as a whole; the worst thing that holds, worst last."""

    OK = "ok"
    """The network kept every limit by itself, and the command is of the kind it was trained on."""

    GOVERNED = "governed"
    """Every limit is kept because the governor changed accelerations; the prediction is of the changed ones."""

    BEYOND_TRAINING_RANGE = "beyond_training_range"
    """Every limit is kept, but the command or the friction is outside the range the model was trained on."""

    TOLERANCE_MISSED = "tolerance_missed"
    """Every limit is kept, but the tracking RMSE is above the tolerance that was asked for."""

    LIMIT_EXCEEDED = "limit_exceeded"
    """A limit is passed: the plan must not be executed as it is. The planner makes no such plans; older files may."""


class Changes(NamedTuple):
    """What the governor changed: number of samples, and by how much on the mean of these and at most (m/s^2)."""

    samples: int
    mean: float
    largest: float


class FrictionRange(NamedTuple):
    """Friction under which the plan, replayed open loop, tracks within a tolerance; one coefficient at a time.

    Each interval is the part of a grid without gaps around the friction the plan was made for, None if the tolerance
    is missed there already.

    Attributes:
        tolerance: largest tracking RMSE (m).
        static_low, static_high: static coefficients, the kinetic one being the plan's.
        kinetic_low, kinetic_high: kinetic coefficients, the static one being the plan's.
    """

    tolerance: float
    static_low: float | None
    static_high: float | None
    kinetic_low: float | None
    kinetic_high: float | None


@dataclass(frozen=True)
class Quality:
    """How good a plan is, by its own prediction under the friction it was made for.

    Attributes:
        tracking_rmse: root of the mean squared distance between object and command (m).
        tracking_max: largest distance between object and command (m).
        pan_reach: largest distance of the pan from the centre of its reach (m).
        acceleration_max: largest pan acceleration (m/s^2).
        jerk_max: largest change of the pan acceleration from one sample to the next, over dt (m/s^3).
        sliding_share: share of the samples at which the object slides (0 to 1).
        limits: the limits that hold, by the names in UNITS and in its units; None where there is none.
        margins: limit minus figure; None where there is no limit.
        worst: by the same names, the sample at which the figure is reached; None where it is not known.
        governed: what the governor changed; None where it is not known.
        friction: under which friction the plan holds a tolerance; None if that was not asked.
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
    worst: Mapping[str, float | None] = field(default_factory=lambda: dict.fromkeys(UNITS))
    governed: Changes | None = None
    friction: FrictionRange | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON document."""
        return {
            **{name: getattr(self, name) for name in _NUMBERS},
            "limits": dict(self.limits),
            "margins": dict(self.margins),
            "worst": dict(self.worst),
            "governed": None if self.governed is None else self.governed._asdict(),
            "friction": None if self.friction is None else self.friction._asdict(),
            "status": self.status.value,
            "notes": list(self.notes),
        }

    @classmethod
    def from_dict(cls, document: object, where: str = "quality") -> Self:
        """Read the JSON document; `where` is its key in the plan.

        What plans of before the governor do not have may be absent: the limit on jerk, `worst`, `governed` and
        `friction`.

        Raises:
            InputError: a key is missing or unknown, or a value is not what it must be.
        """
        needed = (*_NUMBERS, "limits", "margins", "status", "notes")
        parts = fields(document, where, needed, optional=("worst", "governed", "friction"))
        status = text(parts["status"], f"{where}.status")
        if status not in tuple(Status):
            raise InputError(f"{where}.status must be one of {', '.join(Status)}, got {status!r}")
        if not isinstance(parts["notes"], list):
            raise InputError(f"{where}.notes must be a list of texts, got {reprlib.repr(parts['notes'])}")
        governed, friction = parts.get("governed"), parts.get("friction")
        return cls(
            **{name: number(parts[name], f"{where}.{name}") for name in _NUMBERS},
            limits=_by_limit(parts["limits"], f"{where}.limits"),
            margins=_by_limit(parts["margins"], f"{where}.margins"),
            worst=_by_limit(parts.get("worst", {"pan_reach": None, "acceleration": None}), f"{where}.worst"),
            governed=None if governed is None else _changes(governed, f"{where}.governed"),
            friction=None if friction is None else _friction_range(friction, f"{where}.friction"),
            status=Status(status),
            notes=tuple(text(note, f"{where}.notes[{index}]") for index, note in enumerate(parts["notes"])),
        )


_NUMBERS = tuple(each.name for each in fields_of(Quality)[:6])


def _by_limit(value: object, where: str) -> dict[str, float | None]:
    parts = fields(value, where, tuple(name for name in UNITS if name != "jerk"), optional=("jerk",))
    return {name: _optional(parts.get(name), f"{where}.{name}") for name in UNITS}


def _changes(value: object, where: str) -> Changes:
    parts = fields(value, where, Changes._fields)
    samples, mean, largest = (number(parts[name], f"{where}.{name}") for name in Changes._fields)
    return Changes(int(samples), mean, largest)


def _friction_range(value: object, where: str) -> FrictionRange:
    parts = fields(value, where, FrictionRange._fields)
    tolerance, *ends = FrictionRange._fields
    return FrictionRange(
        number(parts[tolerance], f"{where}.{tolerance}"), *(_optional(parts[end], f"{where}.{end}") for end in ends)
    )


def _optional(value: object, where: str) -> float | None:
    return None if value is None else number(value, where)


def assess(
    motion: Motion,
    command_position: FloatArray,
    acceleration_before: FloatArray,
    limits: Limits,
    found: Mapping[str, tuple[float, str]],
    trained_on: Mapping[str, tuple[float, float]],
    friction: FrictionRange | None = None,
) -> Quality:
    """Judge a plan.

    Args:
        motion: K samples of pan and object, as planned; the states after the last are not looked at.
        command_position: (K, 2) where the object should be (m).
        acceleration_before: (2,) of the pan over the sample before the first (m/s^2).
        limits: what the governor kept it to.
        found: by the names in `trained_on`, what the command and the friction are, and the unit.
        trained_on: the lowest and highest value the model was trained on.
        friction: under which friction the plan holds a tolerance, and which; None if there is no tolerance.
    """
    u, asked, pan, sliding = motion
    pan, sliding = pan[:-1], sliding[:-1]
    rmse, farthest = tracking_error(sliding[:, :2], command_position)
    along = {
        "pan_reach": lengths(pan[:, :2]),
        "acceleration": lengths(u),
        "jerk": lengths(u - np.concatenate([acceleration_before[None], u[:-1]])) / DT,
    }
    figures = {FIGURES[name]: float(values.max()) for name, values in along.items()}
    held = {name: value if limits.finite else None for name, value in limits.to_dict().items()}
    changes = _count_changes(u, asked, limits)
    missed = []
    if friction is not None and rmse > friction.tolerance:
        missed.append(f"tracking RMSE {rmse:.4g} m exceeds the tolerance of {friction.tolerance:g} m")
    notes = {
        Status.LIMIT_EXCEEDED: _exceeded(figures, held),
        Status.TOLERANCE_MISSED: missed,
        Status.BEYOND_TRAINING_RANGE: _beyond(found, trained_on),
        Status.GOVERNED: _governed(changes),
    }
    status = next((status for status, lines in notes.items() if lines), Status.OK)
    return Quality(
        tracking_rmse=rmse,
        tracking_max=farthest,
        **figures,
        sliding_share=float(np.mean((sliding[:, 2] != 0.0) | (sliding[:, 3] != 0.0))),
        limits=held,
        margins={name: None if limit is None else limit - figures[FIGURES[name]] for name, limit in held.items()},
        worst={name: int(values.argmax()) for name, values in along.items()},
        governed=changes,
        friction=friction,
        status=status,
        notes=tuple(line for lines in notes.values() for line in lines),
    )


def _exceeded(figures: Mapping[str, float], limits: Mapping[str, float | None]) -> list[str]:
    lines = []
    for name, limit in limits.items():
        value, unit = figures[FIGURES[name]], UNITS[name]
        if limit is not None and value > limit * (1.0 + ROUNDING):
            lines.append(f"{name.replace('_', ' ')} {value:.4g} {unit} exceeds the limit of {limit:g} {unit}")
    return lines


def _beyond(found: Mapping[str, tuple[float, str]], trained_on: Mapping[str, tuple[float, float]]) -> list[str]:
    lines = []
    for name, (low, high) in trained_on.items():
        value, unit = found[name]
        if not low <= value <= high:
            unit = f" {unit}" if unit else ""
            lines.append(f"{name} {value:.4g}{unit} is outside the range trained on, {low:g} to {high:g}{unit}")
    return lines


def _governed(changes: Changes) -> list[str]:
    if not changes.samples:
        return []
    many = "1 sample" if changes.samples == 1 else f"{changes.samples} samples"
    return [f"the governor changed {many}, by {changes.mean:.3g} m/s^2 on the mean, {changes.largest:.3g} at most"]


def _count_changes(u: FloatArray, asked: FloatArray, limits: Limits) -> Changes:
    if not limits.finite:
        return Changes(0, 0.0, 0.0)
    change = lengths(u - asked)
    change = change[change > ROUNDING * limits.acceleration]
    return Changes(len(change), float(change.mean()), float(change.max())) if len(change) else Changes(0, 0.0, 0.0)


def friction_range(
    motion: Motion,
    command_position: FloatArray,
    friction: Friction,
    tolerance: float,
    trained_on: Mapping[str, tuple[float, float]],
) -> FrictionRange:
    """Replay a plan open loop under other friction, on a grid over what the model was trained on.

    Args:
        motion: K samples of pan and object, as planned.
        command_position: (K, 2) where the object should be (m).
        friction: what it was made for.
        tolerance: largest tracking RMSE (m).
        trained_on: lowest and highest coefficient, under "static" and "kinetic".
    """
    static, kinetic = (_grid(getattr(friction, name), *trained_on[name]) for name in ("static", "kinetic"))
    static, kinetic = static[static >= friction.kinetic], kinetic[kinetic <= friction.static]
    cells = [(each, friction.kinetic) for each in static] + [(friction.static, each) for each in kinetic]
    u, start = motion.acceleration, motion.sliding[0]
    inputs = np.broadcast_to(u[:-1], (len(cells), len(u) - 1, 2))
    grid = np.array(cells)
    states = rollout_batch(np.tile(start, (len(cells), 1)), inputs, grid[:, 0], grid[:, 1])
    errors = lengths(states[..., :2] - command_position[1:])
    begin = lengths(start[None, :2] - command_position[:1])
    rmse = np.sqrt((np.sum(errors * errors, axis=1) + begin[0] ** 2) / len(command_position))
    good = (rmse <= tolerance).tolist()
    return FrictionRange(
        tolerance,
        *_around(static, good[: len(static)], friction.static),
        *_around(kinetic, good[len(static) :], friction.kinetic),
    )


def _grid(nominal: float, low: float, high: float) -> FloatArray:
    """Return coefficients FRICTION_STEP apart from `low` to `high`, and `nominal` among them, (n,) increasing."""
    count = int((high - low) / FRICTION_STEP + ROUNDING)
    return np.unique(np.concatenate([low + FRICTION_STEP * np.arange(count + 1), [nominal]]))


def _around(values: FloatArray, good: Sequence[bool], nominal: float) -> tuple[float | None, float | None]:
    """Return the first and last of the values around `nominal` that are good without a gap."""
    middle = values.tolist().index(nominal)
    if not good[middle]:
        return None, None
    low = high = middle
    while low > 0 and good[low - 1]:
        low -= 1
    while high + 1 < len(values) and good[high + 1]:
        high += 1
    return float(values[low]), float(values[high])
