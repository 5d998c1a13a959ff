from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import RectBivariateSpline

from tests.mechanics.conftest import MAP_ORIGIN, MAP_X, MAP_Y, RESOLUTION, random_drive
from zmp_sqp.errors import MachineError, ProblemError
from zmp_sqp.mechanics.ground import Ground
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.terrain.heightmap import Heightmap
from zmp_sqp.mechanics.terrain.spline_surface import SplineSurface

COUNT = 40


def test_the_surface_goes_through_the_samples(rolling: Heightmap) -> None:
    rows, columns = np.mgrid[: len(MAP_Y), : len(MAP_X)]
    poses = np.column_stack([MAP_X[columns.ravel()], MAP_Y[rows.ravel()], np.zeros(rows.size)])
    positions, _ = rolling.base_pose(poses)
    np.testing.assert_allclose(positions[:, 2], rolling.heights.ravel(), atol=1e-12)


def test_the_spline_and_all_its_derivatives_are_those_of_scipy() -> None:
    random = np.random.default_rng(4)
    x, y = 0.5 * np.arange(9) - 3.0, 0.5 * np.arange(7) + 1.0
    heights = random.normal(size=(7, 9))
    at_x, at_y = random.uniform(x[0], x[-1], COUNT), random.uniform(y[0], y[-1], COUNT)
    derivatives = SplineSurface.through(heights, x, y).derivatives(at_x, at_y)
    oracle = RectBivariateSpline(x, y, heights.T, kx=5, ky=5, s=0.0)
    for i, j in np.ndindex(5, 5):
        expected = oracle.ev(at_x, at_y, dx=i, dy=j)
        np.testing.assert_allclose(
            derivatives[:, i, j], expected, rtol=0.0, atol=1e-11 * np.abs(expected).max()
        )


def test_acceleration_is_smooth_across_the_samples() -> None:
    heights = 0.1 * np.random.default_rng(0).normal(size=(12, 12))
    rough = Heightmap(heights, 1.0)
    motions = []
    for offset in (-1e-9, 1e-9):
        pose = np.array([[5.0 + offset, 4.3, 0.4], [5.6, 6.0 + offset, -1.0]])
        motions.append(rough.base_motion(pose, np.ones((2, 2)), np.ones((2, 2))))
    for name in motions[0].__dataclass_fields__:
        np.testing.assert_allclose(
            getattr(motions[0], name), getattr(motions[1], name), atol=1e-6, err_msg=name
        )


def test_heights_come_back_from_files(tmp_path: Path, rolling: Heightmap) -> None:
    np.save(tmp_path / "map.npy", rolling.heights)
    np.savetxt(tmp_path / "map.csv", rolling.heights, delimiter=",", fmt="%.17g")
    pose, rates, accelerations = random_drive(COUNT, seed=3)
    expected = rolling.base_motion(pose, rates, accelerations)
    for read in (
        Heightmap.from_npy(tmp_path / "map.npy", RESOLUTION, MAP_ORIGIN),
        Heightmap.from_csv(str(tmp_path / "map.csv"), RESOLUTION, MAP_ORIGIN),
        pickle.loads(pickle.dumps(rolling)),
    ):
        np.testing.assert_array_equal(
            read.base_motion(pose, rates, accelerations).acceleration, expected.acceleration
        )
        np.testing.assert_array_equal(read.extent, [[MAP_X[0], MAP_Y[0]], [MAP_X[-1], MAP_Y[-1]]])


def test_a_heightmap_is_a_ground(rolling: Heightmap) -> None:
    assert isinstance(rolling, Ground)
    assert "[" not in repr(rolling)


# --- errors ------------------------------------------------------------------------------------

FLAT = np.zeros((7, 8))
HOLE = FLAT.copy()
HOLE[2, 5] = np.nan


