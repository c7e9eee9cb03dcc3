"""Settings as a frozen dataclass whose fields are options of a program too: `runtime.cli.console.run` reads them."""

from __future__ import annotations

from dataclasses import field
from typing import Any


def option(help: str, default: Any = None, metavar: str | None = None, **more: object) -> Any:
    """Return a dataclass field that is an option.

    Args:
        help: what it does, for `--help`.
        default: its value where it is not given.
        metavar: what stands for its value in `--help`.
        more: what else `runtime.cli.console.run` knows: `read_as`, its type on a command line; `flag`, its name there
            if that is not the field's.
    """
    return field(default=default, metadata={"help": help, "metavar": metavar, **more})
