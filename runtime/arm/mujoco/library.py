"""The package mujoco, and the OpenGL that it renders with.

`python -m runtime.arm.mujoco.library` exits with 0 if pictures can be made here, else with one line that says why not.
"""

from __future__ import annotations

import ctypes.util
import os
import sys
from typing import Any

from runtime.errors import MissingExtraError, install_line


def import_mujoco() -> Any:
    """Return the module.

    Raises:
        MissingExtraError: it is not installed, or does not load with the OpenGL that MUJOCO_GL names.
    """
    try:
        import mujoco
    except ModuleNotFoundError as error:
        raise MissingExtraError(f"the arm in MuJoCo needs mujoco: {install_line('mujoco')}") from error
    except (ImportError, AttributeError, RuntimeError) as error:  # AttributeError: PyOpenGL, if a library is missing
        way = os.environ.get("MUJOCO_GL", "")
        raise MissingExtraError(
            f"mujoco does not load with MUJOCO_GL={way}, unset it or install what it names: {_one_line(error)}"
        ) from error
    return mujoco


def gl_context(mujoco: Any, width: int, height: int) -> Any:
    """Return an OpenGL context that needs no screen: MUJOCO_GL's, or by EGL, or by OSMesa.

    Raises:
        MissingExtraError: there is none.
    """
    if not sys.platform.startswith("linux"):
        return mujoco.GLContext(width, height)
    way = os.environ.get("MUJOCO_GL", "").lower()
    if way not in ("egl", "osmesa"):
        found = [way for way, library in (("egl", "EGL"), ("osmesa", "OSMesa")) if ctypes.util.find_library(library)]
        if not found:
            raise MissingExtraError(_nothing_renders("neither library was found"))
        way = found[0]
    try:
        if way == "egl":
            from mujoco.egl import GLContext
        else:
            from mujoco.osmesa import GLContext
        return GLContext(width, height)
    except (ImportError, AttributeError, RuntimeError) as error:  # AttributeError: PyOpenGL, if a library is missing
        raise MissingExtraError(_nothing_renders(f"{way}: {_one_line(error)}")) from error


def _nothing_renders(why: str) -> str:
    return (
        "pictures need EGL or OSMesa, to render without a screen (Debian: apt install libegl1 libgl1-mesa-dri, or "
        f"libosmesa6 and MUJOCO_GL=osmesa): {why}"
    )


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


if __name__ == "__main__":
    try:
        gl_context(import_mujoco(), 8, 8)
    except MissingExtraError as error:
        sys.exit(str(error))