@pytest.mark.parametrize(
    ("heights", "resolution", "origin", "message"),
    [
        (HOLE, 1.0, (0, 0), r"entry \[2, 5\] is nan"),
        (FLAT[:5], 1.0, (0, 0), r"at least 6 rows and columns, not shape \(5, 8\)"),
        (FLAT[:, :5], 1.0, (0, 0), r"shape \(7, 5\)"),
        (FLAT[0], 1.0, (0, 0), "must have shape"),
        ("flat", 1.0, (0, 0), "must be numbers"),
        (FLAT, 0.0, (0, 0), "resolution must be positive, not 0.0"),
        (FLAT, -1.0, (0, 0), "resolution must be positive"),
        (FLAT, np.nan, (0, 0), "resolution must be finite"),
        (FLAT, 1.0, (0, np.inf), r"origin must be finite, but entry \[1\]"),
        (FLAT, 1.0, 3.0, "origin must have shape"),
        (
            FLAT + 1e300,
            1e-300,
            (0, 0),
            r"heights of up to 1e\+300 m at a resolution of 1e-300 m .* beyond what",
        ),
        (FLAT, 1e-60, (0, 0), "beyond what can be computed with"),
        (FLAT, 1e300, (0, 0), "beyond what can be computed with"),
        (FLAT, 1.0, (1e20, 0), "beyond what can be computed with"),
        (FLAT, 1.0, (1.7e308, 0), "beyond what can be computed with"),
    ],
)
def test_impossible_maps_are_refused(
    heights: object, resolution: float, origin: object, message: str
) -> None:
    with pytest.raises(MachineError, match=message):
        Heightmap(heights, resolution, origin)


def test_unreadable_files_are_named(tmp_path: Path) -> None:
    (tmp_path / "words.csv").write_text("1,2,three\n")
    (tmp_path / "words.npy").write_text("no array")
    (tmp_path / "empty.npy").write_text("")
    for read, name in (
        (Heightmap.from_csv, "missing.csv"),
        (Heightmap.from_csv, "words.csv"),
        (Heightmap.from_npy, "words.npy"),
        (Heightmap.from_npy, "empty.npy"),
    ):
        with pytest.raises(MachineError, match=name):
            read(tmp_path / name, 1.0)


@pytest.mark.parametrize(
    "place", [(-3.1, 5.0), (26.6, 5.0), (0.0, 0.9), (0.0, 26.0), (np.nan, 5.0)]
)
def test_leaving_the_map_is_an_error_that_says_where(
    rolling: Heightmap, place: tuple[float, float]
) -> None:
    pose = np.array([[0.0, 5.0, 0.0], [*place, 0.0]])
    zero = np.zeros((2, 2))
    covered = "the map covers x from -3 to 26.5 m and y from 1 to 25.5 m"
    where = rf"\({place[0]:.3f}, {place[1]:.3f}\) m; {covered}"
    for call in (
        lambda: rolling.base_motion(pose, zero, zero),
        lambda: rolling.ground_rates(pose, zero),
        lambda: rolling.base_pose(pose),
        lambda: rolling.slope_at(*place),
    ):
        with pytest.raises(ProblemError, match=where):
            call()


def test_the_rim_of_the_map_is_on_the_map(rolling: Heightmap) -> None:
    corners = np.column_stack([np.add(rolling.extent, [[-1e-4], [1e-4]]), np.zeros(2)])
    assert np.isfinite(rolling.base_pose(corners)[0]).all()


def test_rough_ground_is_an_error_that_says_where_and_by_how_much(feller_buncher: Machine) -> None:
    support = feller_buncher.support
    heights = 0.3 * np.exp(-((MAP_X[None, :] - 15.0) ** 2 + (MAP_Y[:, None] - 12.0) ** 2) / 2.0)
    mound = Heightmap(heights, RESOLUTION, MAP_ORIGIN)
    path = np.column_stack([np.linspace(2.0, 20.0, 30), np.full(30, 12.0), np.zeros(30)])
    mound.check_followable(support, path[:8])
    with pytest.raises(
        ProblemError,
        match=r"\(1\d\.\d\d, 1\d\.\d\d\) m, under the base at pose \d+: .* m more than",
    ):
        mound.check_followable(support, path)
    mound.check_followable(support, path, clearance=5.0)


def test_the_bound_on_a_round_hill_is_its_sag(feller_buncher: Machine) -> None:
    bend = 0.02  # [1/m]
    heights = -0.5 * bend * ((MAP_X[None, :] - 12.0) ** 2 + (MAP_Y[:, None] - 12.0) ** 2)
    hill, top = Heightmap(heights, RESOLUTION, MAP_ORIGIN), np.array([[12.0, 12.0, 0.7]])
    sag = 0.5 * bend * np.max(np.sum(feller_buncher.support.vertices**2, axis=1))
    hill.check_followable(feller_buncher.support, top, clearance=sag + 1e-6)
    with pytest.raises(ProblemError, match=r"curves with a radius of 50\.00 m"):
        hill.check_followable(feller_buncher.support, top, clearance=sag - 1e-6)


def test_tracks_beyond_the_rim_are_an_error(rolling: Heightmap, feller_buncher: Machine) -> None:
    with pytest.raises(ProblemError, match="a track leaves the map"):
        rolling.check_followable(feller_buncher.support, np.array([[-2.0, 5.0, 0.0]]))
