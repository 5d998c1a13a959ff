"""MuJoCo, imported when it is needed: it is an extra."""

from __future__ import annotations

import os
import sys
from importlib import import_module
from typing import Any

from zmp_sqp.errors import MissingExtra

__all__ = ["load_mujoco", "load_pillow", "open_canvas"]

DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")
RENDERER = "MUJOCO_GL"  # how MuJoCo is told what to draw with


def load_mujoco() -> Any:
    """The package `mujoco`.

    Raises:
        MissingExtra: It is not installed.
    """
    return _load("mujoco", "mujoco", purpose="a replay")


def open_canvas(width: int, height: int) -> Any:
    """An OpenGL context of MuJoCo's to draw in memory, made current: EGL on Linux without a display.

    `MUJOCO_GL` in the environment chooses another one; MuJoCo reads it once, at its import.

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
    except Exception as cause:  # whatever the drivers and their bindings raise
        complaint = " ".join(str(cause).split())
        raise MissingExtra(
            f"nothing can be drawn here ({complaint}): install EGL, or set {RENDERER}=osmesa"
        ) from cause
    return canvas


def load_pillow(module: str) -> Any:
    """A module of Pillow, such as "Image".

    Raises:
        MissingExtra: It is not installed.
    """
    return _load(f"PIL.{module}", "Pillow", purpose="a picture of a replay")


def _load(module: str, package: str, *, purpose: str) -> Any:
    try:
        return import_module(module)
    except ModuleNotFoundError as cause:
        if cause.name is None or cause.name.partition(".")[0] != module.partition(".")[0]:
            raise
        raise MissingExtra(f"{purpose} needs {package}: pip install zmp-sqp[sim]") from None
