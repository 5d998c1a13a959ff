"""Jacobians by central differences, to check analytic ones against."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

__all__ = ["central_differences"]

Array = np.ndarray


def central_differences(
    function: Callable[[Array], Array], x: Array, *, step: float = 1e-6
) -> Array:
    """Jacobian of a vector function, shape (m, n); its error is of second order in the step."""
    columns = []
    for i in range(len(x)):
        ahead, behind = x.copy(), x.copy()
        ahead[i] += step
        behind[i] -= step
        columns.append((function(ahead) - function(behind)) / (ahead[i] - behind[i]))
    return np.column_stack(columns)
