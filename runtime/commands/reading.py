"""How a command is to be read: the options that files, documents, Python and HTTP share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Self

from runtime.commands.path import ACCELERATION
from runtime.documents.checks import number
from runtime.documents.options import option
from runtime.errors import InputError

ORIGINS = ("pan", "first")

SMOOTH = (0.1, 200.0)
"""Narrowest and widest smoothing (ms): a narrower one changes nothing, and what is slower is no noise."""

USABLE = (1e-12, 1e12)
"""Range of the other numbers, in their own units: what is beyond is a slip of the unit, its square maybe no number."""


@dataclass(frozen=True)
class Reading:
    """What the numbers of a command mean, where they do not say it themselves.

    Attributes:
        columns: the names of the columns of t, x and y in this order, or of x and y; of a file without a header, what
            its columns hold, t, x and y among it. A string "t,x,y" is taken as well.
        rate: samples per second (Hz) of positions without times.
        scale: what positions are multiplied by to be metres; 0.001 for millimetres.
        time_scale: what times are multiplied by to be seconds; 0.001 for milliseconds.
        origin: where the pan's centre is: "pan", positions are relative to it; "first", at the first position, where
            the object lies; or (x, y) in metres. None is "pan", but for drawings and with `size`: their middle.
        smooth: standard deviation (ms) of a Gaussian over time that takes out noise.
        speed: highest speed (m/s); the positions are a path, and times follow from it, see `runtime.commands.path`.
        path_acceleration: highest acceleration along that path (m/s^2); 2 if None.
        size: how far the command goes from its first position (m), where the numbers are no lengths, as in pixels.

    Raises:
        InputError: a value is not what it must be, or two contradict each other.
    """

    columns: tuple[str, ...] | str | None = option(
        "Columns of t, x and y, or of x and y.", metavar="T,X,Y", read_as=str | None
    )
    rate: float | None = option("Samples per second of a command without times.", metavar="HZ")
    scale: float | None = option("Makes positions metres: 0.001 for millimetres.", metavar="S")
    time_scale: float | None = option("Makes times seconds: 0.001 for milliseconds.", metavar="S")
    origin: str | tuple[float, float] | None = option(
        "Where the pan's centre is: pan, first or X,Y (m).", metavar="WHERE", read_as=str | None
    )
    smooth: float | None = option("Smooth noise out, over so many milliseconds.", metavar="MS")
    speed: float | None = option("Run along a path without times (m/s).", metavar="V")
    path_acceleration: float | None = option("Acceleration along that path (m/s^2).", metavar="A")
    size: float | None = option("How far the command goes from its start (m).", metavar="M")

    def __post_init__(self) -> None:
        for name, unit in POSITIVE.items():
            value = getattr(self, name)
            if value is None:
                continue
            if number(value, name) <= 0.0:
                raise InputError(f"{name} must be greater than 0{unit}, got {value:g}", name)
            low, high = SMOOTH if name == "smooth" else USABLE
            if not low <= value <= high:
                raise InputError(f"{name} must be between {low:g} and {high:g}{unit}, got {value:g}{unit}", name)
        if self.rate is not None and self.speed is not None:
            raise InputError("give rate or speed, not both: speed is for paths without times")
        if self.scale is not None and self.size is not None:
            raise InputError("give scale or size, not both: size finds the scale")
        if self.path_acceleration is not None and self.speed is None:
            raise InputError("path_acceleration goes with speed: it is for paths without times")
        object.__setattr__(self, "columns", _columns(self.columns))
        object.__setattr__(self, "origin", _origin(self.origin))

    @property
    def pull(self) -> float:
        """Highest acceleration along a path (m/s^2)."""
        return ACCELERATION if self.path_acceleration is None else self.path_acceleration

    @property
    def needs_times(self) -> bool:
        """Whether a table has to tell its times, for nothing that was said does."""
        return self.columns is None and self.rate is None and self.speed is None

    def completed(self, options: Mapping[str, Any]) -> Self:
        """Return these options, with those of a document where nothing was said.

        Raises:
            InputError: see the class.
        """
        said = {name: value for name in OPTIONS if (value := getattr(self, name)) is not None}
        return type(self)(**{**options, **said})


POSITIVE = {
    "rate": " Hz",
    "scale": "",
    "time_scale": "",
    "smooth": " ms",
    "speed": " m/s",
    "path_acceleration": " m/s^2",
    "size": " m",
}
"""Options that are numbers above zero, and their units."""

OPTIONS = tuple(each.name for each in fields(Reading))


def _columns(value: object) -> tuple[str, ...] | None:
    if value is None:
        return None
    names = value.split(",") if isinstance(value, str) else value
    if not isinstance(names, (list, tuple)) or not all(isinstance(name, str) for name in names):
        raise InputError(f"columns must be names like t,x,y, got {value!r}")
    names = tuple(name.strip() for name in names)
    if len(names) < 2:
        raise InputError(f"columns must name t, x and y, or x and y, got {','.join(names)!r}")
    return names


def _origin(value: object) -> str | tuple[float, float] | None:
    if value is None or (isinstance(value, str) and value in ORIGINS):
        return value
    parts: Any = value.split(",") if isinstance(value, str) else value
    if isinstance(parts, (list, tuple)) and len(parts) == 2:
        try:
            x, y = (float(part) if isinstance(part, str) else part for part in parts)
        except ValueError:
            pass
        else:
            return number(x, "origin, column x"), number(y, "origin, column y")
    raise InputError(f"origin must be pan, first or X,Y in metres, got {value!r}")
