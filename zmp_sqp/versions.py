"""Versions of this package, of Python and of the packages that a result depends on."""

from __future__ import annotations

import platform
from contextlib import suppress

__all__ = ["__version__", "installed_versions"]

__version__ = "0.1.0"

# Distributions whose versions may change a result: dynamics, QP solvers and linear algebra.
PACKAGES = ("numpy", "scipy", "pin", "proxsuite", "daqp", "piqp", "qpsolvers")


def installed_versions(*extras: str) -> dict[str, str]:
    """Versions of this package, Python, `PACKAGES` and `extras`; missing packages are left out.

    Args:
        extras: Names of further distributions, as package registries spell them.
    """
    from importlib import metadata  # slow to import

    found = {"zmp-sqp": __version__, "python": platform.python_version()}
    for package in (*PACKAGES, *extras):
        with suppress(metadata.PackageNotFoundError):
            found[package] = metadata.version(package)
    return found
