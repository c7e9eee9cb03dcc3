"""Fills pages of the site with what the programs say of themselves, so that no page can differ from the code.

A line `<!-- program: slide-plan -->` becomes that program's --help, `<!-- schema: PlanRequest -->` the table of a
request's names, `<!-- settings -->` that of the server's settings, `<!-- problems -->` that of its problem documents,
`<!-- folders: runtime -->` that of a package's folders, `<!-- notebook: first_plan -->` a notebook of
`examples/notebooks` with what it shows, `<!-- gallery -->` the plans of `examples/gallery.py`, `<!-- moving: eight -->`
one of them at play, and `<!-- planner -->` a link to the page that plans by itself, where `make site` builds it.
"""

from __future__ import annotations

import ast
import functools
import importlib.util
import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

from pydantic_core import PydanticUndefined

from server.app import create_app
from server.problems import TITLES
from server.settings import Settings

ROOT = Path(__file__).parents[1]

WIDTH = 100
"""Columns of a help text: what fits beside the page's menus."""

PROGRAM = re.compile(r"^<!-- program: (slide-[a-z-]+) -->$", flags=re.MULTILINE)
SCHEMA = re.compile(r"^<!-- schema: ([A-Za-z]+) -->$", flags=re.MULTILINE)
GALLERY = "<!-- gallery -->"
MOVING = re.compile(r"^<!-- moving: ([a-z_]+) -->$", flags=re.MULTILINE)
PLANNER = "<!-- planner -->"
NOTEBOOK = re.compile(r"^<!-- notebook: ([a-z_]+) -->$", flags=re.MULTILINE)
FOLDERS = re.compile(r"^<!-- folders: ([a-z]+) -->$", flags=re.MULTILINE)


def on_config(config: Any) -> Any:
    """Put every decision into the menu."""
    pages = sorted((ROOT / "docs" / "decisions").glob("[0-9]*.md"))
    config.nav.append({"Decisions": ["decisions/index.md", *(f"decisions/{page.name}" for page in pages)]})
    return config


def on_page_markdown(markdown: str, config: Any = None, **_: Any) -> str:
    """Replace the marks of one page."""
    if GALLERY in markdown:
        cards = "\n".join(each.card("gallery") for each in made(Path(config.site_dir)).values())
        markdown = markdown.replace(GALLERY, f'<div class="gallery">\n{cards}\n</div>')
    markdown = MOVING.sub(lambda found: made(Path(config.site_dir))[found[1]].picture, markdown)
    markdown = markdown.replace(PLANNER, PLANNER_LINK if os.environ.get("SITE_PLANS") else "")
    markdown = PROGRAM.sub(lambda found: f"```text\n{help_of(found[1])}\n```", markdown)
    markdown = FOLDERS.sub(lambda found: folders_table(found[1]), markdown)
    markdown = NOTEBOOK.sub(lambda found: notebook_page(found[1]), markdown)
    markdown = SCHEMA.sub(lambda found: schema_table(found[1]), markdown)
    markdown = markdown.replace("<!-- settings -->", settings_table())
    return markdown.replace("<!-- problems -->", problems_table())


PLANNER_LINK = '<a class="md-button md-button--primary" href="plan/index.html">Plan your own, here</a>'


@functools.cache
def made(site: Path) -> dict[str, Any]:
    """Write the files of the gallery into the site's folder, and return its plans by name."""
    spec = importlib.util.spec_from_file_location("slide_gallery", ROOT / "examples" / "gallery.py")
    if spec is None or spec.loader is None:
        raise RuntimeError("examples/gallery.py is missing")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its dataclasses look for it there
    spec.loader.exec_module(module)
    return {each.entry.name: each for each in module.make_gallery(site / "gallery")}


def programs() -> dict[str, str]:
    """Return the entry point of every program by its name."""
    scripts: dict[str, str] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["scripts"]
    return scripts


