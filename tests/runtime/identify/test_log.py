"""Logs as people write them: what is read, and what is refused in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from runtime import InputError
from runtime.identify.log import log_of, read_log

ROWS = [(k * 1e-3, 0.1 * k, 0.0, 1e-3 * k if k % 10 == 0 else None) for k in range(400)]


def text(pan: tuple[str, str] = ("pan_ax", "pan_ay"), time: str = "t") -> str:
    lines = [f"{time},{pan[0]},{pan[1]},object_x,object_y"]
    lines += [f"{t},{x},{y},{'' if o is None else o},{'nan' if o is None else 0}" for t, x, y, o in ROWS]
    return "\n".join(lines)


def written(folder: Path, content: str) -> Path:
    path = folder / "log.csv"
    path.write_text(content, encoding="utf-8")
    return path


@pytest.mark.parametrize("time", ["t", "time"])
def test_accelerations_and_frames_are_read(tmp_path: Path, time: str) -> None:
    log = read_log(written(tmp_path, text(time=time)))
    assert len(log.time) == 40
    np.testing.assert_allclose(log.acceleration[:, 0], 0.1 * np.arange(399))
    np.testing.assert_allclose(log.position[:, 0], 1e-2 * np.arange(40))


@pytest.mark.parametrize("noise", [0.0, 1e-5])
@pytest.mark.parametrize("rate", [1000, 200])
def test_accelerations_are_found_from_positions(noise: float, rate: int) -> None:
    t = np.arange(0.0, 1.0, 1.0 / rate)
    rng = np.random.default_rng(0)
    pan = np.stack([0.05 * np.sin(8.0 * t), 0.02 * np.cos(6.0 * t)], axis=1) + rng.normal(0.0, noise, (len(t), 2))
    log = log_of(t, pan, np.zeros((len(t), 2)), are_positions=True)
    at = (np.arange(len(log.acceleration)) + 0.5) * 1e-3
    true = np.stack([-3.2 * np.sin(8.0 * at), -0.72 * np.cos(6.0 * at)], axis=1)
    np.testing.assert_allclose(np.cumsum(log.acceleration - true, axis=0)[40:-40] * 1e-3, 0.0, atol=0.02)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "missing column 't'"),
        ("t,pan_ax,pan_ay,object_x\n", "missing column 'object_y'"),
        ("t,object_x,object_y\n", "missing column 'pan_x'"),
        (text() + "\n0.4,1,one,,", "line 402, column 'pan_ay': 'one' is not a number"),
        (text() + "\n0.4,1,nan,,", "line 402, column 'pan_ay': nan must be between"),
        (text() + "\n0.4,1,1,2000,0", "line 402, column 'object_x': 2000 must be between -1000 and 1000"),
        (text() + "\n0.399,1,1,,", "row 400: the time 0.399 s does not come after 0.399 s"),
        (text() + "\ninf,1,1,,", "line 402, column 't': inf is not a finite number"),
        (text() + "\n0.5,1,1,,", "without a row at 0.399 s"),
        ("\n".join(text().splitlines()[:100]), "the log lasts 0.098 s"),
        ("t,pan_ax,pan_ay,object_x,object_y\n" + "\n".join(f"{k * 1e-3},0,0,," for k in range(400)), "seen in 0 rows"),
    ],
)
def test_log_that_cannot_be_used_is_refused_with_the_place(tmp_path: Path, content: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read_log(written(tmp_path, content))
    assert "log.csv" in str(caught.value)
