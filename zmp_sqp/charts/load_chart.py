"""Load chart of a machine: rated loads by height and radius, as operators know them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number, frozen_array
from zmp_sqp.charts.arm import Arm
from zmp_sqp.charts.chart import ChartPoints, LoadChart
from zmp_sqp.charts.grid import axis_values, steps
from zmp_sqp.charts.lift_point import carried_links, check_machine, unit_payload
from zmp_sqp.charts.poses import Poses, reach_along, search_poses
from zmp_sqp.charts.static_loads import ALL_ROUND, SECTORS, TIPPING, StaticLoads, StaticRows
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics import Ground, Machine, Payload, Slope

__all__ = ["load_chart"]

LEVEL = Slope()  # the default ground
OTHERS = 0.01  # weight of the other sectors where poses are compared by their load all round
HUGE = 1e3  # times the machine's mass: loads above it count as this where poses are compared
WITHIN_REACH = 1e-3  # of the reach, by which the points of the last column are inside it


def load_chart(
    machine: Machine,
    ground: Ground = LEVEL,
    *,
    frame: str | None = None,
    com: Any = None,
    radii: Any = None,
    heights: Any = None,
    held: Any = None,
    attachment: Sequence[str] | None = None,
    tipping_fraction: float = 0.75,
    torque_fraction: float = 0.87,
    progress: Callable[[str], None] = lambda _: None,
) -> LoadChart:
    r"""Rated loads by ISO 10567, in closed form for every pose.

    .. math:: m = \min\Bigl(\min_i \frac{-\varphi_t M_i - A_i}{c_i},
              \min_j \frac{\varphi_\tau (\hat\tau_j \mp \tau_j) \mp a_j}{\pm g_j}\Bigr)

    with moments M_i + A_i + m c_i about the edges (positive tips over) and torques
    tau_j + a_j + m g_j of machine, attachment and load. Both are sinusoids of the slew angle, so
    that the worst of 360 degrees is a closed form, too. Structure, collisions and soil are not
    looked at: this is not a substitute for the maker's load chart.

    The pose at a radius and height is one for all sectors: the best found for the load all round.
    Two joints leave no choice but the side of the elbow; with more, boom, stick and telescope share
    the reach as is best, and a bucket is curled.

    Args:
        machine: Machine with a support polygon. A payload that it carries is taken off; it gives
            frame and centre of mass unless these are given.
        ground: Ground on which it stands.
        frame: Frame that carries the load.
        com: Lift point in that frame, the load's centre of mass, (3,) [m]; None is the origin.
        radii: Distances from the slew axis, shape (C,) [m]; None covers the reach.
        heights: Heights above the support plane, shape (R,) [m]; None covers the reach.
        held: Joint coordinates, shape (n,), whose attitude of the frame to the vertical is kept;
            None leaves it free, as for a load that hangs.
        attachment: Links that count as part of the load; None is `carried_links`.
        tipping_fraction: Share of the tipping load that may be lifted.
        torque_fraction: Share of the torque load that may be lifted.
        progress: Called with words on what is computed next.

    Raises:
        MachineError: No support polygon, no such frame, an arm that does not slew, or limits that
            are missing.
        ProblemError: Arguments out of range, no point within reach, or a slope on which the machine
            tips over without a load at every point.
    """
    check_machine(machine, ground)
    shares = _fraction(tipping_fraction, "tipping"), _fraction(torque_fraction, "torque")
    rows = _rows(machine, ground, unit_payload(machine, frame, com), attachment, shares)
    progress("reach")
    poses = Poses.of(rows.arm, None if held is None else _pose(held, machine))
    radius = _axis(radii, "radii", poses.points[:, 0], positive=True)
    height = _axis(heights, "heights", poses.points[:, 1])
    grid, reach = _points(poses, rows, radius, height, progress)
    grid, reach = _trimmed(grid, reach, rows=heights is None, columns=radii is None)
    _check_found(grid, reach, poses)
    return LoadChart(rows, held is not None, SECTORS, grid, reach)


def _rows(
    machine: Machine,
    ground: Ground,
    payload: Payload,
    attachment: Sequence[str] | None,
    shares: tuple[float, float],
) -> StaticRows:
    """Edges and effort limits of a machine whose own payloads are taken off."""
    empty = machine.with_payload_scaled(0.0) if machine.payload_count else machine
    return StaticRows.of(
        Arm.of(empty, payload.frame, payload.com),
        ground,
        payload,
        carried_links(empty, payload.frame) if attachment is None else tuple(attachment),
        tipping_fraction=shares[0],
        torque_fraction=shares[1],
    )


def _points(
    poses: Poses, rows: StaticRows, radii: Array, heights: Array, progress: Callable[[str], None]
) -> tuple[ChartPoints, ChartPoints]:
    """Points of the grid, shape (R, C), and at the largest radius of each height, shape (R,)."""

    def score(q: Array) -> Array:
        found = rows.loads(q)
        most = HUGE * poses.arm.machine.mass
        weights = np.full(len(SECTORS), OTHERS)
        weights[ALL_ROUND] = 1.0
        loads = np.nan_to_num(np.minimum(found.rated, most)) @ weights
        return np.asarray(loads - np.maximum(found.violation, 0.0).max(axis=1))

    progress("poses")
    shape = (len(heights), len(radii))
    targets = np.stack(np.meshgrid(radii, heights), axis=-1).reshape(-1, 2)
    q, _ = search_poses(poses, targets, score)
    grid = _evaluated(poses.arm, rows, targets, q, shape)
    progress("maximum reach")
    by_row = q.reshape(*shape, -1)
    inside = [row[found][-1:] for row, found in zip(by_row, grid.reached, strict=True)]
    starts = np.full((len(heights), q.shape[1]), np.nan)
    for k, last in enumerate(inside):
        if len(last):
            starts[k] = last[0]
    missing = np.flatnonzero(np.isnan(starts).any(axis=1))
    if len(missing):
        starts[missing] = _at_height(poses, heights[missing])
    far, _ = reach_along(poses, heights, starts)
    far = np.floor((far / poses.reach) / WITHIN_REACH) * WITHIN_REACH * poses.reach
    known = np.flatnonzero(np.isfinite(far))
    targets = np.column_stack([far, heights])
    q = np.full_like(starts, np.nan)
    q[known], _ = search_poses(poses, targets[known], score)
    return grid, _evaluated(poses.arm, rows, targets, q, (len(heights),))


def _at_height(poses: Poses, heights: Array) -> Array:
    """Any pose at each height, shape (R, n); NaN where there is none."""
    nearest = np.abs(poses.points[:, 1][None] - heights[:, None]).argmin(axis=1)
    targets = np.column_stack([poses.points[nearest, 0], heights])
    q, reached = poses.project(poses.samples[nearest], targets)
    return np.where(reached[:, None], q, np.nan)


def _evaluated(
    arm: Arm, rows: StaticRows, targets: Array, q: Array, shape: tuple[int, ...]
) -> ChartPoints:
    """Loads in poses (P, n), NaN rows where there is none, arranged in a shape."""
    known = np.isfinite(q).all(axis=1)
    loads = np.full((3, len(q), len(SECTORS)), np.nan)
    limit = np.full((len(q), len(SECTORS)), TIPPING)
    turned = q.copy()
    if known.any():
        found: StaticLoads = rows.loads(q[known])
        loads[:, known] = found.rated, found.tipping, found.torque
        limit[known] = found.limit
        front = arm.slew_at(q[known], 0.0)
        turned[known, arm.slew] = np.where(np.isfinite(front), front, q[known, arm.slew])
    rated, tipping, torque = (part.reshape(*shape, len(SECTORS)) for part in loads)
    return ChartPoints(
        radius=targets[:, 0].reshape(shape),
        height=targets[:, 1].reshape(shape),
        rated=rated,
        tipping=tipping,
        torque=torque,
        limit=limit.reshape(*shape, len(SECTORS)),
        poses=turned.reshape(*shape, -1),
    )


def _trimmed(
    grid: ChartPoints, reach: ChartPoints, *, rows: bool, columns: bool
) -> tuple[ChartPoints, ChartPoints]:
    """Points without the rows and columns in which nothing is reached."""
    kept = grid.reached
    lines = kept.any(axis=1) if rows and kept.any() else np.ones(kept.shape[0], dtype=bool)
    posts = kept.any(axis=0) if columns and kept.any() else np.ones(kept.shape[1], dtype=bool)
    names = ChartPoints.__dataclass_fields__
    return (
        ChartPoints(**{name: getattr(grid, name)[lines][:, posts] for name in names}),
        ChartPoints(**{name: getattr(reach, name)[lines] for name in names}),
    )


def _pose(held: Any, machine: Machine) -> Array:
    return frozen_array(
        held, name="held", shape=(machine.size,), error=ProblemError, labels=machine.joint_names
    )


def _fraction(given: Any, name: str) -> float:
    value = finite_number(given, name=f"{name}_fraction", error=ProblemError)
    if not 0.0 < value <= 1.0:
        raise ProblemError(f"{name}_fraction must lie within (0, 1], not {value:g}")
    return value


def _axis(given: Any, name: str, reached: Array, *, positive: bool = False) -> Array:
    """Radii or heights that are given, or round ones that cover what is reached."""
    if given is None:
        return steps(float(reached.min()), float(reached.max()), positive=positive)
    return axis_values(given, name, positive=positive)


def _check_found(grid: ChartPoints, reach: ChartPoints, poses: Poses) -> None:
    """Refuse a chart without a point, and one on which the machine tips over at every point."""
    if not grid.reached.any() and not reach.reached.any():
        (r_min, h_min), (r_max, h_max) = poses.points.min(axis=0), poses.points.max(axis=0)
        raise ProblemError(
            f"frame {poses.arm.frame!r} reaches none of the points: radii from {r_min:.2f} to "
            f"{r_max:.2f} m and heights from {h_min:.2f} to {h_max:.2f} m are within reach"
        )
    loads = [part.tipping[part.reached] for part in (grid, reach)]
    tipping = np.concatenate([part.ravel() for part in loads])
    if not (tipping > 0.0).any():
        raise ProblemError(
            f"machine {poses.arm.machine.name!r} tips over on this slope without a load at every "
            "point of the chart"
        )
