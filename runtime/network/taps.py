"""Rows between rows: each is a few of the given ones, times shares. What the network sees, and what its answers are.

The network's samples are not milliseconds, so whatever goes in and comes out is put together of rows (*taps*). Around a
question to the network nothing is in the processor's caches, which its weights have filled; so taps are kept as a few
numbers, and where numba is used all that goes in is made by one function, and all that comes out by another. Both give
the same as without numba, to the last bit.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from runtime.documents.checks import FloatArray
from runtime.physics.compiled import Compiler, compile_together, compiler

PAN, OBJECT = 6, 4
"""Columns of the states of pan and object."""


class Taps(NamedTuple):
    """Makes n rows, each the sum of up to m of the given rows times shares.

    Attributes:
        rows: (n, m) which ones.
        shares: (n, m) of each.
    """

    rows: NDArray[np.intp]
    shares: FloatArray

    @classmethod
    def at(cls, times: NDArray[np.floating[Any]], rows: int | None = None) -> Self:
        """Return what lies at times (n,) in rows, by straight lines; of `rows` rows if so many are all there are."""
        before = np.floor(times).astype(np.intp)
        if rows is not None:
            before = np.minimum(before, rows - 2)
        after = times - before
        return cls(np.stack([before, before + 1], axis=1), np.stack([1.0 - after, after], axis=1))

    @classmethod
    def of_matrix(cls, shares: FloatArray) -> Self:
        """Return what a matrix (n, rows) makes, whose rows have few shares, side by side."""
        most = int(np.count_nonzero(shares, axis=1).max())
        first = np.minimum((shares != 0.0).argmax(axis=1), shares.shape[1] - most)
        rows = first[:, None] + np.arange(most)
        return cls(rows, np.take_along_axis(shares, rows, axis=1))

    def of(self, given: FloatArray, now: int = 0) -> FloatArray:
        """Return the rows (B, n, d) made of those given, (B, K, d), from row `now` on."""
        rows = self.rows + now
        total: FloatArray = given.take(rows[:, 0], axis=1)
        total *= self.shares[:, :1]
        for tap in range(1, rows.shape[1]):
            part = given.take(rows[:, tap], axis=1)
            part *= self.shares[:, tap : tap + 1]
            total += part
        return total


class Told(NamedTuple):
    """What goes into an observation, of B pans and their objects.

    Attributes:
        pan: (B, C, 6) the last states of the pan (m, m/s).
        sliding: (B, C, 4) those of the object (m, m/s).
        last: (B, 3) the pan's last acceleration (m/s^2).
        command: (B, K, 4) the command, in the network's units.
        now: the row of it that is now.
        seen, ahead: make the rows that are seen of the states, and of the command from now on.
        scale: (B, 10) what the states are multiplied by.
        acceleration: (B,) m/s^2 a unit.
        conditions: (B, c) what else is told.
        elapsed: the last number.
    """

    pan: FloatArray
    sliding: FloatArray
    last: FloatArray
    command: FloatArray
    now: int
    seen: Taps
    ahead: Taps
    scale: FloatArray
    acceleration: FloatArray
    conditions: NDArray[np.float32]
    elapsed: float


def observe(told: Told, out: NDArray[np.float32]) -> NDArray[np.float32]:
    """Fill observations, (B, OBSERVED), and return them; `runtime.network.units.OBSERVED` says what is where."""
    compiled = _compiled  # which another thread may replace
    if compiled is not None:
        compiled.observe(told, out)
        return out
    here = told.command[:, told.now : told.now + 1, :2]
    seen = told.seen.of(np.concatenate([told.pan, told.sliding], axis=2))
    seen *= told.scale[:, None]
    seen[..., PAN : PAN + 2] -= here
    ahead = told.ahead.of(told.command, told.now)
    ahead[..., :2] -= here
    parts = (
        seen.reshape(len(out), -1),
        told.last / told.acceleration[:, None],
        ahead.reshape(len(out), -1),
        told.conditions,
        np.full((len(out), 1), told.elapsed),
    )
    np.concatenate(parts, axis=1, out=out, casting="same_kind")
    return out


def answered(answer: NDArray[np.float32], last: FloatArray, taps: Taps, acceleration: FloatArray) -> FloatArray | None:
    """Return the accelerations (B, n, 3) that an answer stands for (m/s^2); None if one is no finite number.

    Args:
        answer: (B, CHUNK, 3) in the network's units.
        last: (B, 3) the pans' last accelerations (m/s^2).
        taps: make milliseconds of the last one and the network's.
        acceleration: (B,) m/s^2 a unit.
    """
    compiled = _compiled
    if compiled is not None:
        return compiled.answered(answer, last, taps, acceleration)
    unit = acceleration[:, None, None]
    u = taps.of(np.concatenate([last[:, None] / unit, answer], axis=1)) * unit
    return u if np.isfinite(u).all() else None


def fill_observation(
    pan: FloatArray,
    sliding: FloatArray,
    last: FloatArray,
    command: FloatArray,
    now: int,
    seen_rows: NDArray[np.intp],
    seen_shares: FloatArray,
    ahead_rows: NDArray[np.intp],
    ahead_shares: FloatArray,
    scale: FloatArray,
    acceleration: FloatArray,
    conditions: NDArray[np.float32],
    elapsed: float,
    out: NDArray[np.float32],
) -> None:
    """Do what `observe` does, with two taps a row, to be compiled."""
    for b in range(len(out)):
        column = 0
        for k in range(len(seen_rows)):
            first, second = seen_rows[k, 0], seen_rows[k, 1]
            one, two = seen_shares[k, 0], seen_shares[k, 1]
            for axis in range(6):
                value = pan[b, first, axis] * one + pan[b, second, axis] * two
                out[b, column] = value * scale[b, axis]
                column += 1
            for axis in range(4):
                value = (sliding[b, first, axis] * one + sliding[b, second, axis] * two) * scale[b, 6 + axis]
                out[b, column] = value - command[b, now, axis] if axis < 2 else value
                column += 1
        for axis in range(3):
            out[b, column] = last[b, axis] / acceleration[b]
            column += 1
        for k in range(len(ahead_rows)):
            first, second = now + ahead_rows[k, 0], now + ahead_rows[k, 1]
            for axis in range(4):
                value = command[b, first, axis] * ahead_shares[k, 0] + command[b, second, axis] * ahead_shares[k, 1]
                out[b, column] = value - command[b, now, axis] if axis < 2 else value
                column += 1
        for k in range(conditions.shape[1]):
            out[b, column] = conditions[b, k]
            column += 1
        out[b, column] = elapsed


def fill_answer(
    answer: NDArray[np.float32],
    last: FloatArray,
    rows: NDArray[np.intp],
    shares: FloatArray,
    acceleration: FloatArray,
    out: FloatArray,
) -> bool:
    """Do what `answered` does, to be compiled; returns whether all numbers are finite."""
    finite = True
    for b in range(len(out)):
        unit = acceleration[b]
        for k in range(len(rows)):
            for axis in range(3):
                total = 0.0
                for tap in range(rows.shape[1]):
                    row = rows[k, tap]
                    given = last[b, axis] / unit if row == 0 else float(answer[b, row - 1, axis])
                    total = given * shares[k, tap] if tap == 0 else total + given * shares[k, tap]
                total *= unit
                finite = finite and math.isfinite(total)
                out[b, k, axis] = total
    return finite


class CompiledTaps:
    """`observe` and `answered` as numba runs them.

    Args:
        compile_one: compiles a function.

    Attributes:
        functions: what it is made of, compiled, by name.
    """

    def __init__(self, compile_one: Compiler) -> None:
        self.functions = compile_together((fill_observation, fill_answer), compile_one)
        self._fill_observation, self._fill_answer = (
            self.functions[each] for each in ("fill_observation", "fill_answer")
        )
        taps, ones, last = Taps.at(np.zeros(1)), np.ones(1), np.zeros((1, 3))  # compiles
        states = np.zeros((1, 2, PAN)), np.zeros((1, 2, OBJECT))
        scale, conditions = np.ones((1, PAN + OBJECT)), np.zeros((1, 1), dtype=np.float32)
        told = Told(*states, last, np.zeros((1, 2, 4)), 0, taps, taps, scale, ones, conditions, 1.0)
        self.observe(told, np.empty((1, PAN + OBJECT + 3 + 4 + 1 + 1), dtype=np.float32))
        self.answered(np.zeros((1, 1, 3), dtype=np.float32), last, taps, ones)

    def observe(self, told: Told, out: NDArray[np.float32]) -> None:
        pan, sliding, last, command = (
            np.ascontiguousarray(each) for each in (told.pan, told.sliding, told.last, told.command)
        )
        self._fill_observation(
            pan,
            sliding,
            last,
            command,
            told.now,
            *told.seen,
            *told.ahead,
            told.scale,
            told.acceleration,
            told.conditions,
            told.elapsed,
            out,
        )

    def answered(
        self, answer: NDArray[np.float32], last: FloatArray, taps: Taps, acceleration: FloatArray
    ) -> FloatArray | None:
        out = np.empty((len(answer), len(taps.rows), 3))
        finite = self._fill_answer(answer, np.ascontiguousarray(last), *taps, acceleration, out)
        return out if finite else None


_compiled: CompiledTaps | None = None


def run_compiled(use: bool) -> None:
    """Let numba put rows together from now on, in all of this process, or no longer."""
    global _compiled
    compile_one = compiler() if use else None
    _compiled = None if compile_one is None else CompiledTaps(compile_one)


def compiled_taps() -> CompiledTaps | None:
    """Return what numba runs of this, None where it runs nothing."""
    return _compiled
