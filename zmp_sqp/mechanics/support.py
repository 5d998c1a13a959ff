"""The support polygon, and its edges as linear rows on the ground reaction wrench."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number, frozen_array
from zmp_sqp.errors import MachineError

__all__ = ["SupportPolygon"]

# sine of the angle between two edges below which a vertex counts as lying on a straight line
STRAIGHT = 1e-9
REPEATED = 1e-9  # [m], vertices closer than this are the same


@dataclass(frozen=True, slots=True, eq=False)
class SupportPolygon:
    """Convex polygon of the ground contacts, in a plane z = height of the root frame.

    Edge i runs from vertex i to vertex i + 1 and is the line e_i . p = b_i.

    Attributes:
        vertices: Corners in the root frame, counter-clockwise seen from above, strictly convex,
            shape (V, 2) [m].
        height: z of the plane in the root frame [m].
        normals: Outward unit normals e_i of the edges, shape (V, 2).
        offsets: Offsets b_i of the edges from the root origin along their normals, shape (V,) [m].

    Raises:
        MachineError: Fewer than three vertices, not finite, repeated, clockwise or not convex; the
            message names the vertex.
    """

    vertices: Array
    height: float = 0.0
    normals: Array = field(init=False, repr=False)
    offsets: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        vertices = frozen_array(
            self.vertices, name="support vertices", shape=(None, 2), error=MachineError
        )
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(
            self, "height", finite_number(self.height, name="support height", error=MachineError)
        )
        if len(vertices) < 3:
            raise MachineError(f"a support polygon needs at least 3 vertices, not {len(vertices)}")
        for i, vertex in enumerate(vertices):
            for j in np.flatnonzero(np.linalg.norm(vertices[:i] - vertex, axis=1) < REPEATED):
                raise MachineError(f"support vertex {i} at {vertex.tolist()} repeats vertex {j}")
        edges = np.roll(vertices, -1, axis=0) - vertices
        turns = _turns(edges)  # sine of the turn at the end of each edge
        if (turns < -STRAIGHT).all():
            raise MachineError(
                f"support vertices must be counter-clockwise; vertex 1 at {vertices[1].tolist()} turns right"
            )
        for edge in np.flatnonzero(turns <= STRAIGHT):
            at = (int(edge) + 1) % len(vertices)
            fault = (
                "is not a corner (straight line)"
                if abs(turns[edge]) <= STRAIGHT
                else "turns inwards"
            )
            raise MachineError(
                f"support polygon must be strictly convex, but vertex {at} at {vertices[at].tolist()} {fault}"
            )
        headings = np.unwrap(np.arctan2(edges[:, 1], edges[:, 0]))
        for edge in np.flatnonzero(
            headings - headings[0] > 2.0 * np.pi
        ):  # a star turns left all the way, but twice round
            at = vertices[edge].tolist()
            raise MachineError(
                f"support polygon crosses itself: before vertex {edge} at {at} it has gone full circle"
            )
        outward = (
            np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
        )
        offsets = np.einsum("ij,ij->i", outward, vertices)
        for name, values in (("normals", outward), ("offsets", offsets)):
            object.__setattr__(
                self, name, frozen_array(values, name=name, shape=values.shape, error=MachineError)
            )

    @classmethod
    def convex_hull(cls, points: Any, height: float = 0.0) -> SupportPolygon:
        """Smallest convex polygon around points; points inside it or on its edges are dropped.

        Args:
            points: Shape (P, 2), root frame [m].
            height: z of the plane in the root frame [m].

        Raises:
            MachineError: Fewer than three points, or all on one line.
        """
        from scipy.spatial import ConvexHull, QhullError  # slow to import, and only needed here

        points = frozen_array(points, name="contact points", shape=(None, 2), error=MachineError)
        points = np.unique(points, axis=0)
        try:
            hull = points[ConvexHull(points).vertices]  # counter-clockwise
        except (QhullError, ValueError):
            raise MachineError(
                f"{len(points)} contact points span no support polygon: they lie on one line"
            ) from None
        while True:
            edges = np.roll(hull, -1, axis=0) - hull
            keep = (np.roll(_turns(edges), 1) > STRAIGHT) & (
                np.linalg.norm(edges, axis=1) >= REPEATED
            )
            if keep.all():
                return cls(hull, height)
            if keep.sum() < 3:
                raise MachineError(
                    f"{len(points)} contact points span no support polygon: they lie on one line"
                )
            hull = hull[keep]

    @property
    def reach(self) -> float:
        """Distance of the farthest corner from the root's vertical axis [m]."""
        return float(np.linalg.norm(self.vertices, axis=1).max())

    def edge_name(self, index: int) -> str:
        """Name of an edge for people: 'front', 'left', 'rear', 'right' on rectangles, 'edge i' otherwise."""
        normals = self.normals
        if (
            len(normals) != 4
            or np.abs(np.einsum("ij,ij->i", normals, np.roll(normals, 1, axis=0))).max() > 1e-6
        ):
            return f"edge {index}"
        front = int(np.argmax(normals[:, 0]))
        return ("front", "left", "rear", "right")[(index - front) % 4]

    def signed_distance(self, points: Array) -> Array:
        r"""Distance from points to the nearest edge, positive inside.

        .. math:: \min_i (b_i - e_i \cdot p)

        Outside a corner it is the (negative) distance to the edge *line* most violated, not to the
        corner.

        Args:
            points: In the plane of the polygon, root frame, shape (..., 2) [m].

        Returns:
            Shape (...) [m].
        """
        return np.asarray((self.offsets - points @ self.normals.T).min(axis=-1))

    def wrench_rows(self, margin: float = 0.0) -> Array:
        r"""Rows C with C (f, tau) <= 0 exactly where the ZMP keeps a margin from every edge, given f_z > 0.

        .. math::
            \tau' = \tau - (0, 0, h) \times f, \quad p = (-\tau'_y, \tau'_x) / f_z, \quad
            (e \cdot p - b + margin) f_z = -e_x \tau'_y + e_y \tau'_x - (b - margin) f_z

        Args:
            margin: Distance kept from every edge [m].

        Returns:
            Shape (V, 6), for the ground reaction wrench about the root origin, root axes [N, N m].
        """
        margin = finite_number(margin, name="margin", error=MachineError)
        e_x, e_y = self.normals.T
        zero = np.zeros_like(e_x)
        # tau'_x = tau_x + h f_y, tau'_y = tau_y - h f_x
        return np.column_stack(
            [self.height * e_x, self.height * e_y, margin - self.offsets, e_y, -e_x, zero]
        )

    def inset(self, margin: float) -> SupportPolygon:
        """The polygon of the points that keep a margin from every edge; edges that no longer bound it are dropped.

        Args:
            margin: At least 0 [m].

        Raises:
            MachineError: Negative margin, or nothing is left.
        """
        margin = finite_number(margin, name="margin", error=MachineError)
        if margin < 0.0:
            raise MachineError(f"margin must not be negative, not {margin} m")
        corners = self.vertices
        for normal, offset in zip(self.normals, self.offsets - margin, strict=True):
            corners = _clip(corners, normal, offset)
            if len(corners) < 3:
                break
        try:
            return SupportPolygon.convex_hull(corners, self.height)
        except MachineError:
            raise MachineError(
                f"a margin of {margin} m leaves nothing of the support polygon"
            ) from None


def _turns(edges: Array) -> Array:
    """Sine of the turn between each edge and the next, positive to the left, shape (V,)."""
    ahead = np.roll(edges, -1, axis=0)
    lengths = np.linalg.norm(edges, axis=1)
    return np.asarray(
        (edges[:, 0] * ahead[:, 1] - edges[:, 1] * ahead[:, 0]) / (lengths * np.roll(lengths, -1))
    )


def _clip(corners: Array, normal: Array, offset: float) -> Array:
    """Part of a convex polygon with normal . p <= offset (Sutherland and Hodgman 1974)."""
    beyond = corners @ normal - offset
    kept = []
    for i, (corner, excess) in enumerate(zip(corners, beyond, strict=True)):
        before, excess_before = corners[i - 1], beyond[i - 1]
        if (excess > 0.0) != (excess_before > 0.0):
            kept.append(before + (corner - before) * excess_before / (excess_before - excess))
        if excess <= 0.0:
            kept.append(corner)
    return np.array(kept).reshape(-1, 2)
