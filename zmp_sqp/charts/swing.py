"""The largest loads that a machine may swing: the dynamic companion of a load chart."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number
from zmp_sqp.charts.chart import LoadChart, write_records
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics import Machine
from zmp_sqp.planning import Problem, phase_plane, plan
from zmp_sqp.planning.problem.checks import check_limits

__all__ = ["Swing", "SwingChart", "SwingLoad", "swing_chart"]

HALVINGS = 6  # bisection steps: loads are found to 2^-6 of the load that can be held at the ends
NO_SLOWER = 1e-3  # relative excess over the least duration that counts as none
EXCESS = 1e-6  # relative excess over the duration asked for that counts as rounding
HEAVIEST = 5.0  # times the machine's mass: heavier loads are not tried
BELOW_STATIC = 1e-3  # share by which the heaviest load that is tried is below the static one
# arguments of `Problem` that say nothing of a machine without a payload
OF_THE_PAYLOAD = ("tipping_fraction", "payload_uncertainty", "payload_com_uncertainty")
LONGEST_SEARCH = 10.0  # [s] time budget of one plan


@dataclass(frozen=True, slots=True)
class SwingLoad:
    """Largest load found for a swing from one point of a chart.

    Attributes:
        row: Row of the point in the chart.
        column: Column of the point in the chart.
        load: Largest load for which a certified swing was found [kg]; 0 where there is none even
            without a load.
        duration: Duration of that swing [s]; NaN without one.
        bound: Load that can be held at both ends of the swing [kg]; no swing has a larger one.
    """

    row: int
    column: int
    load: float
    duration: float
    bound: float


@dataclass(frozen=True, slots=True, eq=False)
class SwingChart:
    """Largest loads with which a swing is certified, by height and radius where it begins and ends.

    Attributes:
        chart: The load chart that gives points, poses and machine.
        angle: Angle of the swing, positive to the left [rad].
        start: Azimuth at which it begins [rad].
        duration: Longest duration allowed [s].
        fastest: Least duration that the joint limits allow [s].
        margin: Distance kept between the ZMP and every edge of the support polygon [m].
        only_slew: Whether only the slew joint moves, so that the load keeps its radius.
        loads: Largest loads, shape (R, C) [kg]; NaN beyond reach and where nothing was computed.
        durations: Durations of these swings, shape (R, C) [s].
        bounds: Loads that can be held at both ends of the swing, shape (R, C) [kg].
        complete: Whether all points within reach were computed.
    """

    chart: LoadChart
    angle: float
    start: float
    duration: float
    fastest: float
    margin: float
    only_slew: bool
    loads: Array = field(repr=False)
    durations: Array = field(repr=False)
    bounds: Array = field(repr=False)
    complete: bool

    def records(self) -> list[dict[str, Any]]:
        """One record per point that was computed, in SI units; the columns of `to_csv`."""
        return [
            {
                "height": float(self.chart.heights[row]),
                "radius": float(self.chart.radii[column]),
                "load": float(self.loads[row, column]),
                "duration": float(self.durations[row, column]),
                "static_bound": float(self.bounds[row, column]),
            }
            for row, column in np.argwhere(np.isfinite(self.loads)).tolist()
        ]

    def to_csv(self, path: str | Path) -> None:
        """Write one line per point that was computed: `records`, loads in kg, lengths in m."""
        write_records(path, self.records())


@dataclass(frozen=True, slots=True, eq=False)
class Swing:
    """Swing that is asked for, the same at every point of a chart.

    Attributes:
        chart: The load chart.
        angle: Angle of the swing, positive to the left [rad].
        start: Azimuth at which it begins [rad].
        duration: Longest duration allowed [s].
        fastest: Least duration that the joint limits allow [s].
        ends: Joint coordinates at start and goal for every point of the chart within reach of both,
            by row and column, shape (2, n) each.
        only_slew: Whether only the slew joint moves.
        settings: Further arguments of `Problem`.
        qp_solver: Name of the QP solver.
    """

    chart: LoadChart
    angle: float
    start: float
    duration: float
    fastest: float
    ends: dict[tuple[int, int], Array] = field(repr=False)
    only_slew: bool
    settings: dict[str, Any] = field(repr=False)
    qp_solver: str

    @classmethod
    def of(
        cls,
        chart: LoadChart,
        angle: float,
        *,
        duration: float | None = None,
        pace: float | None = None,
        start: float = 0.0,
        only_slew: bool = False,
        qp_solver: str = "auto",
        **settings: Any,
    ) -> Swing:
        """Swing of a chart; arguments and errors as in `swing_chart`.

        Args:
            chart: Points, poses and machine.
            angle: Angle of the swing, positive to the left [rad].
            duration: Longest duration [s]; None leaves it to the pace.
            pace: Longest duration as a multiple of the least that the joint limits allow.
            start: Azimuth at which the swing begins [rad].
            only_slew: Whether only the slew joint moves.
            qp_solver: Name of the QP solver of the plans.
            settings: Further arguments of `Problem`.
        """
        angle = finite_number(angle, name="swing angle", error=ProblemError)
        start = finite_number(start, name="swing start", error=ProblemError)
        if angle == 0.0:
            raise ProblemError("swing angle must not be zero")
        check_limits(chart.machine)
        ends = _ends(chart, angle, start)
        joint = chart.machine.joint_names[chart.arm.slew]
        if not ends:
            lower, upper = np.rad2deg(chart.arm.slew_range)
            raise ProblemError(
                f"a swing by {np.degrees(angle):g} degrees from azimuth {np.degrees(start):g} "
                f"degrees exceeds the limits of joint {joint!r}, {lower:.1f} to {upper:.1f} degrees"
            )
        first, last = next(iter(ends.values()))
        fastest = phase_plane(chart.machine, first, last).duration
        longest = _longest(duration, pace, fastest)
        if longest < fastest:
            raise ProblemError(
                f"a swing by {np.degrees(angle):g} degrees takes at least {fastest:.4g} s "
                f"within the limits of joint {joint!r}, not {longest:.4g} s"
            )
        swing = cls(chart, angle, start, longest, fastest, ends, only_slew, settings, qp_solver)
        swing._check()
        return swing

    def _check(self) -> None:
        """Raise what `Problem` raises if it does so at every point, even without a load."""
        error: ProblemError | None = None
        for ends in self.ends.values():
            try:
                self.problem(ends, 0.0)
            except ProblemError as cause:
                error = error or cause
            else:
                return
        if error is not None:
            raise error

    def problem(self, ends: Array, load: float) -> Problem:
        """Problem of the swing with a load [kg], or without one."""
        machine, payload = self.chart.machine, self.chart.payload
        settings = self.settings
        if load <= 0.0:
            settings = {key: settings[key] for key in settings if key not in OF_THE_PAYLOAD}
        else:
            inertia = None if payload.inertia is None else load * payload.inertia
            carried = replace(payload, mass=load, inertia=inertia)
            # no doubts about units: bisection tries every load
            machine = replace(machine, model=carried.attached_to(machine.model))
        if self.only_slew:
            machine = self._held(machine, ends[0])
        return Problem(machine, ends[0], ends[1], ground=self.chart.ground, **settings)

    def _held(self, machine: Machine, pose: Array) -> Machine:
        """Machine whose position limits hold every joint but the slew joint where it is."""
        held = np.arange(machine.size) != self.chart.arm.slew
        lower, upper = machine.limits.position_lower, machine.limits.position_upper
        limits = replace(
            machine.limits,
            position_lower=np.where(held, pose, lower),
            position_upper=np.where(held, pose, upper),
        )
        return replace(machine, limits=limits)

    def planned(self, ends: Array, load: float) -> float | None:
        """Duration of a certified swing [s]; None where none was found that is fast enough."""
        try:
            problem = self.problem(ends, load)
        except ProblemError:  # tips over, or breaks a constraint, at rest at one of its ends
            return None
        found = plan(problem, qp_solver=self.qp_solver, time_budget=LONGEST_SEARCH)
        longest = self.duration * (1.0 + EXCESS)
        return found.duration if found.success and found.duration <= longest else None

    def loads(self) -> Iterator[SwingLoad]:
        """Largest load at one point after the other, from the ground up."""
        poses = np.array([ends[0] for ends in self.ends.values()])
        goals = np.array([ends[1] for ends in self.ends.values()])
        rows = self.chart.rows
        bounds = np.minimum(rows.loads_at(poses), rows.loads_at(goals))
        most = HEAVIEST * self.chart.machine.mass
        for (at, ends), bound in zip(self.ends.items(), bounds, strict=True):
            load, duration = self._largest(ends, min(float(bound), most))
            yield SwingLoad(*at, load, duration, float(bound))

    def _largest(self, ends: Array, bound: float) -> tuple[float, float]:
        """Largest load [kg] by bisection and the duration of its swing [s]; it was certified.

        Loads below one with a certified swing are taken to have one, too.
        """
        best = self.planned(ends, 0.0)
        if best is None:
            return 0.0, np.nan
        upper = trial = (1.0 - BELOW_STATIC) * bound
        lower = 0.0
        for _ in range(HALVINGS + 1):
            found = self.planned(ends, trial) if trial > 0.0 else None
            if found is None:
                upper = trial
            else:
                lower, best = trial, found
            if lower == upper:
                break
            trial = 0.5 * (lower + upper)
        return lower, best

    def arranged(self, found: Iterable[SwingLoad]) -> SwingChart:
        """Chart of the loads that were found so far."""
        shape = self.chart.grid.radius.shape
        loads, durations, bounds = np.full((3, *shape), np.nan)
        for one in found:
            at = one.row, one.column
            loads[at], durations[at], bounds[at] = one.load, one.duration, one.bound
        return SwingChart(
            chart=self.chart,
            angle=self.angle,
            start=self.start,
            duration=self.duration,
            fastest=self.fastest,
            margin=float(self.settings.get("margin", 0.0)),
            only_slew=self.only_slew,
            loads=loads,
            durations=durations,
            bounds=bounds,
            complete=bool(np.isfinite(loads).sum() == len(self.ends)),
        )


def _longest(duration: float | None, pace: float | None, fastest: float) -> float:
    """Longest duration that is allowed [s].

    Raises:
        ProblemError: Both are given, or one is no number.
    """
    if duration is not None:
        if pace is not None:
            raise ProblemError("swing duration and swing pace exclude each other: give one of them")
        return finite_number(duration, name="swing duration", error=ProblemError)
    if pace is not None:
        return finite_number(pace, name="swing pace", error=ProblemError) * fastest
    return (1.0 + NO_SLOWER) * fastest


def _ends(chart: LoadChart, angle: float, start: float) -> dict[tuple[int, int], Array]:
    """Start and goal of the swing at every point where the slew's limits allow it."""
    arm = chart.arm
    found: dict[tuple[int, int], Array] = {}
    lower, upper = arm.slew_range
    for row, column in np.argwhere(chart.grid.reached).tolist():
        ends = np.tile(chart.grid.poses[row, column], (2, 1))
        first = arm.slew_at(ends[:1], start)[0]
        for turns in (0.0, -2.0 * np.pi, 2.0 * np.pi):
            slews = first + turns + np.array([0.0, arm.sense * angle])
            # a joint without limits may turn further than once about zero
            if arm.endless or (slews.min() >= lower - 1e-9 and slews.max() <= upper + 1e-9):
                ends[:, arm.slew] = slews if arm.endless else np.clip(slews, lower, upper)
                found[row, column] = ends
                break
    return found


