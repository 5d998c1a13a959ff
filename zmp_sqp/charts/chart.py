"""Load chart of a machine as a value: loads by height and radius."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.charts.arm import Arm
from zmp_sqp.charts.static_loads import NOTHING, TIPPING, StaticRows
from zmp_sqp.mechanics import Ground, Machine, Payload

__all__ = ["NOT_A_SUBSTITUTE", "ChartPoints", "LoadChart", "write_records"]

DIGITS = "123456789"  # that stand for joints whose names have no letter left
NOT_A_SUBSTITUTE = "Not a substitute for the maker's load chart."


@dataclass(frozen=True, slots=True, eq=False)
class ChartPoints:
    """Loads at points of a chart; NaN where the arm does not reach.

    Attributes:
        radius: Distance of the lift point from the slew axis, shape (...) [m].
        height: Height of the lift point above the support plane, shape (...) [m].
        rated: Rated load, shape (..., S) [kg]; inf where nothing limits it.
        tipping: Load that tips the machine over, shape (..., S) [kg]; 0 where it tips without one.
        torque: Load at which a joint reaches its effort limit, shape (..., S) [kg].
        limit: What limits the rated load: index of a planned joint, -1 for tipping, -2 for
            nothing, shape (..., S).
        poses: Joint coordinates, turned to the front where the slew joint can, shape (..., n)
            [rad or m].
    """

    radius: Array
    height: Array
    rated: Array
    tipping: Array
    torque: Array
    limit: Indices
    poses: Array

    @property
    def reached(self) -> Any:
        """Whether the arm reaches a point, shape (...)."""
        return np.isfinite(self.poses).all(axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class LoadChart:
    """Rated loads of a machine at rest, by height and radius of its lift point.

    Attributes:
        rows: Edges of the support polygon and effort limits, from which all loads follow.
        held: Whether all poses keep the attitude of the lift point's frame to the vertical.
        sectors: Names of the S sectors.
        grid: Points by height (rows, lowest first) and radius, shape (R, C).
        reach: Points at the largest radius of each height, shape (R,).
    """

    rows: StaticRows = field(repr=False)
    held: bool
    sectors: tuple[str, ...]
    grid: ChartPoints = field(repr=False)
    reach: ChartPoints = field(repr=False)

    @property
    def arm(self) -> Arm:
        """The joints that slew and reach."""
        return self.rows.arm

    @property
    def machine(self) -> Machine:
        """The machine without load."""
        return self.arm.machine

    @property
    def ground(self) -> Ground:
        """Ground on which the machine stands."""
        return self.rows.ground

    @property
    def payload(self) -> Payload:
        """A load of 1 kg: frame, and lift point in it."""
        return self.rows.payload

    @property
    def attachment(self) -> tuple[str, ...]:
        """Links that count as part of the load; their weight is subtracted."""
        return self.rows.attachment

    @property
    def unlimited(self) -> tuple[str, ...]:
        """Joints that carry the load and have no effort limit."""
        carrying = {self.arm.slew, *self.arm.joints.tolist()} - set(self.rows.efforts.tolist())
        return tuple(self.machine.joint_names[joint] for joint in sorted(carrying))

    @property
    def radii(self) -> Array:
        """Radii of the columns, shape (C,) [m]."""
        return np.asarray(self.grid.radius[0])

    @property
    def heights(self) -> Array:
        """Heights of the rows, lowest first, shape (R,) [m]."""
        return np.asarray(self.grid.height[:, 0])

    @property
    def attachment_mass(self) -> float:
        """Mass of the links that count as part of the load [kg]."""
        return self.machine.mass - self.machine.with_massless(self.attachment).mass

    def limit_name(self, limit: int) -> str:
        """What an entry of `ChartPoints.limit` stands for: a joint, "tipping" or "nothing"."""
        others = {TIPPING: "tipping", NOTHING: "nothing"}
        return others.get(limit) or self.machine.joint_names[limit]

    @property
    def letters(self) -> dict[int, str]:
        """Letter for every value of `ChartPoints.limit` that occurs: t is tipping.

        A joint has the first letter after what all names of the arm's joints begin with, else a
        digit or another letter of its name.
        """
        joints = (self.arm.slew, *self.arm.joints.tolist())
        columns = zip(*(self.machine.joint_names[joint] for joint in joints), strict=False)
        shared = next((at for at, found in enumerate(columns) if len(set(found)) > 1), 0)
        found = {TIPPING: "t", NOTHING: "-"}
        limits = [part.limit[part.reached].ravel() for part in (self.grid, self.reach)]
        for joint in np.unique(np.concatenate(limits)).tolist():
            if joint not in found:
                name = self.machine.joint_names[joint][shared:]
                digits = [c for c in name if c.isdigit()]
                candidates = [*name[:1].lower(), *digits, *name.lower(), *name.upper(), *DIGITS]
                free = (c for c in candidates if c.isalnum() and c not in found.values())
                found[joint] = next(free, "?")
        return found

    def records(self) -> list[dict[str, Any]]:
        """One record per point within reach and sector, in SI units; the columns of `to_csv`."""
        found = []
        for points, at_reach in ((self.grid, False), (self.reach, True)):
            for at in map(tuple, np.argwhere(points.reached).tolist()):
                where = {
                    "height": float(points.height[at]),
                    "radius": float(points.radius[at]),
                    "maximum_reach": at_reach,
                }
                pose = dict(zip(self.machine.joint_names, points.poses[at].tolist(), strict=True))
                found += [
                    where | {"sector": name} | self._loads(points, (*at, sector)) | pose
                    for sector, name in enumerate(self.sectors)
                    if not np.isnan(points.rated[(*at, sector)])
                ]
        return found

    def _loads(self, points: ChartPoints, at: tuple[int, ...]) -> dict[str, Any]:
        """Loads and limit of one point and sector."""
        return {
            "rated": float(points.rated[at]),
            "limit": self.limit_name(int(points.limit[at])),
            "tipping": float(points.tipping[at]),
            "torque": float(points.torque[at]),
        }

    def to_csv(self, path: str | Path) -> None:
        """Write one line per point and sector: `records`, loads in kg, lengths in m."""
        write_records(path, self.records())


def write_records(path: str | Path, records: Sequence[dict[str, Any]]) -> None:
    """Write records of equal keys as CSV with a line of names."""
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(records[0]) if records else [])
        writer.writeheader()
        writer.writerows(records)
