from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import pytest

from runtime.arm import geometry as g
from runtime.arm.urdf import ARM_URDF, arm_urdf
from runtime.sizes import Sizes


def test_the_urdf_is_what_the_geometry_says() -> None:
    assert ARM_URDF.read_text(encoding="utf-8") == arm_urdf(), "renew it: python -m runtime.arm.urdf"


def test_the_urdf_has_short_lines_and_only_the_pan_collides() -> None:
    assert max(map(len, arm_urdf().splitlines())) < 80
    root = ET.fromstring(arm_urdf())
    colliding = {link.get("name") for link in root.iter("link") if link.find("collision") is not None}
    assert colliding == {"pan"}
    masses = [float(mass.get("value", "nan")) for mass in root.iter("mass")]
    assert masses[1:] == list(g.LINK_MASSES)


def test_home_is_where_equation_29_begins() -> None:
    yaw, shoulder, elbow, roll, wrist, turn = g.home_angles()
    assert yaw == roll == turn == 0.0
    assert shoulder + elbow + wrist == pytest.approx(g.HOME_PITCH)
    forearm = shoulder + elbow
    x = g.UPPER_ARM * math.sin(shoulder) + g.FOREARM * math.sin(forearm) + g.HAND
    z = g.SHOULDER_HEIGHT + g.UPPER_ARM * math.cos(shoulder) + g.FOREARM * math.cos(forearm)
    assert (x, 0.0, z) == pytest.approx(g.HOME_POSITION)
    assert 0.0 < shoulder < math.pi / 2 < forearm, "the elbow is up"


def test_the_report_draws_the_pan_and_the_object_of_the_arm() -> None:
    assert Sizes(g.PAN_RADIUS, g.OBJECT_RADIUS) == Sizes()


def test_the_object_slides_rather_than_tips_at_the_default_friction() -> None:
    assert g.OBJECT_HEIGHT < 2.0 * g.OBJECT_RADIUS / 0.5
