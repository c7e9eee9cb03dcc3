"""Twelve commands from everyday life, each planned: a moving picture, its figures, and how to make it again.

    python examples/gallery.py [FOLDER]

The folder, out/gallery if none is given, then has a command file and a report of each, and index.html.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime import Command, Plan, Planner
from runtime.report.report import write_report

Array = NDArray[np.float64]

RATE = 100.0
"""Positions a second in a command file."""

EVERY = 20
"""Samples between two of the picture's moments."""

SLOWER = 3.0
"""Times that the picture is slower than the plan."""

PAUSE = 0.4
"""Time at which it stands still at the end (s)."""

MM = 1e3
"""Millimetres in a metre."""

BORDER = 4.0
"""Width of the picture's border (mm)."""

REST = 0.2
"""Time for which a command rests at its end, so that the object stays there (s)."""


@dataclass(frozen=True)
class Entry:
    """A command of the gallery.

    Attributes:
        name: of its files.
        title: for people.
        text: what it is, in a sentence.
        position: where the object is at each of n even steps from 0 to 1, (n,) to (n, 2) (mm).
        duration: how long it takes (s).
    """

    name: str
    title: str
    text: str
    position: Callable[[Array], Array]
    duration: float

    def csv(self) -> str:
        """Return the command file: it comes from rest, and rests at the end."""
        count = round(self.duration * RATE)
        share = np.arange(count + 1) / count
        position = self.position(share)
        rest = np.repeat(position[-1:], round(REST * RATE), axis=0)
        rows = np.concatenate([position, rest]) / MM
        lines = [f"{index / RATE:.2f},{x:.5f},{y:.5f}" for index, (x, y) in enumerate(rows)]
        return "\n".join(["t,x,y", *lines]) + "\n"


def eased(share: Array) -> Array:
    """Return shares that begin and end slowly, 0 to 1."""
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def turned(share: Array, turns: float) -> tuple[Array, Array]:
    """Return cosine and sine of an angle that goes through so many turns, from rest to rest."""
    angle = 2.0 * np.pi * turns * eased(share)
    return np.cos(angle), np.sin(angle)


def through(points: list[tuple[float, float]], share: Array, moving: float = 1.0) -> Array:
    """Return positions that go from point to point, each way from rest to rest, and rest for the rest of its time."""
    corners = np.array(points)
    ways = len(corners) - 1
    number = np.minimum((share * ways).astype(int), ways - 1)
    part = eased(np.minimum((share * ways - number) / moving, 1.0))[:, None]
    return corners[number] + part * (corners[number + 1] - corners[number])


def stir(share: Array) -> Array:
    x, y = turned(share, 3.0)
    size = 20.0 + 25.0 * share
    return np.stack([size * x, size * y], axis=1)


def shuffle(share: Array) -> Array:
    swing = np.sin(2.0 * np.pi * 4.0 * eased(share)) * np.sin(np.pi * share)
    return np.stack([45.0 * swing, 12.0 * np.sin(2.0 * np.pi * eased(share))], axis=1)


def sort(share: Array) -> Array:
    return through([(0, 0), (-55, 20), (0, 0), (55, 20), (0, 0)], share, moving=0.75)


def word(share: Array) -> Array:
    """Return the word elle, whose letters are loops."""
    angle = 2.0 * np.pi * 4.0 * eased(share)
    tall = np.interp(angle / (2.0 * np.pi), [0.0, 0.8, 1.2, 2.8, 3.2, 4.0], [22.0, 22.0, 46.0, 46.0, 22.0, 22.0])
    return np.stack(
        [-45.0 + 22.0 * angle / (2.0 * np.pi) - 9.0 * np.sin(angle), tall * (1 - np.cos(angle)) / 2], axis=1
    )


def eight(share: Array) -> Array:
    x, y = turned(share, 2.0)
    return np.stack([45.0 * y, 45.0 * x * y], axis=1)


def spiral(share: Array) -> Array:
    x, y = turned(share, 3.0)
    size = 60.0 * eased(share)
    return np.stack([size * x, size * y], axis=1)


def around_a_spot(share: Array) -> Array:
    angle = np.pi * (1.0 - eased(share))
    return np.stack([60.0 * np.cos(angle), 45.0 * np.sin(angle) ** 2], axis=1)


def stop_and_go(share: Array) -> Array:
    return through([(-60, 0), (-30, 0), (0, 0), (30, 0), (60, 0)], share, moving=0.7)


def square(share: Array) -> Array:
    return through([(-35, -35), (35, -35), (35, 35), (-35, 35), (-35, -35)], share)


def star(share: Array) -> Array:
    angles = np.pi / 2.0 + 4.0 * np.pi / 5.0 * np.arange(6)
    return through([(50.0 * np.cos(each), 50.0 * np.sin(each)) for each in angles], share)


def heart(share: Array) -> Array:
    angle = 2.0 * np.pi * eased(share)
    x = 16.0 * np.sin(angle) ** 3
    y = 13.0 * np.cos(angle) - 5.0 * np.cos(2 * angle) - 2.0 * np.cos(3 * angle) - np.cos(4 * angle)
    return 3.0 * np.stack([x, y], axis=1)


def flower(share: Array) -> Array:
    angle = 2.0 * np.pi * eased(share)
    size = 30.0 + 20.0 * np.cos(5.0 * angle)
    return np.stack([size * np.cos(angle), size * np.sin(angle)], axis=1)


