"""Support polygon, and the ZMP constraint as linear inequalities on the ground reaction wrench."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number, frozen_array, set_frozen_state
from zmp_sqp.errors import MachineError

__all__ = ["SupportPolygon"]

# sine of the angle between two edges up to which their common vertex counts as no corner: far
# above rounding, far below any real corner
STRAIGHT = 1e-9
REPEATED = 1e-9  # [m] distance below which two vertices count as one


@dataclass(frozen=True, slots=True, eq=False)
class SupportPolygon:
    """Convex polygon spanned by the ground contacts, in the plane z = height of the root frame.

    Edge i runs from vertex i to vertex i + 1 and lies on the line e_i . p = b_i. Edges are named by
    the axes of the root frame (REP-103: x forward, y left), see `edge_name`.

    Attributes:
        vertices: Vertices in the root frame, counter-clockwise seen from above, strictly convex,
            shape (V, 2) [m].
        height: z of the plane in the root frame [m].
        normals: Outward unit normals e_i of the edges, root frame, shape (V, 2).
        offsets: Distances b_i of the edges from the root origin along their normals, shape (V,)
            [m].
        reach: Largest distance of a vertex from the z axis of the root frame [m].

    Raises:
        MachineError: Fewer than three vertices, or vertices that are not finite, repeated,
            clockwise or not strictly convex; the message names the vertex.
    """

    vertices: Array
    height: float = 0.0
    normals: Array = field(init=False, repr=False)
    offsets: Array = field(init=False, repr=False)
    reach: float = field(init=False, repr=False)

    __setstate__ = set_frozen_state

    def __post_init__(self) -> None:
        vertices = frozen_array(
            self.vertices, name="support vertices", shape=(None, 2), error=MachineError
        )
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(
            self, "height", finite_number(self.height, name="support height", error=MachineError)
        )
        object.__setattr__(self, "reach", float(np.linalg.norm(vertices, axis=1).max(initial=0.0)))
        if len(vertices) < 3:
            raise MachineError(f"a support polygon needs at least 3 vertices, not {len(vertices)}")
        for i, vertex in enumerate(vertices):
            for j in np.flatnonzero(np.linalg.norm(vertices[:i] - vertex, axis=1) < REPEATED):
                raise MachineError(f"support vertex {i} at {vertex.tolist()} repeats vertex {j}")
        edges = np.roll(vertices, -1, axis=0) - vertices
        turns = _turns(edges)  # sine of the turn at the end of each edge
        if (turns < -STRAIGHT).all():
            raise MachineError(
                "support vertices must be counter-clockwise; "
                f"vertex 1 at {vertices[1].tolist()} turns right"
            )
        for edge in np.flatnonzero(turns <= STRAIGHT):
            at = (int(edge) + 1) % len(vertices)
            fault = (
                "is not a corner (straight line)"
                if abs(turns[edge]) <= STRAIGHT
                else "turns inwards"
            )
            raise MachineError(
                f"support polygon must be strictly convex, but vertex {at} at "
                f"{vertices[at].tolist()} {fault}"
            )
        # a star-shaped polygon turns left at every vertex, too, but by more than one full turn
        headings = np.unwrap(np.arctan2(edges[:, 1], edges[:, 0]))
        for edge in np.flatnonzero(headings - headings[0] > 2.0 * np.pi):
            at = vertices[edge].tolist()
            raise MachineError(
                f"support polygon crosses itself: before vertex {edge} at {at} "
                "it has gone full circle"
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
        """Convex hull of points; points inside the hull or on its edges are dropped.

        Args:
            points: Points in the root frame, shape (P, 2) [m].
            height: z of the support plane in the root frame [m].

        Raises:
            MachineError: Fewer than three points, or all on one line.
        """
        points = frozen_array(points, name="contact points", shape=(None, 2), error=MachineError)
        points = np.unique(points, axis=0)
        hull = _hull(points)
        while len(hull) > 2:
            with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # tiny, huge edges
                edges = np.roll(hull, -1, axis=0) - hull
                turns, lengths = np.roll(_turns(edges), 1), np.linalg.norm(edges, axis=1)
                keep = (turns > STRAIGHT) & (lengths >= REPEATED)
            if keep.all():
                return cls(hull, height)
            hull = hull[keep]
        raise MachineError(
            f"{len(points)} contact points span no support polygon: they lie on one line"
        )

    def edge_name(self, index: int) -> str:
        """Readable name of edge `index`.

        Front is where the root's x axis points (REP-103). For a machine whose URDF has y forward,
        its own front is the edge named 'left'.

        Returns:
            'front', 'left', 'rear' or 'right' on a rectangle, 'edge i' on any other polygon.
        """
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

        For a point outside it is the negative distance to the most violated edge *line*; beyond a
        corner this is less than the distance to the corner.

        Args:
            points: Points in the plane of the polygon, root frame, shape (..., 2) [m].

        Returns:
            Signed distances, shape (...) [m].
        """
        return np.asarray((self.offsets - points @ self.normals.T).min(axis=-1))

    def wrench_rows(self, margin: float = 0.0) -> Array:
        r"""Matrix C with C (f, tau) <= 0 if and only if the ZMP keeps a margin from every edge.

        The equivalence needs f_z > 0. With the support height h,

        .. math::
            \tau' = \tau - (0, 0, h) \times f, \quad p = (-\tau'_y, \tau'_x) / f_z, \quad
            (e \cdot p - b + margin) f_z = -e_x \tau'_y + e_y \tau'_x - (b - margin) f_z

        Args:
            margin: Least distance of the ZMP from every edge [m].

        Returns:
            One row per edge, shape (V, 6). The rows multiply the ground reaction wrench about the
            root origin, root axes [N, N m].
        """
        margin = finite_number(margin, name="margin", error=MachineError)
        rows = _distance_rows(self).copy()
        rows[:, 2] += margin
        return rows

    def inset(self, margin: float) -> SupportPolygon:
        """Polygon of the points that keep a margin from every edge of this one.

        Edges that do not bound the smaller polygon are dropped.

        Args:
            margin: Distance from every edge, at least 0 [m].

        Raises:
            MachineError: The margin is negative, or so large that no polygon is left.
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


@lru_cache(maxsize=64)
def _distance_rows(support: SupportPolygon) -> Array:
    """`SupportPolygon.wrench_rows` without a margin."""
    e_x, e_y = support.normals.T
    h, zero = support.height, np.zeros_like(e_x)
    # substituted: tau'_x = tau_x + h f_y and tau'_y = tau_y - h f_x
    return np.column_stack([h * e_x, h * e_y, -support.offsets, e_y, -e_x, zero])


def _hull(points: Array) -> Array:
    """Corners of the convex hull, counter-clockwise from the first point, shape (H, 2).

    Andrew's monotone chain (1979). Qhull finds the same corners, but is slow to import: it takes as
    long as a plan.

    Args:
        points: Distinct points, sorted by x, then by y, shape (P, 2).
    """

    def chain(ordered: list[list[float]]) -> list[list[float]]:
        kept: list[list[float]] = []
        for x, y in ordered:
            while len(kept) > 1:
                (x0, y0), (x1, y1) = kept[-2:]
                if (x1 - x0) * (y - y0) > (y1 - y0) * (x - x0):  # a turn to the left
                    break
                kept.pop()
            kept.append([x, y])
        return kept[:-1]

    ordered = points.tolist()
    return np.array(chain(ordered) + chain(ordered[::-1])).reshape(-1, 2)


def _turns(edges: Array) -> Array:
    """Sine of the angle from each edge to the next, positive to the left, shape (V,)."""
    ahead = np.roll(edges, -1, axis=0)
    lengths = np.linalg.norm(edges, axis=1)
    return np.asarray(
        (edges[:, 0] * ahead[:, 1] - edges[:, 1] * ahead[:, 0]) / (lengths * np.roll(lengths, -1))
    )


def _clip(corners: Array, normal: Array, offset: float) -> Array:
    """Part of a convex polygon where normal . p <= offset (Sutherland & Hodgman 1974)."""
    beyond = corners @ normal - offset
    kept = []
    for i, (corner, excess) in enumerate(zip(corners, beyond, strict=True)):
        before, excess_before = corners[i - 1], beyond[i - 1]
        if (excess > 0.0) != (excess_before > 0.0):
            kept.append(before + (corner - before) * excess_before / (excess_before - excess))
        if excess <= 0.0:
            kept.append(corner)
    return np.array(kept).reshape(-1, 2)
