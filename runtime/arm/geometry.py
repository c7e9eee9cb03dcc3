"""Sizes of the pan and the object of the simulation: written once, for either simulator."""

from __future__ import annotations

from runtime.sizes import Sizes

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
