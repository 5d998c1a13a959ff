"""`cached_property` without the lock that Python 3.11 holds for all instances of a class."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, Generic, TypeVar, overload

__all__ = ["cached_property"]

T = TypeVar("T")

if sys.version_info >= (3, 12):
    from functools import cached_property
else:

    class cached_property(Generic[T]):  # noqa: N801 - named as in functools
        """Property that is computed once for each instance, as in `functools` from 3.12 on.

        That of 3.11 holds one lock per attribute of a class while it computes, so that planners in
        two threads would wait for each other.
        """

        def __init__(self, compute: Callable[[Any], T]) -> None:
            self._compute, self.__doc__ = compute, compute.__doc__

        def __set_name__(self, owner: type, name: str) -> None:
            self._name = name

        @overload
        def __get__(self, instance: None, owner: type | None = None) -> cached_property[T]: ...

        @overload
        def __get__(self, instance: object, owner: type | None = None) -> T: ...

        def __get__(self, instance: object, owner: type | None = None) -> cached_property[T] | T:
            if instance is None:
                return self
            value = instance.__dict__[self._name] = self._compute(instance)
            return value
