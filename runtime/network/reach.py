"""How much of a pan's reach the network is told: less for slow commands, which it then plans finer."""

from __future__ import annotations

import math

import numpy as np

from runtime.network.job import Job
from runtime.network.reader import units_of_one
from runtime.physics.law import DT
from runtime.physics.motion import squares

SPAN = 50
"""Samples over which a command's speed is averaged: noise of a tenth of a millimetre is no speed."""

PER_SPEED = {"level": 8.0, "lifting": 4.0}
"""Share of the reach for each m/s, in the network's units, of a command's speed: a pan that lifts needs half of it."""

SHARES = (1.0, 0.7, 0.5, 0.35, 0.25)
"""Shares that there are, so that many commands have one in common and are planned together. With a smaller one, chunks
would be so short that planning took more than twice as long."""


def with_reach(job: Job) -> Job:
    """Return a job with the share of the reach that suits its command, of SHARES."""
    position = job.command.position
    before = np.concatenate([np.repeat(position[:1], SPAN, axis=0), position])
    fastest = math.sqrt(squares(before[SPAN:] - before[:-SPAN]).max()) / (SPAN * DT)
    unit = float(units_of_one(job.limits).velocity[0])
    wanted = PER_SPEED["level" if job.limits.level else "lifting"] * fastest / unit
    return job._replace(reach_used=nearest(wanted))


def nearest(wanted: float) -> float:
    """Return the share that is nearest by ratio."""
    return min(SHARES, key=lambda share: abs(math.log(share / max(wanted, SHARES[-1]))))


def shares_about(share: float) -> tuple[float, float, float]:
    """Return a share, the next smaller one and the next larger one; the ends are followed by their neighbours."""
    index = min(max(SHARES.index(nearest(share)), 1), len(SHARES) - 2)
    about = sorted(SHARES[index - 1 : index + 2], key=lambda other: abs(math.log(other / share)))
    return about[0], about[1], about[2]
