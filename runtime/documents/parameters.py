"""Parameters: a few numbers that belong together, frozen, checked when they are built, and a JSON object."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, ClassVar, Self

from runtime.documents import checks
from runtime.errors import within


@dataclass(frozen=True)
class Parameters:
    """Base of `Friction`, `Limits` and `Sizes`: their JSON document, whose keys are their fields."""

    OPTIONAL: ClassVar[tuple[str, ...]] = ()
    """Keys that a document may lack, as older ones do; the fields have their defaults then."""

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON document."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @classmethod
    def from_dict(cls, document: object, where: str | None = None) -> Self:
        """Read the JSON document.

        Args:
            document: the parsed document.
            where: its key; the name of the class in small letters if None.

        Raises:
            InputError: a key is missing or unknown, a value is no finite number, or the class refuses it.
        """
        where = cls.__name__.lower() if where is None else where
        needed = tuple(field.name for field in fields(cls) if field.name not in cls.OPTIONAL)
        parts = checks.fields(document, where, needed, cls.OPTIONAL)
        values = {name: checks.number(value, f"{where}.{name}") for name, value in parts.items()}
        with within(where):
            return cls(**values)
