"""What a plan comes out as: the same numbers in every format, pictures, one line."""

from __future__ import annotations

import csv
import io
import json
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime import FormatError, MissingExtraError, OutputError, Plan, Planner
from runtime.outputs.columns import columns
from runtime.physics.law import slide_one

NAMES = ["t", "command_x", "command_y", "object_x", "object_y", "object_vx", "object_vy"]
NAMES += ["pan_x", "pan_y", "pan_z", "pan_vx", "pan_vy", "pan_vz", "pan_ax", "pan_ay", "pan_az", "stop"]


def assert_rows(column: Callable[[str], Any], plan: Plan) -> None:
    """Compare the rows of a table before the stop with the plan's arrays, to the last bit."""
    samples = len(plan)
    parts = {
        "command_": plan.command_position,
        "object_": plan.object_position,
        "object_v": plan.object_velocity,
        "pan_": plan.pan_position,
        "pan_v": plan.pan_velocity,
        "pan_a": plan.pan_acceleration,
    }
    for name, values in parts.items():
        for i in range(values.shape[1]):
            assert np.array_equal(np.asarray(column(name + "xyz"[i]), dtype=float)[:samples], values[:, i]), name
    assert not np.any(np.asarray(column("stop"), dtype=float)[:samples])
    assert np.asarray(column("t"), dtype=float)[:samples].tolist() == [k / 1000 for k in range(samples)]


def test_csv_has_every_number_of_the_plan(plan: Plan, tmp_path: Path) -> None:
    text = plan.to_csv()
    rows = list(csv.DictReader(io.StringIO(text)))
    assert list(rows[0]) == NAMES
    assert_rows(lambda name: [row[name] for row in rows], plan)
    plan.save(tmp_path / "plan.csv")
    assert plan.to_csv(tmp_path / "table.txt") == text
    assert (tmp_path / "plan.csv").read_text() == (tmp_path / "table.txt").read_text() == text
    table = np.loadtxt(tmp_path / "plan.csv", delimiter=",", skiprows=1)
    assert np.isfinite(table).all()


def test_table_goes_on_with_the_stop_until_the_pan_rests(plan: Plan) -> None:
    dt, samples = plan.dt, 40
    leaving = plan.pan_velocity[-1] + dt * plan.pan_acceleration[-1]
    stop = np.tile(-leaving / (samples * dt), (samples, 1))
    table = columns(plan.document() | {"stop": {"acceleration": stop}})
    assert_rows(table.__getitem__, plan)
    after = {name: values[len(plan) :] for name, values in table.items()}
    assert after["stop"].all()
    assert after["t"].tolist() == [(len(plan) + k) / 1000 for k in range(samples + 1)]
    assert np.array_equal(np.stack([after["pan_ax"], after["pan_ay"], after["pan_az"]], axis=1)[:-1], stop)
    velocity = np.stack([after["pan_vx"], after["pan_vy"], after["pan_vz"]], axis=1)
    position = np.stack([after["pan_x"], after["pan_y"], after["pan_z"]], axis=1)
    assert np.allclose(velocity[0], leaving, atol=1e-15)
    assert np.allclose(velocity[-1], 0.0, atol=1e-12)
    assert np.allclose(np.diff(position, axis=0), dt * (velocity[:-1] + velocity[1:]) / 2, atol=1e-15)
    assert (after["pan_ax"][-1], after["pan_ay"][-1], after["pan_az"][-1]) == (0.0, 0.0, 0.0)
    assert set(after["command_x"]) == {plan.command_position[-1, 0]}
    acceleration = np.concatenate([plan.pan_acceleration, stop])
    start = np.concatenate([plan.object_position[0], plan.object_velocity[0]])
    slid = slide_one(start, acceleration, plan.friction)[len(plan) - 1 :]
    for i, name in enumerate(("object_x", "object_y", "object_vx", "object_vy")):
        assert np.array_equal(after[name], slid[:, i])


def test_dataframe_has_every_number_of_the_plan(plan: Plan) -> None:
    pytest.importorskip("pandas")
    frame = plan.to_dataframe()
    assert frame.index.name == "t"
    assert list(frame.columns) == NAMES[1:]
    assert_rows(lambda name: frame.reset_index()[name], plan)


