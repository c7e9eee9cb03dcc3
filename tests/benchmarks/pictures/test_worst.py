"""The worst commands: found, compared with all, and drawn."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

from benchmarks.pictures.worst import WORST, compare, track


@pytest.fixture(scope="module")
def still():
    """What a pan that never moves makes of two families: the error of each command is its distance from the start."""
    return track(lambda positions, frictions: [np.zeros_like(position) for position in positions], ["short", "odd"])


def test_the_worst_come_first_by_their_distance_from_the_object(still):
    errors = [each.rmse for each in still]
    assert errors == sorted(errors, reverse=True)
    assert errors[0] == pytest.approx(float(np.sqrt((still[0].position ** 2).sum(-1).mean())))


def test_what_makes_a_still_pan_bad_is_how_far_a_command_goes(still):
    traits = {trait.trait: trait for trait in compare(still)}
    assert traits["reach"].correlation > 0.8
    assert traits["reach"].worst > traits["reach"].all
    assert traits["pan reach"].correlation == 0.0


def test_picture_and_table_of_a_bundle(tiny_bundle, tmp_path):
    picture = tmp_path / "worst.png"
    arguments = [sys.executable, "-m", "benchmarks.pictures.worst", "--model", tiny_bundle, "-o", picture, "--json"]
    done = subprocess.run([*map(str, arguments)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert len(json.loads(done.stdout)["worst"]) == WORST
    assert picture.read_bytes().startswith(b"\x89PNG")
