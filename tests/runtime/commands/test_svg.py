from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from runtime import Command, InputError, Reading
from runtime.commands.svg import parse_svg


def drawing(*elements: str, **attributes: str) -> str:
    given = " ".join(f'{name}="{value}"' for name, value in attributes.items())
    return f'<svg xmlns="http://www.w3.org/2000/svg" {given}>{"".join(elements)}</svg>'


def ends(data: str) -> list[list[float]]:
    """Return the first and last point of a path, y as in the drawing."""
    position = parse_svg(drawing(f'<path d="{data}"/>')).position * (1.0, -1.0)
    return np.round(position[[0, -1]], 9).tolist()


@pytest.mark.parametrize(
    ("data", "end"),
    [
        ("M1 2L3 4", [3, 4]),
        ("M1,2 3,4", [3, 4]),
        ("m1 2 3 4", [4, 6]),
        ("M1 2h3v-4", [4, -2]),
        ("M1 2H3V-4", [3, -4]),
        ("M0 0C0 1 1 1 1 0S2-1 2 0", [2, 0]),
        ("M0 0c0 1 1 1 1 0s1-1 1 0", [2, 0]),
        ("M0 0Q1 1 2 0T4 0", [4, 0]),
        ("M0 0q1 1 2 0t2 0", [4, 0]),
        ("M0 0A1 1 0 0 1 2 0", [2, 0]),
        ("M0 0a1 1 0 01.5.5", [0.5, 0.5]),
        ("M1 1L2 1L2 2Z", [1, 1]),
        ("M1 1h1v1zl5 5", [6, 6]),
        ("M1e1-2L.5.5", [0.5, 0.5]),
    ],
)
def test_each_command_of_a_path_is_understood(data: str, end: list[float]) -> None:
    assert ends(data)[1] == end


def test_curves_have_the_shape_they_say() -> None:
    def points(data: str) -> np.ndarray:
        return parse_svg(drawing(f'<path d="{data}"/>')).position * (1.0, -1.0)

    for flags, middle in (("0 1", 0.7071), ("1 1", 1.7071), ("0 0", 0.2929)):
        arc = points(f"M1 0A1 1 0 {flags} 0 1")
        np.testing.assert_allclose(arc[32], [middle, middle], atol=1e-4)
    half = points("M0 0A9 9 0 0 1 40 0")  # too small a radius grows until it fits
    np.testing.assert_allclose(np.hypot(*(half - (20, 0)).T), 20.0, atol=1e-9)
    turned = points("M-2 0A2 1 90 0 1 2 0")
    assert np.abs(turned[:, 1]).max() == pytest.approx(4.0, abs=1e-3)
    bow = points("M0 0Q1 2 2 0")
    np.testing.assert_allclose(bow[32], [1.0, 1.0])
    wave = points("M0 0C0 1 1 1 1 0S2-1 2 0")
    np.testing.assert_allclose(wave[64 + 32], [1.5, -0.75], atol=1e-9)


@pytest.mark.parametrize(
    ("transform", "expected"),
    [
        ("translate(2 3)", [3, 3]),
        ("translate(2)", [3, 0]),
        ("scale(2,3)", [2, 0]),
        ("rotate(90)", [0, 1]),
        ("rotate(90, 1, 1)", [2, 1]),
        ("matrix(0 1 -1 0 5 6)", [5, 7]),
        ("skewY(45)", [1, 1]),
        ("skewX(45)", [1, 0]),
        ("translate(1) scale(2)", [3, 0]),
    ],
)
def test_transforms_are_applied(transform: str, expected: list[float]) -> None:
    found = parse_svg(drawing(f'<g transform="{transform}"><path d="M9 9L1 0"/></g>')).position[-1] * (1, -1)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_shapes_are_lines_too_and_what_is_not_drawn_is_not_read() -> None:
    shapes = [
        '<polyline points="0,0 1,0 1,1"/>',
        '<polygon points="0 0 1 0 1 1"/>',
        '<line x1="1" y1="2" x2="3" y2="4"/>',
        '<rect x="1" y="2" width="3" height="4"/>',
        '<circle cx="1" cy="1" r="2"/>',
        '<ellipse cx="1" cy="1" rx="2" ry="1"/>',
    ]
    lengths = [len(parse_svg(drawing(shape)).position) for shape in shapes]
    assert lengths == [3, 4, 2, 5, 257, 257]
    assert len(parse_svg(drawing(*shapes, "<text>hello</text>", f"<defs>{shapes[0]}</defs>")).position) == sum(lengths)


def test_a_drawing_in_millimetres_knows_its_unit() -> None:
    line = '<line x1="0" y1="0" x2="100" y2="0"/>'
    assert parse_svg(drawing(line, width="80mm", viewBox="0 0 200 100")).unit == pytest.approx(0.0004)
    assert parse_svg(drawing(line, width="2in")).unit == pytest.approx(0.0254 / 96)
    assert parse_svg(drawing(line, width="80", viewBox="0 0 200 100")).unit is None


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("<svg", "not SVG"),
        ("<html></html>", "the outermost element is 'html'"),
        (drawing(), "has no path, polyline or shape"),
        (drawing('<path d="L1 1"/>'), "a path begins with M, got L"),
        (drawing('<path d="M1 1 nonsense"/>'), "not understood at 'nonsense'"),
        (drawing('<path d="M1"/>'), "not understood at ''"),
        (drawing('<path d="M1 1z 4"/>'), "not understood at '4'"),
        (drawing('<g transform="spin(3)"><path d="M1 1L2 2"/></g>'), r"the transform spin\(3\) is not understood"),
        ('<!DOCTYPE svg [<!ENTITY a "b">]>' + drawing(), "defines entities"),
    ],
)
def test_what_is_no_drawing_is_refused(content: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_svg(content)


def test_what_is_switched_off_is_not_drawn() -> None:
    line, far = '<path d="M0 0L3 4"/>', '<path d="M0 0L900 900"/>'
    for attribute in ('style="fill:none; display : none"', 'display="none"', 'visibility="hidden"'):
        assert parse_svg(drawing(f"<g {attribute}>{far}</g>", line)).position.max() == 3.0
    shown = parse_svg(drawing(f'<g style="display:inline">{line}</g>'))
    assert shown.position.max() == 3.0


def test_a_drawing_is_fitted_into_width_and_height() -> None:
    line = '<path d="M0 0L3 4"/>'
    assert parse_svg(drawing(line, width="200mm", height="100mm", viewBox="0 0 200 200")).unit == 0.5e-3
    assert parse_svg(drawing(line, width="200mm", viewBox="0 0 200 200")).unit == 1e-3


@pytest.mark.parametrize(
    ("element", "message"),
    [
        ('<use href="#a"/>', "an element <use>, which is not read"),
        ('<svg viewBox="0 0 1 1"><path d="M0 0L3 4"/></svg>', "an element <svg>, which is not read"),
        ('<path d="M0 0L1e999 1"/>', "a coordinate beyond 1e\\+09 in an element <path>"),
    ],
)
def test_what_would_be_drawn_wrongly_is_refused(element: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_svg(drawing(element))


def test_letters_of_other_encodings_are_read(tmp_path: Path) -> None:
    head = '<?xml version="1.0" encoding="ISO-8859-1"?>'
    (tmp_path / "a.svg").write_bytes((head + drawing("<title>é</title>", '<path d="M0 0L3 4"/>')).encode("latin-1"))
    assert Command.load(tmp_path / "a.svg", Reading(speed=0.3, size=0.1)).reach == pytest.approx(0.1, abs=1e-3)
