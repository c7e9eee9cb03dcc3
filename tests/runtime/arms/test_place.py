"""Where a pan is held by arms that are built otherwise than most: with joints that slide, or with odd ranges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from runtime.arms.description import ArmDescription, Body, Frame, Joint, Vector
from runtime.arms.load import MOUNT
from runtime.arms.model import ArmModel
from runtime.arms.place import find_place
from runtime.errors import InputError

pytest.importorskip("mujoco")

LINK = Body(1.0, (0.0, 0.0, 0.0), (0.01, 0.01, 0.01, 0.0, 0.0, 0.0))
Z: Vector = (0.0, 0.0, 1.0)


def joint(name: str, place: Vector, axis: Vector, lower: float, upper: float, sliding: bool = False) -> Joint:
    return Joint(name, Frame(place), LINK, axis, sliding, lower=lower, upper=upper, speed=2.0, torque=200.0)


GANTRY = ArmDescription(
    "gantry",
    "three joints that slide carry a wrist",
    (
        joint("x", (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), 0.0, 1.0, sliding=True),
        joint("y", (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), -0.5, 0.5, sliding=True),
        joint("z", (0.0, 0.0, 0.0), Z, -0.1, 0.1, sliding=True),
        joint("first", (0.0, 0.0, 0.0), Z, 3.5, 8.0),
        joint("second", (0.0, 0.0, -0.2), (0.0, 1.0, 0.0), -2.0, 2.0),
        joint("third", (0.0, 0.0, -0.1), Z, -3.0, 3.0),
    ),
    Frame(),
    MOUNT,
    LINK,
)


def test_joints_that_slide_and_ranges_beyond_half_a_turn_hold_a_pan() -> None:
    place = find_place(ArmModel(GANTRY), cached=False)
    lower, upper = GANTRY.range
    assert ((lower < place.home) & (place.home < upper)).all()
    assert place.home[3] > 3.5
    np.testing.assert_allclose(place.rotation[:, 2], Z, atol=1e-8)


@pytest.mark.parametrize(
    ("index", "width", "message"),
    [(0, 0.01, "joint x is 0.01 m wide, and at least 0.03 m are needed"), (4, 1e-7, "joint second is 1e-07 rad wide")],
)
def test_a_range_too_narrow_to_move_in_is_told_with_the_joint(index: int, width: float, message: str) -> None:
    joints = list(GANTRY.joints)
    joints[index] = replace(joints[index], lower=0.0, upper=width)
    with pytest.raises(InputError, match=message):
        find_place(ArmModel(replace(GANTRY, joints=tuple(joints))), cached=False)
