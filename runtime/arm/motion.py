"""Plans that no network made: from pan accelerations given by anybody, to be executed like any other."""

from __future__ import annotations

import numpy as np

from runtime.assess.assess import assess
from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.limits import NO_LIMITS
from runtime.physics.law import rollout
from runtime.physics.motion import Motion
from runtime.physics.pan import integrate_pan
from runtime.plan import Plan
from runtime.safety.pan import Pan, state_after
from runtime.safety.rest import stop_after
from runtime.safety.stop import RESTING
from runtime.sizes import Sizes


def plan_of_motion(u: FloatArray, friction: Friction, name: str, command_position: FloatArray | None = None) -> Plan:
    """Return the plan of given pan accelerations.

    Args:
        u: (K, 2) pan accelerations (m/s^2); the pan begins at rest.
        friction: coefficients the object's motion is predicted with.
        name: what stands in the place of the model's name.
        command_position: (K, 2) where the object should be (m); what is predicted if None.
    """
    start = np.zeros((1, 4))
    if command_position is not None:
        start[0, :2] = command_position[0]
    pan = np.concatenate([np.zeros((1, 4)), integrate_pan(np.zeros(4), u)])
    motion = Motion(u, u, pan, np.concatenate([start, rollout(start[0], u, friction)]))
    command = motion.sliding[:-1, :2] if command_position is None else command_position
    ahead = Pan(state_after(pan, u), RESTING, NO_LIMITS)
    stop = stop_after(motion, len(u), ahead, command[-1], friction)
    quality = assess(motion, stop, command, friction, NO_LIMITS, Sizes(), u[0])
    return Plan.of(motion, stop, command, friction, quality, name)