def help_of(program: str) -> str:
    """Return what a program prints for --help.

    Raises:
        RuntimeError: it fails.
    """
    module, function = programs()[program].split(":")
    done = subprocess.run(
        [sys.executable, "-c", f"from {module} import {function}; {function}()", "--help"],
        cwd=ROOT,
        env={**os.environ, "COLUMNS": str(WIDTH), "TERMINAL_WIDTH": str(WIDTH), "NO_COLOR": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{program} --help failed: {done.stderr.strip()[-500:]}")
    return done.stdout.strip()


def folders_table(package: str) -> str:
    """Return the folders of a package with the first line of what each says of itself."""
    rows = ["| folder | what it knows |", "|---|---|"]
    for init in sorted((ROOT / package).glob("*/__init__.py")):
        said = ast.get_docstring(ast.parse(init.read_text(encoding="utf-8"))) or ""
        rows.append(f"| `{package}/{init.parent.name}/` | {said.splitlines()[0] if said else ''} |")
    return "\n".join(rows)


def notebook_page(name: str) -> str:
    """Return a notebook of `examples/notebooks` as a page: its text, its code, and what each cell has shown."""
    path = ROOT / "examples" / "notebooks" / f"{name}.ipynb"
    parts = []
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        parts += [_shown_output(output) for output in cell["outputs"]]
    return "\n\n".join(parts)


def _shown_output(output: dict[str, Any]) -> str:
    """Return what a cell has shown, the richest form of it."""
    data = {kind: "".join(content) for kind, content in output.get("data", {}).items()}
    if "text/html" in data:
        return "\n".join(line for line in data["text/html"].splitlines() if line.strip())  # a blank line would end it
    if "image/png" in data:
        return f'<img alt="" src="data:image/png;base64,{"".join(data["image/png"].split())}">'
    return f"```text\n{(data.get('text/plain') or ''.join(output.get('text', ''))).rstrip()}\n```"


def schema_table(name: str) -> str:
    """Return the names of a request, of the server's own description: what each takes, and whether it is needed."""
    schema = create_app(Settings()).openapi()["components"]["schemas"][name]
    needed = schema.get("required", [])
    rows = ["| name | value | |", "|---|---|---|"]
    for key, about in schema["properties"].items():
        remark = [about["description"]] if "description" in about else []
        remark += ["Needed."] if key in needed else []
        rows.append(f"| `{key}` | {_type(about)} | {' '.join(remark)} |")
    return "\n".join(rows)


def settings_table() -> str:
    """Return every setting of the server: its variable, its default, its range and what it is."""
    rows = ["| variable | default | range | what it is |", "|---|---|---|---|"]
    for name, field in Settings.model_fields.items():
        default = "none" if field.default in (None, PydanticUndefined) else f"`{_shown(field.default)}`"
        rows.append(f"| `SLIDE_{name.upper()}` | {default} | {_range(field.metadata)} | {field.description} |")
    return "\n".join(rows)


def problems_table() -> str:
    """Return every problem document that the server may answer with."""
    rows = ["| type | status | title |", "|---|---|---|"]
    rows += [f"| `{name}` | {status} | {title} |" for name, (status, title) in TITLES.items()]
    return "\n".join(rows)


def _type(about: dict[str, Any]) -> str:
    if "$ref" in about:
        return str(about["$ref"]).rsplit("/", 1)[-1].removesuffix("Request").lower()
    if "anyOf" in about:
        return " or ".join(_type(each) for each in about["anyOf"] if each.get("type") != "null")
    if about.get("type") == "array":
        if "prefixItems" in about:
            return "[x, y]" if len(about["prefixItems"]) == 2 else "[x, y, z]"
        item = _type(about["items"])
        return f"list of {item}s" if item.isalpha() else f"list of {item}"
    if "enum" in about:
        return " or ".join(f"`{each}`" for each in about["enum"])
    return str(about.get("type", "any"))


def _shown(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


def _range(metadata: list[Any]) -> str:
    bounds: dict[str, Any] = {}
    for each in metadata:
        bounds |= {name: getattr(each, name) for name in ("gt", "ge", "lt", "le") if hasattr(each, name)}
    signs = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}
    return ", ".join(f"{signs[name]} {_shown(value)}" for name, value in bounds.items() if value is not None)
