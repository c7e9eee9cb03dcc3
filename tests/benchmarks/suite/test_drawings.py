"""Drawings from a file: through their points, as far as said, from rest to rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.suite.drawings import MOST, drawings, drawn
from benchmarks.suite.families import SAMPLES, lengths
from benchmarks.suite.letters import REACH
from runtime.errors import InputError
from runtime.physics.law import DT

ZIGZAG = np.array([[0.0, 0.0], [40.0, 10.0], [80.0, 0.0], [100.0, 60.0], [60.0, 100.0], [60.0, 100.0], [10.0, 90.0]])


def test_a_drawing_passes_its_points_from_rest_to_rest() -> None:
    position = drawn(ZIGZAG)
    assert position.shape == (SAMPLES, 2)
    scaled = ZIGZAG * REACH / lengths(ZIGZAG).max()
    assert all(lengths(position - point).min() < 1e-3 for point in scaled)
    speed = lengths(np.diff(position, axis=0)) / DT
    assert max(speed[0], speed[-1]) < 0.01 < speed.max() < 1.5
    assert position[0] == pytest.approx([0.0, 0.0])


def test_a_hand_is_slow_where_it_turns() -> None:
    t = np.linspace(0.0, 1.0, 60)
    ellipse = np.stack([np.cos(2.0 * np.pi * t), 0.3 * np.sin(2.0 * np.pi * t)], axis=1)
    position = drawn(ellipse)
    speed = lengths(np.diff(position, axis=0)) / DT
    turn = int(np.argmax(lengths(position)))  # the far end of the ellipse
    middle = int(np.argmax(np.abs(position[:, 1])))
    assert speed[turn] < 0.7 * speed[middle]


def test_lines_of_a_file_are_drawings_with_or_without_a_label(tmp_path: Path) -> None:
    file = tmp_path / "digits.csv"
    row = ",".join(f"{value:g}" for value in ZIGZAG.ravel())
    file.write_text(f"{row}, 8\n{row.replace(',', ' ')}\n\n" * MOST)
    family = drawings(file)
    assert len(family) == MOST
    assert np.array_equal(family.positions[0], family.positions[1])
    assert family.labels[:2] == ("drawing 1", "drawing 2")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no drawing"),
        ("1,2,3,4\n", "line 1: expected at least 4 points"),
        ("0,0,1,1,2,2,3,x\n", "line 1: could not convert"),
        ("0,0,1,1,2,2,3,nan\n", "line 1: expected at least 4 points"),
        ("5,5,5,5,5,5,5,5\n", "not all the same"),
    ],
)
def test_a_file_that_holds_no_drawings_is_refused(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "digits.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        drawings(file)


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot read"):
        drawings(tmp_path / "none.csv")
