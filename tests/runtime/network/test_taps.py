"""Rows made of a few others: by straight lines, by a matrix, and by numba the same to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

from runtime.network.reader import chunk_of, milliseconds
from runtime.network.taps import Taps, Told, answered, observe, run_compiled
from runtime.network.units import CHUNK


def test_rows_between_rows_are_on_straight_lines():
    rows = np.stack([np.arange(10.0), np.arange(10.0) ** 2], axis=1)[None]
    found = Taps.at(np.array([0.0, 0.25, 3.5])).of(rows, 2)
    np.testing.assert_allclose(found[0], [[2.0, 4.0], [2.25, 5.25], [5.5, 30.5]])
    last = Taps.at(np.array([9.0]), 10).of(rows)
    np.testing.assert_allclose(last[0], rows[0, -1:])


@pytest.mark.parametrize("step", [0.27, 0.45, 0.9, 1.0, 2.5])
def test_taps_of_a_matrix_make_what_it_makes(step: float):
    matrix = milliseconds(step, chunk_of(step))
    given = np.random.default_rng(0).normal(size=(3, CHUNK + 1, 3))
    taps = Taps.of_matrix(matrix)
    assert taps.rows.shape[1] <= 2 + int(1.0 / step)
    np.testing.assert_allclose(taps.of(given), matrix @ given, atol=1e-12)


def test_compiled_taps_give_the_same_to_the_last_bit():
    pytest.importorskip("numba")
    rng = np.random.default_rng(1)
    told = Told(
        rng.normal(size=(3, 40, 6)),
        rng.normal(size=(3, 40, 4)),
        rng.normal(size=(3, 3)),
        rng.normal(size=(3, 90, 4)),
        17,
        Taps.at(np.array([2.5, 30.1, 39.0]), 40),
        Taps.at(np.array([0.0, 7.3, 60.9])),
        rng.normal(size=(3, 10)),
        rng.uniform(1.0, 2.0, 3),
        rng.normal(size=(3, 5)).astype(np.float32),
        0.5,
    )
    answer, taps = rng.normal(size=(3, CHUNK, 3)).astype(np.float32), Taps.of_matrix(milliseconds(0.45, 29))

    def made() -> tuple[np.ndarray, np.ndarray | None]:
        seen = observe(told, np.empty((3, 3 * 10 + 3 + 3 * 4 + 5 + 1), dtype=np.float32))
        return seen, answered(answer, told.last, taps, told.acceleration)

    plain = made()
    try:
        run_compiled(True)
        compiled = made()
        answer[1, 20, 2] = np.nan
        assert answered(answer, told.last, taps, told.acceleration) is None
    finally:
        run_compiled(False)
    assert answered(answer, told.last, taps, told.acceleration) is None
    for one, other in zip(plain, compiled, strict=True):
        np.testing.assert_array_equal(one, other)
