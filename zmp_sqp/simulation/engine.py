"""MuJoCo, imported when it is needed: it is an extra."""

from __future__ import annotations

import os
import sys
from ctypes.util import find_library
from importlib import import_module
from typing import Any

from zmp_sqp.errors import MissingExtra

__all__ = ["load_mujoco", "load_pillow"]

DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")
RENDERER = "MUJOCO_GL"  # MuJoCo reads it once, at its import


def load_mujoco() -> Any:
    """The package `mujoco`; on Linux without a display, told to draw through EGL if there is one.

    Raises:
        MissingExtra: It is not installed.
    """
    headless = sys.platform == "linux" and not any(os.environ.get(name) for name in DISPLAYS)
    ours = "mujoco" not in sys.modules and headless and RENDERER not in os.environ and find_library("EGL") is not None
    if ours:
        os.environ[RENDERER] = "egl"
    try:
        return _load("mujoco", "mujoco", purpose="a replay")
    finally:
        if ours:
            del os.environ[RENDERER]


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
