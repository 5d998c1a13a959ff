"""Checked, copied, write-protected arrays for the frozen values of this library."""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt

from zmp_sqp.errors import ZmpSqpError

LONGEST_SHOWN = 80  # characters of a value in a message

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
        kind = np.asarray(values).dtype.kind
        # NumPy would read booleans, texts, dates, what lies masked
        if kind not in "iufO" or np.ma.is_masked(values):
            raise error(f"{name} must be numbers of shape {_spell(shape)}, not {shortened(values)}")
        array = np.array(values, dtype=np.float64, order="C")
    except (TypeError, ValueError, OverflowError) as cause:
        raise error(
            f"{name} must be numbers of shape {_spell(shape)}: {' '.join(str(cause).split())}"
        ) from None
    if array.ndim != len(shape) or any(
        want not in (None, have) for want, have in zip(shape, array.shape, strict=True)
    ):
        raise error(f"{name} must have shape {_spell(shape)}, not {array.shape}")
    if finite and not np.isfinite(array).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        label = f" ({labels[where[-1]]!r})" if labels else ""
        raise error(f"{name} must be finite, but entry {list(where)}{label} is {array[where]}")
    array.flags.writeable = False
    return array


def finite_number(value: Any, *, name: str, error: type[ZmpSqpError]) -> float:
    """`value` as a float; anything that is not one finite number raises `error` with `name` in the message."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    # float would read texts as numbers
    if not isinstance(value, Real) or isinstance(value, bool | np.bool_):
        raise error(f"{name} must be a number, not {shortened(value)}")
    try:
        number = float(value)
    except OverflowError:
        raise error(f"{name} must be finite, not {shortened(value)}") from None
    if not np.isfinite(number):
        raise error(f"{name} must be finite, not {number}")
    return number


def shortened(value: Any) -> str:
    """What messages show of a value that may be anything: one line, not too long."""
    text = " ".join(repr(value).split())
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."


def _spell(shape: tuple[int | None, ...]) -> str:
    inner = ", ".join("any" if length is None else str(length) for length in shape)
    return f"({inner},)" if len(shape) == 1 else f"({inner})"
