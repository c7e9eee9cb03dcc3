"""Ctrl-C in a program: exit code 130 and no traceback, from its first instruction to its last.

Importing numpy and onnxruntime takes a program a good part of a second, in which Python would answer Ctrl-C with a
traceback. So `runtime` imports this module before all others: in a program, Ctrl-C ends the process at once, except
where `raising` lets it raise KeyboardInterrupt. Scripts of others that import `runtime` keep Python's way.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

INTERRUPTED = 130
"""Exit code of what Ctrl-C ended: 128 and the number of the signal, as shells give it."""

PROGRAMS = {
    "slide-bench",
    "slide-eval",
    "slide-export",
    "slide-identify",
    "slide-info",
    "slide-joints",
    "slide-plan",
    "slide-plan-many",
    "slide-run",
    "slide-serve",
    "slide-train",
}
"""The programs, by the names under which they are installed."""


def _end(signal_number: int, frame: FrameType | None) -> None:
    os._exit(INTERRUPTED)


class _Raise:
    """Raises KeyboardInterrupt at Ctrl-C, and knows that it did."""

    def __init__(self) -> None:
        self.did = False

    def __call__(self, signal_number: int, frame: FrameType | None) -> None:
        self.did = True
        raise KeyboardInterrupt


def interrupted() -> bool:
    """Return whether Ctrl-C was pressed inside of the `raising` that is open.

    A loop that goes on for hours asks: where Python was called by C code, as while numba compiles, KeyboardInterrupt is
    dropped.
    """
    handler = signal.getsignal(signal.SIGINT)
    return isinstance(handler, _Raise) and handler.did


@contextmanager
def raising() -> Iterator[None]:
    """Let Ctrl-C raise KeyboardInterrupt inside, where there may be something to put in order.

    It is a KeyboardInterrupt that leaves, whatever the code in between makes of it: a library that is just being loaded
    makes it an ImportError.
    """
    if signal.getsignal(signal.SIGINT) is not _end:
        yield
        return
    interrupt, show = _Raise(), sys.unraisablehook

    def show_others(unraisable: sys.UnraisableHookArgs) -> None:
        if unraisable.exc_type is not KeyboardInterrupt:  # which `interrupted` tells of
            show(unraisable)

    signal.signal(signal.SIGINT, interrupt)
    sys.unraisablehook = show_others
    try:
        yield
    except Exception:
        if interrupt.did:
            raise KeyboardInterrupt from None
        raise
    finally:
        signal.signal(signal.SIGINT, _end)
        sys.unraisablehook = show


# A shell lets what it starts in the background ignore SIGINT: that stays so.
if os.path.basename(sys.argv[0]) in PROGRAMS and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, _end)
