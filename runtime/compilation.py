"""What numba may run of planning, where it is installed and where that is asked for."""

from __future__ import annotations

from runtime.network import decode, taps
from runtime.physics import law
from runtime.safety import governor, rest


def compile_law(use: bool = True) -> bool:
    """Let numba run law, governor and decode loop from now on, in all of this process, or no longer.

    It saves a third of a plan's time, half of that of many candidates or plans at once, and takes a few seconds and
    130 MB, so a program that plans once is better off without; a service or a controller calls it when it starts. Plans
    are the same to the last bit.

    Returns:
        Whether numba is used: False where it is not installed.
    """
    governor.run_compiled(use)
    taps.run_compiled(use)
    used = law.run_compiled(use)
    rest.run_compiled(use)
    decode.run_compiled(use)
    return used
