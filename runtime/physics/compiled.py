"""Numba, where it is installed: plain functions over numbers and sequences of numbers, compiled.

What is written once runs twice: as it stands, over lists of floats, and compiled, over arrays, some forty times faster.
Numba takes half a second to import and seconds to compile, so nothing here happens before it is asked for.

Where numba's own variable NUMBA_CACHE_DIR names a folder, what is compiled is kept there, and the next process loads it
in a tenth of the time. Numba does not see when a function has changed that a kept one calls: each version needs a
folder of its own.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from types import FunctionType
from typing import Any

from runtime.errors import extra

Compiler = Callable[[Any], Any]

CACHE = "NUMBA_CACHE_DIR"
"""The variable that names the folder for what is compiled."""


def compiler() -> Compiler | None:
    """Return what compiles a function, None if numba is not installed."""
    try:
        import numba
    except ImportError:
        return None
    compile_one: Compiler = numba.njit(nogil=True, error_model="numpy", cache=CACHE in os.environ)
    return compile_one


def check_compiler() -> None:
    """Check that there is a compiler, for what would take too long without.

    Raises:
        MissingExtraError: numba is not installed.
    """
    with extra("refine"):
        import numba  # noqa: F401


def compile_together(
    functions: Sequence[Any], compile_one: Compiler, known: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Compile functions of which later ones may call earlier ones.

    Args:
        functions: plain ones of a module, with neither defaults nor closures.
        compile_one: compiles one.
        known: compiled ones that they may call, by their names.

    Returns:
        The compiled functions by their names; they call each other, and their modules are left as they are.
    """
    compiled: dict[str, Any] = {}
    for function in functions:
        names = {**function.__globals__, **(known or {}), **compiled}
        compiled[function.__name__] = compile_one(FunctionType(function.__code__, names, function.__name__))
    return compiled
