"""A page about a fit: what was found, and pictures of how well the law explains the log."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.documents.writing import write_whole
from runtime.identify.fit import Fit
from runtime.outputs.picture import OBJECT, PAN, RIM

MM = 1e3
"""Millimetres in a metre."""

WIDTH, HEIGHT, EDGE = 640, 200, 46
"""Size of a picture and of its edge (pixels)."""

STYLE = """
:root { color-scheme: light dark; }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 46rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; } td { padding: .15rem 1.2rem .15rem 0; vertical-align: top; }
svg { width: 100%; height: auto; } figure { margin: 1.5rem 0; } figcaption { font-weight: 600; }
text { font-size: 11px; fill: currentColor; }
"""


def rows(fit: Fit) -> list[tuple[str, str]]:
    """Return the figures as a table of names and values."""
    friction = fit.friction
    kinetic = "not known: the object hardly ever slides"
    if fit.kinetic is not None:
        kinetic = f"{friction.kinetic:.3f}, from {fit.kinetic[0]:.3f} to {fit.kinetic[1]:.3f}"
    explained = "yes" if fit.explained else "no"
    return [
        ("kinetic friction", kinetic),
        ("static friction", f"from {fit.static[0]:.2f} to {fit.static[1]:.2f}, best {friction.static:.2f}"),
        ("left over", f"{fit.residual * MM:.2f} mm RMS, noise of the frames {fit.noise * MM:.2f} mm"),
        ("explained by Coulomb's law", explained),
        ("share of time sliding", f"{fit.sliding_share:.1%}"),
        ("frames, far off", f"{fit.frames}, {fit.outliers}"),
        *((f"hint: {hint.name.replace('_', ' ')}", hint_text(fit, index)) for index, hint in enumerate(fit.hints)),
    ]


def hint_text(fit: Fit, index: int) -> str:
    """Return one hint in words."""
    hint = fit.hints[index]
    size = f"{hint.value:.3g} +- {hint.spread:.1g} {hint.unit}"
    return f"{size} explains {hint.explains:.0%} of what is left: {hint.meaning}"


def notes(fit: Fit) -> list[str]:
    """Return one line for each thing that was missed."""
    lines = []
    if fit.kinetic is None:
        lines.append(f"the object slides for {fit.sliding_share:.1%} of the time, too little to find its friction")
    if not fit.explained:
        lines.append(
            f"Coulomb's law leaves {fit.residual * MM:.2f} mm, the frames' noise is {fit.noise * MM:.2f} mm: the "
            "frictions are not to be trusted"
        )
    return lines


def write_report(path: Path, title: str, fit: Fit) -> None:
    """Write the page.

    Raises:
        OutputError: it cannot be written.
    """
    table = "".join(f"<tr><td>{html.escape(name)}</td><td>{html.escape(value)}</td></tr>" for name, value in rows(fit))
    residual = (fit.seen - fit.law) * MM
    pictures = [
        (
            "x of the object, seen and by the law (mm)",
            [(fit.seen[:, 0] * MM, RIM, True), (fit.law[:, 0] * MM, OBJECT, False)],
        ),
        (
            "y of the object, seen and by the law (mm)",
            [(fit.seen[:, 1] * MM, RIM, True), (fit.law[:, 1] * MM, OBJECT, False)],
        ),
        ("what is left in x and y (mm)", [(residual[:, 0], OBJECT, True), (residual[:, 1], PAN, True)]),
    ]
    figures = "".join(
        f"<figure><figcaption>{caption}</figcaption>{_picture(caption, fit.time, lines)}</figure>"
        for caption, lines in pictures
    )
    title = html.escape(title)
    page = (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title>'
        f'<meta name="viewport" content="width=device-width"><style>{STYLE}</style>'
        f"<body><h1>Friction in {title}</h1><table>{table}</table>{figures}</body></html>\n"
    )
    write_whole(path, page.encode())


def _picture(title: str, time: FloatArray, lines: Sequence[tuple[FloatArray, str, bool]]) -> str:
    """Draw values over time (s): each line's values, colour, and whether it is dots."""
    values = np.concatenate([line[0] for line in lines])
    low, high = float(values.min()), float(values.max())
    low, high = (low, high) if high - low > 1e-9 else (low - 1.0, high + 1.0)
    begin, end = float(time[0]), float(time[-1])
    x = EDGE + (time - begin) / (end - begin) * (WIDTH - EDGE - 8)
    parts = []
    for label, at in ((low, HEIGHT - 24.0), (high, 8.0)):
        parts.append(f'<line x1="{EDGE}" x2="{WIDTH - 8}" y1="{at}" y2="{at}" stroke="{RIM}" stroke-opacity=".4"/>')
        parts.append(f'<text x="{EDGE - 6}" y="{at + 4}" text-anchor="end">{label:.2f}</text>')
    parts.append(f'<text x="{EDGE}" y="{HEIGHT - 6}">{begin:.2f} s</text>')
    parts.append(f'<text x="{WIDTH - 8}" y="{HEIGHT - 6}" text-anchor="end">{end:.2f} s</text>')
    for line, colour, dots in lines:
        y = HEIGHT - 24.0 - (line - low) / (high - low) * (HEIGHT - 32.0)
        points = list(zip(x.tolist(), y.tolist(), strict=True))
        if dots:
            parts += [f'<circle cx="{px:.1f}" cy="{py:.1f}" r="1.6" fill="{colour}"/>' for px, py in points]
        else:
            text = " ".join(f"{px:.1f},{py:.1f}" for px, py in points)
            parts.append(f'<polyline points="{text}" fill="none" stroke="{colour}" stroke-width="1.4"/>')
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" '
        f'aria-label="{title}">{"".join(parts)}</svg>'
    )
