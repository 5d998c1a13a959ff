"""Largest loads of swings: what is returned was certified, and a little more is not."""

from __future__ import annotations

import csv

import numpy as np
import pytest

import zmp_sqp as zs
from tests.charts.machines import (
    BALLAST,
    BALLAST_AT,
    BASE,
    HALF,
    HOOK,
    JIB,
    TROLLEY,
    tower_crane,
)
from zmp_sqp.charts import Swing
from zmp_sqp.mechanics.ground import GRAVITY

TURN = np.pi / 2
OPTIONS = {"radii": [5.0, 6.5], "heights": [4.0], "frame": "head"}
SLOPE = zs.Slope(roll=-0.25)  # leans to the left, where the swing ends


@pytest.fixture(scope="module")
def chart():
    return zs.load_chart(zs.load_machine("feller_buncher"), SLOPE, **OPTIONS)


@pytest.fixture(scope="module")
def swing(chart):
    return zs.swing_chart(chart, TURN, intervals=20)


def replanned(swing, at, load):
    """Certificate of the swing from a point with a load, planned without the chart's code."""
    chart = swing.chart
    machine = chart.machine
    if load > 0.0:
        machine = machine.with_payload(zs.Payload(load, (0.0, 0.0, 0.0), "head"))
    start = chart.grid.poses[at]
    goal = start + np.array([swing.angle, 0.0, 0.0, 0.0, 0.0])
    return zs.plan(zs.Problem(machine, start, goal, ground=SLOPE, intervals=20))


def test_every_load_is_certified_within_the_duration(swing):
    assert swing.complete
    assert np.isfinite(swing.loads).sum() == swing.chart.grid.reached.sum() == 2
    for at in map(tuple, np.argwhere(np.isfinite(swing.loads))):
        found = replanned(swing, at, swing.loads[at])
        assert found.success
        assert found.certificate.margin >= 0.0
        assert found.duration == pytest.approx(swing.durations[at])
        assert found.duration <= swing.duration


def test_loads_a_little_above_have_no_such_swing(swing):
    for at in map(tuple, np.argwhere(np.isfinite(swing.loads))):
        heavier = swing.loads[at] + swing.bounds[at] / 32.0
        if heavier >= swing.bounds[at]:
            with pytest.raises(zs.ProblemError, match="tips over at rest"):
                replanned(swing, at, 1.001 * swing.bounds[at])
            continue
        found = replanned(swing, at, heavier)
        assert not found.success or found.duration > swing.duration


def test_the_bound_is_the_lesser_tipping_load_of_both_ends(chart, swing):
    rows = chart.rows
    for at in map(tuple, np.argwhere(chart.grid.reached)):
        start = chart.grid.poses[at]
        ends = np.array([start, start + np.array([TURN, 0.0, 0.0, 0.0, 0.0])])
        assert swing.bounds[at] == pytest.approx(rows.loads_at(ends).min())
        assert swing.loads[at] <= swing.bounds[at]


def test_a_longer_duration_never_costs_load(chart, swing):
    slower = zs.swing_chart(chart, TURN, pace=2.0, intervals=20)
    assert slower.duration == pytest.approx(2.0 * swing.fastest)
    assert (slower.loads >= swing.loads - swing.bounds / 32.0)[chart.grid.reached].all()
    same = zs.swing_chart(chart, TURN, duration=2.0 * swing.fastest, intervals=20)
    assert np.array_equal(same.loads, slower.loads, equal_nan=True)


def edge_moment(mass, times, profile):
    """Largest moment of point masses about any edge of the square [kg m^2/s^2]; positive tips.

    The ZMP of points at height z with horizontal accelerations a is
    sum m (g p - z a) / sum m g (Song & Sharf 2020, eq. (5)).
    """
    angle, rate, acceleration = (part[:, 0] for part in profile(times))
    radial = np.column_stack([np.cos(angle), np.sin(angle)])
    tangent = np.column_stack([-np.sin(angle), np.cos(angle)])
    points = [(BASE, 0.0, 0.0), (BALLAST, -BALLAST_AT, JIB), (TROLLEY, 8.0, JIB)]
    points.append((HOOK + mass, 8.0, 9.0))
    total = sum(weight for weight, _, _ in points)
    moment = np.zeros((len(times), 2))
    for weight, radius, height in points:
        moved = radius * (acceleration[:, None] * tangent - rate[:, None] ** 2 * radial)
        moment += weight * (GRAVITY * radius * radial - height * moved)
    return np.abs(moment).max() - HALF * total * GRAVITY


