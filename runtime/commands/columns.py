"""Which columns of a table hold t, x and y, by their names."""

from __future__ import annotations

import re
import reprlib
from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

from runtime.errors import InputError

TUM = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
"""Columns of a trajectory in the format of the TUM RGB-D benchmark."""

SECONDS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millis", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs", "usec", "micros", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanosec", "nanoseconds"), 1e-9),
}
"""Units of time that a column's name may end in, in seconds."""

METRES = {
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1.0),
    **dict.fromkeys(("cm", "centimeters", "centimetres"), 1e-2),
    **dict.fromkeys(("mm", "millimeters", "millimetres"), 1e-3),
    **dict.fromkeys(("in", "inch", "inches"), 0.0254),
    **dict.fromkeys(("ft", "foot", "feet"), 0.3048),
    **dict.fromkeys(("um", "µm", "μm", "micrometers", "micrometres"), 1e-6),
}
"""Units of length that a column's name may end in, in metres."""

PIXELS = {"px", "pixel", "pixels"}
"""Units that are no lengths."""

TIMES = (
    *("t", "time", "timestamp", "sec", "secs", "second", "seconds", "stamp", "times", "timestamps", "elapsed"),
    *("ts", "tstamp", "datetime", "date", "epoch", "clock", "zeit", "temps", "tiempo", "tempo", "tijd"),
)
"""Names of a time column, the likeliest first."""

COUNTERS = {"frame", "frames", "sample", "samples"}
"""Names of a column that counts what was recorded at a steady rate."""

GLUED = ("pos{}", "{}pos", "p{}", "t{}", "c{}", "position{}", "{}position", "{}coord")
"""How an axis is written in one word with something else."""

POSITIONS = {"position", "pos", "p", "translation", "point", "coord", *(each.format("*") for each in GLUED)}
"""What tells that an axis is one of a position."""

NO_POSITIONS = {
    *("velocity", "vel", "speed", "acceleration", "accel", "acc", "linear", "angular", "twist", "orientation"),
    *("quaternion", "rotation", "rot", "angle", "deg", "rad", "force", "torque", "moment", "wrench", "effort", "gyro"),
    *("mag", "dot", "ddot", "jerk", "err", "error", "std", "sigma", "var", "variance", "cov", "covariance"),
}
"""What tells that an axis is one of something else."""


LISTED = 12
"""Most names that a message lists."""

LETTERS = {"v", "a", "q", "w", "b", "f"}
"""Letters that tell it too, if there is anything else."""


class Choice(NamedTuple):
    """Where t, x and y are.

    Attributes:
        x, y: indices of columns.
        t: index and seconds a unit of each column that times are the sum of; empty if there is none. The unit is None
            where the name does not say it.
        unit: metres a unit of position, where the names say it.
    """

    x: int
    y: int
    t: tuple[tuple[int, float | None], ...] = ()
    unit: float | None = None


def choose(names: Sequence[str], wanted: Sequence[str] | None) -> Choice:
    """Find the columns in a table with a header.

    Args:
        names: the header.
        wanted: what the user calls the columns of t, x, y, or of x, y; None to find them.

    Raises:
        InputError: there is no such column, or more than one that it may be.
    """
    plain = [_plain(name) for name in names]
    if wanted is not None:
        return _wanted(plain, wanted)
    pairs = _pairs(plain)
    if not pairs:
        missing = [axis for axis in "xy" if not any(_stem(_parts(name)[0], axis) for name in plain)] or ["x"]
        raise InputError(
            f"missing column {missing[0]!r} among {_listed(names)}: say which are meant by --columns T,X,Y"
        )
    if len(pairs) > 1:
        several = list(dict.fromkeys(f"{plain[x]}, {plain[y]}" for x, y in pairs))
        ways_out = "--columns T,X,Y"
        if len(several) < len(pairs):
            several = [f"columns {x + 1}, {y + 1}" for x, y in pairs]
            ways_out = "their numbers, as in --columns 1,2,3"
        several = several[:LISTED] + ["others"] * (len(several) > LISTED)
        raise InputError(f"x and y may be {' or '.join(several)}: say which are meant by {ways_out}")
    x, y = pairs[0]
    return Choice(x, y, _time(plain), _unit(plain, x, y))


def may_be_header(names: Sequence[str]) -> bool:
    """Return whether x and y are found by these names, be it more than once."""
    return bool(_pairs([_plain(name) for name in names]))


def name_or_number(names: Sequence[str], index: int) -> str:
    """Return how `--columns` calls a column: by its name, or by its number from 1 if others have that too, or none."""
    name = _plain(names[index])
    return name if name and [_plain(each) for each in names].count(name) == 1 else str(index + 1)


def counts(name: str) -> bool:
    """Return whether a column of this name counts what was recorded at a steady rate."""
    return bool(COUNTERS & set(_words(name)))


def choose_unnamed(count: int, wanted: Sequence[str] | None) -> Choice:
    """Find the columns in a table without a header.

    Args:
        count: its number of columns.
        wanted: what they hold, "t" or another name of time, "x" and "y" among it; or the numbers of the columns of t, x
            and y, or of x and y, from 1.

    Raises:
        InputError: that was not said, or not understood.
    """
    if wanted is None:
        example = "x,y" if count == 2 else "t,x,y"
        raise InputError(f"there is no header: say what the {count} columns hold, as in --columns {example}")
    if all(name.isdecimal() for name in wanted):
        return _wanted([str(index + 1) for index in range(count)], wanted)
    lower = [name.lower() for name in wanted]
    for axis in "xy":
        if lower.count(axis) != 1:
            raise InputError(f"there is no header: --columns must name {axis!r} once, got {','.join(wanted)}")
    if len(wanted) > count:
        raise InputError(f"--columns {','.join(wanted)} names {len(wanted)} columns, there are {count}")
    return Choice(lower.index("x"), lower.index("y"), _time(lower))


