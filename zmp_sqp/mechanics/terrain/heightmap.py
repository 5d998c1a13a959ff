"""Terrain as heights on a regular grid, with a smooth surface through them."""

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

# [m] beyond the outermost samples that count as on the map: solvers keep bounds to a tolerance only
RIM = 1e-3
ORIGIN = (0.0, 0.0)
LARGEST = 1e30  # [m, or of derivatives in metres] beyond it squares of products overflow
MOST_POINTS = 200_000  # looked at under the tracks along a path, but at least two per edge and step


@dataclass(frozen=True, slots=True, eq=False)
class Heightmap:
    r"""Terrain z = h(x, y), a spline of degree five through heights on a regular grid.

    Gravity is vertical, and the ground frame is the map's: x and y are horizontal, z points up. The
    root of a base at (x, y, yaw) stands at (x, y, h(x, y)), and its rotation is

    .. math:: R = R_y(pitch) R_x(roll) R_z(yaw)

    with the roll and pitch for which R z is the surface normal. A planar map is thus a `Slope` of
    that roll and pitch, but for the coordinates: here (x, y) are those of the map, there they lie
    in the plane. Speeds and accelerations are measured along the surface.

    The spline has four continuous derivatives, so the base's twist and acceleration have continuous
    first derivatives; their second ones jump where the base crosses a row or column of samples.

    Attributes:
        heights: heights[row, column] at y = origin[1] + row resolution and x = origin[0] + column
            resolution, at least six rows and columns, shape (ny, nx) [m]. The first row has the
            lowest y, other than in most images.
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
        # so is the fifth derivative
        computable = max(highest, 1.0) <= LARGEST * min(resolution, 1.0) ** DEGREE
        axes = []
        if computable and max(farthest, resolution) <= LARGEST:
            axes = [
                start + resolution * np.arange(n)
                for start, n in zip(origin[::-1], heights.shape, strict=True)
            ]
        if not axes or not all((np.diff(axis) > 0.0).all() for axis in axes):
            raise MachineError(
                f"heights of up to {highest:.3g} m at a resolution of {resolution:.3g} m from the origin "
                f"({origin[0]:.3g}, {origin[1]:.3g}) m on are beyond what can be computed with; all are in metres"
            )
        y, x = axes
        object.__setattr__(self, "heights", heights)
        object.__setattr__(self, "resolution", resolution)
        object.__setattr__(self, "origin", (float(origin[0]), float(origin[1])))
        object.__setattr__(self, "_surface", SplineSurface.through(heights, x, y))

    def __reduce__(self) -> tuple[type[Heightmap], tuple[Any, ...]]:
        # the surface is larger, and soon made
        return Heightmap, (self.heights, self.resolution, self.origin)

    @classmethod
    def from_csv(
        cls, path: str | os.PathLike[str], resolution: float, origin: tuple[float, float] = ORIGIN
    ) -> Heightmap:
        """Heights from a text file: a row per line, numbers separated by commas, no header; `#` starts a comment.

        Raises:
            MachineError: No such file, or not a table of numbers; also as for the class.
        """
        return cls(
            _read(path, lambda file: np.loadtxt(file, delimiter=",", ndmin=2)), resolution, origin
        )

    @classmethod
    def from_npy(
        cls, path: str | os.PathLike[str], resolution: float, origin: tuple[float, float] = ORIGIN
    ) -> Heightmap:
        """Heights from NumPy's own file format.

        Raises:
            MachineError: No such file, or not an array of numbers; also as for the class.
        """
        return cls(_read(path, lambda file: np.load(file, allow_pickle=False)), resolution, origin)

    @classmethod
    def from_file(
        cls, path: str | os.PathLike[str], resolution: float, origin: tuple[float, float] = ORIGIN
    ) -> Heightmap:
        """As `from_npy` if the name ends in .npy, otherwise as `from_csv`."""
        read = cls.from_npy if Path(path).suffix == ".npy" else cls.from_csv
        return read(path, resolution, origin)

    @property
    def extent(self) -> Array:
        """Lowest and highest (x, y) on the map, shape (2, 2) [m]."""
        rows, columns = self.heights.shape
        return np.array(self.origin) + self.resolution * np.array(
            [[0.0, 0.0], [columns - 1.0, rows - 1.0]]
        )

    def check_on(self, places: Array, *, what: str = "the base") -> None:
        """Refuse places off the map.

        Args:
            places: Shape (K, 2) [m].
            what: Stands there.

        Raises:
            ProblemError: A place is not on the map; the message says where.
        """
        low, high = self.extent
        x, y = places[:, 0], places[:, 1]
        on_map = (
            (x >= low[0] - RIM) & (x <= high[0] + RIM) & (y >= low[1] - RIM) & (y <= high[1] + RIM)
        )
        if not on_map.all():
            at = places[int(np.argmin(on_map))]
            raise ProblemError(
                f"{what} leaves the map at (x, y) = ({at[0]:.3f}, {at[1]:.3f}) m; the map covers "
                f"x from {low[0]:g} to {high[0]:g} m and y from {low[1]:g} to {high[1]:g} m"
            )

    @property
    def uniform(self) -> bool:
        """Terrain differs from place to place."""
        return False

    def derivative_bounds(self, low: Array, high: Array) -> Array:
        """Steepest slope and norms of the second to fifth derivative of h over boxes, see `spline_bounds`.

        Args:
            low, high: Corners of the boxes, shape (K, 2) [m].

        Returns:
            Shape (5, K) [m^(1 - k), k = 1..5].
        """
        return derivative_bounds(self._surface, low, high, rim=RIM)

    def slope_at(self, x: float, y: float) -> Slope:
        """Tangent plane at a point of the map: what a machine that stands still there stands on.

        Raises:
            ProblemError: The point is not on the map.
        """
        derivatives = self._derivatives(np.array([[x, y]], dtype=np.float64))
        by_x, by_y = float(derivatives[0, 1, 0]), float(derivatives[0, 0, 1])
        return Slope(
            roll=float(np.arctan2(by_y, np.hypot(1.0, by_x))), pitch=-float(np.arctan(by_x))
        )

    def gravity(self, yaw: float = 0.0) -> Array:
        """Gravity in the root frame of a machine that stands at x = y = 0; for other places see `slope_at`.

        Args:
            yaw: Heading [rad].

        Returns:
            Shape (3,) [m/s^2].

        Raises:
            ProblemError: The map does not contain x = y = 0.
        """
        return self.slope_at(0.0, 0.0).gravity(yaw)

    def base_pose(self, pose: Array) -> tuple[Array, Array]:
        r"""Where the root is and how it is turned: :math:`(x, y, h(x, y)), \; R_y(pitch) R_x(roll) R_z(yaw)`.

        Args:
            pose: (x, y, yaw), shape (K, 3) [m, rad].

        Returns:
            Positions (K, 3) [m] and rotations from the root frame (K, 3, 3), both in the map's
            frame.

        Raises:
            ProblemError: A pose is not on the map.
        """
        derivatives = self._derivatives(pose)
        _, turns = Slope().base_pose(pose)
        positions = np.column_stack([pose[:, :2], derivatives[:, 0, 0]])
        return positions, SurfaceFrame.of_derivatives(derivatives).rotations() @ turns

    def ground_rates(self, pose: Array, rates: Array) -> GroundRates:
        """Rates of the map coordinates: the horizontal part of speed times heading, see `ground_rates_on_surface`.

        Args:
            pose: (x, y, yaw), shape (K, 3) [m, rad].
            rates: Speed along the heading and yaw rate, shape (K, 2) [m/s, rad/s].

        Raises:
            ProblemError: A pose is not on the map.
        """
        return ground_rates_on_surface(self._frame(pose), pose[:, 2], rates)

    def base_motion(
        self, pose: Array, rates: Array, accelerations: Array, S: float = 1.0
    ) -> GroundMotion:
        """Motion of the root of a unicycle that stays tangent to the surface, see `drive_on_surface`.

        Args:
            pose: (x, y, yaw), shape (K, 3) [m, rad].
            rates: Speed along the heading and rate of the yaw coordinate, shape (K, 2) [m/s,
                rad/s].
            accelerations: Their rates, shape (K, 2) [m/s^2, rad/s^2].
            S: Square of the time scale; 1 in seconds.

        Raises:
            ProblemError: A pose is not on the map.
        """
        return drive_on_surface(self._frame(pose), pose[:, 2], rates, accelerations, S)

    def check_followable(
        self, support: SupportPolygon, poses: Array, *, clearance: float = CLEARANCE
    ) -> None:
        r"""Refuse a path on which the tracks' plane and the ground part by more than a clearance.

        On the way from the root to the point u of the polygon the ground leaves the tangent plane
        by at most

        .. math:: \max_{s \in [0, 1]} |II(s u)[u, u]| / 2     (Taylor's remainder; II is the second
            fundamental form)

        It is taken towards points of the edges, at the resolution of the map; on long paths, where
        many poses look at the same ground, towards fewer of them.

        Args:
            support: Where the tracks are, in the root frame.
            poses: Path of the base, (x, y, yaw), shape (P, 3) [m, rad].
            clearance: Largest departure that tracks and soil still make up for [m].

        Raises:
            ProblemError: Ground too rough, or not on the map under the tracks; the message says
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
        ways = np.einsum("pij,uj->pui", rotations[:, :2, :2], reach)  # on the map, (P, U, 2)
        places = poses[:, None, None, :2] + steps[:, None] * ways[:, :, None, :]  # (P, U, steps, 2)
        h = self._derivatives(places.reshape(-1, 2), what="a track").reshape(
            (*places.shape[:-1], 5, 5)
        )
        x, y = ways[..., None, 0], ways[..., None, 1]
        second = h[..., 2, 0] * x * x + 2.0 * h[..., 1, 1] * x * y + h[..., 0, 2] * y * y
        # (P, U, steps)
        sag = 0.5 * np.abs(second) / np.sqrt(1.0 + h[..., 1, 0] ** 2 + h[..., 0, 1] ** 2)
        worst = np.unravel_index(np.argmax(sag), sag.shape)
        if sag[worst] > clearance:
            far, at = float(np.linalg.norm(reach[worst[1]])), places[worst]
            raise ProblemError(
                f"terrain is too rough for the tracks at (x, y) = ({at[0]:.2f}, {at[1]:.2f}) m, under the base at pose "
                f"{worst[0]}: with a radius of curvature of {0.5 * far**2 / sag[worst]:.2f} m it leaves the plane of "
                f"the tracks by up to {sag[worst]:.3f} m within {far:.2f} m, {sag[worst] - clearance:.3f} m more than "
                f"the clearance of {clearance} m"
            )

    def _frame(self, pose: Array) -> SurfaceFrame:
        return SurfaceFrame.of_derivatives(self._derivatives(pose))

    def _derivatives(self, places: Array, *, what: str = "the base") -> Array:
        """Derivatives of h at (x, y, ...), shape (K, 5, 5); raises ProblemError off the map."""
        self.check_on(places, what=what)
        return self._surface.derivatives(places[:, 0], places[:, 1])


def _read(path: str | os.PathLike[str], reader: Callable[[Path], Array]) -> Array:
    try:
        return reader(Path(path))
    except (OSError, ValueError, EOFError) as cause:
        raise MachineError(f"heights cannot be read from {os.fspath(path)}: {cause}") from None
