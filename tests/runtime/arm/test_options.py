"""What is refused before anything moves; none of it needs a simulator."""

from __future__ import annotations

import ctypes.util
import sys
from pathlib import Path

import pytest

from runtime import InputError
from runtime.arm.events import Event
from runtime.arm.simulated import Simulated

from .conftest import SlideRun


@pytest.mark.parametrize(
    ("text", "kind", "time", "values"),
    [("push@0.5=1,-2", "push", 0.5, (1.0, -2.0)), ("friction@0=0.3", "friction", 0.0, (0.3,))],
)
def test_events_are_read(text: str, kind: str, time: float, values: tuple[float, ...]) -> None:
    assert Event.parse(text) == Event(kind, time, values)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("push", "must be push@SECONDS=FX,FY"),
        ("push@0.5=1", "must be push@SECONDS=FX,FY"),
        ("kick@0.5=1,2", "must be push@SECONDS=FX,FY"),
        ("friction@soon=1", "must be push@SECONDS=FX,FY"),
        ("push@-1=1,2", "the time must be 0 s or later"),
        ("push@nan=1,2", "the time must be 0 s or later"),
        ("push@1=nan,2", "the force must be at most 100 N"),
        ("push@1=1000,0", "the force must be at most 100 N"),
        ("friction@1=11", "friction must be between 0 and 10"),
    ],
)
def test_events_that_are_none_are_refused(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Event.parse(text)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"friction": -0.1}, "friction must be between 0 and 10, got -0.1"),
        ({"friction": float("nan")}, "friction must be between 0 and 10, got nan"),
        ({"object_mass": 0.0}, "object mass must be between 0.001 and 10 kg, got 0"),
        ({"noise": 1.0}, "noise must be between 0 and 0.1 m, got 1"),
        ({"seed": -1}, "seed must be 0 or more, got -1"),
    ],
)
def test_settings_beyond_reason_are_refused(values: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Simulated(**values)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--closed-loop"], "--closed-loop needs --simulator"),
        (["--video", "x.mp4"], "--video needs --simulator"),
        (["--seed", "0"], "--seed needs --simulator"),
        (["--noise", "0"], "--noise needs --simulator"),
        (["--at", "0.5,0,0.4"], "--at needs --arm"),
        (["--pybullet", "--static", "0.5"], "give --friction with --simulator"),
        (["--pybullet", "--simulator", "mujoco"], "--pybullet and --simulator mujoco: one of them"),
        (["--pybullet", "--model", "x"], "--model needs --closed-loop"),
        (["--pybullet", "--video", "x.avi"], "a film is written as .mp4, got the suffix '.avi'"),
        (["--pybullet", "--video", "absent/x.mp4"], "there is no folder absent"),
        (["--pybullet", "--report", "absent/x.html"], "there is no folder absent"),
        (["--pybullet", "--disturb", "push"], "--disturb 'push' must be push@SECONDS=FX,FY"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    slide_run: SlideRun, shake_file: Path, options: list[str], message: str
) -> None:
    code, out, err = slide_run(shake_file, *options)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err


def test_gui_without_a_display_is_refused(
    slide_run: SlideRun, shake_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    code, _, err = slide_run(shake_file, "--pybullet", "--gui")
    assert (code, err) == (2, "slide-run: error: --gui needs a display: DISPLAY is not set\n")
    if ctypes.util.find_library("X11") is None:
        return
    monkeypatch.setenv("DISPLAY", ":nowhere")
    code, _, err = slide_run(shake_file, "--simulator", "mujoco", "--gui")
    assert (code, err) == (
        2, "slide-run: error: --gui needs a display: DISPLAY is ':nowhere', which does not open\n",
    )  # fmt: skip


def test_missing_pybullet_is_said_with_the_pip_command(
    slide_run: SlideRun, shake_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pybullet", None)
    monkeypatch.setattr(sys, "version_info", (3, 11, 9))
    code, _, err = slide_run(shake_file, "--pybullet")
    assert (code, err) == (
        2,
        "slide-run: error: the arm in pybullet needs pybullet: pip install './[pybullet]' in a checkout, "
        "'FILE.whl[pybullet]' with a wheel\n",
    )
    monkeypatch.setattr(sys, "version_info", (3, 12, 1))
    code, _, err = slide_run(shake_file, "--pybullet")
    assert (code, err.count("\n")) == (2, 1)
    assert err.endswith("; pip builds it on this Python, in a quarter of an hour, or use --simulator mujoco\n")


def test_missing_mujoco_is_said_with_the_pip_command(
    slide_run: SlideRun, shake_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    code, _, err = slide_run(shake_file, "--simulator", "mujoco")
    assert (code, err) == (
        2,
        "slide-run: error: the arm in MuJoCo needs mujoco: pip install './[mujoco]' in a checkout, "
        "'FILE.whl[mujoco]' with a wheel\n",
    )


def test_film_without_ffmpeg_is_refused_before_the_run(
    slide_run: SlideRun, shake_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    film = tmp_path / "film.mp4"
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    code, _, err = slide_run(shake_file, "--pybullet", "--video", film)
    assert (code, err) == (
        2,
        "slide-run: error: --video needs imageio-ffmpeg: pip install './[pybullet]' in a checkout, "
        "'FILE.whl[pybullet]' with a wheel\n",
    )
    assert not film.exists()


def test_film_with_a_broken_ffmpeg_is_refused_before_the_run(
    slide_run: SlideRun, shake_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")

    def none_found() -> str:
        raise RuntimeError("No ffmpeg exe could be found.")

    monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", none_found)
    code, _, err = slide_run(shake_file, "--pybullet", "--video", tmp_path / "film.mp4")
    assert (code, err.count("\n")) == (2, 1)
    assert "--video needs ffmpeg, which imageio-ffmpeg did not find" in err
