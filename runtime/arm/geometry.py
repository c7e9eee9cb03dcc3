"""Sizes and masses of the simulated arm, its pan and the object: written once, for the URDF and for the code.

The arm has a yaw and a pitch joint in the shoulder, a pitch joint in the elbow and a spherical wrist. With all joint
angles zero it stands upright, its hand along the z axis; Eq. 29 turns the hand by pi/2 about y, so that it points
ahead and the pan, whose normal is the hand's -x axis, lies flat.
"""

from __future__ import annotations

import math

from runtime.sizes import Sizes

SHOULDER_HEIGHT = 0.35
"""Height of the shoulder above the ground (m)."""

UPPER_ARM = 0.42
"""Length from shoulder to elbow (m)."""

FOREARM = 0.42
"""Length from elbow to wrist centre (m)."""

FLANGE = 0.08
"""Length from the wrist centre to the end of the pan's handle (m)."""

HAND = 0.30
"""Length from the wrist centre to the pan's centre (m)."""

LINK_MASSES = (3.7, 8.0, 2.6, 1.2, 1.0, 0.9)
"""Masses of the six moving links (kg); the last is the flange with the pan."""

PAN_RADIUS = Sizes().pan_radius
"""Inner radius of the pan (m): what plans are made for unless told otherwise."""

PAN_THICKNESS = 0.004
"""Thickness of the pan's bottom (m)."""

RIM_HEIGHT = 0.02
"""Height of the pan's rim above its bottom (m)."""

RIM_THICKNESS = 0.004
"""Thickness of the rim (m)."""

RIM_BOXES = 32
"""Number of boxes the rim is made of."""

PAN_FRICTION = 1.0
"""Friction coefficient of the pan; the simulator multiplies it by the object's, which is then the friction."""

OBJECT_RADIUS = Sizes().object_radius
"""Radius of the cylinder on the pan (m)."""

OBJECT_HEIGHT = 0.04
"""Height of the cylinder on the pan (m); at a height of 2 radius / mu or more it would tip rather than slide."""

HOME_POSITION = (0.65, 0.0, 0.3)
"""Where the pan's centre begins in the world (m), the constants of Eq. 29."""

HOME_PITCH = math.pi / 2
"""Pitch of the hand, the constant of Eq. 29 (rad); the other angles are zero."""

PAN_IN_HAND = ((0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))
"""The pan's attitude in the hand, turned back by `HOME_PITCH`: its columns are the pan's axes, its normal the last."""

TORQUE_LIMITS = (200.0, 200.0, 150.0, 60.0, 60.0, 60.0)
"""Largest torques of the joints (N m)."""

SPEED_LIMITS = (8.0, 8.0, 8.0, 12.0, 12.0, 12.0)
"""Largest speeds of the joints (rad/s)."""


def home_angles() -> tuple[float, float, float, float, float, float]:
    """Return the joint angles (rad) that put the pan where Eq. 29 begins, with the elbow up."""
    ahead = HOME_POSITION[0] - HAND
    up = HOME_POSITION[2] - SHOULDER_HEIGHT
    distance = math.hypot(ahead, up)
    # Angles from the vertical, forward: of the line from the shoulder to the wrist centre, and of the two links.
    line = math.atan2(ahead, up)
    at_shoulder = math.acos((UPPER_ARM**2 + distance**2 - FOREARM**2) / (2.0 * UPPER_ARM * distance))
    upper = line - at_shoulder
    elbow = math.acos((distance**2 - UPPER_ARM**2 - FOREARM**2) / (2.0 * UPPER_ARM * FOREARM))
    return 0.0, upper, elbow, 0.0, HOME_PITCH - upper - elbow, 0.0
