"""Jacobians and Hessians by differences, to check analytic ones against."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

__all__ = ["central_differences", "second_differences", "symmetric"]

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


def second_differences(
    function: Callable[[Array], float], x: Array, *, step: float = 1e-4
) -> Array:
    """Hessian of a scalar function, shape (n, n); its error is of second order in the step."""
    n = len(x)
    moves = step * np.eye(n)
    here = function(x)
    ahead = np.array([function(x + move) for move in moves])
    behind = np.array([function(x - move) for move in moves])
    H = np.diag(ahead - 2.0 * here + behind)
    for i in range(n):
        for j in range(i):
            both = function(x + moves[i] + moves[j]) + function(x - moves[i] - moves[j])
            # to second order in both steps: what the steps one by one contribute cancels
            mixed = both - ahead[i] - behind[i] - ahead[j] - behind[j] + 2.0 * here
            H[i, j] = H[j, i] = 0.5 * mixed
    return H / step**2


def symmetric(upper: Any) -> Array:
    """A symmetric matrix as an array, from its sparse upper triangle."""
    half = upper.toarray()
    return np.asarray(half + half.T - np.diag(np.diag(half)))