def told(names: Sequence[str], choice: Choice) -> tuple[str, ...]:
    """Return what to say of columns that were taken: nothing where the table has t, x and y and no more."""
    if {name.strip() for name in names} in ({"t", "x", "y"}, {"x", "y"}):
        return ()
    time = " and ".join(repr(names[index].strip()) for index, _ in choice.t)
    taken = [each for each in (time, *(repr(names[index].strip()) for index in (choice.x, choice.y))) if each]
    return (f"took {'t, x, y' if time else 'x, y'} from the columns {', '.join(taken)}",)


def _wanted(plain: list[str], wanted: Sequence[str]) -> Choice:
    if len(wanted) not in (2, 3):
        raise InputError(f"columns must name t, x and y, or x and y, got {','.join(wanted)}")
    indices = []
    for name in map(_plain, wanted):
        exact = [index for index, each in enumerate(plain) if each == name]
        close = exact or [index for index, each in enumerate(plain) if each.lower() == name.lower()]
        if not close and name.isdecimal() and 0 < int(name) <= len(plain):
            close = [int(name) - 1]
        if not close:
            raise InputError(f"there is no column {name!r}, the columns are {_listed(plain)}")
        if len(close) > 1:
            numbers = " and ".join(str(index + 1) for index in close)
            raise InputError(f"the columns {numbers} are called {name!r}: say which is meant by its number")
        indices.append(close[0])
    *time, x, y = indices
    return Choice(x, y, tuple((index, _parts(plain[index])[1]) for index in time), _unit(plain, x, y))


def _plain(name: str) -> str:
    """Return a name without quotes around it and the mark of a comment before it."""
    return name.strip().strip("\"'").lstrip("#%").strip()


def _listed(names: Sequence[str]) -> str:
    """Return names for a message, the first of many."""
    return ", ".join([*(reprlib.repr(name) for name in names[:LISTED]), *["..."] * (len(names) > LISTED)])


def _parts(name: str) -> tuple[tuple[str, ...], float | None]:
    """Return the words of a name, and its unit in seconds if it ends in one: time_ms, time [ms], Time (ms)."""
    return _split(name, SECONDS)


def _split(name: str, units: dict[str, float]) -> tuple[tuple[str, ...], float | None]:
    words = _words(name)
    if len(words) > 1 and words[-1] in units:
        return words[:-1], units[words[-1]]
    return (words[:-1] if len(words) > 1 and words[-1] in PIXELS else words), None


def _words(name: str) -> tuple[str, ...]:
    return tuple(word for word in re.split(r"[^a-z0-9µμ]+", name.lower()) if word)


def _unit(plain: list[str], x: int, y: int) -> float | None:
    units = {_split(plain[index], METRES)[1] for index in (x, y)}
    if len(units) > 1:
        raise InputError(f"{plain[x]!r} and {plain[y]!r} are in different units")
    return units.pop()


def _stem(words: tuple[str, ...], axis: str) -> tuple[str, ...] | None:
    """Return the words with the axis replaced by "*": the same for x and y of one pair; None if it is not in them."""
    for index in range(len(words) - 1, -1, -1):
        for form in ("{}", *GLUED):
            if words[index] == form.format(axis):
                return (*words[:index], form.format("*"), *words[index + 1 :])
    return None


def _pairs(plain: list[str]) -> list[tuple[int, int]]:
    """Return the pairs of columns that are likeliest x and y."""
    found: dict[tuple[str, ...], dict[str, list[int]]] = {}
    for index, name in enumerate(plain):
        words = _split(name, METRES)[0]
        for axis in "xy":
            stem = _stem(words, axis)
            if stem is not None and not NO_POSITIONS & set(stem):
                found.setdefault(stem, {}).setdefault(axis, []).append(index)
    ranked: dict[int, list[tuple[int, int]]] = {}
    for stem, axes in found.items():
        x_columns, y_columns = axes.get("x", []), axes.get("y", [])
        alike = len(x_columns) == len(y_columns)  # x, y, X, Y: each with the next
        for x, y in zip(x_columns, y_columns, strict=True) if alike else product(x_columns, y_columns):
            rank = 0 if stem == ("*",) else 1 if POSITIONS & set(stem) else 3 if LETTERS & set(stem) else 2
            ranked.setdefault(rank, []).append((x, y))
    return ranked[min(ranked)] if ranked else []


def _time(plain: list[str]) -> tuple[tuple[int, float | None], ...]:
    """Return the columns whose sum is the time, with their units where their names say it."""
    ranked = []
    for index, name in enumerate(plain):
        *before, last = _words(name) or ("",)
        if last in ("sec", "secs"):
            rest = [k for k, each in enumerate(plain) if _words(each) in [(*before, word) for word in NANOSECONDS]]
            if len(rest) == 1:
                return (index, 1.0), (rest[0], 1e-9)
        words, unit = _parts(name)
        if len(words) == 1 and words[0] in TIMES:
            ranked.append((TIMES.index(words[0]), index, unit))
        elif words and words[-1] in TIMES[1:]:
            ranked.append((len(TIMES), index, unit))
    if not ranked:
        return ()
    best = [each for each in ranked if each[0] == min(ranked)[0]]
    if len(best) > 1:
        called = [name_or_number(plain, index) for _, index, _ in best]
        several = " or ".join(f"column {each}" if each.isdecimal() else each for each in called)
        raise InputError(f"t may be {several}: say which is meant by --columns T,X,Y")
    return (best[0][1:],)


NANOSECONDS = ("nanosec", "nsec", "nsecs", "nanosecs", "nanoseconds")
"""How ROS calls the rest of a time stamp."""
