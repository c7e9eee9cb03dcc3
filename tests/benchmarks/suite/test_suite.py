"""The suite: its numbers must not change, and its commands are what they claim to be."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.suite import families, suite
from benchmarks.suite.families import FRICTION_GRID, NOMINAL, Family, lengths
from benchmarks.suite.suite import FAMILIES
from runtime.command import Command
from runtime.documents.checks import FloatArray
from runtime.errors import InputError
from runtime.physics.law import DT

COUNTS = {"spline": 64, "shapes": 12, "stops": 24, "long": 8, "short": 8, "odd": 8, "friction": 896}
SAMPLES = {"spline": 1200, "shapes": 1200, "stops": 1200, "long": 1500, "short": 500, "odd": 777, "friction": 1200}

CHECKSUMS = {
    "spline": [-94.4871892696, -93.7520043423, -94.9214003422],
    "shapes": [9.4107458753, 9.5575511612, 9.3478738869],
    "stops": [-12.7969330185, -12.921096019, -13.1095580209],
    "long": [0.1812123521, -0.2753398811, 0.1293429668],
    "short": [-10.2175859768, -10.0903720949, -10.2673286744],
    "odd": [14.1195918492, 13.6599125833, 13.8475764409],
}
"""Whoever has to change these has made another suite: the figures of before no longer compare."""


@pytest.fixture(params=FAMILIES)
def family(request: pytest.FixtureRequest) -> Family:
    return FAMILIES[request.param]()


def checksum(positions: tuple[FloatArray, ...]) -> list[float]:
    """Project the samples of a family on three fixed sequences of signs.

    A hash of rounded samples would now and then differ from one machine to the next, where a last digit of a sine
    meets an edge of the rounding; a sum of the samples shows a change of 1e-9 m anywhere just as well.
    """
    values = np.concatenate([position.ravel() for position in positions])
    index = np.arange(len(values), dtype=np.int64)
    return [float(np.sum(values * (1.0 - 2.0 * ((index * step // 7) % 2)))) for step in (1, 3, 5)]


@pytest.mark.parametrize("name", CHECKSUMS)
def test_the_suite_is_the_one_of_before(name: str) -> None:
    assert checksum(FAMILIES[name]().positions) == pytest.approx(CHECKSUMS[name], rel=0.0, abs=1e-9)


def test_a_family_does_not_depend_on_which_others_were_drawn_before() -> None:
    again = families.stops.__wrapped__()
    assert checksum(again.positions) == checksum(families.stops().positions)


def test_families_have_the_numbers_and_lengths_they_claim(family: Family) -> None:
    assert len(family) == len(family.frictions) == len(family.labels) == COUNTS[family.name]
    assert {position.shape for position in family.positions} == {(SAMPLES[family.name], 2)}
    assert len(set(family.labels)) == len(family)


def test_every_command_starts_at_the_origin_at_rest(family: Family) -> None:
    for position in family.positions:
        assert position[0].tolist() == [0.0, 0.0]
        # Within the first sample nobody gets further than under an acceleration of 20 m/s^2.
        assert lengths(position[1:2])[0] <= 0.5 * 20.0 * DT * DT


def test_every_command_is_one_the_runtime_takes_as_it_is(family: Family) -> None:
    for position in family.positions:
        assert np.array_equal(Command(position).position, position)


def test_commands_cannot_be_changed(family: Family) -> None:
    with pytest.raises(ValueError, match="read-only"):
        family.positions[0][0, 0] = 1.0


@pytest.mark.parametrize("name", ["spline", "long", "short", "odd"])
def test_spline_commands_reach_as_far_as_they_are_meant_to(name: str) -> None:
    reach = [lengths(position).max() for position in FAMILIES[name]().positions]
    assert min(reach) >= 0.03
    assert max(reach) <= 0.15


def test_spline_accelerations_are_smooth_over_the_knots() -> None:
    for position in families.spline().positions:
        acceleration = np.diff(position, 2, axis=0) / DT**2
        largest = np.abs(acceleration).max()
        # A cubic B-spline with knots 0.15 s apart changes by a small share of its size within 1 ms.
        assert np.abs(np.diff(acceleration, axis=0)).max() < 0.03 * largest


def test_a_spline_is_the_cubic_b_spline_of_its_control_points() -> None:
    interpolate = pytest.importorskip("scipy.interpolate")
    spacing, samples = 0.2137, 1200
    position = families.spline_position(np.random.default_rng(3), samples, 0.1, spacing)
    t = np.arange(samples) * DT
    control = np.random.default_rng(3).standard_normal((int(t[-1] / spacing) + 4, 2))
    knots = (np.arange(len(control) + 4) - 3) * spacing
    acceleration = interpolate.BSpline(knots, control, 3)(t)
    # The second difference of a double integrator's positions is the mean of two accelerations in a row.
    means = 0.5 * (acceleration[1:] + acceleration[:-1])[:-1] * DT**2
    differences = np.diff(position, 2, axis=0)
    scale = np.sum(differences * means) / np.sum(means * means)
    assert differences == pytest.approx(scale * means, rel=0.0, abs=1e-14)


def test_shapes_close_after_exactly_one_cycle() -> None:
    family = families.shapes()
    for label, position in zip(family.labels, family.positions, strict=True):
        radius = float(label.split()[-2])
        end = 2.0 * radius if label.startswith("point to point") else 0.0
        assert lengths(position[-1:])[0] == pytest.approx(end, abs=1e-12)
        extent = max(lengths(position - row).max() for row in position[::10])
        # A figure eight is as wide as the others: from the far side of one loop to that of the other.
        assert extent == pytest.approx(2.0 * radius, rel=0.01)


def test_stops_rest_after_each_move_and_stay_near_the_origin() -> None:
    family = families.stops()
    for label, position in zip(family.labels, family.positions, strict=True):
        moves = int(label.split(", ")[1].split()[0])
        moving = lengths(np.diff(position, axis=0)) > 1e-9
        begins = np.flatnonzero(np.diff(moving.astype(int), prepend=0) == 1)
        assert len(begins) == moves
        assert not moving[-10:].any()
        assert lengths(position).max() <= families.STOPS_RADIUS + 1e-12
        acceleration = lengths(np.diff(position, 2, axis=0)) / DT**2
        assert acceleration.max() <= families.STOPS_MAX_ACCELERATION * 1.001


def test_only_the_family_friction_leaves_the_nominal_friction(family: Family) -> None:
    if family.name != "friction":
        assert set(family.frictions) == {NOMINAL}
        return
    assert NOMINAL in FRICTION_GRID
    assert all(each.kinetic <= each.static for each in FRICTION_GRID)
    spline = families.spline().positions
    for index, friction in enumerate(FRICTION_GRID):
        cell = slice(index * len(spline), (index + 1) * len(spline))
        assert set(family.frictions[cell]) == {friction}
        assert family.positions[cell] == spline


def test_an_unknown_family_is_refused_by_its_name() -> None:
    with pytest.raises(InputError, match="unknown family 'splines'"):
        suite.suite(["splines"])


def test_the_first_commands_of_each_family_are_those_of_the_suite() -> None:
    few, whole = suite.suite(["odd", "friction"], commands=2), suite.suite(["odd", "spline"])
    assert few["odd"].labels == whole["odd"].labels[:2]
    assert len(few["friction"]) == 2 * len(FRICTION_GRID)
    assert set(few["friction"].frictions) == set(FRICTION_GRID)
    first = whole["spline"].positions[0]
    assert all(np.array_equal(position, first) for position in few["friction"].positions[::2])
