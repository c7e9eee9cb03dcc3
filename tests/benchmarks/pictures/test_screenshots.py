"""The documentation's pictures: they are taken of what is there, and a machine without a browser says so."""

from __future__ import annotations

import os
import shutil
import struct
import sys

import pytest

from benchmarks.pictures import screenshots
from benchmarks.pictures.browser import chromium
from runtime.cli.console import run


def call(folder, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["screenshots", str(folder)])
    with pytest.raises(SystemExit) as caught:
        run(screenshots.NAME, screenshots.screenshots)
    return caught.value.code


@pytest.mark.skipif(not (chromium() or os.environ.get("CI")), reason="no Chromium")
def test_pictures_are_as_wide_as_the_windows(tmp_path, monkeypatch):
    assert not call(tmp_path, monkeypatch)
    sizes = {path.stem: struct.unpack(">II", path.read_bytes()[16:24]) for path in tmp_path.iterdir()}
    wide = ("page-wide", "page-dark", "page-arm", "page-loop", "page-off-pan", "report")
    widths = dict.fromkeys(wide, 1280) | {"page-narrow": 360}
    assert {name: width for name, (width, _) in sizes.items()} == widths
    assert all(height >= 900 for _, height in sizes.values())


def test_without_a_browser_it_says_what_to_do(tmp_path, monkeypatch, capsys):
    monkeypatch.delenv("SLIDE_CHROMIUM", raising=False)
    monkeypatch.setattr(shutil, "which", lambda name: None)
    assert call(tmp_path, monkeypatch) == 2
    assert "no Chromium here: install it" in capsys.readouterr().err
