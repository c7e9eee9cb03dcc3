"""The entry point of `slide-serve`, which says in one line what to install where the server's packages are missing."""

from __future__ import annotations

from runtime.cli.console import cannot_run, run
from runtime.errors import MissingExtraError, extra


def serve_main() -> None:
    """Entry point of `slide-serve`."""
    try:
        with extra("server"):
            from server.run import slide_serve
    except MissingExtraError as error:
        cannot_run("slide-serve", str(error))
    run("slide-serve", slide_serve)
