from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.support import SupportPolygon

RECTANGLE = [[-2.5, -1.615], [2.5, -1.615], [2.5, 1.615], [-2.5, 1.615]]
TRIANGLE = [[0.0, 0.0], [2.0, 0.0], [0.0, 1.0]]
CLOSE = 1e-9  # [m], nearer to an edge than this the sign is rounding
STAR = [[np.cos(t), np.sin(t)] for t in 4 * np.pi / 5 * np.arange(5)]


@pytest.mark.parametrize(
    ("vertices", "named"),
    [
        ([[0, 0], [1, 0]], "at least 3 vertices, not 2"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "shape"),
        ([[0, 0], [1, np.nan], [0, 1]], "entry [1, 1] is nan"),
        ([[0, 0], [np.inf, 0], [0, 1]], "entry [1, 0] is inf"),
        ([[0, 0], [1, 0], [1, 0], [0, 1]], "vertex 2 at [1.0, 0.0] repeats vertex 1"),
        ([[0, 0], [1, 0], [0, 1], [0, 0]], "vertex 3 at [0.0, 0.0] repeats vertex 0"),
        ([[0, 0], [0, 1], [1, 0]], "counter-clockwise"),
        ([[0, 0], [2, 0], [1, 0.5], [0, 2]], "vertex 2 at [1.0, 0.5] turns inwards"),
        ([[0, 0], [1, 0], [2, 0], [0, 2]], "vertex 1 at [1.0, 0.0] is not a corner"),
        ([[0, 0], [1, 1], [1, 0], [0, 1]], "strictly convex, but vertex"),
        (STAR, "crosses itself"),
        ("square", "numbers"),
    ],
    ids=[
        "few",
        "3d",
        "nan",
        "inf",
        "repeated",
        "closed",
        "clockwise",
        "dent",
        "straight",
        "bow tie",
        "star",
        "text",
    ],
)
def test_bad_polygons_are_refused_by_vertex(vertices: object, named: str) -> None:
    with pytest.raises(MachineError, match=re.escape(named)):
        SupportPolygon(vertices)


def test_bad_height_is_refused() -> None:
    with pytest.raises(MachineError, match="height"):
        SupportPolygon(RECTANGLE, height=np.nan)


def test_edges_of_a_rectangle_have_names() -> None:
    polygon = SupportPolygon(RECTANGLE)
    assert [polygon.edge_name(i) for i in range(4)] == ["right", "front", "left", "rear"]
    np.testing.assert_allclose(polygon.offsets, [1.615, 2.5, 1.615, 2.5])
    np.testing.assert_allclose(polygon.normals, [[0, -1], [1, 0], [0, 1], [-1, 0]])
    assert SupportPolygon(TRIANGLE).edge_name(1) == "edge 1"


def test_vertices_cannot_be_written_to() -> None:
    with pytest.raises(ValueError, match="read-only"):
        SupportPolygon(RECTANGLE).vertices[0, 0] = 9.0


def test_outside_a_corner_the_distance_is_to_the_edge_line_most_violated() -> None:
    assert SupportPolygon(RECTANGLE).signed_distance(np.array([4.5, 2.615])) == pytest.approx(-2.0)
    assert SupportPolygon(RECTANGLE).signed_distance(np.zeros((3, 2))).tolist() == pytest.approx(
        [1.615] * 3
    )


def test_hull_drops_inner_and_collinear_points() -> None:
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 5), np.linspace(-2, 2, 5)), axis=-1).reshape(
        -1, 2
    )
    hull = SupportPolygon.convex_hull(grid, height=0.2)
    assert sorted(hull.vertices.tolist()) == [[-1, -2], [-1, 2], [1, -2], [1, 2]]
    assert hull.height == 0.2


@pytest.mark.parametrize("seed", range(20))
def test_hull_has_the_corners_that_qhull_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, 40))
    clouds = (
        rng.normal(size=(rng.integers(3, 12), 2)),
        rng.uniform(-3.0, 3.0, (2000, 2)),
        rng.integers(-4, 5, (60, 2)).astype(float),  # collinear and repeated points
        np.column_stack([np.cos(angle), np.sin(angle)]) + rng.normal(size=2),
        rng.uniform(-1.0, 1.0, (300, 2)) * [1e3, 1e-3] + 1e3,
    )
    for points in clouds:
        found = SupportPolygon.convex_hull(points).vertices
        expected = points[ConvexHull(points).vertices]
        np.testing.assert_array_equal(found, np.roll(found, -np.lexsort(found.T[::-1])[0], axis=0))
        start = np.lexsort(expected.T[::-1])[0]
        np.testing.assert_array_equal(found, np.roll(expected, -start, axis=0))


