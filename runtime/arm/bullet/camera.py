"""Pictures of the arm in pybullet, rendered offscreen."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from runtime.arm.engine import Image, Pose, Size
from runtime.documents.checks import FloatArray

WIDTH, HEIGHT = 640, 480
"""Size of a picture (pixels)."""

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


class World(Protocol):
    """What a camera sees of the engine: its module, its connection, the number of the object, and where the pan is."""

    bullet: Any
    client: int
    object_body: int

    def pan(self) -> Pose:
        """Return where the pan is now."""


class BulletCamera:
    """A `Camera` of pybullet's own renderer.

    Args:
        world: what is looked at.
        command: (K, 2) where the object should be, relative to the pan (m); None to draw none.
        size: width and height (pixels); 640 x 480 if None.
    """

    def __init__(self, world: World, command: FloatArray | None = None, size: Size | None = None) -> None:
        self.size = size or (WIDTH, HEIGHT)
        self._world, self._command = world, command
        bullet = world.bullet
        self._view = bullet.computeViewMatrixFromYawPitchRoll(upAxisIndex=2, **CAMERA)
        self._projection = bullet.computeProjectionMatrixFOV(FIELD_OF_VIEW, self.size[0] / self.size[1], NEAR, FAR)
        self._ground = self._paint_ground()

    def picture(self, k: int) -> Image:
        """Return what is seen at t_k, (height, width, 3)."""
        bullet, (width, height) = self._world.bullet, self.size
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
            physicsClientId=self._world.client,
        )
        image: Image = np.reshape(np.asarray(pixels, dtype=np.uint8), (height, width, 4))[..., :3].copy()
        body = np.reshape(np.asarray(bodies), (height, width))
        image[body < 0] = self._ground[body < 0]
        if self._command is not None:
            self._draw_command(image, self._command, k, body == self._world.object_body)
        return image

    def _paint_ground(self) -> Image:
        """Return the ground as the camera sees it, with lines on it: (height, width, 3).

        A line of sight meets the ground where its world coordinates, which are linear in the depth along it up to a
        factor, have height zero. Painting it takes no time; the renderer would need longer for it than for the arm.
        """
        width, height = self.size
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
        scale = self.size[1] / HEIGHT
        for points, colour, size in ((path, COMMAND_COLOUR, 1.2 * scale), (now, TARGET_COLOUR, 5.0 * scale)):
            for column, row in self._pixels(points):
                _dot(image, column, row, size, colour)
            if points is path:
                image[hidden] = hiding

    def _pixels(self, points: FloatArray) -> FloatArray:
        """Return columns and rows (n, 2) of points (n, 2) on the pan (m)."""
        position, frame = self._world.pan()
        world = position + points @ frame[:, :2].T
        homogeneous = np.column_stack([world, np.ones(len(world))])
        view, projection = np.reshape(self._view, (4, 4)), np.reshape(self._projection, (4, 4))
        clip = homogeneous @ view @ projection
        screen = clip[:, :2] / clip[:, 3:]
        width, height = self.size
        return np.column_stack([0.5 * (1.0 + screen[:, 0]) * width, 0.5 * (1.0 - screen[:, 1]) * height])


def _dot(image: Image, column: float, row: float, radius: float, colour: tuple[int, int, int]) -> None:
    left, top = max(0, int(column - radius)), max(0, int(row - radius))
    part = image[top : max(0, int(row + radius) + 2), left : max(0, int(column + radius) + 2)]
    rows, columns = np.indices(part.shape[:2])
    part[np.hypot(rows + top - row, columns + left - column) <= radius] = colour
