"""The suite: the commands everyone is measured on, the network and whatever a user would pick instead.

Positions are relative to the pan, in metres at 1 kHz, and start at the origin, at rest; K = 1200 samples unless said.

    spline    64  the object's acceleration is a cubic B-spline (Section IV-B)
    shapes    12  circle, figure eight, point to point, back and forth, in three sizes, one cycle in 1.2 s
    stops     24  1 to 5 minimum-jerk moves between random points, with a rest after each
    long       8  as `spline`, K = 1500
    short      8  as `spline`, K = 500
    odd        8  as `spline`, K = 777, which no chunk divides
    friction      the 64 of `spline` under each friction of FRICTION_GRID

Nothing here may change: figures of different days are compared by it. So it depends on nothing that may (neither the
generators of the training nor scipy), each family draws from a generator of its own, and a test holds its numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from benchmarks.suite.families import (
    Family,
    friction,
    long,
    odd,
    shapes,
    short,
    spline,
    stops,
    under_every_friction,
)
from runtime.errors import InputError


def suite(names: Iterable[str] | None = None, commands: int | None = None) -> dict[str, Family]:
    """Return families by their names.

    Args:
        names: of the families; if None, all of them, which leaves out the letters.
        commands: only the first ones of each family, in `friction` under every friction; all if None.

    Raises:
        InputError: there is no family of that name.
    """
    from benchmarks.suite.letters import letters

    known = FAMILIES | {"letters": letters}
    chosen = tuple(FAMILIES if names is None else names)
    for name in chosen:
        if name not in known:
            raise InputError(f"unknown family {name!r}: known are {', '.join(known)}")
    return {name: known[name]() if commands is None else _first(known[name], commands) for name in chosen}


def _first(family: Callable[[], Family], commands: int) -> Family:
    if family is friction:
        return under_every_friction(spline().first(commands))
    return family().first(commands)


FAMILIES: dict[str, Callable[[], Family]] = {
    "spline": spline,
    "shapes": shapes,
    "stops": stops,
    "long": long,
    "short": short,
    "odd": odd,
    "friction": friction,
}
"""The families by their names; each is built when it is first asked for."""
