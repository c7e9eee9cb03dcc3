"""Pictures and films of a simulated run, rendered offscreen."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arm.interface import Measured
from runtime.arm.run import Hook
from runtime.arm.simulation import SimulatedArm
from runtime.documents.checks import FloatArray
from runtime.errors import MissingExtraError, OutputError, install_line
from runtime.physics.law import DT

Image = NDArray[np.uint8]

WIDTH, HEIGHT = 640, 480
"""Size of a picture (pixels)."""

FRAMES_PER_SECOND = 25
SLOW_MOTION = 4
"""A film shows a run this many times slower: all of a stick and a slip is over in a tenth of a second."""

CAMERA = {"cameraTargetPosition": [0.58, 0.0, 0.33], "distance": 1.15, "yaw": 55.0, "pitch": -38.0, "roll": 0.0}
"""Where the camera looks (m) and from where (m, degrees): from ahead and above, so that the pan's bottom is seen."""

LIGHT = [0.5, -0.6, 1.5]
"""Where the light comes from."""

FIELD_OF_VIEW = 42.0
"""Vertical angle of view (degrees)."""

NEAR, FAR = 0.1, 6.0
"""Distances between which there is a picture (m)."""

GROUND_COLOUR = (160, 178, 168)
GRID_COLOUR = (122, 140, 131)
GRID_SPACING = 0.25
"""Distance between the lines on the ground (m)."""

GRID_WIDTH = 0.008
"""Width of these lines (m)."""

COMMAND_COLOUR = (20, 60, 200)
TARGET_COLOUR = (0, 150, 60)
PATH_DOTS = 120
"""Dots a command's path is drawn with."""


