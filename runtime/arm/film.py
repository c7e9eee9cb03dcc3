"""Films of a simulated run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from runtime.arm.engine import Camera
from runtime.arm.interface import Measured
from runtime.arm.run import Hook
from runtime.errors import MissingExtraError, OutputError, install_line
from runtime.physics.law import DT

FRAMES_PER_SECOND = 25
SLOW_MOTION = 4
"""A film shows a run this many times slower: all of a stick and a slip is over in a tenth of a second."""


def check_ffmpeg(extra: str) -> None:
    """Check, before a run, that a film can be written.

    Args:
        extra: the one that brings ffmpeg along.

    Raises:
        MissingExtraError: imageio-ffmpeg is not installed, or there is no ffmpeg.
    """
    try:
        import imageio_ffmpeg

        imageio_ffmpeg.get_ffmpeg_exe()
    except ImportError as error:
        raise MissingExtraError(f"--video needs imageio-ffmpeg: {install_line(extra)}") from error
    except RuntimeError as error:
        raise MissingExtraError(
            "--video needs ffmpeg, which imageio-ffmpeg did not find: install it, or set IMAGEIO_FFMPEG_EXE"
        ) from error


def check_film(path: Path) -> None:
    """Check that a film can be written under this name.

    Raises:
        OutputError: the suffix is not .mp4.
    """
    if path.suffix.lower() != ".mp4":
        raise OutputError(f"{path}: a film is written as .mp4, got the suffix {path.suffix!r}")


@contextmanager
def filming(path: Path, camera: Camera) -> Iterator[Hook]:
    """Give a hook that films; the film is finished when the block is left, however it is left.

    Args:
        path: the .mp4 file, replaced if it exists.
        camera: looks at the arm.

    Raises:
        OutputError: the film could not be written.
    """
    import imageio_ffmpeg

    every = round(1.0 / (FRAMES_PER_SECOND * SLOW_MOTION * DT))
    writer = imageio_ffmpeg.write_frames(
        str(path), camera.size, fps=FRAMES_PER_SECOND, quality=7, ffmpeg_log_level="error"
    )
    writer.send(None)

    def hook(k: int, measured: Measured) -> None:
        if k % every == 0:
            writer.send(np.ascontiguousarray(camera.picture(k)))

    try:
        yield hook
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error}") from error
    finally:
        writer.close()
