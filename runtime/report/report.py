"""A plan as a page to look at: one HTML file with the pan animated from above and plots linked to it.

The file stands alone: the template beside this module with the viewer's style sheet and modules, which the server's
page uses too, written into it as one script, and the plan's numbers in one JSON block. It asks nothing of the network
and works from a file:// address. `#t=0.6` at the end of the address opens it at that time (s), and `#t=0.6&frame=pan`
with the pan held still.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.documents.checks import FloatArray, table, text
from runtime.documents.writing import write_whole
from runtime.errors import InputError
from runtime.physics.motion import lengths
from runtime.plan import Plan

DECIMALS = 6
"""Decimals kept of positions (m), speeds (m/s) and accelerations (m/s^2): finer than any screen by far."""

MAX_SAMPLES = 6000
"""Most samples written for drawing; of a longer plan every n-th is taken, its figures are of all samples."""

FILES = files("runtime.report")
"""Where the template lies, the report's own module, and the viewer's."""

IMPORT = re.compile(r'^import \{[^}]*\} from "\./(?:viewer/)?(\w+\.js)";\n', re.MULTILINE)
"""A module's import of another: names as they are called there."""


@dataclass(frozen=True, eq=False)
class Track:
    """Another motion on the plan's time line, drawn beside it: a replay, or what a simulator measured.

    Attributes:
        name: what the legend calls it.
        object_position: (K, 2) relative to the pan (m).
        object_velocity: (K, 2) relative to the pan (m/s).
        pan_position: (K, 3) in the world, relative to where the pan began (m).

    Raises:
        InputError: the name is no printable text, an array is not (K, 2) finite numbers, the pan's (K, 3), or
            lengths differ.
    """

    name: str
    object_position: FloatArray
    object_velocity: FloatArray
    pan_position: FloatArray

    def __post_init__(self) -> None:
        text(self.name, "track name")
        for field in ("object_position", "object_velocity", "pan_position"):
            width = 3 if field == "pan_position" else 2
            array = table(getattr(self, field), f"track {self.name!r}: {field}", width)
            if len(array) != len(self.object_position):
                rows = len(self.object_position)
                raise InputError(f"track {self.name!r}: {field} has {len(array)} rows, object_position has {rows}")
            object.__setattr__(self, field, array)


def slip_phases(object_velocity: FloatArray) -> list[tuple[int, int]]:
    """Return the runs of samples at which the object slides; at the others it rests, with a speed of exactly 0.

    Args:
        object_velocity: (K, 2) relative to the pan (m/s).

    Returns:
        For each run its first sample and the sample after its last, in the order of time.
    """
    sliding = np.concatenate([[False], object_velocity.any(axis=1), [False]])
    edges = np.flatnonzero(np.diff(sliding.astype(np.int8)))
    return [(int(first), int(end)) for first, end in edges.reshape(-1, 2)]


def render_report(plan: Plan, tracks: Sequence[Track] = ()) -> str:
    """Return the page of a plan, a whole HTML document.

    Args:
        plan: the plan.
        tracks: further motions to draw beside the plan's own prediction, on the same time line.

    Raises:
        InputError: a track has another number of samples than the plan.
    """
    for track in tracks:
        if len(track.object_position) != len(plan):
            count = len(track.object_position)
            raise InputError(f"track {track.name!r} has {count} samples, the plan has {len(plan)}")
    # Only `<` could end the script block or open a comment in it; inside JSON it stands in strings alone.
    data = json.dumps(_document(plan, tracks), allow_nan=False, separators=(",", ":")).replace("<", r"\u003c")
    # The data come last: a name in them may look like a placeholder.
    parts = {"STYLE": _read("viewer.css"), "SCRIPT": _script(), "REPORT": data}
    page = _read("report.html")
    for name, part in parts.items():
        page = page.replace(f"@@{name}@@", part.rstrip(), 1)
    return page


def write_report(path: str | PathLike[str], plan: Plan, tracks: Sequence[Track] = ()) -> None:
    """Write the page of a plan; the file appears whole or not at all.

    Args:
        path: the HTML file, replaced if it exists.
        plan: the plan.
        tracks: further motions to draw beside the plan's own prediction, on the same time line.

    Raises:
        InputError: a track has another number of samples than the plan.
        OutputError: the file cannot be written.
    """
    write_whole(Path(path), render_report(plan, tracks).encode("utf-8"))


def _read(name: str) -> str:
    """Return a file of the report or of the viewer."""
    own = name.startswith("report.")
    return (FILES if own else FILES.joinpath("viewer")).joinpath(name).read_text(encoding="utf-8")


def _script() -> str:
    """Return the report's module after all that it imports, as one script without imports."""
    sources: dict[str, str] = {}

    def add(name: str) -> None:
        source = _read(name)
        for imported in IMPORT.findall(source):
            if imported not in sources:
                add(imported)
        sources[name] = re.sub(r"^export ", "", IMPORT.sub("", source), flags=re.MULTILINE)

    add("report.js")
    return "\n".join(f"// {name}\n{source}" for name, source in sources.items())


def _document(plan: Plan, tracks: Sequence[Track]) -> dict[str, Any]:
    """Return what the page is drawn from: the plan's document with its rows thinned and rounded.

    With it comes what can no longer be told from the rows (their times, the slip phases, the number of samples), and
    what is drawn beside the plan.
    """
    drawn = _drawn_samples(len(plan))
    document = plan.document()
    rows = {
        group: {name: _rounded(values[drawn]) for name, values in document[group].items()}
        for group in ("command", "pan", "object")
    }
    return {
        **{name: document[name] for name in ("dt", "model", "friction", "sizes", "quality")},
        **rows,
        "time": _rounded(drawn * plan.dt),
        "slip": [_rounded(np.array(phase) * plan.dt) for phase in slip_phases(plan.object_velocity)],
        "samples": len(plan),
        "stop": {"acceleration": _rounded(plan.stop_acceleration)},
        "tracks": [_track_document(plan, track, drawn) for track in tracks],
    }


def _track_document(plan: Plan, track: Track, drawn: NDArray[np.intp]) -> dict[str, Any]:
    error = lengths(track.object_position - plan.command_position)
    return {
        "name": track.name,
        "pan": {"position": _rounded(track.pan_position[drawn])},
        "object": {
            "position": _rounded(track.object_position[drawn]),
            "velocity": _rounded(track.object_velocity[drawn]),
        },
        "tracking_rmse": float(np.sqrt(np.mean(error * error))),
        "tracking_max": float(error.max()),
        "end_distance": float(error[-1]),
        "pan_deviation_max": float(lengths(track.pan_position - plan.pan_position).max()),
    }


def _drawn_samples(samples: int) -> NDArray[np.intp]:
    """Return which samples are drawn: all of them, or every n-th and the last."""
    every = -(-samples // (MAX_SAMPLES - 1))  # one place is kept for the last sample
    return np.unique(np.append(np.arange(0, samples, every), samples - 1))


def _rounded(values: NDArray[np.floating[Any]]) -> Any:
    """Return nested lists with DECIMALS decimals, without negative zeros."""
    return (np.round(values, DECIMALS) + 0.0).tolist()
