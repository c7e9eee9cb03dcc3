"""Which commands are worth planning several ways: those whose one plan the object follows badly."""

from __future__ import annotations

from runtime.assess.assess import cannot_slide, still_error
from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.network.reader import chunk_samples

SEVERAL = 8
"""Plans that are made where one is bad, and where the best of them is refined: twice as many gain a tenth more, and
take a third to a half as long again."""

BAD_SHARE = {"level": 0.03, "lifting": 0.015}
"""Share of a still pan's tracking RMSE above which a plan is bad: half as much again as is usual within the default
limits."""

BAD_FLOOR = 5e-4
"""Tracking RMSE (m) up to which no plan is bad: what remains is stick-slip."""

MOST_CHUNKS = 70
"""Most chunks, about 4 s, of a command that is planned several ways: a longer one goes well here and badly there,
whichever way it is planned."""


def follows_badly(
    rmse: float, start: FloatArray, command_position: FloatArray, friction: Friction, limits: Limits
) -> bool:
    """Whether the object follows so badly that other plans of the command are worth their time.

    Measured is how much of what the command moves the object by is left: the law of friction has no units, so what is
    a large error in millimetres depends on pan and command. A pan that is too weak to move the object at all has no
    better plan, and what is too long (MOST_CHUNKS) is not planned several ways.

    Args:
        rmse: of the plan (m).
        start: (4,) the object at the start (m, m/s).
        command_position: (K, 2) where it should be (m).
        friction, limits: what the plan was made for.
    """
    if rmse <= BAD_FLOOR or -(-len(command_position) // chunk_samples(limits)) > MOST_CHUNKS:
        return False
    still = still_error(start, len(command_position), command_position, friction)
    return rmse > BAD_SHARE["level" if limits.level else "lifting"] * still and not cannot_slide(friction, limits)
