"""Imports the optional packages MuJoCo and Pillow when they are needed."""

from __future__ import annotations

import os
import sys
from importlib import import_module
from typing import Any

from zmp_sqp.errors import MissingExtra

__all__ = ["load_mujoco", "load_pillow", "open_canvas"]

DISPLAYS = (
    "DISPLAY",
    "WAYLAND_DISPLAY",
)  # environment variables that are set if there is a display
RENDERER = "MUJOCO_GL"  # environment variable that selects MuJoCo's OpenGL backend


def load_mujoco() -> Any:
    """Import and return the package `mujoco`.

    Raises:
        MissingExtra: MuJoCo is not installed.
    """
    return _load("mujoco", "mujoco", purpose="a replay")


def open_canvas(width: int, height: int) -> Any:
    """Create an OpenGL context for drawing into memory and make it current.

    On Linux without a display this is an EGL context, elsewhere MuJoCo's default. The environment
    variable `MUJOCO_GL` selects another backend; MuJoCo reads it once, when it is imported.

    Args:
        width, height: Size of the picture [pixels].

    Raises:
        MissingExtra: MuJoCo is not installed, or OpenGL does not work here.
    """
    load_mujoco()
    headless = sys.platform == "linux" and not any(
        os.environ.get(name) for name in (RENDERER, *DISPLAYS)
    )
    try:
        canvas = import_module("mujoco.egl" if headless else "mujoco.gl_context").GLContext(
            width, height
        )
        canvas.make_current()
    except Exception as cause:  # drivers and their bindings raise exceptions of many types
        complaint = " ".join(str(cause).split())
        raise MissingExtra(
            f"nothing can be drawn here ({complaint}): install EGL, or set {RENDERER}=osmesa"
        ) from cause
    return canvas


def load_pillow(module: str) -> Any:
    """Import and return a module of Pillow, such as "Image".

    Raises:
        MissingExtra: Pillow is not installed.
    """
    return _load(f"PIL.{module}", "Pillow", purpose="a picture of a replay")


def _load(module: str, package: str, *, purpose: str) -> Any:
    """Import a module; raises MissingExtra if its package is not installed."""
    try:
        return import_module(module)
    except ModuleNotFoundError as cause:
        if cause.name is None or cause.name.partition(".")[0] != module.partition(".")[0]:
            raise
        raise MissingExtra(f"{purpose} needs {package}: pip install zmp-sqp[sim]") from None
