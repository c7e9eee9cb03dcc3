"""What to ask where numbers look like another unit: a line that names the likely cause and the option that mends it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from runtime.commands.bounds import MAX_DURATION
from runtime.commands.columns import counts, name_or_number
from runtime.documents.checks import FloatArray
from runtime.errors import InputError

MAX_REACH = 0.5
"""Farthest that a command may go from its first position (m): more than a pan is wide."""

MOSTLY = 0.9
"""Share of the positions that may be where it is: of a single one that is out of place the unit is not asked."""

USUAL_REACH = (0.02, 0.2)
"""How far commands go in metres, to tell a unit by."""

UNITS = {"millimetres": 0.001, "centimetres": 0.01, "inches": 0.0254}
"""Units that positions come in, in metres."""

MANY = 200.0
"""From here on, whole numbers are likelier pixels than millimetres."""

USUAL_SPEED = 1.1
"""Fastest usual command (m/s): what the shipped model was trained on."""

BRISK = 0.75
"""Fastest command that a rate is proposed for (m/s)."""

STEADY = 10
"""Samples over which a speed is taken, so that noise counts little."""

RATES = (1000, 500, 400, 250, 240, 200, 125, 120, 100, 60, 50, 30, 25, 20)
"""Rates of recordings (Hz), to propose one."""

SLOW = 0.002
"""A recording at 1 Hz or less that moves slower than this (m/s) has its times in another unit than seconds."""

COUNTED = 30
"""From so many times on that are whole numbers one after the other, they are likelier counted than seconds."""

COUNTED_STEP = 0.02
"""Farthest that a recording goes from one sample to the next (m): 0.5 m/s at 25 Hz."""

FAST = 10.0
"""A command that moves faster than this (m/s) has its times in another unit too."""

CLOCKS = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
"""Units that times come in, in seconds."""


def ask_unit(position: FloatArray, drawing: bool) -> None:
    """Ask for the unit of positions that go farther than a pan is wide.

    Raises:
        InputError: they do, or they are those of a drawing.
    """
    with np.errstate(over="ignore"):
        away = np.abs(position - position[0])
        distance = np.minimum(np.hypot(*away.T), np.finfo(np.float64).max)
    reach = float(distance.max())
    if drawing:
        raise InputError(
            f"a drawing has no unit of length, and goes {reach:.4g} from its first point: --size 0.1 makes that 0.1 m",
            "position",
        )
    if reach <= MAX_REACH or np.quantile(distance, MOSTLY) <= MAX_REACH:
        return
    whole = bool((position == np.round(position)).all())
    low, high = USUAL_REACH
    guesses = [f"{name} (--scale {unit:g})" for name, unit in UNITS.items() if low <= reach * unit <= high]
    if reach > MANY * 0.75 and (whole or not guesses):
        guesses.append("pixels (--size 0.1, the reach in metres)")
    question = f"are these {' or '.join(guesses)}?" if guesses else "are these metres? --scale makes them so"
    row, axis = np.unravel_index(away.argmax(), away.shape)
    raise InputError(
        f"the command goes {reach:.4g} m from its first position, a pan is 0.4 m wide: {question}",
        f"position[{row}][{axis}]",
    )


def ask_rate(position: FloatArray) -> None:
    """Ask for the rate of positions without times that are too fast for 1 kHz.

    Raises:
        InputError: they are.
    """
    span = min(STEADY, len(position) - 1)
    step = float(np.hypot(*(position[span:] - position[:-span]).T).max()) / span
    fastest = step * RATES[0]
    if fastest <= USUAL_SPEED:
        return
    rate = next((rate for rate in RATES if step * rate <= BRISK), None)
    way_out = f"--rate {rate} makes it {step * rate:.2g} m/s" if rate else "--speed 0.3 runs along it as a path"
    raise InputError(
        f"there are no times, and at 1 kHz the command moves at {fastest:.3g} m/s, above the usual {USUAL_SPEED:g}: "
        f"what is its rate? {way_out}"
    )


def ask_time(names: Sequence[str], columns: Iterable[tuple[int, FloatArray]], x: int, y: int) -> None:
    """Ask whether a column that increases is the time, if none has a name of it.

    Args:
        names: the names of all columns.
        columns: index and values (n,) of each that is neither x nor y; whole numbers one after the other are a table's
            index, and no time.
        x, y: the indices of those.

    Raises:
        InputError: there is one, or one that counts frames.
    """
    for index, values in columns:
        steps = np.diff(values)
        if len(steps) and (steps == 1.0).all():
            if counts(names[index]):
                raise InputError(f"there are no times, and {names[index]!r} counts: give its rate, as in --rate 60")
        elif len(steps) and (steps > 0.0).all():
            said = ",".join(name_or_number(names, each) for each in (index, x, y))
            name = repr(names[index]) if names[index].strip() else f"column {index + 1}"
            raise InputError(f"is {name} the time? Say so by --columns {said}, or give the rate, --rate 100")


def ask_clock(t: FloatArray, position: FloatArray, named: bool) -> None:
    """Ask for the unit of times that last too long for a command, or hardly move it.

    Args:
        t: (n,) increasing times, taken for seconds.
        position: (n, 2) (m).
        named: whether somebody said that these are seconds, so that only their length counts.

    Raises:
        InputError: they do.
    """
    duration = float(t[-1] - t[0])
    steps = np.diff(t)
    speed = float((np.hypot(*np.diff(position, axis=0).T) / steps).max())
    slow = not named and len(t) >= 10 and steps.min() >= 1.0 and 0.0 < speed < SLOW
    counted = not named and len(t) >= COUNTED and bool((steps == 1.0).all()) and 0.0 < speed < COUNTED_STEP
    slow = slow or counted
    if duration <= MAX_DURATION and not slow:
        return
    guess = ""
    if len(t) > 2 and (steps == 1.0).all():
        guess = ": does t count samples? Give their rate, as in --rate 100"
    else:
        likely = [name for name, unit in CLOCKS.items() if duration * unit <= MAX_DURATION]
        likely = [name for name in likely if SLOW < speed / CLOCKS[name] < FAST] or likely
        if likely:
            guess = f": are these {likely[0]}? --time-scale {CLOCKS[likely[0]]:g} makes them seconds"
    if duration > MAX_DURATION:
        guess = guess or " (is it in seconds?)"
        raise InputError(f"t spans {duration:g} s, at most {MAX_DURATION:g} s are allowed{guess}", "t")
    raise InputError(f"t spans {duration:g} s, at {speed * 1e3:.2g} mm/s at most{guess}", "t")