@pytest.mark.parametrize(
    "points", [[[0, 0], [1, 1]], [[0, 0], [1, 1], [2, 2], [3, 3]], [[1, 1]] * 5, []]
)
def test_points_on_a_line_span_no_polygon(points: list[list[float]]) -> None:
    with pytest.raises(MachineError):
        SupportPolygon.convex_hull(points)


def test_inset_keeps_the_margin_and_drops_edges_that_no_longer_bound() -> None:
    inner = SupportPolygon(RECTANGLE).inset(0.5)
    assert sorted(inner.vertices.tolist()) == [
        [-2.0, -1.115],
        [-2.0, 1.115],
        [2.0, -1.115],
        [2.0, 1.115],
    ]
    cut = SupportPolygon([[0, 0], [4, 0], [4, 3.9], [3.9, 4], [0, 4]])  # the bevel is 0.14 m long
    assert len(cut.vertices) == 5
    assert len(cut.inset(0.5).vertices) == 4
    for margin in (1.615, 3.0):
        with pytest.raises(MachineError, match=f"margin of {margin} m leaves nothing"):
            SupportPolygon(RECTANGLE).inset(margin)
    with pytest.raises(MachineError, match="must not be negative"):
        SupportPolygon(RECTANGLE).inset(-0.1)


coordinates = st.floats(-5.0, 5.0).map(lambda x: round(x, 3))
hulls = st.lists(st.tuples(coordinates, coordinates), min_size=3, max_size=12)


def hull_of(points: list[tuple[float, float]], height: float) -> SupportPolygon:
    try:
        return SupportPolygon.convex_hull(points, height)
    except MachineError:
        assume(False)
        raise


def ray_crossings(vertices: np.ndarray, point: np.ndarray) -> int:
    """How often a ray to the right of the point crosses the outline; odd is inside."""
    ahead = np.roll(vertices, -1, axis=0)
    straddles = (vertices[:, 1] > point[1]) != (ahead[:, 1] > point[1])
    rise = np.where(straddles, ahead[:, 1] - vertices[:, 1], 1.0)
    at = vertices[:, 0] + (point[1] - vertices[:, 1]) / rise * (ahead[:, 0] - vertices[:, 0])
    return int(np.sum(straddles & (at > point[0])))


@given(
    points=hulls,
    point=st.tuples(coordinates, coordinates),
    height=st.floats(-1, 1),
    force=st.floats(1.0, 1e5),
)
def test_wrench_rows_are_negative_exactly_where_the_point_is_inside(
    points: list[tuple[float, float]], point: tuple[float, float], height: float, force: float
) -> None:
    polygon = hull_of(points, height)
    p = np.array([*point, height])
    f = np.array([0.3 * force, -0.2 * force, force])
    # a vertical moment does not matter
    wrench = np.concatenate([f, np.cross(p, f) + np.array([0.0, 0.0, 7.0])])
    rows = polygon.wrench_rows() @ wrench / force  # distances beyond the edge lines [m]
    assume(np.abs(rows).min() > CLOSE)
    assert bool((rows <= 0.0).all()) == bool(ray_crossings(polygon.vertices, p[:2]) % 2)
    np.testing.assert_allclose(-rows.max(), polygon.signed_distance(p[:2]), atol=CLOSE)
    np.testing.assert_allclose(polygon.wrench_rows(0.25) @ wrench / force, rows + 0.25, atol=CLOSE)


@given(points=hulls, point=st.tuples(coordinates, coordinates), margin=st.floats(0.0, 2.0))
def test_inset_holds_exactly_the_points_that_keep_the_margin(
    points: list[tuple[float, float]], point: tuple[float, float], margin: float
) -> None:
    polygon = hull_of(points, 0.0)
    distance = float(polygon.signed_distance(np.array(point)))
    assume(abs(distance - margin) > 1e-6)
    try:
        inner = polygon.inset(margin)
    except MachineError:
        assert distance < margin
        return
    assert (inner.signed_distance(np.array(point)) > 0.0) == (distance > margin)
