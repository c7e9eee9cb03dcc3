"""What the programs share: errors in one line, exit codes, tables."""

from __future__ import annotations

import functools
import json
import sys
from collections.abc import Callable, Iterable
from typing import Annotated, Any

import typer

from runtime.errors import SlideError

MM = 1e3
"""Millimetres in a metre."""

DONE_BUT_MISSED = 1
BAD_INPUT = 2
INTERRUPTED = 130
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of the table.")]


def run(name: str, command: Callable[..., None]) -> None:
    """Run a function as a program: typer reads its arguments, and an error is one line and an exit code.

    Args:
        name: the program's name, for its messages.
        command: what it does; its parameters are the program's.
    """

    @functools.wraps(command)
    def guarded(*args: Any, **kwargs: Any) -> None:
        try:
            command(*args, **kwargs)
            sys.stdout.flush()  # a closed pipe shows here, and not in a traceback at the interpreter's end
        except SlideError as error:
            say(name, f"error: {error}")
            raise typer.Exit(BAD_INPUT) from None
        except BrokenPipeError:  # whoever read our output has seen enough; typer ends it quietly
            raise
        except OSError as error:
            say(name, f"error: {error}")
            raise typer.Exit(BAD_INPUT) from None
        except KeyboardInterrupt:
            raise typer.Exit(INTERRUPTED) from None

    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    app.command(name)(guarded)
    app(prog_name=name)


def say(name: str, message: str) -> None:
    """Print one line on standard error, preceded by the program's name."""
    print(f"{name}: {' '.join(message.split())}", file=sys.stderr)


def print_table(title: str, rows: Iterable[tuple[str, str]]) -> None:
    """Print names and values as a table on standard output."""
    from rich import box  # rich takes as long to import as all the rest of a short program
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE, show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for row in rows:
        table.add_row(*row)
    Console(markup=False, highlight=False).print(table)


def print_json(document: dict[str, Any]) -> None:
    print(json.dumps(document, allow_nan=False))
