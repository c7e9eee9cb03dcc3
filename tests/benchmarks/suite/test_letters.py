"""The letters: commands of their own, from rest to rest, that the suite leaves out."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.suite.families import SAMPLES, lengths
from benchmarks.suite.letters import CHARACTERS, REACH
from benchmarks.suite.suite import suite


def test_letters_reach_as_far_as_they_say_and_rest_at_both_ends() -> None:
    (family,) = suite(["letters"]).values()
    assert [len(position) for position in family.positions] == [SAMPLES] * len(CHARACTERS)
    assert list(family.labels) == list(CHARACTERS)
    for position in family.positions:
        speed = lengths(np.diff(position, axis=0)) * 1e3
        assert (position[0] == 0.0).all()
        assert lengths(position).max() == pytest.approx(REACH)
        assert max(speed[:5].max(), speed[-5:].max()) < 0.02
        assert 0.3 < speed.max() < 1.5


def test_suite_leaves_the_letters_out() -> None:
    assert "letters" not in suite()
