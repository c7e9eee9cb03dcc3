"""A plan at a glance: one line of text, or what a notebook shows, with two small pictures."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from runtime.outputs.picture import MM, object_picture, pan_picture

GOOD, MIXED, BAD = "#00705a", "#7d5300", "#b3261e"

COLOURS = {"ok": GOOD, "governed": GOOD, "limited": MIXED, "beyond_training_range": MIXED}
"""Of the statuses; the others are bad."""

CELL = "text-align:left;padding:1px 14px 1px 0;border:0;background:none"


def summary(document: Mapping[str, Any]) -> str:
    """Return one line: the plan's length, status, figures and model."""
    quality = document["quality"]
    return (
        f"Plan of {_duration(document)} by {document['model']['name']}: {_words(quality['status'])}, "
        f"RMSE {quality['tracking_rmse'] * MM:.2f} mm, pan reach {_of_limit(quality, 'pan_reach', 'pan_reach', MM)} mm"
    )


def to_html(document: Mapping[str, Any]) -> str:
    """Return a piece of HTML that needs nothing else: status, figures, notes, and the pictures as SVG."""
    quality, friction = document["quality"], document["friction"]
    status, off = quality["status"], quality.get("friction_off_rmse")
    rows = [
        ("length", _duration(document)),
        ("tracking RMSE", f"{quality['tracking_rmse'] * MM:.2f} mm"),
        ("tracking maximum", f"{quality['tracking_max'] * MM:.2f} mm"),
        *([] if off is None else [("RMSE if friction is 10 % off", f"{off * MM:.2f} mm")]),
        ("pan reach", f"{_of_limit(quality, 'pan_reach', 'pan_reach', MM)} mm"),
        *([("pan height", f"{_of_limit(quality, 'height_max', 'height', MM)} mm")] if quality["height_max"] else []),
        *([("pan speed", _speed(quality))] if quality["height_max"] or quality["limits"]["speed"] is not None else []),
        ("pan acceleration", f"{_of_limit(quality, 'acceleration_max', 'acceleration')} m/s²"),
        ("pan jerk", f"{_of_limit(quality, 'jerk_max', 'jerk')} m/s³"),
        ("time sliding", f"{quality['sliding_share']:.0%}"),
        ("friction, static/kinetic", f"{friction['static']:g}/{friction['kinetic']:g}"),
        ("model", document["model"]["name"]),
    ]
    table = "".join(
        f'<tr style="background:none"><th style="{CELL};font-weight:normal;opacity:.75">{escape(name)}</th>'
        f'<td style="{CELL}">{escape(value)}</td></tr>'
        for name, value in rows
    )
    notes = "".join(f'<div style="max-width:60ch;margin-top:6px">{escape(note)}</div>' for note in quality["notes"])
    chip = (
        f'<span style="background:{COLOURS.get(status, BAD)};color:#fff;border-radius:99px;padding:2px 12px">'
        f"{escape(_words(status))}</span>"
    )
    return (
        '<div style="display:flex;flex-wrap:wrap;gap:8px 20px;align-items:center;font-size:13px;line-height:1.5">'
        f"<div>{object_picture(document)}{_caption('object on the pan')}</div>"
        f"<div>{pan_picture(document)}{_caption('pan in the world')}</div>"
        f'<div style="flex:1 1 320px">{chip}<table style="border:0;margin:8px 0 0;border-collapse:collapse;'
        f'font-size:inherit;color:inherit">{table}</table>{notes}</div></div>'
    )


def _caption(text: str) -> str:
    return f'<div style="text-align:center;opacity:.75">{text}</div>'


def _words(status: str) -> str:
    return status.replace("_", " ")


def _duration(document: Mapping[str, Any]) -> str:
    samples = len(document["command"]["position"])
    return f"{samples * document['dt']:g} s ({samples} samples)"


def _speed(quality: Mapping[str, Any]) -> str:
    """Return the pan's largest speed, and its limit if there is one."""
    bound, value = quality["limits"]["speed"], f"{quality['speed_max']:.2f}"
    return f"{value} m/s" if bound is None else f"{value} of {bound:g} m/s"


def _of_limit(quality: Mapping[str, Any], figure: str, limit: str, scale: float = 1.0) -> str:
    """Return a figure, and the limit it keeps to if there is one."""
    bound = quality["limits"][limit]
    value = f"{quality[figure] * scale:,.1f}"
    return value if bound is None else f"{value} of {bound * scale:,.6g}"
