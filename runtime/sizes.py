"""How large the pan and the object are: the law of friction slides a point, and knows no rim."""

from __future__ import annotations

from dataclasses import dataclass

from runtime.documents.checks import number
from runtime.documents.parameters import Parameters
from runtime.errors import InputError

LARGEST = 10.0
"""Largest radius accepted (m): beyond it is millimetres, or no pan."""


@dataclass(frozen=True)
class Sizes(Parameters):
    """The radii of the pan and of the object on it.

    Attributes:
        pan_radius: inner radius of the pan, from its centre to the rim (m).
        object_radius: radius of the object (m); 0 for a point.

    Raises:
        InputError: a radius is no number, the pan's is not between 0 and LARGEST, or the object does not fit in.
    """

    pan_radius: float = 0.18
    object_radius: float = 0.03

    def __post_init__(self) -> None:
        for name in ("pan_radius", "object_radius"):
            object.__setattr__(self, name, number(getattr(self, name), name))
        if not 0.0 < self.pan_radius <= LARGEST:
            raise InputError(
                f"pan_radius must be above 0 and at most {LARGEST:g} m, got {self.pan_radius:g} m", "pan_radius"
            )
        if not 0.0 <= self.object_radius < self.pan_radius:
            raise InputError(
                f"object_radius must be at least 0 m and less than the pan's, {self.pan_radius:g} m, "
                f"got {self.object_radius:g} m",
                "object_radius",
            )

    @property
    def room(self) -> float:
        """Largest distance of the object's centre from the pan's at which the object does not touch the rim (m)."""
        return self.pan_radius - self.object_radius
