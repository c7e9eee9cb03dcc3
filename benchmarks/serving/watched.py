"""`slide-serve` with a clock in its event loop: `python -m benchmarks.serving.watched FILE`.

FILE holds one float64: the longest processor time (s) that one turn of the loop has taken since somebody last wrote
zero there. Processor time, because a loop that waits for a processor blocks nobody by itself.
"""

from __future__ import annotations

import mmap
import selectors
import struct
import sys
import time
from pathlib import Path
from typing import Any

from server.cli import serve_main

NUMBER = struct.Struct("=d")


class LongestTurn:
    """The file that the longest turn is written to.

    Args:
        path: of the file; it is made where there is none.
    """

    def __init__(self, path: Path) -> None:
        if not path.exists():
            path.write_bytes(bytes(NUMBER.size))
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), NUMBER.size)

    @property
    def seconds(self) -> float:
        """The longest turn."""
        value: float = NUMBER.unpack_from(self._map)[0]
        return value

    @seconds.setter
    def seconds(self, value: float) -> None:
        NUMBER.pack_into(self._map, 0, value)


def watch(longest: LongestTurn) -> None:
    """Let event loops that are made from now on write down how long their turns take."""

    class Watched(selectors.DefaultSelector):
        """A turn is what a loop does between two looks at what has come."""

        _begun: float | None = None

        def select(self, timeout: float | None = None) -> Any:
            """Look at what has come."""
            if self._begun is not None:
                taken = time.thread_time() - self._begun
                if taken > longest.seconds:
                    longest.seconds = taken
            events = super().select(timeout)
            self._begun = time.thread_time()
            return events

    selectors.DefaultSelector = Watched  # type: ignore[misc]


if __name__ == "__main__":
    watch(LongestTurn(Path(sys.argv.pop(1))))
    serve_main()
