"""Pictures of the arm in MuJoCo, rendered without a screen."""

from __future__ import annotations

import atexit
import weakref
from itertools import pairwise
from typing import Any, Protocol

import numpy as np

from runtime.arm import geometry as g
from runtime.arm.engine import Image, Size
from runtime.arm.mujoco.library import gl_context
from runtime.arms.model import PAN_SITE
from runtime.documents.checks import FloatArray

WIDTH, HEIGHT = 1280, 720
"""Size of a picture (pixels)."""

AZIMUTH, ELEVATION = 138.0, -28.0
"""Direction in which the camera looks (degrees)."""

DISTANCE = 1.05
"""Distance of the camera over the diagonal of the box around arm and pan, into whose middle it looks."""

COMMAND_COLOUR = (0.20, 0.62, 1.0, 1.0)
TARGET_COLOUR = (0.15, 0.85, 0.35, 1.0)
PATH_PIECES = 160
"""Straight pieces a command's path is drawn with."""

LINE_RADIUS = 0.002
"""Radius of the line on the pan (m)."""

TARGET_RADIUS = 0.006
"""Radius of the ball above where the object should be (m)."""

MAX_SHAPES = 2000
"""Shapes there is room for in a picture."""


class World(Protocol):
    """What a camera sees of the engine: its module, the model and the state."""

    mujoco: Any
    model: Any
    data: Any


class MujocoCamera:
    """A `Camera` of MuJoCo's own renderer.

    Args:
        world: what is looked at.
        command: (K, 2) where the object should be, relative to the pan (m); None to draw none.
        size: width and height (pixels); 1280 x 720 if None.

    Raises:
        MissingExtraError: nothing here can render.
    """

    def __init__(self, world: World, command: FloatArray | None = None, size: Size | None = None) -> None:
        self.size = size or (WIDTH, HEIGHT)
        self._world, self._command = world, command
        mujoco, model = world.mujoco, world.model
        self._site = model.site(PAN_SITE).id
        self._gl = gl_context(mujoco, *self.size)
        self._gl.make_current()
        model.vis.global_.offwidth, model.vis.global_.offheight = self.size
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        freeing = weakref.finalize(self, _free, self._gl, self._context)
        freeing.atexit = False
        atexit.register(freeing)  # after the display's own, so that it runs before it
        self._scene = mujoco.MjvScene(model, MAX_SHAPES)
        self._options = mujoco.MjvOption()
        self._view = mujoco.MjvCamera()
        self._view.lookat, self._view.distance = self._frame_arm()
        self._view.azimuth, self._view.elevation = AZIMUTH, ELEVATION

    def picture(self, k: int) -> Image:
        """Return what is seen at t_k, (height, width, 3)."""
        world, (width, height) = self._world, self.size
        mujoco, everything = world.mujoco, world.mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(
            world.model, world.data, self._options, mujoco.MjvPerturb(), self._view, everything, self._scene
        )
        if self._command is not None:
            self._draw_command(self._command, k)
        self._gl.make_current()
        image: Image = np.empty((height, width, 3), dtype=np.uint8)
        rectangle = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(rectangle, self._scene, self._context)
        mujoco.mjr_readPixels(image, None, rectangle, self._context)
        return image[::-1]

    def _frame_arm(self) -> tuple[FloatArray, float]:
        """Return the middle (3,) of the box around base, joints and pan, where they are now, and its distance (m)."""
        data = self._world.data
        pan = data.site_xpos[self._site]
        joints = self._world.model.jnt_type != self._world.mujoco.mjtJoint.mjJNT_FREE
        points = np.vstack([np.zeros(3), data.xanchor[joints], pan + g.PAN_RADIUS, pan - g.PAN_RADIUS])
        low, high = points.min(axis=0), points.max(axis=0)
        return 0.5 * (low + high), DISTANCE * float(np.linalg.norm(high - low))

    def _draw_command(self, command: FloatArray, k: int) -> None:
        """Draw the path on the pan, and a ball above where the object should be."""
        mujoco, data = self._world.mujoco, self._world.data
        centre, frame = data.site_xpos[self._site], data.site_xmat[self._site].reshape(3, 3)
        ends = np.linspace(0, len(command) - 1, PATH_PIECES + 1).astype(int)
        path = centre + np.column_stack([command[ends], np.full(len(ends), 0.5 * LINE_RADIUS)]) @ frame.T
        for begin, end in pairwise(path):
            if not np.array_equal(begin, end):
                line = self._shape(mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3), np.zeros(3), COMMAND_COLOUR)
                mujoco.mjv_connector(line, mujoco.mjtGeom.mjGEOM_CAPSULE, LINE_RADIUS, begin, end)
        now = np.array([*command[min(k, len(command) - 1)], g.OBJECT_HEIGHT + 1.5 * TARGET_RADIUS])
        size = np.full(3, TARGET_RADIUS)
        self._shape(mujoco.mjtGeom.mjGEOM_SPHERE, size, centre + frame @ now, TARGET_COLOUR)

    def _shape(self, kind: Any, size: FloatArray, position: FloatArray, colour: tuple[float, ...]) -> Any:
        scene = self._scene
        shape = scene.geoms[scene.ngeom]
        rgba = np.array(colour, dtype=np.float32)
        self._world.mujoco.mjv_initGeom(shape, kind, size, position, np.eye(3).ravel(), rgba)
        shape.category = self._world.mujoco.mjtCatBit.mjCAT_DECOR
        scene.ngeom += 1
        return shape


def _free(gl: Any, context: Any) -> None:
    """Free what the renderer holds where it holds it: in its own OpenGL context, not in another camera's."""
    gl.make_current()
    context.free()
    gl.free()
