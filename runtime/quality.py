"""What is to be said of a plan: its figures, what the governor did, its limits and the margin to each, its status."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from dataclasses import fields as fields_of
from enum import StrEnum
from typing import Any, NamedTuple, Self

from runtime.documents.checks import fields, number, text
from runtime.errors import InputError
from runtime.limits import UNITS


class Status(StrEnum):
    """What is to be said of a plan as a whole; the worst thing that holds, worst last."""

    OK = "ok"
    """The network kept every limit by itself, and the command is of the kind it was trained on."""

    GOVERNED = "governed"
    """Every limit is kept because the governor changed accelerations, in up to 5 % of the samples; the prediction is of
    the changed ones."""

    LIMITED = "limited"
    """The governor changed accelerations in more than 5 % of the samples: the limits decide how the object follows."""

    BEYOND_TRAINING_RANGE = "beyond_training_range"
    """The command, the friction or the start is outside the range the model was trained on."""

    POOR = "poor"
    """The object follows worse than half as well as on a pan that never moves, or worse than 10 mm if no tolerance was
    given."""

    CANNOT_SLIDE = "cannot_slide"
    """The acceleration limit is not above mu g: no allowed motion of the pan breaks the object away."""

    OFF_PAN = "off_pan"
    """The command, or the object by the prediction, comes over the pan's rim; past that the prediction is wrong."""

    TOLERANCE_MISSED = "tolerance_missed"
    """The tracking RMSE is above the tolerance that was given."""

    LIMIT_EXCEEDED = "limit_exceeded"
    """A limit is passed: the plan must not be executed as it is. The planner makes no such plans; older files may."""

    @property
    def failed(self) -> bool:
        """Whether the plan does not do what was asked for: from `poor` on. `slide-plan` then exits with 1."""
        return self in _FAILED


_FAILED = tuple(Status)[tuple(Status).index(Status.POOR) :]


class OffPan(NamedTuple):
    """When and how far something comes over the rim.

    Attributes:
        first: the first sample at which it does.
        farthest: largest distance of the object's edge beyond the rim (m).
    """

    first: int
    farthest: float


class Changes(NamedTuple):
    """What the governor changed: number of samples, and by how much on average and at most (m/s^2)."""

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
        height_max: largest distance of the pan above or below the centre of its reach (m); 0 for a level pan.
        speed_max: largest speed of the pan (m/s).
        acceleration_max: largest pan acceleration (m/s^2).
        jerk_max: largest change of the pan acceleration from one sample to the next, over dt (m/s^3).
        sliding_share: share of the samples at which the object slides (0 to 1).
        limits: the limits that hold, by the names in UNITS and in its units; None where there is none.
        margins: limit minus figure; None where there is no limit.
        worst: by the same names, the sample at which the figure is reached; None where it is not known.
        governed: what the governor changed; None where it is not known.
        friction: under which friction the plan holds a tolerance; None if that was not asked.
        friction_off_rmse: tracking RMSE (m) if both coefficients are 10 % off, lower or higher, open loop: the worst of
            the four ways; None where it is not known.
        rest_error: distance (m) between where the object rests after the plan's stop and where the command ends; None
            where it is not known.
        command_off_pan, object_off_pan: where the command, and the object by the prediction, come over the pan's rim;
            None where they do not, or it is not known.
        status: the worst thing to be said.
        notes: a line for each thing that led to the status, the worst first, with value, range and unit; then what is
            worth knowing of how the command was read.
    """

    tracking_rmse: float
    tracking_max: float
    pan_reach: float
    height_max: float
    speed_max: float
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
    friction_off_rmse: float | None = None
    rest_error: float | None = None
    command_off_pan: OffPan | None = None
    object_off_pan: OffPan | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON document."""
        return {
            **{name: getattr(self, name) for name in _NUMBERS},
            "limits": dict(self.limits),
            "margins": dict(self.margins),
            "worst": dict(self.worst),
            "governed": None if self.governed is None else self.governed._asdict(),
            "friction": None if self.friction is None else self.friction._asdict(),
            "friction_off_rmse": self.friction_off_rmse,
            "rest_error": self.rest_error,
            "command_off_pan": None if self.command_off_pan is None else self.command_off_pan._asdict(),
            "object_off_pan": None if self.object_off_pan is None else self.object_off_pan._asdict(),
            "status": self.status.value,
            "notes": list(self.notes),
        }

    @classmethod
    def from_dict(cls, document: object, where: str = "quality") -> Self:
        """Read the JSON document; `where` is its key in the plan.

        Older plans may lack the keys of _OPTIONAL.

        Raises:
            InputError: a key is missing or unknown, or a value is not what it must be.
        """
        needed = (*_NUMBERS, "limits", "margins", "status", "notes")
        parts = fields(document, where, needed, optional=_OPTIONAL)
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
            worst=_by_limit(parts.get("worst", dict.fromkeys(UNITS)), f"{where}.worst"),
            governed=None if governed is None else _changes(governed, f"{where}.governed"),
            friction=None if friction is None else _friction_range(friction, f"{where}.friction"),
            friction_off_rmse=_optional(parts.get("friction_off_rmse"), f"{where}.friction_off_rmse"),
            rest_error=_optional(parts.get("rest_error"), f"{where}.rest_error"),
            command_off_pan=_off_pan(parts.get("command_off_pan"), f"{where}.command_off_pan"),
            object_off_pan=_off_pan(parts.get("object_off_pan"), f"{where}.object_off_pan"),
            status=Status(status),
            notes=tuple(text(note, f"{where}.notes[{index}]") for index, note in enumerate(parts["notes"])),
        )


_NUMBERS = tuple(each.name for each in fields_of(Quality)[:8])
_OPTIONAL = (
    "worst",
    "governed",
    "friction",
    "friction_off_rmse",
    "rest_error",
    "command_off_pan",
    "object_off_pan",
)


def _by_limit(value: object, where: str) -> dict[str, float | None]:
    parts = fields(value, where, tuple(UNITS))
    return {name: _optional(parts[name], f"{where}.{name}") for name in UNITS}


def _changes(value: object, where: str) -> Changes:
    parts = fields(value, where, Changes._fields)
    samples, mean, largest = (number(parts[name], f"{where}.{name}") for name in Changes._fields)
    return Changes(int(samples), mean, largest)


def _off_pan(value: object, where: str) -> OffPan | None:
    if value is None:
        return None
    parts = fields(value, where, OffPan._fields)
    first, farthest = (number(parts[name], f"{where}.{name}") for name in OffPan._fields)
    return OffPan(int(first), farthest)


def _friction_range(value: object, where: str) -> FrictionRange:
    parts = fields(value, where, FrictionRange._fields)
    tolerance, *ends = FrictionRange._fields
    return FrictionRange(
        number(parts[tolerance], f"{where}.{tolerance}"), *(_optional(parts[end], f"{where}.{end}") for end in ends)
    )


def _optional(value: object, where: str) -> float | None:
    return None if value is None else number(value, where)
