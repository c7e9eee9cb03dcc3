"""What the programs share: errors in one line, exit codes, tables."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import io
import json
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Annotated, Any, NoReturn, cast, get_args, get_origin, get_type_hints

import typer

from runtime.errors import SlideError, plain
from runtime.interrupt import INTERRUPTED, raising
from runtime.version import __version__

MM = 1e3
"""Millimetres in a metre."""

DONE_BUT_MISSED = 1
BAD_INPUT = 2
NOBODY_READS = 141
"""Exit code where standard output was closed by its reader: 128 and the number of SIGPIPE, as shells give it."""

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of the table.")]


def run(name: str, command: Callable[..., None]) -> None:
    """Run a function as a program: typer reads its arguments, and an error is one line and an exit code.

    Args:
        name: the program's name, for its messages.
        command: what it does; its parameters are the program's. A parameter that is a dataclass stands for its fields:
            each is an option, with the `help` and the `metavar` of its metadata; `read_as` is its type where a command
            line cannot give the field's.
    """
    groups, parameters = _parameters(command)

    @functools.wraps(command)
    def guarded(**given: Any) -> None:
        del given["version"]
        try:
            with raising():
                for group, kind in groups.items():
                    given[group] = kind(
                        **{field.name: _value(field, given.pop(field.name)) for field in dataclasses.fields(kind)}
                    )
                command(**given)
                sys.stdout.flush()  # what cannot be written shows here, and not in a traceback at the end
        except BrokenPipeError:  # whoever read our output has seen enough
            raise typer.Exit(NOBODY_READS) from None
        except (SlideError, OSError) as error:
            say(name, f"error: {error}")
            raise typer.Exit(BAD_INPUT) from None
        except KeyboardInterrupt:
            raise typer.Exit(INTERRUPTED) from None

    guarded.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    guarded.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    app.command(name)(guarded)
    _ready_streams()
    try:
        app(prog_name=name)
    finally:
        _drop_unwritten()


def _ready_streams() -> None:
    """Let standard output and error take any text, escaping what they cannot show; what is closed takes it nowhere."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115 (as long as the process)
        elif mode == "w" and isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _drop_unwritten() -> None:
    """Let go of what standard output does not take, of which the exit code and a line have told."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _parameters(command: Callable[..., None]) -> tuple[dict[str, type[Any]], list[inspect.Parameter]]:
    """Return the dataclasses among a function's parameters, and the parameters of the program that it is."""
    groups: dict[str, type[Any]] = {}
    parameters = []
    hints = get_type_hints(command, include_extras=True)
    for parameter in inspect.signature(command).parameters.values():
        hint = hints[parameter.name]
        if dataclasses.is_dataclass(hint):
            groups[parameter.name] = cast(type[Any], hint)
            parameters += [_option(field, kind) for field, kind in _fields(cast(type[Any], hint))]
        else:
            parameters.append(parameter.replace(annotation=hint))
    shown = typer.Option("--version", is_eager=True, callback=_show_version, help="Show the version and exit.")
    kind = inspect.Parameter.KEYWORD_ONLY
    parameters.append(inspect.Parameter("version", kind, default=False, annotation=Annotated[bool, shown]))
    return groups, [parameter.replace(kind=kind) for parameter in parameters]


def _fields(kind: type[Any]) -> Iterable[tuple[dataclasses.Field[Any], Any]]:
    hints = get_type_hints(kind)
    return [(field, hints[field.name]) for field in dataclasses.fields(kind)]


def _option(field: dataclasses.Field[Any], hint: Any) -> inspect.Parameter:
    """Return the option of a dataclass's field; a tuple is an option that may be repeated."""
    default = field.default
    if get_origin(hint) is tuple:
        hint, default = list[get_args(hint)[0]] | None, None  # type: ignore[misc]
    metadata = dict(field.metadata)
    hint = metadata.pop("read_as", hint)
    option = typer.Option(metadata.pop("flag", f"--{field.name.replace('_', '-')}"), **metadata)
    return inspect.Parameter(
        field.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[hint, option]
    )


def _value(field: dataclasses.Field[Any], given: Any) -> Any:
    """Return what a field was given; an option that may be repeated gives a list, and None if it was not given."""
    return tuple(given or ()) if isinstance(field.default, tuple) else given


def _show_version(asked: bool) -> None:
    if asked:
        print(__version__)
        raise typer.Exit


def say(name: str, message: str) -> None:
    """Print one line on standard error, preceded by the program's name; if that is closed, there is nobody to tell."""
    with suppress(OSError):
        print(f"{name}: {plain(' '.join(message.split()))}", file=sys.stderr)


def cannot_run(name: str, why: str) -> NoReturn:
    """End a program that lacks what it needs, with one line on how to get it; it tells its version all the same."""
    if sys.argv[1:] == ["--version"]:
        print(__version__)
        raise SystemExit(0)
    say(name, f"error: {why}")
    raise SystemExit(BAD_INPUT)


def print_table(title: str, rows: Iterable[Sequence[str]], header: Sequence[str] = (), stderr: bool = False) -> None:
    """Print a table: names and values, or the columns of a header, numbers but for the first two.

    Args:
        title: its title.
        rows: its rows.
        header: names of the columns, if there are to be any.
        stderr: whether it goes to standard error, because standard output is taken.
    """
    from rich import box  # rich takes as long to import as all the rest of a short program
    from rich.console import Console
    from rich.table import Table

    table = Table(title=plain(title), title_justify="left", box=box.SIMPLE, show_header=bool(header))
    table.add_column(*header[:1], no_wrap=not header, overflow="fold")
    table.add_column(*header[1:2], overflow="fold")
    for name in header[2:]:
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(*("\n".join(map(plain, cell.split("\n"))) for cell in row))
    Console(markup=False, highlight=False, stderr=stderr).print(table)


def print_json(document: dict[str, Any], stderr: bool = False) -> None:
    print(json.dumps(document, allow_nan=False), file=sys.stderr if stderr else sys.stdout)
