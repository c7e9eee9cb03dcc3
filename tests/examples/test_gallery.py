"""The gallery: every command is planned well, plays, and can be made again."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree

import pytest

from runtime import Command, Planner


@pytest.fixture(scope="module")
def gallery() -> ModuleType:
    path = Path(__file__).parents[2] / "examples" / "gallery.py"
    spec = importlib.util.spec_from_file_location("slide_gallery", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("gallery")


@pytest.fixture(scope="module")
def made(gallery: ModuleType, folder: Path) -> list[Any]:
    found: list[Any] = gallery.make_gallery(folder)
    return found


def test_every_plan_follows_its_command_and_leaves_the_object_at_its_end(made: list[Any]) -> None:
    assert len(made) == 12
    for each in made:
        quality = each.plan.quality
        assert quality.status in ("ok", "governed"), each.entry.name
        assert quality.tracking_rmse < 4e-3, each.entry.name
        assert quality.rest_error is not None
        assert quality.rest_error < 5e-3, each.entry.name


def test_command_file_makes_the_plan_again(made: list[Any], folder: Path) -> None:
    entry, plan = made[0].entry, made[0].plan
    again = Planner().plan(Command.load(folder / f"{entry.name}.csv"))
    assert (again.pan_acceleration == plan.pan_acceleration).all()
    for each in made:
        card = each.card("gallery")
        assert f"slide-plan {each.entry.name}.csv -o {each.entry.name}.json" in card
        for file in (f"{each.entry.name}.csv", f"{each.entry.name}.html"):
            assert f'href="gallery/{file}"' in card
            assert (folder / file).exists()


def test_picture_plays_the_pan_and_the_object(gallery: ModuleType, made: list[Any]) -> None:
    for each in made:
        picture = gallery.moving_picture(each.plan)
        assert len(picture) < 20_000
        moving = [part for part in ElementTree.fromstring(picture).iter() if part.tag.endswith("animateTransform")]
        assert len(moving) == 2
        assert len({part.get("values", "").count(";") for part in moving}) == 1
        assert len({part.get("dur") for part in moving}) == 1
