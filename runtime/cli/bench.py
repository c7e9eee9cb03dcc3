"""`slide-bench`: starts the benchmarks, which are a folder of a checkout and no part of the installed package."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

from runtime.cli.console import cannot_run

CHECKOUT = Path(__file__).resolve().parents[2]
"""Where the folder `benchmarks` is, beside `runtime`, if this is a checkout."""


def bench_main() -> None:
    """Entry point of `slide-bench`."""
    if not (CHECKOUT / "benchmarks" / "cli.py").exists():
        cannot_run(
            "slide-bench",
            "the benchmarks are not part of the installed package; in a checkout of the source, "
            "run: make bench, or pip install -e '.[dev]' and slide-bench SECTION...",
        )
    sys.path.insert(0, str(CHECKOUT))
    import_module("benchmarks.cli").bench_main()
