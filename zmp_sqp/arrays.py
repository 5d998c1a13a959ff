"""Checked, copied, write-protected arrays for the frozen values of this library."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from zmp_sqp.errors import ZmpSqpError

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]


def frozen_array(
    values: Any,
    *,
    name: str,
    shape: tuple[int | None, ...],
    error: type[ZmpSqpError],
    finite: bool = True,
    labels: tuple[str, ...] = (),
) -> Array:
    """Copy of `values` as float64 that nobody can write to.

    Args:
        values: Anything NumPy turns into numbers.
        name: What the message calls it.
        shape: Expected shape; None stands for any length.
        error: What to raise.
        finite: Whether NaN and infinity are refused.
        labels: What the entries of the last axis are called, if they have names.

    Raises:
        error: Not numbers, wrong shape, or not finite; the message names the first offending entry.
    """
    try:
        array = np.array(values, dtype=np.float64, order="C")
    except (TypeError, ValueError) as cause:
        raise error(f"{name} must be numbers of shape {_spell(shape)}: {cause}") from None
    if array.ndim != len(shape) or any(want not in (None, have) for want, have in zip(shape, array.shape, strict=True)):
        raise error(f"{name} must have shape {_spell(shape)}, not {array.shape}")
    if finite and not np.isfinite(array).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        label = f" ({labels[where[-1]]!r})" if labels else ""
        raise error(f"{name} must be finite, but entry {list(where)}{label} is {array[where]}")
    array.flags.writeable = False
    return array


def finite_number(value: Any, *, name: str, error: type[ZmpSqpError]) -> float:
    """`value` as a float; anything that is not one finite number raises `error` with `name` in the message."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise error(f"{name} must be a number, not {value!r}") from None
    if not np.isfinite(number):
        raise error(f"{name} must be finite, not {number}")
    return number


def _spell(shape: tuple[int | None, ...]) -> str:
    inner = ", ".join("any" if length is None else str(length) for length in shape)
    return f"({inner},)" if len(shape) == 1 else f"({inner})"