def test_a_crane_that_only_slews_carries_what_point_masses_say(tmp_path):
    """Trapezoid of the slew joint, all else held; at the fastest pace there is no other motion."""
    machine = tower_crane(tmp_path)  # 1 rad/s, 1 rad/s^2
    chart = zs.load_chart(machine, frame="hook", radii=[8.0], heights=[9.0])
    fast = zs.swing_chart(chart, TURN, only_slew=True, duration=TURN + 1.0)
    assert fast.fastest == pytest.approx(TURN + 1.0)
    start = chart.grid.poses[0, 0]
    profile = zs.phase_plane(machine, start, start + np.array([TURN, 0.0, 0.0]))
    times = np.linspace(0.0, profile.duration, 4001)
    lower, upper = 0.0, fast.bounds[0, 0]
    for _ in range(40):
        middle = 0.5 * (lower + upper)
        stands = edge_moment(middle, times, profile) <= 0.0
        lower, upper = (middle, upper) if stands else (lower, middle)
    resolution = fast.bounds[0, 0] / 64.0
    assert 0.0 < lower < 0.8 * fast.bounds[0, 0]
    assert lower - resolution <= fast.loads[0, 0] <= lower * (1.0 + 1e-3)
    slow = zs.swing_chart(chart, TURN, only_slew=True, pace=3.0)
    assert fast.loads[0, 0] < slow.loads[0, 0] <= slow.bounds[0, 0]


def test_what_only_slews_carries_no_more_than_what_may_be_drawn_in(chart):
    free = zs.swing_chart(chart, TURN, pace=1.3, intervals=20)
    held = zs.swing_chart(chart, TURN, pace=1.3, intervals=20, only_slew=True)
    assert held.only_slew
    reached = chart.grid.reached
    assert (held.loads <= free.loads + free.bounds / 64.0)[reached].all()
    assert (held.loads[reached] > 0.0).any()


def test_constraints_and_margin_of_the_problem_are_kept(chart, swing):
    tight = zs.swing_chart(chart, TURN, intervals=20, margin=0.3)
    assert tight.margin == 0.3
    assert (tight.loads < swing.loads)[chart.grid.reached].all()


def test_what_was_found_before_an_interruption_is_kept(chart, swing, tmp_path):
    asked = Swing.of(chart, TURN, intervals=20)
    first = next(asked.loads())
    partial = asked.arranged([first])
    assert not partial.complete
    assert np.isfinite(partial.loads).sum() == 1
    assert partial.loads[first.row, first.column] == swing.loads[first.row, first.column]
    swing.to_csv(tmp_path / "swing.csv")
    with (tmp_path / "swing.csv").open(newline="", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    assert [float(line["load"]) for line in lines] == swing.loads[0].tolist()
    assert [float(line["radius"]) for line in lines] == swing.chart.radii.tolist()


@pytest.mark.parametrize(
    ("angle", "options", "words"),
    [
        (0.0, {}, "swing angle must not be zero"),
        (np.nan, {}, "swing angle must be finite"),
        (20.0, {}, "exceeds the limits of joint 'slew', -360.0 to 360.0 degrees"),
        (np.pi, {"duration": 3.0}, "takes at least 4.5 s within the limits of joint 'slew'"),
        (np.pi, {"duration": 5.0, "pace": 2.0}, "exclude each other"),
        (np.pi, {"pace": 0.5}, "takes at least 4.5 s"),
        (np.pi, {"margin": 9.0}, "margin 9.0 m leaves nothing"),
        (np.pi, {"intervals": 1}, "intervals must be a whole number of at least 2"),
    ],
)
def test_misuse_says_what_is_wrong(chart, angle, options, words):
    with pytest.raises(zs.ProblemError, match=words):
        zs.swing_chart(chart, angle, **options)


def test_a_chart_is_needed():
    with pytest.raises(zs.ProblemError, match="chart must be a LoadChart"):
        zs.swing_chart(zs.load_machine("feller_buncher"), 1.0)
