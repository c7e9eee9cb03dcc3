"""How MuJoCo's contacts are set so that they follow Coulomb's law, and why.

MuJoCo's contacts are soft, and by default viscous: an object at rest creeps, and one that slides slower than about
5 cm/s feels less than its friction. What each setting is for, and the distance from object to the law of friction where
it was measured (root mean square over 1.2 s at friction 0.5/0.5):

- elliptic cone: friction is equally strong in all directions. A pyramidal cone costs 9 mm.
- `IMPRATIO`: friction is that many times harder than the normal contact, so that it hardly creeps.
- `NOSLIP`: steps of a second solver that takes the rest of the creep away, to below 0.001 mm/s.
- `SOLREF`: contacts answer within 2 ms, critically damped. MuJoCo's own 20 ms cost 11 mm in open loop.
- `TIMESTEP`: a contact needs about eight steps within its time.
- `FEET`: the object stands on balls along its edges. A cylinder's own contacts jump about between points of its edge,
  so that it hops: 1.2 to 5.6 mm, where on eight balls it is 0.5 to 1.4 mm.
"""

from __future__ import annotations

from typing import Any

from runtime.physics.law import DT, GRAVITY

TIMESTEP = 0.25e-3
"""Step of the engine (s)."""

SUBSTEPS = round(DT / TIMESTEP)
IMPRATIO = 100.0
NOSLIP = 20
SOLREF = (0.002, 1.0)
"""Time constant (s) and damping ratio of a contact."""

FEET = 8
"""Balls along each edge of the object."""

FOOT_RADIUS = 0.001
"""Radius of a ball (m)."""


def set_options(mujoco: Any, option: Any) -> None:
    """Set a model's options."""
    option.timestep = TIMESTEP
    option.gravity = [0.0, 0.0, -GRAVITY]
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = IMPRATIO
    option.noslip_iterations = NOSLIP
