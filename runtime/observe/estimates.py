"""What is believed of the object and of the friction, as it is told to a user."""

from __future__ import annotations

from typing import NamedTuple

from runtime.documents.checks import FloatArray
from runtime.friction import Friction


class ObjectEstimate(NamedTuple):
    """What a stream believes of the object.

    Attributes:
        position: (2,) relative to the pan (m).
        velocity: (2,) relative to the pan (m/s).
        sticks: whether it sticks to the pan; then its velocity is exactly zero.
        position_error, velocity_error: standard deviations, in the worse direction (m, m/s).
        age: time since it was seen last (s).
    """

    position: FloatArray
    velocity: FloatArray
    sticks: bool
    position_error: float
    velocity_error: float
    age: float


class FrictionEstimate(NamedTuple):
    """What a stream believes of the friction.

    Attributes:
        friction: as it was told, until frames say more.
        kinetic, static: between what each lies, by 95 %; static friction shows only where the object breaks away.
    """

    friction: Friction
    kinetic: tuple[float, float]
    static: tuple[float, float]