GALLERY = (
    Entry("eight", "An eight", "Twice along a figure eight.", eight, 3.2),
    Entry("stir", "Stir", "Three rounds, each wider than the one before.", stir, 3.6),
    Entry("shuffle", "Shuffle", "To and fro, as one shakes what must not stick to the pan.", shuffle, 2.4),
    Entry("sort", "Sort", "One to the left, one to the right, with a rest at every place.", sort, 3.2),
    Entry("word", "A word", "The word elle, in one line.", word, 3.6),
    Entry("spiral", "A spiral", "From the middle outwards.", spiral, 3.2),
    Entry(
        "around_a_spot", "Avoid a spot", "From one side to the other, around what lies in between.", around_a_spot, 1.2
    ),
    Entry("stop_and_go", "Stop and go", "Across the pan, with three stops on the way.", stop_and_go, 2.8),
    Entry("square", "A square", "Four sides, a stop at each corner.", square, 2.4),
    Entry("star", "A star", "Five strokes across the pan.", star, 3.0),
    Entry("heart", "A heart", "Once around.", heart, 2.4),
    Entry("flower", "A flower", "Five petals, without a stop.", flower, 3.6),
)


@dataclass(frozen=True)
class Made:
    """An entry with its plan."""

    entry: Entry
    plan: Plan

    @property
    def picture(self) -> str:
        """The plan as an SVG that plays by itself."""
        return moving_picture(self.plan)

    def card(self, files: str) -> str:
        """Return the moving picture, the figures and the commands that make the plan again, as HTML.

        Args:
            files: address of the folder of command files and reports.
        """
        name, quality = self.entry.name, self.plan.quality
        repeat = f"slide-plan {name}.csv -o {name}.json\nslide-run {name}.json --report {name}.html"
        return (
            f'<div class="gallery-card">{self.picture}<p><b>{escape(self.entry.title)}</b>. '
            f"{escape(self.entry.text)}</p>"
            f"<p>{len(self.plan) * self.plan.dt:.1f} s, tracking RMSE {quality.tracking_rmse * MM:.1f} mm, "
            f"{quality.status.replace('_', ' ')}. "
            f'<a href="{files}/{name}.csv">{name}.csv</a>, <a href="{files}/{name}.html">report</a></p>'
            f"<pre><code>{repeat}</code></pre></div>"
        )


def make_gallery(folder: Path) -> list[Made]:
    """Write the command files and the reports, and return what was made."""
    folder.mkdir(parents=True, exist_ok=True)
    planner, made = Planner(), []
    for entry in GALLERY:
        file = folder / f"{entry.name}.csv"
        file.write_text(entry.csv(), encoding="ascii")
        plan = planner.plan(Command.load(file))
        write_report(folder / f"{entry.name}.html", plan)
        made.append(Made(entry, plan))
    return made


def moving_picture(plan: Plan) -> str:
    """Return a plan and its stop as an SVG that plays by itself: the pan from above, command and object on it."""
    motion = plan.with_stop()
    moments = np.unique(np.append(np.arange(0, len(motion.pan), EVERY), len(motion.pan) - 1))
    moments = np.append(moments, np.full(round(PAUSE * 1e3 / EVERY), moments[-1]))
    duration = f"{len(moments) * EVERY * 1e-3 * SLOWER:.2f}s"
    reach = MM * (plan.quality.limits["pan_reach"] or 0.0)
    pan, thing = MM * plan.sizes.pan_radius, MM * plan.sizes.object_radius
    size = max(reach, float(np.abs(MM * motion.pan[:, :2]).max()) + pan) + BORDER
    command = " ".join(f"{x:.1f},{-y:.1f}" for x, y in MM * plan.command_position[::10])

    def moved(position: Array) -> str:
        values = ";".join(f"{x:.1f} {-y:.1f}" for x, y in MM * position[moments, :2])
        return (
            f'<animateTransform attributeName="transform" type="translate" values="{values}" dur="{duration}" '
            'repeatCount="indefinite"/>'
        )

    return (
        f'<svg class="moving" role="img" aria-label="the pan moves, and the object slides on it" '
        f'viewBox="{-size:.0f} {-size:.0f} {2 * size:.0f} {2 * size:.0f}" fill="none" stroke="currentColor">'
        f'<circle r="{reach:.0f}" stroke-dasharray="6 8" stroke-width="2" opacity="0.3"/>'
        f'<g><circle r="{pan:.0f}" stroke-width="4" fill="currentColor" fill-opacity="0.05"/>'
        f'<polyline points="{command}" stroke-width="3" opacity="0.5"/>'
        f'<circle r="{thing:.0f}" fill="#d4691e" fill-opacity="0.6" stroke="#d4691e" stroke-width="3">'
        f"{moved(motion.sliding)}</circle>{moved(motion.pan)}</g></svg>"
    )


STYLE = """body{font:16px/1.5 sans-serif;max-width:1100px;margin:2em auto;padding:0 1em}
.gallery{display:grid;grid-template-columns:repeat(auto-fill,minmax(260px,1fr));gap:2em}
.moving{width:100%;height:auto}pre{overflow-x:auto;font-size:12px}"""


def main() -> None:
    """Write the gallery, and its page."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/gallery")
    cards = "\n".join(each.card(".") for each in make_gallery(folder))
    page = (
        '<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f"<title>slide-planner: gallery</title><style>{STYLE}</style><h1>Gallery</h1>"
        f'<div class="gallery">{cards}</div></html>\n'
    )
    (folder / "index.html").write_text(page, encoding="utf-8")
    print(f"{folder / 'index.html'}: {len(GALLERY)} plans")


if __name__ == "__main__":
    main()