class Camera:
    """Takes pictures of a simulated arm, with the command drawn onto the pan.

    Args:
        arm: what is looked at.
        command: (K, 2) where the object should be, relative to the pan (m); None to draw none.
        size: width and height (pixels).
    """

    def __init__(
        self, arm: SimulatedArm, command: FloatArray | None = None, size: tuple[int, int] = (WIDTH, HEIGHT)
    ) -> None:
        self._arm, self._command, self._size = arm, command, size
        bullet = arm.bullet
        self._view = bullet.computeViewMatrixFromYawPitchRoll(upAxisIndex=2, **CAMERA)
        self._projection = bullet.computeProjectionMatrixFOV(FIELD_OF_VIEW, size[0] / size[1], NEAR, FAR)
        self._ground = self._paint_ground()

    def picture(self, k: int) -> Image:
        """Return what is seen at t_k, (height, width, 3)."""
        bullet, (width, height) = self._arm.bullet, self._size
        _, _, pixels, _, bodies = bullet.getCameraImage(
            width,
            height,
            self._view,
            self._projection,
            lightDirection=LIGHT,
            lightAmbientCoeff=0.65,
            lightDiffuseCoeff=0.4,
            lightSpecularCoeff=0.05,
            shadow=0,  # it would double the time
            renderer=bullet.ER_TINY_RENDERER,
            physicsClientId=self._arm.client,
        )
        image: Image = np.reshape(np.asarray(pixels, dtype=np.uint8), (height, width, 4))[..., :3].copy()
        body = np.reshape(np.asarray(bodies), (height, width))
        image[body < 0] = self._ground[body < 0]
        if self._command is not None:
            self._draw_command(image, self._command, k, body == self._arm.object_body)
        return image

    def _paint_ground(self) -> Image:
        """Return the ground as the camera sees it, with lines on it: (height, width, 3).

        A line of sight meets the ground where its world coordinates, which are linear in the depth along it up to a
        factor, have height zero. Painting it takes no time; the renderer would need longer for it than for the arm.
        """
        width, height = self._size
        columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        screen_x, screen_y = 2.0 * columns / width - 1.0, 1.0 - 2.0 * rows / height
        inverse = np.linalg.inv(np.reshape(self._view, (4, 4)) @ np.reshape(self._projection, (4, 4)))
        ends = []
        for depth in (-1.0, 1.0):
            clip = np.stack([screen_x, screen_y, np.full_like(screen_x, depth), np.ones_like(screen_x)], axis=-1)
            world = clip @ inverse
            ends.append(world[..., :3] / world[..., 3:])
        near, far = ends
        share = near[..., 2] / (near[..., 2] - far[..., 2])
        place = near[..., :2] + share[..., None] * (far - near)[..., :2]
        lines = (np.abs(place - GRID_SPACING * np.round(place / GRID_SPACING)) < 0.5 * GRID_WIDTH).any(axis=-1)
        return np.where(lines[..., None], np.array(GRID_COLOUR), np.array(GROUND_COLOUR)).astype(np.uint8)

    def _draw_command(self, image: Image, command: FloatArray, k: int, hidden: NDArray[np.bool_]) -> None:
        """Draw the path, behind the object, and where the object should be, before it."""
        hiding = image[hidden]
        path = command[:: max(1, len(command) // PATH_DOTS)]
        now = command[min(k, len(command) - 1)][None]
        scale = self._size[1] / HEIGHT
        for points, colour, size in ((path, COMMAND_COLOUR, 1.2 * scale), (now, TARGET_COLOUR, 5.0 * scale)):
            for column, row in self._pixels(points):
                _dot(image, column, row, size, colour)
            if points is path:
                image[hidden] = hiding

    def _pixels(self, points: FloatArray) -> FloatArray:
        """Return columns and rows (n, 2) of points (n, 2) on the pan (m)."""
        position, frame = self._arm.pan_pose()
        world = position + points @ frame[:, :2].T
        homogeneous = np.column_stack([world, np.ones(len(world))])
        view, projection = np.reshape(self._view, (4, 4)), np.reshape(self._projection, (4, 4))
        clip = homogeneous @ view @ projection
        screen = clip[:, :2] / clip[:, 3:]
        width, height = self._size
        return np.column_stack([0.5 * (1.0 + screen[:, 0]) * width, 0.5 * (1.0 - screen[:, 1]) * height])


def _dot(image: Image, column: float, row: float, radius: float, colour: tuple[int, int, int]) -> None:
    left, top = max(0, int(column - radius)), max(0, int(row - radius))
    part = image[top : max(0, int(row + radius) + 2), left : max(0, int(column + radius) + 2)]
    rows, columns = np.indices(part.shape[:2])
    part[np.hypot(rows + top - row, columns + left - column) <= radius] = colour


def check_ffmpeg() -> None:
    """Check, before a run, that a film can be written.

    Raises:
        MissingExtraError: imageio-ffmpeg is not installed, or there is no ffmpeg.
    """
    _ffmpeg()


def _ffmpeg() -> Any:
    try:
        import imageio_ffmpeg

        imageio_ffmpeg.get_ffmpeg_exe()
    except ImportError as error:
        raise MissingExtraError(f"--video needs imageio-ffmpeg: {install_line('pybullet')}") from error
    except RuntimeError as error:
        raise MissingExtraError(
            "--video needs ffmpeg, which imageio-ffmpeg did not find: install it, or set IMAGEIO_FFMPEG_EXE"
        ) from error
    return imageio_ffmpeg


def check_film(path: Path) -> None:
    """Check that a film can be written under this name.

    Raises:
        OutputError: the suffix is not .mp4.
    """
    if path.suffix.lower() != ".mp4":
        raise OutputError(f"{path}: a film is written as .mp4, got the suffix {path.suffix!r}")


@contextmanager
def filming(path: Path, picture: Callable[[int], Image]) -> Iterator[Hook]:
    """Give a hook that films; the film is finished when the block is left, however it is left.

    Args:
        path: the .mp4 file, replaced if it exists.
        picture: gives what is seen at t_k.

    Raises:
        MissingExtraError: there is no ffmpeg.
        OutputError: the film could not be written.
    """
    every = round(1.0 / (FRAMES_PER_SECOND * SLOW_MOTION * DT))
    writer = _ffmpeg().write_frames(
        str(path), (WIDTH, HEIGHT), fps=FRAMES_PER_SECOND, quality=7, ffmpeg_log_level="error"
    )
    writer.send(None)

    def hook(k: int, measured: Measured) -> None:
        if k % every == 0:
            writer.send(np.ascontiguousarray(picture(k)))

    try:
        yield hook
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error}") from error
    finally:
        writer.close()
