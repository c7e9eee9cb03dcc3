"""The lines of an SVG drawing, as points: paths, polylines and shapes, with their transforms.

What is read is the geometry of SVG 1.1: https://www.w3.org/TR/SVG11/paths.html. Styles, text and images are passed by.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np

from runtime.commands.points import Points
from runtime.documents.checks import FloatArray
from runtime.errors import InputError

PIECES = 64
"""Straight pieces that a curve is drawn with."""

MAX_POINTS = 1_000_000
"""Most points of a drawing."""

FARTHEST = 1e9
"""Largest coordinate of a drawing, in its own units."""

LENGTHS = {"mm": 1e-3, "cm": 1e-2, "in": 0.0254, "pt": 0.0254 / 72, "pc": 0.0254 / 6}
"""Units in metres that the width of a drawing may have. A pixel is no length."""

ARGUMENTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
"""Numbers that each command of a path takes."""

NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
FLAG = re.compile("[01]")
HIDDEN = {"defs", "clipPath", "mask", "symbol", "marker", "pattern", "metadata"}
"""Elements whose shapes are not drawn."""


def parse_svg(content: str) -> Points:
    """Read all lines of a drawing, one after the other.

    Raises:
        InputError: it is no SVG, holds no line, or a path or transform is not understood.
    """
    if "<!ENTITY" in content:
        raise InputError("the SVG defines entities, which are not read")
    try:
        root = ElementTree.fromstring(content)
    except ElementTree.ParseError as error:
        raise InputError(f"not SVG: {error}") from error
    if _name(root) != "svg":
        raise InputError(f"not SVG: the outermost element is {_name(root)!r}")
    lines = [line for line in _drawn(root, np.eye(3)) if len(line)]
    if not lines:
        raise InputError("the SVG has no path, polyline or shape")
    points = np.concatenate(lines)
    if len(points) > MAX_POINTS:
        raise InputError(f"the SVG has {len(points)} points, at most {MAX_POINTS} are taken")
    unit = _unit(root)
    found = f"took {len(lines)} lines of the drawing, joined by straight ones" if len(lines) > 1 else ""
    return Points(points * (1.0, -1.0), unit=unit, drawing=True, found=(found,) if found else ())


def _name(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def _unit(root: ElementTree.Element) -> float | None:
    """Return metres a unit of the drawing, if its width says it."""
    width, height = (_length(root.get(name, "")) for name in ("width", "height"))
    if width is None:
        return None
    box = [float(number) for number in NUMBER.findall(root.get("viewBox", ""))]
    if len(box) == 4 and box[2] > 0.0 and box[3] > 0.0 and width > 0.0:
        return min(width / box[2], height / box[3]) if height else width / box[2]  # the drawing is fitted in
    return LENGTHS["in"] / 96.0  # without a viewBox, units are CSS pixels, 96 an inch


def _length(value: str) -> float | None:
    """Return a length in metres, None if it has no unit of length."""
    match = re.fullmatch(rf"\s*({NUMBER.pattern})\s*({'|'.join(LENGTHS)})\s*", value)
    return float(match[1]) * LENGTHS[match[2]] if match else None


def _is_hidden(element: ElementTree.Element) -> bool:
    """Return whether an element is not drawn, and nothing in it: an Inkscape layer that is switched off, for one."""
    style = dict(re.findall(r"([\w-]+)\s*:\s*([\w-]+)", element.get("style", "")))
    said = {name: style.get(name, element.get(name)) for name in ("display", "visibility")}
    return _name(element) in HIDDEN or said["display"] == "none" or said["visibility"] in ("hidden", "collapse")


def _drawn(element: ElementTree.Element, outer: FloatArray) -> Iterator[FloatArray]:
    """Yield the lines of an element and of what is in it, (n, 2) in the units of the drawing."""
    root, pending = element, [(element, outer)]
    while pending:
        element, outer = pending.pop()
        name = _name(element)
        if _is_hidden(element):
            continue
        if name == "use" or (name == "svg" and element is not root):
            raise InputError(f"the SVG has an element <{name}>, which is not read: unlink clones and ungroup first")
        matrix = outer @ _transform(element.get("transform", ""))
        for line in _lines(element, name):
            if not (np.abs(line) <= FARTHEST).all():
                raise InputError(f"the SVG has a coordinate beyond {FARTHEST:g} in an element <{name}>")
            yield line @ matrix[:2, :2].T + matrix[:2, 2]
        pending += [(child, matrix) for child in reversed(element)]


def _lines(element: ElementTree.Element, name: str) -> list[FloatArray]:
    if name == "path":
        return _path(element.get("d", ""))
    if name in ("polyline", "polygon"):
        numbers = _numbers(element.get("points", ""))
        points = np.array(numbers[: len(numbers) // 2 * 2]).reshape(-1, 2)
        return [np.concatenate([points, points[:1]]) if name == "polygon" else points]
    if name not in ("line", "rect", "circle", "ellipse"):
        return []

    def length(attribute: str) -> float:
        numbers = _numbers(element.get(attribute, "0"))
        return numbers[0] if numbers else 0.0

    if name == "line":
        return [np.array([[length("x1"), length("y1")], [length("x2"), length("y2")]])]
    if name == "rect":
        x, y, width, height = (length(attribute) for attribute in ("x", "y", "width", "height"))
        corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]])
        return [corners * (width, height) + (x, y)]
    radii = (length("r"), length("r")) if name == "circle" else (length("rx"), length("ry"))
    angle = np.linspace(0.0, 2.0 * np.pi, 4 * PIECES + 1)
    return [np.stack([np.cos(angle), np.sin(angle)], axis=1) * radii + (length("cx"), length("cy"))]


def _numbers(value: str) -> list[float]:
    return [float(number) for number in NUMBER.findall(value)]


def _transform(value: str) -> FloatArray:
    """Return the matrix (3, 3) of a transform attribute.

    Raises:
        InputError: a function is unknown or has another number of arguments.
    """
    matrix = np.eye(3)
    for name, arguments in re.findall(r"(\w+)\s*\(([^)]*)\)", value):
        numbers = _numbers(arguments)
        step = _one_transform(name, numbers)
        if step is None:
            raise InputError(f"the transform {name}({arguments.strip()[:40]}) is not understood")
        matrix = matrix @ step
    return matrix


def _one_transform(name: str, numbers: list[float]) -> FloatArray | None:
    match name, numbers:
        case "matrix", [a, b, c, d, e, f]:
            return np.array([[a, c, e], [b, d, f], [0.0, 0.0, 1.0]])
        case "translate", [x, *y] if len(y) < 2:
            return np.array([[1.0, 0.0, x], [0.0, 1.0, y[0] if y else 0.0], [0.0, 0.0, 1.0]])
        case "scale", [x, *y] if len(y) < 2:
            return np.diag([x, y[0] if y else x, 1.0])
        case "rotate", [angle]:
            cosine, sine = math.cos(math.radians(angle)), math.sin(math.radians(angle))
            return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        case "rotate", [angle, x, y]:
            there, turn = _one_transform("translate", [x, y]), _one_transform("rotate", [angle])
            back = _one_transform("translate", [-x, -y])
            return None if there is None or turn is None or back is None else there @ turn @ back
        case "skewX", [angle]:
            return np.array([[1.0, math.tan(math.radians(angle)), 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        case "skewY", [angle]:
            return np.array([[1.0, 0.0, 0.0], [math.tan(math.radians(angle)), 1.0, 0.0], [0.0, 0.0, 1.0]])
    return None


def _path(data: str) -> list[FloatArray]:
    """Return the lines of a path's data, each (n, 2), curves drawn with PIECES straight ones.

    Raises:
        InputError: the data are not understood; the character is named.
    """
    lines: list[list[complex]] = []
    here = start = handle = 0j  # handle: the last control point, which S and T mirror
    before = ""
    for command, numbers in _path_commands(data):
        upper, offset = command.upper(), 0j if command.isupper() else here
        at = [offset + complex(*pair) for pair in zip(numbers[::2], numbers[1::2], strict=False)]
        if upper == "M":
            here = start = at[0]
            lines.append([here])
        elif not lines:
            raise InputError(f"a path begins with M, got {command}")
        elif upper == "Z":
            here = start
            lines[-1].append(here)
        else:
            if before == "Z":  # a new line begins where the one before was closed
                lines.append([here])
            mirrored = 2.0 * here - handle
            match upper:
                case "L":
                    curve = [at[0]]
                case "H":
                    curve = [complex(numbers[0] + offset.real, here.imag)]
                case "V":
                    curve = [complex(here.real, numbers[0] + offset.imag)]
                case "C":
                    handle, curve = at[1], _bezier([here, *at])
                case "S":
                    handle, curve = at[0], _bezier([here, mirrored if before in "CS" and before else here, *at])
                case "Q":
                    handle, curve = at[0], _bezier([here, *at])
                case "T":
                    handle = mirrored if before in "QT" and before else here
                    curve = _bezier([here, handle, at[0]])
                case _:
                    curve = _arc(here, numbers, offset + complex(*numbers[5:]))
            lines[-1] += curve
            here = curve[-1]
        before = upper
        if len(lines) > MAX_POINTS or len(lines[-1]) > MAX_POINTS:
            raise InputError(f"a path has more than {MAX_POINTS} points")
    return [np.stack([np.real(line), np.imag(line)], axis=1) for line in lines if len(line) > 1]


def _path_commands(data: str) -> Iterator[tuple[str, list[float]]]:
    """Yield each command of a path with its numbers; one that is left out is the one before, M being L."""
    place, command = 0, ""
    blank = re.compile(r"[\s,]*")
    while (place := blank.match(data, place).end()) < len(data):  # type: ignore[union-attr]
        if data[place].upper() in ARGUMENTS:
            command = data[place]
            place += 1
        elif command in ("", "Z", "z"):
            raise InputError(f"the path is not understood at {data[place : place + 10]!r}")
        elif command in "Mm":
            command = "L" if command == "M" else "l"
        numbers: list[float] = []
        while len(numbers) < ARGUMENTS[command.upper()]:
            place = blank.match(data, place).end()  # type: ignore[union-attr]
            flag = command in "Aa" and len(numbers) in (3, 4)  # may stand without a space: a1 1 0 01.5.5
            match = (FLAG if flag else NUMBER).match(data, place)
            if match is None:
                raise InputError(f"the path is not understood at {data[place : place + 10]!r}")
            numbers.append(float(match[0]))
            place = match.end()
        yield command, numbers


def _bezier(points: list[complex]) -> list[complex]:
    """Return a curve's points without the first, by de Casteljau's construction."""
    share = np.linspace(0.0, 1.0, PIECES + 1)[1:]
    curve = [np.full(PIECES, point) for point in points]
    while len(curve) > 1:
        curve = [a + share * (b - a) for a, b in pairwise(curve)]
    result: list[complex] = curve[0].tolist()
    return result


def _arc(begin: complex, numbers: list[float], end: complex) -> list[complex]:
    """Return an elliptic arc's points without the first (SVG 1.1, appendix F.6.5)."""
    rx, ry, degrees, large, sweep = abs(numbers[0]), abs(numbers[1]), *numbers[2:5]
    if rx == 0.0 or ry == 0.0 or begin == end:
        return [end]
    turn = complex(math.cos(math.radians(degrees)), math.sin(math.radians(degrees)))
    half = (begin - end) / 2.0 / turn
    grown = math.sqrt(max(1.0, (half.real / rx) ** 2 + (half.imag / ry) ** 2))
    rx, ry = rx * grown, ry * grown
    x, y = half.real / rx, half.imag / ry  # half the chord, on the unit circle
    if x * x + y * y == 0.0:  # the ellipse is so large that the arc is straight
        return [end]
    away = math.sqrt(max(0.0, 1.0 / (x * x + y * y) - 1.0)) * (1.0 if large == sweep else -1.0)
    centre = away * complex(-y, x)
    first, last = complex(x, y) - centre, complex(-x, -y) - centre
    angle = math.atan2((last / first).imag, (last / first).real)
    if sweep and angle < 0.0:
        angle += 2.0 * math.pi
    elif not sweep and angle > 0.0:
        angle -= 2.0 * math.pi
    around = centre + first * np.exp(1j * angle * np.linspace(0.0, 1.0, PIECES + 1)[1:])
    curve = (begin + end) / 2.0 + turn * (rx * around.real + 1j * ry * around.imag)
    return [*curve[:-1].tolist(), end]