def test_parquet_has_every_number_of_the_plan_and_the_rest_beside_them(plan: Plan, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    plan.save(tmp_path / "plan.parquet")
    table = parquet.read_table(tmp_path / "plan.parquet")
    assert_rows(lambda name: table[name].to_numpy(), plan)
    rest = json.loads(table.schema.metadata[b"slide-plan"])
    assert rest["quality"] == plan.quality.to_dict()
    assert rest["friction"] == plan.friction.to_dict()
    assert rest["model"] == {"name": plan.model_name, "sha256": plan.model_sha256}


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_table_is_not_read_as_a_plan_and_says_what_is(suffix: str, plan: Plan, tmp_path: Path) -> None:
    path = tmp_path / f"plan{suffix}"
    path.write_text(plan.to_csv())
    with pytest.raises(FormatError, match=r"a plan is read from .json or .npz; "):
        Plan.load(path)


@pytest.mark.parametrize(
    ("package", "make"),
    [
        ("pandas", lambda plan, folder: plan.to_dataframe()),
        ("matplotlib", lambda plan, folder: plan.plot()),
        ("pyarrow", lambda plan, folder: plan.save(folder / "plan.parquet")),
    ],
)
def test_what_needs_a_package_says_what_to_install(
    package: str, make: Callable[[Plan, Path], Any], plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [Absent(package), *sys.meta_path])
    with pytest.raises(MissingExtraError, match=rf"{package}.* is not installed: pip install './\[\w+\]'"):
        make(plan, tmp_path)
    assert list(tmp_path.iterdir()) == []


class Absent:
    """A finder to which a package is not installed."""

    def __init__(self, package: str) -> None:
        self.package = package

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> None:
        if name.partition(".")[0] == self.package:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


@pytest.mark.parametrize("name", ["plan.yaml", "plan", "plan.csv.gz"])
def test_another_suffix_writes_nothing(name: str, plan: Plan, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"written as .json, .npz, .csv or .parquet, got the suffix"):
        plan.save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_figure_shows_both_paths_the_rim_and_the_limits(plan: Plan) -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("agg")
    figure = plan.plot()
    try:
        on_pan, in_world, *over_time = figure.axes
        drawn = {line.get_label(): line.get_xydata() for line in (*on_pan.lines, *in_world.lines)}
        assert np.allclose(drawn["object"], plan.object_position * 1e3)
        assert np.allclose(drawn["command"], plan.command_position * 1e3)
        assert np.allclose(np.hypot(*drawn["rim"].T), 180.0)
        assert np.allclose(drawn["pan"][: len(plan)], plan.pan_position[:, :2] * 1e3)
        limit = plan.quality.limits["acceleration"]
        assert limit is None or any(np.all(np.asarray(line.get_ydata()) == limit) for line in over_time[-1].lines)
        assert plan.quality.status.replace("_", " ") in figure.get_suptitle()
        figure.savefig(io.BytesIO())
    finally:
        pyplot.close(figure)


def test_height_and_speed_are_shown_of_a_pan_that_lifts(plan: Plan) -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("agg")
    lifted = plan.pan_position + [0.0, 0.0, 0.02] * np.sin(np.linspace(0.0, np.pi, len(plan)))[:, None]
    limits = {**plan.quality.limits, "height": 0.1, "speed": 1.7}
    lifting = replace(plan, pan_position=lifted, quality=replace(plan.quality, height_max=0.02, limits=limits))
    for each, shown in ((plan, False), (lifting, True)):
        figure = each.plot()
        assert (figure.axes[-1].get_title(loc="left") == "pan height (mm)") is shown
        pyplot.close(figure)
        assert ("pan height" in each._repr_html_()) is shown
        assert ("of 1.7 m/s" in each._repr_html_()) is shown


def test_notebook_is_shown_pictures_and_figures_that_need_nothing_else(plan: Plan) -> None:
    shown = plan._repr_html_()
    assert len(shown) < 20_000
    page = ET.fromstring(shown)  # whole, and every tag closed
    pictures = list(page.iter("{http://www.w3.org/2000/svg}svg"))
    assert len(pictures) == 2
    for picture in pictures:
        left, top, width, height = map(float, picture.attrib["viewBox"].split())
        for line in picture.iter("{http://www.w3.org/2000/svg}polyline"):
            points = np.array([point.split(",") for point in line.attrib["points"].split()], dtype=float)
            assert np.all((points >= (left, top)) & (points <= (left + width, top + height)))
    assert f"{plan.quality.tracking_rmse * 1e3:.2f} mm" in shown
    assert plan.quality.status.replace("_", " ") in shown
    for word in ("script", "http://", "https://", "url("):
        assert word not in shown.replace("http://www.w3.org/2000/svg", "")


def test_notebook_is_shown_names_as_text(plan: Plan) -> None:
    shown = replace(plan, model_name="<script>alert(1)</script>")._repr_html_()
    assert "<script>" not in shown
    assert "&lt;script&gt;" in shown


def test_repr_is_one_line_that_says_how_good_the_plan_is(plan: Plan) -> None:
    text = repr(plan)
    assert len(text) < 120
    assert "\n" not in text
    for words in ("250 samples", plan.quality.status.replace("_", " "), "tiny"):
        assert words in text


def test_plans_as_short_as_they_come_and_without_limits_are_drawn(planner: Planner) -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("agg")
    short = planner.plan(np.zeros((2, 2)))
    free = replace(short, quality=replace(short.quality, limits=dict.fromkeys(short.quality.limits)))
    for plan in (short, free):
        pyplot.close(plan.plot())
        ET.fromstring(plan._repr_html_())
        assert "2 samples" in repr(plan)
        assert plan.to_csv().count("\n") >= 3
