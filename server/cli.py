"""The entry point of `slide-serve`, which says in one line what to install where the server's packages are missing."""

from __future__ import annotations

import sys

from runtime.cli.console import BAD_INPUT, run, say
from runtime.errors import MissingExtraError, extra


def serve_main() -> None:
    """Entry point of `slide-serve`."""
    try:
        with extra("server"):
            from server.run import slide_serve
    except MissingExtraError as error:
        say("slide-serve", f"error: {error}")
        sys.exit(BAD_INPUT)
    run("slide-serve", slide_serve)
