"""Terrain given as heights on a regular grid, with a smooth surface through them."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number, frozen_array
from zmp_sqp.errors import MachineError, ProblemError
from zmp_sqp.mechanics.ground import CLEARANCE, Slope
from zmp_sqp.mechanics.ground_motion import GroundMotion, GroundRates
from zmp_sqp.mechanics.support import SupportPolygon
from zmp_sqp.mechanics.terrain.spline_bounds import derivative_bounds
from zmp_sqp.mechanics.terrain.spline_surface import DEGREE, WIDTH, SplineSurface
from zmp_sqp.mechanics.terrain.surface_drive import drive_on_surface, ground_rates_on_surface
from zmp_sqp.mechanics.terrain.surface_frame import SurfaceFrame

__all__ = ["Heightmap"]

# [m] strip beyond the outermost samples that still counts as on the map, because solvers satisfy
# the bounds on x and y to a tolerance only
RIM = 1e-3
ORIGIN = (0.0, 0.0)  # [m] default position of the first sample
# [m, or m^(1 - k) for k-th derivatives] largest height or derivative: squares of products of larger
# ones overflow
LARGEST = 1e30
# number of ground points checked under the tracks along one path, to limit time and memory; at
# least two per edge and step are checked on any path
MOST_POINTS = 200_000


@dataclass(frozen=True, slots=True, eq=False)
class Heightmap:
    r"""Terrain z = h(x, y): a spline surface of degree five through heights on a regular grid.

    The ground frame is the frame of the map: x and y are horizontal and z points up, against
    gravity. The root of a base with pose (x, y, yaw) is at (x, y, h(x, y)), and its rotation is

    .. math:: R = R_y(pitch) R_x(roll) R_z(yaw)

    with the roll and pitch for which the z axis of R is the surface normal. Speeds and
    accelerations are measured along the surface. A map of a plane describes the same ground as a
    `Slope` of this roll and pitch, but with other coordinates: the (x, y) of a Heightmap are
    horizontal, those of a Slope lie in the plane.

    The fourth derivative of the spline is continuous. Hence the first derivatives of the base's
    twist and acceleration are continuous, and their second derivatives jump where the base crosses
    a row or column of samples.

    Attributes:
        heights: Height samples, shape (ny, nx) with at least six rows and columns [m].
            heights[row, column] is the height at x = origin[0] + column * resolution and
            y = origin[1] + row * resolution; the first row has the lowest y, unlike in most images.
        resolution: Distance between neighbouring samples [m].
        origin: (x, y) of heights[0, 0] [m].

    Raises:
        MachineError: Too few samples, an entry that is not finite, a resolution that is not
            positive, or numbers so large or so far apart that derivatives overflow or neighbouring
            samples coincide.
    """

    heights: Array = field(repr=False)
    resolution: float
    origin: tuple[float, float] = ORIGIN
    _surface: SplineSurface = field(init=False, repr=False)

    def __post_init__(self) -> None:
        heights = frozen_array(self.heights, name="heights", shape=(None, None), error=MachineError)
        if min(heights.shape) < WIDTH:
            raise MachineError(
                f"heights must have at least {WIDTH} rows and columns, not shape {heights.shape}"
            )
        resolution = finite_number(self.resolution, name="heightmap resolution", error=MachineError)
        if resolution <= 0.0:
            raise MachineError(f"heightmap resolution must be positive, not {resolution} m")
        origin = frozen_array(self.origin, name="heightmap origin", shape=(2,), error=MachineError)
        highest, farthest = float(np.abs(heights).max()), float(np.abs(origin).max())
        # bounds the fifth derivative, too
        computable = max(highest, 1.0) <= LARGEST * min(resolution, 1.0) ** DEGREE
        axes = []
        if computable and max(farthest, resolution) <= LARGEST:
            axes = [
                start + resolution * np.arange(n)
                for start, n in zip(origin[::-1], heights.shape, strict=True)
            ]
        if not axes or not all((np.diff(axis) > 0.0).all() for axis in axes):
            raise MachineError(
                f"heights of up to {highest:.3g} m at a resolution of {resolution:.3g} m from the "
                f"origin ({origin[0]:.3g}, {origin[1]:.3g}) m on are beyond what can be computed "
                "with: give all of them in metres"
            )
        y, x = axes
        object.__setattr__(self, "heights", heights)
        object.__setattr__(self, "resolution", resolution)
        object.__setattr__(self, "origin", (float(origin[0]), float(origin[1])))
        object.__setattr__(self, "_surface", SplineSurface.through(heights, x, y))

    def __reduce__(self) -> tuple[type[Heightmap], tuple[Any, ...]]:
        # pickled without the surface, which is larger than the heights and quick to compute
        return Heightmap, (self.heights, self.resolution, self.origin)

    @classmethod
    def from_csv(
        cls, path: str | os.PathLike[str], resolution: float, origin: tuple[float, float] = ORIGIN
    ) -> Heightmap:
        """Terrain from a text file of heights.

        Args:
            path: File with one row of heights per line, numbers separated by commas, no header;
                `#` starts a comment.
            resolution: Distance between neighbouring samples [m].
            origin: (x, y) of the first number in the file [m].

        Raises:
            MachineError: No such file, not a table of numbers, or heights that `Heightmap` refuses.
        """
        return cls(
            _read(path, lambda file: np.loadtxt(file, delimiter=",", ndmin=2)), resolution, origin
        )

    @classmethod
    def from_npy(
        cls, path: str | os.PathLike[str], resolution: float, origin: tuple[float, float] = ORIGIN
    ) -> Heightmap:
        """Terrain from an array of heights in NumPy's .npy format.

        Args:
            path: File with an array of shape (ny, nx) [m].
            resolution: Distance between neighbouring samples [m].
            origin: (x, y) of the array's first entry [m].

        Raises:
            MachineError: No such file, not an array of numbers, or heights that `Heightmap`
                refuses.
        """
        return cls(_read(path, lambda file: np.load(file, allow_pickle=False)), resolution, origin)

    @classmethod
    def from_file(
        cls, path: str | os.PathLike[str], resolution: float, origin: tuple[float, float] = ORIGIN
    ) -> Heightmap:
        """Terrain from a .npy file (see `from_npy`) or, for any other suffix, from a text file.

        Args:
            path: File of heights; for the text format see `from_csv`.
            resolution: Distance between neighbouring samples [m].
            origin: (x, y) of the first height in the file [m].

        Raises:
            MachineError: No such file, not a table of numbers, or heights that `Heightmap` refuses.
        """
        read = cls.from_npy if Path(path).suffix == ".npy" else cls.from_csv
        return read(path, resolution, origin)

    @property
    def extent(self) -> Array:
        """Lowest and highest (x, y) on the map, shape (2, 2) [m]."""
        rows, columns = self.heights.shape
        return np.array(self.origin) + self.resolution * np.array(
            [[0.0, 0.0], [columns - 1.0, rows - 1.0]]
        )

    def check_on(self, positions: Array, *, what: str = "the base") -> None:
        """Raise ProblemError if any position lies off the map.

        Args:
            positions: (x, y), shape (K, 2) or wider [m]; further columns are ignored.
            what: Name of the thing at these positions, for the error message.

        Raises:
            ProblemError: A position is not on the map; the message gives the first such position.
        """
        low, high = self.extent
        x, y = positions[:, 0], positions[:, 1]
        on_map = (
            (x >= low[0] - RIM) & (x <= high[0] + RIM) & (y >= low[1] - RIM) & (y <= high[1] + RIM)
        )
        if not on_map.all():
            at = positions[int(np.argmin(on_map))]
            raise ProblemError(
                f"{what} leaves the map at (x, y) = ({at[0]:.3f}, {at[1]:.3f}) m; the map covers "
                f"x from {low[0]:g} to {high[0]:g} m and y from {low[1]:g} to {high[1]:g} m"
            )

    @property
    def uniform(self) -> bool:
        """False: the terrain differs from position to position."""
        return False

    def derivative_bounds(self, low: Array, high: Array) -> Array:
        """Bounds on the first five derivatives of the height h(x, y) over K boxes.

        Args:
            low, high: Lowest and highest (x, y) of the boxes, shape (K, 2) [m].

        Returns:
            Norms of the k-th derivatives, k = 1..5, shape (5, K) [m^(1 - k)]; see `spline_bounds`.
        """
        return derivative_bounds(self._surface, low, high, rim=RIM)

    def slope_at(self, x: float, y: float) -> Slope:
        """Tangent plane at a point of the map, as ground for a machine that stands there.

        Args:
            x, y: Coordinates of the point [m].

        Raises:
            ProblemError: The point is not on the map.
        """
        derivatives = self._derivatives(np.array([[x, y]], dtype=np.float64))
        by_x, by_y = float(derivatives[0, 1, 0]), float(derivatives[0, 0, 1])
        return Slope(
            roll=float(np.arctan2(by_y, np.hypot(1.0, by_x))), pitch=-float(np.arctan(by_x))
        )

    def gravity(self, yaw: float = 0.0) -> Array:
        """Gravity in the root frame of a machine at x = y = 0; elsewhere use `slope_at`.

        Args:
            yaw: Heading of the machine [rad].

        Returns:
            Gravity, shape (3,) [m/s^2].

        Raises:
            ProblemError: The map does not contain x = y = 0.
        """
        return self.slope_at(0.0, 0.0).gravity(yaw)

    def base_pose(self, pose: Array) -> tuple[Array, Array]:
        r"""Position and rotation of the root in the map's frame.

        .. math:: (x, y, h(x, y)), \quad R_y(pitch) R_x(roll) R_z(yaw)

        Args:
            pose: (x, y, yaw) of the base, shape (K, 3) [m, m, rad].

        Returns:
            Positions (K, 3) [m] and rotations from the root frame to the map's frame (K, 3, 3).

        Raises:
            ProblemError: A pose is not on the map.
        """
        derivatives = self._derivatives(pose)
        _, turns = Slope().base_pose(pose)
        positions = np.column_stack([pose[:, :2], derivatives[:, 0, 0]])
        return positions, SurfaceFrame.of_derivatives(derivatives).rotations() @ turns

    def ground_rates(self, pose: Array, rates: Array) -> GroundRates:
        """Rates of x and y: the horizontal part of speed times heading.

        See `ground_rates_on_surface` for the formula.

        Args:
            pose: (x, y, yaw) of the base, shape (K, 3) [m, m, rad].
            rates: Speed along the heading and yaw rate, shape (K, 2) [m/s, rad/s].

        Raises:
            ProblemError: A pose is not on the map.
        """
        return ground_rates_on_surface(self._frame(pose), pose[:, 2], rates)

    def base_motion(
        self, pose: Array, rates: Array, accelerations: Array, S: float = 1.0
    ) -> GroundMotion:
        """Motion of the root of a unicycle that stays tangent to the surface, with derivatives.

        See `drive_on_surface` for the formula.

        Args:
            pose: (x, y, yaw) of the base, shape (K, 3) [m, m, rad].
            rates: Speed along the heading and rate of the yaw coordinate, shape (K, 2) [m/s,
                rad/s].
            accelerations: Rates of the speed and of the yaw rate, shape (K, 2) [m/s^2, rad/s^2].
            S: Square T^2 of the time scale; 1 in seconds.

        Raises:
            ProblemError: A pose is not on the map.
        """
        return drive_on_surface(self._frame(pose), pose[:, 2], rates, accelerations, S)

    def check_followable(
        self, support: SupportPolygon, poses: Array, *, clearance: float = CLEARANCE
    ) -> None:
        r"""Raise ProblemError where the ground is too uneven for the tracks.

        Between the root and a point u of the support polygon, the distance of the ground from the
        tangent plane at the root is at most (Taylor's theorem)

        .. math:: \max_{s \in [0, 1]} |II(s u)[u, u]| / 2

        with the second fundamental form II of the ground. The maximum is taken over points u on the
        edges of the polygon and steps s at the resolution of the map; on long paths, where the
        neighbourhoods of many poses overlap, over fewer points u.

        Args:
            support: Support polygon of the tracks, root frame.
            poses: (x, y, yaw) of the base along its path, shape (P, 3) [m, m, rad].
            clearance: Largest distance between ground and tangent plane for which tracks and soil
                can compensate [m].

        Raises:
            ProblemError: The ground is too uneven, or the tracks leave the map; the message says
                where and by how much.
        """
        poses = np.asarray(poses, dtype=np.float64)
        corners = support.vertices
        edges = np.roll(corners, -1, axis=0) - corners
        steps = np.linspace(
            0.0, 1.0, 2 + int(np.linalg.norm(corners, axis=1).max() / self.resolution)
        )
        wanted = 2 + int(np.linalg.norm(edges, axis=1).max() / self.resolution)
        affordable = max(2, MOST_POINTS // (len(poses) * len(corners) * len(steps)))
        shares = np.linspace(0.0, 1.0, min(wanted, affordable), endpoint=False)
        reach = (corners[:, None] + shares[:, None] * edges[:, None]).reshape(-1, 2)  # (U, 2)
        _, rotations = self.base_pose(poses)
        # displacements from the root to the points u as seen on the map, (P, U, 2)
        offsets = np.einsum("pij,uj->pui", rotations[:, :2, :2], reach)
        points = poses[:, None, None, :2] + steps[:, None] * offsets[:, :, None, :]
        h = self._derivatives(points.reshape(-1, 2), what="a track").reshape(
            (*points.shape[:-1], 5, 5)
        )
        x, y = offsets[..., None, 0], offsets[..., None, 1]
        second = h[..., 2, 0] * x * x + 2.0 * h[..., 1, 1] * x * y + h[..., 0, 2] * y * y
        # (P, U, steps)
        sag = 0.5 * np.abs(second) / np.sqrt(1.0 + h[..., 1, 0] ** 2 + h[..., 0, 1] ** 2)
        worst = np.unravel_index(np.argmax(sag), sag.shape)
        if sag[worst] > clearance:
            far, at = float(np.linalg.norm(reach[worst[1]])), points[worst]
            raise ProblemError(
                f"terrain is too rough for the tracks at (x, y) = ({at[0]:.2f}, {at[1]:.2f}) m, "
                f"under the base at pose {worst[0]}: it curves with a radius of "
                f"{0.5 * far**2 / sag[worst]:.2f} m, and leaves the plane of the tracks by up to "
                f"{sag[worst]:.3f} m within {far:.2f} m, {sag[worst] - clearance:.3f} m more than "
                f"the clearance of {clearance} m"
            )

    def _frame(self, pose: Array) -> SurfaceFrame:
        return SurfaceFrame.of_derivatives(self._derivatives(pose))

    def _derivatives(self, positions: Array, *, what: str = "the base") -> Array:
        """Derivatives of h at positions (x, y, ...) on the map, shape (K, 5, 5)."""
        self.check_on(positions, what=what)
        return self._surface.derivatives(positions[:, 0], positions[:, 1])


def _read(path: str | os.PathLike[str], reader: Callable[[Path], Array]) -> Array:
    try:
        return reader(Path(path))
    except (OSError, ValueError, EOFError) as cause:
        raise MachineError(f"heights cannot be read from {os.fspath(path)}: {cause}") from None
