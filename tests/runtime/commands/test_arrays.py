"""Arrays and tables of other libraries."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from runtime import Command, InputError, Planner, Reading

T = np.arange(41) * 0.025
POSITION = 0.02 * np.stack([1 - np.cos(6 * T), np.sin(6 * T)], axis=1)


def test_masked_values_are_missing_and_refused_by_row() -> None:
    masked = np.ma.masked_array(POSITION, mask=False)
    assert np.array_equal(Command.from_samples(masked).position, POSITION)
    masked[7, 1] = np.ma.masked
    for build in (Command, Command.from_samples, lambda position: Command.from_waypoints(T, position)):
        with pytest.raises(InputError, match=r"position\[7\] is masked: a value is missing there"):
            build(masked)
    with pytest.raises(InputError, match=r"t\[3\] is masked"):
        Command.from_waypoints(np.ma.masked_equal(T, T[3]), POSITION)


def test_torch_tensors_are_arrays_also_with_gradients(planner: Planner) -> None:
    torch = pytest.importorskip("torch")
    tensor = torch.tensor(POSITION, requires_grad=True)
    assert np.array_equal(Command.from_samples(tensor).position, POSITION)
    assert np.array_equal(Command(tensor).position, POSITION)
    expected = Command.from_waypoints(T, POSITION).position
    assert np.array_equal(Command.from_waypoints(torch.tensor(T), tensor).position, expected)
    assert np.array_equal(planner.plan(tensor).command_position, POSITION)


def test_pandas_is_read_by_names_and_by_its_index() -> None:
    pandas = pytest.importorskip("pandas")
    expected = Command.from_waypoints(T, POSITION).position
    frame = pandas.DataFrame({"stamp": T, "pos_x": POSITION[:, 0], "pos_y": POSITION[:, 1], "label": "a"})
    dates = pandas.Timestamp("2024-03-01") + pandas.to_timedelta(T, unit="s")
    tables: list[Any] = [
        frame,
        frame.set_index("stamp"),
        frame.assign(stamp=dates),
        frame.set_index(dates).drop(columns="stamp"),
    ]
    for table in tables:
        np.testing.assert_allclose(Command.from_samples(table).position, expected, atol=1e-9)
    series = frame["stamp"], frame[["pos_x", "pos_y"]].to_numpy()
    assert np.array_equal(Command.from_waypoints(*series).position, expected)
    assert np.array_equal(Command.from_waypoints(pandas.Index(T), POSITION).position, expected)
    assert np.array_equal(Command.from_samples(pandas.DataFrame(POSITION)).position, POSITION)
    gap = frame.assign(pos_x=frame["pos_x"].where(frame["stamp"] != T[5]))
    with pytest.raises(InputError, match=r"pos_x\[5\]: nan is not a finite number"):
        Command.from_samples(gap)


def test_dates_of_numpy_are_times() -> None:
    t = np.datetime64("2024-03-01T10:00") + (T * 1e6).round().astype("timedelta64[us]")
    np.testing.assert_allclose(
        Command.from_waypoints(t, POSITION).position, Command.from_waypoints(T, POSITION).position, atol=1e-9
    )
    t[4] = np.datetime64("NaT")
    with pytest.raises(InputError, match=r"t\[4\] is missing"):
        Command.from_waypoints(t, POSITION)


def test_options_mean_the_same_for_arrays() -> None:
    expected = Command.from_waypoints(T, POSITION).position
    millimetres = Reading(scale=0.001, time_scale=0.001)
    np.testing.assert_allclose(
        Command.from_waypoints(T * 1e3, POSITION * 1e3, millimetres).position, expected, atol=1e-9
    )
    np.testing.assert_allclose(Command.from_samples(POSITION, reading=Reading(rate=40)).position, expected, atol=1e-12)
    shifted = Command.from_samples(POSITION + 0.5, 0.025, Reading(origin=(0.5, 0.5)))
    np.testing.assert_allclose(shifted.position, expected, atol=1e-12)
    table = np.column_stack([POSITION, T])
    np.testing.assert_allclose(Command.from_samples(table, reading=Reading(columns="x,y,t")).position, expected)
