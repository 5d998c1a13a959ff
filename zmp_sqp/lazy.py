"""Names of a package that are imported at first use, so that the package is fast to import."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

__all__ = ["at_first_use"]


def at_first_use(
    package: str, sources: Mapping[str, str]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a package (PEP 562) that imports some names at first use.

    Modules directly below the package are such names, too. Type checkers do not see this: they need
    the same imports under `if TYPE_CHECKING`.

    Args:
        package: `__name__` of the package.
        sources: Names that are imported from a module, with blanks between, by name of the module.
    """
    found_in = {name: module for module, names in sources.items() for name in names.split()}
    below = {module.removeprefix(f"{package}."): module for module in sources}

    def get(name: str) -> Any:
        if name in found_in:
            value = getattr(import_module(found_in[name]), name)
            setattr(sys.modules[package], name, value)
            return value
        if name in below:
            return import_module(below[name])
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    def names() -> list[str]:
        return sorted({*vars(sys.modules[package]), *found_in, *(n for n in below if "." not in n)})

    return get, names
