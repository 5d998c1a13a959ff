"""Checks of numbers and arrays that users pass in, and read-only copies of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt

from zmp_sqp.errors import ZmpSqpError

LONGEST_SHOWN = 80  # [characters] of a value that an error message shows; the rest is cut
LEAST_IN_METRES = 5e-3  # [m] shorter lengths are shown in millimetres: 0.002 m says little
MOST_DIGITS = 17  # significant digits that tell any two float64 apart

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
    """Read-only float64 copy of `values`, after a check of type, shape and finiteness.

    Args:
        values: Anything that NumPy can turn into numbers.
        name: Name of the values in error messages.
        shape: Expected shape; None stands for any length.
        error: Exception class to raise.
        finite: Whether NaN and infinity are refused.
        labels: Names of the entries along the last axis, for error messages; empty if they have
            none.

    Raises:
        error: Not numbers, wrong shape, or not finite; the message names the first offending entry.
    """
    try:
        # NumPy would convert booleans, texts, dates and masked entries without complaint
        if not (type(values) is np.ndarray and values.dtype == np.float64) and (
            np.asarray(values).dtype.kind not in "iufO" or np.ma.is_masked(values)
        ):
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


def set_frozen_state(self: Any, state: Sequence[Any]) -> None:
    """`__setstate__` of frozen dataclasses with slots: arrays become read-only again.

    Copies of arrays, and arrays out of a pickle, are writable otherwise.

    Args:
        self: The new instance.
        state: Values of its fields.
    """
    for field, value in zip(fields(self), state, strict=True):
        if isinstance(value, np.ndarray):
            value.flags.writeable = False
        object.__setattr__(self, field.name, value)


def finite_number(value: Any, *, name: str, error: type[ZmpSqpError]) -> float:
    """Convert one finite number to a float.

    Args:
        value: What the user gave.
        name: Name of the value in error messages.
        error: Exception class to raise.

    Raises:
        error: Not a number, or not finite; the message contains `name`.
    """
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    # float() would convert texts, too
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
    """Any value as one line of at most about `LONGEST_SHOWN` characters, for error messages."""
    text = " ".join(repr(value).split())
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."


def length_text(length: float) -> str:
    """Length [m] as text: in metres, or in millimetres where metres would show few digits."""
    return f"{length:.3f} m" if length >= LEAST_IN_METRES else f"{1e3 * length:.2g} mm"


def distinct_texts(*values: float, digits: int = 6) -> tuple[str, ...]:
    """Numbers as text, with enough significant digits to tell unequal ones apart.

    Args:
        values: Numbers that a message compares, such as a value and its limits.
        digits: Least number of significant digits.
    """
    texts: tuple[str, ...] = ()
    for count in range(digits, MOST_DIGITS + 1):
        texts = tuple(f"{value:.{count}g}" for value in values)
        if len(set(texts)) >= len(set(values)):
            break
    return texts


def _spell(shape: tuple[int | None, ...]) -> str:
    """Shape as text, with "any" for a length that is free: (any, 3)."""
    inner = ", ".join("any" if length is None else str(length) for length in shape)
    return f"({inner},)" if len(shape) == 1 else f"({inner})"
