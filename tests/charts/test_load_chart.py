"""Load charts against hand calculations, bisection on the ZMP, samples and brute force."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import zmp_sqp as zs
from tests.charts.machines import (
    BALLAST,
    BALLAST_AT,
    BASE,
    HALF,
    HOIST,
    HOOK,
    JIB,
    TROLLEY,
    body,
    joint,
    load,
    telescopic_crane,
    tower_crane,
)
from zmp_sqp.charts.arm import Arm
from zmp_sqp.charts.poses import Poses
from zmp_sqp.charts.static_loads import ALL_ROUND, TIPPING, StaticRows
from zmp_sqp.mechanics.ground import GRAVITY
from zmp_sqp.mechanics.tipping_load import worst_turn

FRONT, SIDE = 0, 1
TREE = zs.Payload(4000.0, (0.0, 0.0, 3.323), "head")
UPRIGHT = np.array([0.0, -0.8, -2.0, 2.8 - np.pi / 2, 0.0])  # boom + stick + tilt = -pi/2
SLOPES = [zs.Slope(), zs.Slope(roll=-0.2, pitch=0.1)]


@pytest.fixture(scope="module")
def crane(tmp_path_factory):
    return tower_crane(tmp_path_factory.mktemp("crane"))


@pytest.fixture(scope="module")
def feller():
    return zs.load_machine("feller_buncher")


@pytest.fixture(scope="module")
def charts(feller):
    """Chart of the feller-buncher per slope, the tree upright in the head."""
    options = {"held": UPRIGHT, "radii": [3.0, 4.5, 6.0], "heights": [4.323, 7.323, 9.323]}
    return [zs.load_chart(feller.with_payload(TREE), slope, **options) for slope in SLOPES]


# --- by hand ------------------------------------------------------------------------------------


def test_a_tower_crane_has_the_loads_of_a_hand_calculation(crane):
    """On level ground, moments about the edge x = 2 m [kg m]; the front is as bad as any side.

    With the hook as attachment, 0.75 of what the bare crane holds at the hook, less the hook.
    """
    radii = [3.0, 5.0, 8.0]
    chart = zs.load_chart(crane, frame="hook", radii=radii, heights=[2.0, 5.0])
    assert chart.attachment == ("hook",)
    assert chart.attachment_mass == pytest.approx(HOOK)
    for column, radius in enumerate(radii):
        standing = BASE * HALF + BALLAST * (HALF + BALLAST_AT) - TROLLEY * (radius - HALF)
        gross = standing / (radius - HALF)
        hoist = HOIST / GRAVITY
        rated = min(0.75 * gross, 0.87 * hoist) - HOOK
        for row in range(2):
            for sector in (FRONT, SIDE, ALL_ROUND):
                at = row, column, sector
                assert chart.grid.tipping[at] == pytest.approx(gross - HOOK)
                assert chart.grid.torque[at] == pytest.approx(hoist - HOOK)
                assert chart.grid.rated[at] == pytest.approx(rated)
                limit = "tipping" if 0.75 * gross < 0.87 * hoist else "hook"
                assert chart.limit_name(int(chart.grid.limit[at])) == limit
    assert set(chart.letters.values()) >= {"t", "h"}
    assert chart.reach.radius == pytest.approx(8.0, abs=0.02)


def test_a_slope_moves_the_hand_calculation_by_height_times_tangent(crane):
    """Nose down by 0.1 rad: what is at height z acts z tan(0.1) further ahead."""
    chart = zs.load_chart(
        crane,
        zs.Slope(pitch=0.1),
        frame="hook",
        radii=[4.0],
        heights=[3.0],
        attachment=[],
        tipping_fraction=1.0,
        torque_fraction=1.0,
    )
    lean = np.tan(0.1)
    standing = (
        BASE * HALF
        + BALLAST * (HALF + BALLAST_AT - JIB * lean)
        - TROLLEY * (4.0 - HALF + JIB * lean)
        - HOOK * (4.0 - HALF + 3.0 * lean)
    )
    tipping = standing / (4.0 - HALF + 3.0 * lean)
    assert chart.grid.tipping[0, 0, FRONT] == pytest.approx(tipping)
    assert chart.grid.tipping[0, 0, ALL_ROUND] == pytest.approx(tipping)  # downhill is the worst
    assert chart.grid.tipping[0, 0, SIDE] > tipping
    # the weight along the jib pulls at the hook with cos(0.1) only
    held = HOIST / (GRAVITY * np.cos(0.1)) - HOOK
    assert chart.grid.torque[0, 0, FRONT] == pytest.approx(held)


def test_a_crane_that_tips_backwards_without_a_load_lifts_nothing(tmp_path):
    parts = [
        body("base", 1000.0),
        joint("slew", kind="revolute", parent="base", axis="0 0 1", limits=(-7.0, 7.0)),
        body("slew", 3000.0, (-4.0, 0.0, 1.0)),
        joint("trolley", kind="prismatic", parent="slew", axis="1 0 0", limits=(3.0, 9.0)),
        body("trolley", 1.0),
        joint("hook", kind="prismatic", parent="trolley", axis="0 0 1", limits=(1.0, 5.0)),
        body("hook", 1.0),
    ]
    machine = load(tmp_path, "heavy_ballast", parts)
    with pytest.raises(zs.ProblemError, match="tips over on this slope without a load"):
        zs.load_chart(machine, frame="hook", radii=[4.0], heights=[2.0])


# --- second derivations -------------------------------------------------------------------------


@pytest.mark.parametrize("number", range(len(SLOPES)))
def test_bisection_on_the_stability_margin_gives_the_tipping_load(charts, number):
    chart = charts[number]
    checked = 0
    for at in map(tuple, np.argwhere(chart.grid.reached)):
        found = chart.grid.tipping[(*at, FRONT)]
        q = chart.grid.poses[at]
        if not 0.0 < found < 4.0 * chart.machine.mass:  # heavier payloads draw a warning
            continue
        lower, upper = 0.0, 1.2 * found
        for _ in range(50):
            middle = 0.5 * (lower + upper)
            loaded = chart.machine.with_payload(replace(TREE, mass=middle))
            stands = zs.stability_margin(loaded, q, 0.0 * q, 0.0 * q, chart.ground) >= 0.0
            lower, upper = (middle, upper) if stands else (lower, middle)
        assert found == pytest.approx(lower, rel=1e-6)
        checked += 1
    assert checked >= 5


@pytest.mark.parametrize("number", range(len(SLOPES)))
def test_the_worst_of_all_round_is_the_least_of_dense_samples(charts, number):
    chart = charts[number]
    rows = chart.rows
    for at in map(tuple, np.argwhere(chart.grid.reached)):
        q = np.tile(chart.grid.poses[at], (3601, 1))
        q[:, chart.arm.slew] = np.linspace(-np.pi, np.pi, len(q))
        sampled = rows.loads_at(q).min()
        whole = min(chart.grid.tipping[(*at, ALL_ROUND)], chart.grid.torque[(*at, ALL_ROUND)])
        assert whole <= sampled * (1.0 + 1e-9)
        assert whole == pytest.approx(sampled, rel=1e-5, abs=1e-6)
        sectors = chart.grid.rated[at]
        assert sectors[ALL_ROUND] <= sectors[:ALL_ROUND].min() * (1.0 + 1e-12)


@pytest.mark.parametrize("number", range(len(SLOPES)))
def test_stationary_points_of_the_ratio_give_the_same_worst_of_all_round(charts, number):
    """The tipping load of `inspect`: least value of a ratio of sinusoids, another derivation."""
    chart = charts[number]
    for at in map(tuple, np.argwhere(chart.grid.reached)):
        other = worst_turn(
            chart.machine,
            chart.grid.poses[at],
            chart.ground,
            joint="slew",
            frame="head",
            offset=chart.payload.com,
        )
        assert chart.grid.tipping[(*at, ALL_ROUND)] == pytest.approx(other.mass, rel=1e-9)


def test_a_joint_is_at_its_limit_with_the_torque_load_by_pinocchio(charts):
    """Generalised gravity of a model with the load in it, gravity in the model itself."""
    chart = charts[1]
    limits = chart.machine.limits.effort
    for at in map(tuple, np.argwhere(chart.grid.reached)):
        load_held = chart.grid.torque[(*at, FRONT)]
        model = chart.machine.with_payload(replace(TREE, mass=load_held)).model.copy()
        model.gravity.linear = chart.ground.gravity()
        q = chart.machine.configuration(chart.grid.poses[at][None])[0]
        torque = pin.computeGeneralizedGravity(model, model.createData(), q)[6:]
        assert np.abs(torque / limits).max() == pytest.approx(1.0, rel=1e-6)


def test_rated_loads_are_the_lesser_share(feller):
    """Without an attachment the fractions apply to the loads themselves."""
    chart = zs.load_chart(feller, frame="head", radii=[3.0, 5.0], heights=[2.0], attachment=[])
    grid = chart.grid
    assert grid.rated == pytest.approx(np.minimum(0.75 * grid.tipping, 0.87 * grid.torque))
    tips = 0.75 * grid.tipping < 0.87 * grid.torque
    assert ((grid.limit == TIPPING) == tips).all()


def test_the_attachment_is_weighed_with_the_load(feller):
    """A head without mass that lifts 2600 kg more is the same machine, if its centre is there."""
    options = {"frame": "head", "radii": [5.0], "heights": [2.0]}
    chart = zs.load_chart(feller, attachment=["head"], **options)
    bare = zs.load_chart(
        feller.with_massless(["head"]), attachment=[], held=chart.grid.poses[0, 0], **options
    )
    # the head's centre of mass is the lift point
    assert chart.grid.rated == pytest.approx(bare.grid.rated - 2600.0, rel=1e-3)


def test_poses_are_within_limits_at_their_points_and_keep_the_attitude(charts, feller):
    for chart in charts:
        arm, reached = chart.arm, chart.grid.reached
        q = chart.grid.poses[reached]
        points, verticals = arm.placements(q)
        found = arm.radius_and_height(points)
        wanted = np.column_stack([chart.grid.radius[reached], chart.grid.height[reached]])
        assert found == pytest.approx(wanted, abs=1e-6)
        assert np.abs(verticals - [0.0, 0.0, 1.0]).max() < 1e-6  # the tree is upright
        assert arm.azimuth(points) == pytest.approx(0.0, abs=1e-9)
        assert (q >= feller.limits.position_lower - 1e-9).all()
        assert (q <= feller.limits.position_upper + 1e-9).all()


def test_the_largest_radius_is_the_largest(charts):
    """Two bars of 3.27 m from a shoulder at 2.56 m, stretched to -0.3 rad; a level tilt link."""
    for chart in charts:
        assert chart.held
        heights, radii = chart.heights - 3.323, chart.reach.radius
        bound = 0.458 + np.sqrt((2.0 * 3.27 * np.cos(0.15)) ** 2 - (heights - 2.56) ** 2)
        assert (radii <= bound + 1e-6).all()
        assert (radii[1:] >= bound[1:] - 0.02).all()
        tip = 2.56 + 3.27 * np.cos(1.4)  # of the boom at its lower limit
        low = 0.458 + 3.27 * np.sin(1.4) + np.sqrt(3.27**2 - (tip - heights[0]) ** 2)
        assert low - 0.02 <= radii[0] <= low + 1e-6


@pytest.mark.parametrize("slope", SLOPES)
def test_redundant_arms_share_the_reach_as_well_as_brute_force_finds(tmp_path, slope):
    """Every length of the telescope in steps of 1 cm, both sides of the elbow."""
    machine = telescopic_crane(tmp_path)
    options: dict = {"tipping_fraction": 1.0, "torque_fraction": 1.0}
    radii, heights = [2.5, 4.0, 5.5], [0.5, 2.5, 4.5]
    chart = zs.load_chart(
        machine, slope, frame="extension", radii=radii, heights=heights, **options
    )
    arm = chart.arm
    lower, upper = arm.box
    lengths = np.arange(1.6, 3.601, 0.01)
    for at in map(tuple, np.argwhere(chart.grid.reached)):
        across, up = chart.grid.radius[at], chart.grid.height[at] - 2.0
        far = np.hypot(across, up)
        cosine = (3.0**2 + lengths**2 - far**2) / (2.0 * 3.0 * lengths)
        inner = np.arccos(np.where(np.abs(cosine) <= 1.0, cosine, np.nan))
        stick = inner - np.pi  # -y axes: negative folds down
        beyond = np.arctan2(lengths * np.sin(-stick), 3.0 + lengths * np.cos(stick))
        q = np.column_stack([0.0 * stick, np.arctan2(up, across) + beyond, stick, lengths])
        q = q[np.isfinite(q).all(axis=1)]
        q = q[(q >= lower).all(axis=1) & (q <= upper).all(axis=1)]
        assert arm.radius_and_height(arm.placements(q)[0]) == pytest.approx(
            np.tile([across, up + 2.0], (len(q), 1)), abs=1e-9
        )
        best = chart.rows.loads(q).rated[:, ALL_ROUND].max()
        assert chart.grid.rated[(*at, ALL_ROUND)] >= 0.99 * best
    assert chart.grid.reached.sum() >= 6


def test_a_slew_joint_with_limits_counts_only_its_own_arc(tmp_path):
    """On a slope to the rear, a crane that cannot turn there lifts more all round."""
    slope = zs.Slope(pitch=-0.12)
    options = {"frame": "hook", "radii": [5.0], "heights": [3.0]}
    free = zs.load_chart(tower_crane(tmp_path), slope, **options)
    tied = zs.load_chart(tower_crane(tmp_path, slew=(-1.0, 2.0)), slope, **options)
    assert tied.grid.rated[0, 0, ALL_ROUND] > 1.05 * free.grid.rated[0, 0, ALL_ROUND]
    rows = tied.rows
    q = np.tile(tied.grid.poses[0, 0], (3001, 1))
    q[:, tied.arm.slew] = np.linspace(-1.0, 2.0, len(q))
    whole = min(tied.grid.tipping[0, 0, ALL_ROUND], tied.grid.torque[0, 0, ALL_ROUND])
    assert whole == pytest.approx(rows.loads_at(q).min(), rel=1e-6)
    # only the left side is in the range
    left = tied.arm.slew_at(tied.grid.poses[0], np.pi / 2)
    right = tied.arm.slew_at(tied.grid.poses[0], -np.pi / 2)
    assert np.isfinite(left).all()
    assert np.isnan(right).all()
    assert min(tied.grid.tipping[0, 0, SIDE], tied.grid.torque[0, 0, SIDE]) == pytest.approx(
        rows.loads_at(np.array([[left[0], *tied.grid.poses[0, 0, 1:]]]))[0]
    )


def test_the_slew_joint_is_found_below_its_mast(tmp_path):
    """A mast that rises comes first, an axis that points down turns to the right."""
    parts = [
        body("base", 4000.0),
        joint("mast", kind="prismatic", parent="base", axis="0 0 1", limits=(0.5, 2.0)),
        body("mast", 100.0),
        joint(
            "turn", kind="revolute", parent="mast", axis="0 0 -1", limits=(-4.0, 4.0), at="1 0.5 0"
        ),
        body("turn", 100.0),
        joint("arm", kind="revolute", parent="turn", axis="0 1 0", limits=(-1.0, 1.0)),
        body("arm", 50.0, (1.0, 0.0, 0.0)),
        '<link name="tip"/>',
        '<joint name="tip_mount" type="fixed"><parent link="arm"/><child link="tip"/>'
        '<origin xyz="2 0.3 0"/></joint>',
    ]
    machine = load(tmp_path, "mast", parts)
    arm = Arm.of(machine, "tip", np.zeros(3))
    assert machine.joint_names[arm.slew] == "turn"
    assert arm.axis == pytest.approx([1.0, 0.5])
    assert arm.sense == -1.0
    q = np.array([[1.0, 0.2, 0.4]])
    turned = q.copy()
    turned[:, arm.slew] = arm.slew_at(q, 1.2)
    assert arm.azimuth(arm.placements(turned)[0]) == pytest.approx(1.2)


# --- what goes in and out -----------------------------------------------------------------------


def test_the_payload_of_a_machine_gives_frame_and_centre_of_mass_but_no_mass(feller):
    options = {"held": UPRIGHT, "radii": [5.0], "heights": [7.0]}
    heavy = feller.with_payload(replace(TREE, mass=9000.0))
    by_payload = zs.load_chart(heavy, **options)
    by_hand = zs.load_chart(feller, frame="head", com=TREE.com, **options)
    assert by_payload.grid.rated == pytest.approx(by_hand.grid.rated)
    assert by_payload.machine.mass == pytest.approx(feller.mass)


def test_without_effort_limits_there_is_tipping_only(feller):
    limits = replace(feller.limits, effort=np.full(5, np.nan))
    chart = zs.load_chart(
        replace(feller, limits=limits), frame="head", radii=[1.0, 5.0], heights=[2.0]
    )
    assert chart.unlimited == feller.joint_names
    assert np.isinf(chart.grid.torque).all()
    assert np.isinf(chart.grid.rated[0, 0]).all()  # above the tracks nothing tips over
    assert {chart.limit_name(int(limit)) for limit in chart.grid.limit[0, 0]} == {"nothing"}
    assert (chart.grid.limit[0, 1] == TIPPING).all()


def test_the_csv_reads_back(charts, tmp_path):
    chart = charts[1]
    chart.to_csv(tmp_path / "chart.csv")
    with (tmp_path / "chart.csv").open(newline="", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    points = chart.grid.reached.sum() + chart.reach.reached.sum()
    assert len(lines) == 3 * points
    for line in lines:
        if line["maximum_reach"] == "True":
            continue
        row = chart.heights.tolist().index(float(line["height"]))
        column = chart.radii.tolist().index(float(line["radius"]))
        at = row, column, chart.sectors.index(line["sector"])
        assert float(line["rated"]) == chart.grid.rated[at]
        assert float(line["tipping"]) == chart.grid.tipping[at]
        assert line["limit"] == chart.limit_name(int(chart.grid.limit[at]))
        pose = [float(line[name]) for name in chart.machine.joint_names]
        assert pose == chart.grid.poses[row, column].tolist()


def test_the_same_chart_has_the_same_bits(feller):
    options = {"frame": "head", "radii": [3.0, 5.0], "heights": [2.0]}
    one, two = zs.load_chart(feller, **options), zs.load_chart(feller, **options)
    assert (one.grid.rated == two.grid.rated).all()
    assert (one.grid.poses == two.grid.poses).all()


def test_the_default_grid_covers_the_reach_with_round_steps(crane):
    chart = zs.load_chart(crane, frame="hook")
    assert chart.grid.reached.any(axis=0).all()
    assert chart.grid.reached.any(axis=1).all()
    assert np.allclose(np.diff(chart.radii), chart.radii[1] - chart.radii[0])
    assert chart.radii.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]
    assert chart.heights.tolist() == list(range(10))


# --- refused ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "carries 0 payloads: say which frame"),
        ({"frame": "hed"}, "there is no frame 'hed'"),
        ({"frame": "left_track"}, "no joint moves frame 'left_track'"),
        ({"frame": "head", "radii": [3.0], "heights": [20.0]}, "reaches none of the points"),
        ({"frame": "head", "radii": [3.0, 2.0]}, "radii must increase, but 2 m follows 3 m"),
        ({"frame": "head", "radii": [0.0, 2.0]}, "radii must be positive"),
        ({"frame": "head", "heights": []}, "heights must be 1 to 200 numbers"),
        ({"frame": "head", "heights": [np.nan]}, "heights must be finite"),
        ({"frame": "head", "tipping_fraction": 1.2}, r"tipping_fraction must lie within \(0, 1\]"),
        ({"frame": "head", "torque_fraction": 0.0}, r"torque_fraction must lie within \(0, 1\]"),
        ({"frame": "head", "attachment": ["bucket"]}, "there is no link 'bucket'"),
        ({"frame": "head", "held": [0.0, 1.0]}, r"held must have shape \(5,\)"),
        ({"frame": "head", "ground": zs.Slope(roll=1.0)}, "tips over on this slope"),
        ({"frame": "head", "ground": 3}, "ground must be a Slope, a Heightmap"),
        ({"frame": "head", "com": (0.0, 1.0)}, "payload com must have shape"),
    ],
)
def test_misuse_says_what_is_wrong(feller, options, words):
    with pytest.raises(zs.ZmpSqpError, match=words):
        zs.load_chart(feller, **{"radii": [4.0], "heights": [3.0]} | options)


def test_machines_that_have_no_chart_say_why(feller):
    with pytest.raises(zs.MachineError, match="no support polygon"):
        zs.load_chart(replace(feller, support=None), frame="head")
    with pytest.raises(zs.MachineError, match="turns it about a fixed vertical axis"):
        zs.load_chart(zs.load_machine("slider"), frame="slider")
    with pytest.raises(zs.MachineError, match="machine must be a Machine"):
        zs.load_chart("feller_buncher", frame="head")
    limits = replace(feller.limits, position_lower=np.full(5, np.nan))
    with pytest.raises(zs.MachineError, match="no position limits for joint 'slew'"):
        zs.load_chart(replace(feller, limits=limits), frame="head")


def test_an_attitude_out_of_reach_is_refused(feller):
    limits = replace(
        feller.limits,
        position_lower=np.array([-6.0, -0.2, -0.5, 0.0, -3.0]),
        position_upper=np.array([6.0, 0.2, -0.4, 0.1, 3.0]),
    )
    machine = replace(feller, limits=limits)
    with pytest.raises(zs.ProblemError, match="keeps the attitude of frame 'head'"):
        zs.load_chart(machine, frame="head", held=UPRIGHT)


def test_a_jib_that_only_slews_has_one_point(tmp_path):
    parts = [
        body("base", 4000.0),
        joint("slew", kind="revolute", parent="base", axis="0 0 1", limits=(-4.0, 4.0)),
        body("slew", 50.0),
        '<link name="tip"/>',
        '<joint name="tip_mount" type="fixed"><parent link="slew"/><child link="tip"/>'
        '<origin xyz="4 0 3"/></joint>',
    ]
    machine = load(tmp_path, "jib", parts)
    chart = zs.load_chart(machine, frame="tip", radii=[3.0, 4.0], heights=[2.0, 3.0])
    assert chart.grid.reached.tolist() == [[False, False], [False, True]]
    gross = (4000.0 + 50.0) * HALF / (4.0 - HALF)
    assert chart.attachment == ()
    assert chart.grid.rated[1, 1] == pytest.approx(0.75 * gross)


def test_a_joint_that_cannot_move_is_no_hindrance(tmp_path):
    """Limits of 0 and -0, as grippers have them in URDFs of others."""
    crane = tower_crane(tmp_path)
    limits = replace(
        crane.limits,
        position_lower=np.array([-7.0, 5.0, -7.0]),
        position_upper=np.array([7.0, 5.0, -2.0]),
    )
    shifted = replace(crane, limits=limits)
    chart = zs.load_chart(shifted, frame="hook", radii=[5.0], heights=[6.0])
    free = zs.load_chart(crane, frame="hook", radii=[5.0], heights=[6.0])
    assert chart.grid.rated == pytest.approx(free.grid.rated)
    parts = [
        body("base", 4000.0),
        joint("slew", kind="revolute", parent="base", axis="0 0 1", limits=(-4.0, 4.0)),
        body("slew", 50.0),
        joint("boom", kind="prismatic", parent="slew", axis="1 0 0", limits=(3.0, 6.0)),
        body("boom", 10.0),
        joint("finger", kind="prismatic", parent="boom", axis="1 0 0", limits=(0.0, -0.0)),
        body("finger", 1.0),
    ]
    fixed = load(tmp_path, "finger", parts)
    found = zs.load_chart(fixed, frame="finger", radii=[4.0], heights=[0.0], attachment=[])
    assert found.grid.tipping[0, 0] == pytest.approx((4050.0 * HALF - 11.0 * 2.0) / 2.0)


def test_rows_do_not_depend_on_the_slew_of_the_poses(feller):
    arm = Arm.of(feller, "head", np.zeros(3))
    payload = zs.Payload(1.0, (0.0, 0.0, 0.0), "head")
    rows = StaticRows.of(
        arm, SLOPES[1], payload, ["head"], tipping_fraction=0.75, torque_fraction=0.87
    )
    poses = Poses.of(arm, None).samples[:20]
    turned = poses.copy()
    turned[:, arm.slew] = 2.0
    for one, two in zip(
        (rows.loads(poses).rated, rows.loads(poses).tipping),
        (rows.loads(turned).rated, rows.loads(turned).tipping),
        strict=True,
    ):
        assert one == pytest.approx(two, rel=1e-9, abs=1e-6)