def swing_chart(
    chart: LoadChart,
    angle: float,
    *,
    duration: float | None = None,
    pace: float | None = None,
    start: float = 0.0,
    only_slew: bool = False,
    progress: Callable[[int, int], None] = lambda done, total: None,
    qp_solver: str = "auto",
    **settings: Any,
) -> SwingChart:
    """Largest load at each point of a load chart with which a swing is certified.

    The swing begins and ends at rest in the chart's pose. Between, the planner moves all joints,
    and may draw the load in, unless only the slew joint may move. The load counts if the fastest
    motion found, certified for all t, is no longer than `duration`. The payload is rigid: a load
    that hangs and sways is not modelled. Loads are found by bisection to 1/64 of what can be held
    at both ends; each was certified.

    Args:
        chart: Points, poses and machine.
        angle: Angle of the swing, positive to the left [rad].
        duration: Longest duration [s]; None is the least that the joint limits allow, and 0.1 %.
        pace: Longest duration as a multiple of that least one, in place of `duration`.
        start: Azimuth at which the swing begins, 0 ahead, pi/2 to the left [rad].
        only_slew: Whether only the slew joint moves, so that the load keeps radius and height.
        progress: Called with the number of points that are done, and of all points.
        qp_solver: Name of the QP solver of the plans.
        settings: Further arguments of `Problem`: margin, constraints such as `TorqueLimits()`,
            intervals, model, and what is uncertain.

    Raises:
        ProblemError: An angle that is zero or beyond the slew joint's limits, a duration below what
            the joint limits allow, limits that are missing, or arguments that `Problem` refuses.
    """
    if not isinstance(chart, LoadChart):
        raise ProblemError(f"chart must be a LoadChart, not {type(chart).__name__}")
    settings |= {"start": start, "only_slew": only_slew, "qp_solver": qp_solver}
    swing = Swing.of(chart, angle, duration=duration, pace=pace, **settings)
    found: list[SwingLoad] = []
    for load in swing.loads():
        found.append(load)
        progress(len(found), len(swing.ends))
    return swing.arranged(found)
