"""Fewer triangles for a surface: its vertices are merged on a grid."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array, Indices

__all__ = ["coarsened"]

FINEST, COARSEST = 1024, 4  # cells along the longest side of a surface
LEAST = 12  # triangles that every surface may have


def coarsened(points: Array, faces: Indices, most: int) -> tuple[Array, Indices]:
    """Surface with at most so many triangles, or as few as the coarsest grid leaves.

    The vertices in a cell of a cubic grid become their mean (Rossignac & Borrel 1993); triangles
    without area are dropped. The grid is coarsened by quarters until few enough triangles remain.

    Args:
        points: Vertices, shape (P, 3) [m].
        faces: Vertices of each triangle, shape (F, 3).
        most: Number of triangles to keep at most; every surface may have twelve.
    """
    low = points.min(axis=0)
    extent = float((points.max(axis=0) - low).max()) or 1.0
    cells = FINEST
    while True:
        merged, left = _merged(points, faces, np.rint((points - low) * (cells / extent)))
        if len(left) <= max(most, LEAST) or cells <= COARSEST:
            return merged, left
        cells = 3 * cells // 4


def _merged(points: Array, faces: Indices, cell: Array) -> tuple[Array, Indices]:
    """Means of the vertices of each cell, and the triangles between different ones."""
    _, number, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    number = number.reshape(-1)
    means = np.stack(
        [np.bincount(number, weights=column, minlength=len(count)) for column in points.T], axis=1
    )
    corners = number[faces]
    a, b, c = corners.T
    corners = corners[(a != b) & (b != c) & (a != c)]
    _, first = np.unique(np.sort(corners, axis=1), axis=0, return_index=True)
    kept = corners[np.sort(first)]
    used, renumbered = np.unique(kept, return_inverse=True)
    return (means / count[:, None])[used], renumbered.reshape(-1, 3)
