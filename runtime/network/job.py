"""What is to be planned."""

from __future__ import annotations

from typing import NamedTuple

from runtime.command import Command
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.network.manifest import DEFAULT_SIZES
from runtime.sizes import Sizes
from runtime.start import Start


class Job(NamedTuple):
    """One command to be planned: where the object should be, on what, within what, from where, and on which pan.

    Attributes:
        command: where the object should be.
        friction: between the object and the pan.
        limits: of the pan's motion.
        start: where pan and object are.
        sizes: of pan and object.
        reach_used: share of the reach that the network is told. With less it plans shorter, finer motions.
    """

    command: Command
    friction: Friction
    limits: Limits
    start: Start
    sizes: Sizes = DEFAULT_SIZES
    reach_used: float = 1.0
