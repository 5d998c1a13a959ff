"""Vectors and matrices whose entries are exact integers, balls, or power series of balls."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

__all__ = [
    "Matrix",
    "Scalar",
    "Vector",
    "cross",
    "derivative",
    "dot",
    "matrix_product",
    "plus",
    "product",
    "scaled",
    "times",
    "times_transposed",
    "vector_derivative",
    "vector_sum",
]

Scalar = Any  # 0, 1 or -1 as int: exact; `arb`; or `arb_series`
Vector = tuple[Scalar, Scalar, Scalar]
Matrix = tuple[Vector, Vector, Vector]  # rows


def product(a: Scalar, b: Scalar) -> Scalar:
    """Product; an exact 0, 1 or -1 costs nothing."""
    if a.__class__ is int:
        return 0 if a == 0 else (b if a == 1 else -b)
    if b.__class__ is int:
        return 0 if b == 0 else (a if b == 1 else -a)
    return a * b


def plus(a: Scalar, b: Scalar) -> Scalar:
    """Sum; an exact 0 costs nothing."""
    if a.__class__ is int and a == 0:
        return b
    if b.__class__ is int and b == 0:
        return a
    return a + b


def dot(a: Sequence[Scalar], b: Sequence[Scalar]) -> Scalar:
    """Inner product of two vectors."""
    total: Scalar = 0
    for x, y in zip(a, b, strict=True):
        total = plus(total, product(x, y))
    return total


def vector_sum(a: Vector, b: Vector) -> Vector:
    """Sum of two vectors."""
    return plus(a[0], b[0]), plus(a[1], b[1]), plus(a[2], b[2])


def scaled(factor: Scalar, a: Vector) -> Vector:
    """Vector times a number."""
    return product(factor, a[0]), product(factor, a[1]), product(factor, a[2])


def cross(a: Vector, b: Vector) -> Vector:
    """Cross product of two vectors."""
    return (
        plus(product(a[1], b[2]), product(-a[2], b[1])),
        plus(product(a[2], b[0]), product(-a[0], b[2])),
        plus(product(a[0], b[1]), product(-a[1], b[0])),
    )


def times(A: Matrix, x: Vector) -> Vector:
    """A x."""
    return dot(A[0], x), dot(A[1], x), dot(A[2], x)


def times_transposed(A: Matrix, x: Vector) -> Vector:
    """A^T x."""
    columns = tuple(zip(*A, strict=True))
    return dot(columns[0], x), dot(columns[1], x), dot(columns[2], x)


def matrix_product(A: Matrix, B: Matrix) -> Matrix:
    """A B."""
    columns = tuple(zip(*B, strict=True))
    rows = [tuple(dot(row, column) for column in columns) for row in A]
    return rows[0], rows[1], rows[2]


def derivative(x: Scalar) -> Scalar:
    """Derivative of a series by its variable; zero for a constant."""
    return x.derivative() if hasattr(x, "derivative") else 0


def vector_derivative(a: Vector) -> Vector:
    """Derivatives of the entries of a vector."""
    return derivative(a[0]), derivative(a[1]), derivative(a[2])
