"""Trajectories: exact between nodes, and into files and back without losing a bit."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from tests.planning.conftest import planned_paper_1, planned_random

ROUNDING = 1e-12
MACHINE = zs.load_machine("feller_buncher")


def random_trajectory(*, jerks: bool, seed: int = 0, count: int = 7, n: int = 5) -> zs.Trajectory:
    """Unequal steps, integrated node by node."""
    rng = np.random.default_rng(seed)
    h = rng.uniform(0.05, 0.4, (count, 1))
    a, j = rng.normal(0.0, 1.0, (count, n)), rng.normal(0.0, 1.0, (count, n)) * jerks
    q, v = [rng.normal(0.0, 1.0, n)], [rng.normal(0.0, 1.0, n)]
    for k in range(count):
        q.append(q[-1] + h[k] * v[-1] + 0.5 * h[k] ** 2 * a[k] + h[k] ** 3 * j[k] / 6.0)
        v.append(v[-1] + h[k] * a[k] + 0.5 * h[k] ** 2 * j[k])
    times = np.concatenate([[0.0], np.cumsum(h)])
    return zs.Trajectory(
        MACHINE.joint_names, times, np.array(q), np.array(v), a, j if jerks else None
    )


@pytest.fixture(params=[False, True], ids=["constant", "linear"])
def trajectory(request: pytest.FixtureRequest) -> zs.Trajectory:
    return random_trajectory(jerks=request.param)


# --- between nodes ------------------------------------------------------------------------------


def test_between_nodes_it_is_what_fine_integration_gives(trajectory: zs.Trajectory) -> None:
    t, dt = np.linspace(0.0, trajectory.duration, 20_001, retstep=True)
    middle = 0.5 * (t[:-1] + t[1:])
    # the midpoint rule is exact for linear accelerations but in steps with a node in them
    a = trajectory(middle)[2]
    v = trajectory.velocities[0] + np.vstack([np.zeros((1, 5)), np.cumsum(dt * a, axis=0)])
    q = trajectory.positions[0] + np.vstack(
        [np.zeros((1, 5)), np.cumsum(dt * 0.5 * (v[1:] + v[:-1]), axis=0)]
    )
    found_q, found_v, _ = trajectory(t)
    # seven jumps of the acceleration, each missed by one step
    np.testing.assert_allclose(found_v, v, atol=20.0 * dt)
    np.testing.assert_allclose(found_q, q, atol=20.0 * dt)


def test_within_an_interval_it_is_a_polynomial_with_the_right_derivatives(
    trajectory: zs.Trajectory,
) -> None:
    step = 1e-5
    t = (trajectory.times[:-1] + 0.3 * np.diff(trajectory.times))[:, None] + step * np.array(
        [-1.0, 0.0, 1.0]
    )
    q, v, a = (part.reshape(-1, 3, 5) for part in trajectory(t.ravel()))
    np.testing.assert_allclose((q[:, 2] - q[:, 0]) / (2.0 * step), v[:, 1], atol=1e-9)
    np.testing.assert_allclose((v[:, 2] - v[:, 0]) / (2.0 * step), a[:, 1], atol=1e-9)


def test_at_its_nodes_it_is_its_nodes(trajectory: zs.Trajectory) -> None:
    q, v, a = trajectory(trajectory.times)
    np.testing.assert_allclose(q, trajectory.positions, atol=ROUNDING)
    np.testing.assert_allclose(v, trajectory.velocities, atol=ROUNDING)
    np.testing.assert_array_equal(a[:-1], trajectory.accelerations)
    h = np.diff(trajectory.times)[-1]
    np.testing.assert_allclose(
        a[-1], trajectory.accelerations[-1] + h * trajectory.jerks[-1], atol=ROUNDING
    )


def test_a_scalar_time_gives_vectors_and_an_array_of_times_rows(trajectory: zs.Trajectory) -> None:
    assert [part.shape for part in trajectory(0.3)] == [(5,)] * 3
    assert [part.shape for part in trajectory([0.3])] == [(1, 5)] * 3
    assert [part.shape for part in trajectory([])] == [(0, 5)] * 3
    np.testing.assert_array_equal(trajectory(0.3)[0], trajectory(np.array([0.3]))[0][0])


def test_a_plans_trajectory_has_a_node_at_every_interval() -> None:
    named, plan = planned_paper_1(point_masses=True)
    trajectory = plan.trajectory
    assert trajectory.times.shape == (51,)
    assert trajectory.positions.shape == trajectory.velocities.shape == (51, 5)
    assert trajectory.accelerations.shape == (50, 5)
    assert trajectory.intervals == 50
    assert trajectory.duration == plan.duration == trajectory.times[-1]
    assert trajectory.joint_names == named.problem.machine.joint_names


def test_its_arrays_cannot_be_written_to(trajectory: zs.Trajectory) -> None:
    for array in (
        trajectory.times,
        trajectory.positions,
        trajectory.velocities,
        trajectory.accelerations,
    ):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


# --- files --------------------------------------------------------------------------------------


def same_bits(one: zs.Trajectory, other: zs.Trajectory) -> bool:
    names = ("times", "positions", "velocities", "accelerations", "jerks")
    return one.joint_names == other.joint_names and all(
        getattr(one, name).tobytes() == getattr(other, name).tobytes() for name in names
    )


def test_csv_gives_every_bit_back(tmp_path: Path, trajectory: zs.Trajectory) -> None:
    trajectory.to_csv(tmp_path / "motion.csv")
    assert same_bits(zs.Trajectory.from_csv(tmp_path / "motion.csv", MACHINE), trajectory)


@pytest.mark.parametrize("seed", [29, 63])
def test_csv_gives_every_bit_of_a_plan_back(tmp_path: Path, seed: int) -> None:
    plan = planned_random(seed)[1]
    plan.trajectory.to_csv(tmp_path / "motion.csv")
    assert same_bits(zs.Trajectory.from_csv(str(tmp_path / "motion.csv"), MACHINE), plan.trajectory)


def test_csv_columns_may_come_in_any_order_and_jerks_may_be_left_out(tmp_path: Path) -> None:
    trajectory = random_trajectory(jerks=False)
    path = tmp_path / "motion.csv"
    trajectory.to_csv(path)
    rows = [line.split(",") for line in path.read_text().splitlines()]
    order = [i for i in reversed(range(len(rows[0]))) if not rows[0][i].endswith(".jerk")]
    path.write_text("\n".join(",".join(row[i] for i in order) for row in rows) + "\n\n")
    assert same_bits(zs.Trajectory.from_csv(path, MACHINE), trajectory)


def test_json_has_the_fields_of_a_joint_trajectory_message(
    tmp_path: Path, trajectory: zs.Trajectory
) -> None:
    trajectory.to_json(tmp_path / "motion.json")
    content = json.loads((tmp_path / "motion.json").read_text())
    assert set(content) == {"joint_names", "points", "made_for"}
    assert "quintics" in content["made_for"]
    assert content["joint_names"] == list(MACHINE.joint_names)
    assert len(content["points"]) == len(trajectory.times)
    for time, position, velocity, point in zip(
        trajectory.times,
        trajectory.positions,
        trajectory.velocities,
        content["points"],
        strict=True,
    ):
        assert set(point) == {
            "positions",
            "velocities",
            "accelerations",
            "jerks",
            "time",
            "time_from_start",
        }
        stamp = point["time_from_start"]
        assert isinstance(stamp["sec"], int)
        assert 0 <= stamp["nanosec"] < 1_000_000_000
        assert stamp["sec"] + 1e-9 * stamp["nanosec"] == pytest.approx(time, abs=1e-9)
        assert point["positions"] == position.tolist()
        assert point["velocities"] == velocity.tolist()
        assert len(point["accelerations"]) == 5


def test_json_gives_every_bit_back(tmp_path: Path, trajectory: zs.Trajectory) -> None:
    trajectory.to_json(tmp_path / "motion.json")
    assert same_bits(zs.Trajectory.from_json(tmp_path / "motion.json", MACHINE), trajectory)


@pytest.mark.parametrize("seed", [29, 63])
def test_json_gives_every_bit_of_a_plan_back(tmp_path: Path, seed: int) -> None:
    plan = planned_random(seed)[1]
    plan.trajectory.to_json(tmp_path / "motion.json")
    assert same_bits(
        zs.Trajectory.from_json(str(tmp_path / "motion.json"), MACHINE), plan.trajectory
    )


def changed_json(tmp_path: Path, change: Any) -> Path:
    """A good file, its content changed in place."""
    path = tmp_path / "motion.json"
    random_trajectory(jerks=False).to_json(path)
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    return path


def test_json_of_a_bare_joint_trajectory_with_joints_in_another_order_is_read(
    tmp_path: Path,
) -> None:
    def change(content: dict[str, Any]) -> None:
        content["header"] = {"frame_id": ""}
        content["joint_names"].reverse()
        for point in content["points"]:
            del point["jerks"], point["time"]
            point["effort"] = []
            for field in ("positions", "velocities", "accelerations"):
                point[field].reverse()

    read, asked = (
        zs.Trajectory.from_json(changed_json(tmp_path, change), MACHINE),
        random_trajectory(jerks=False),
    )
    np.testing.assert_allclose(read.times, asked.times, atol=1e-9)
    np.testing.assert_array_equal(read.positions, asked.positions)
    np.testing.assert_array_equal(read.accelerations, asked.accelerations)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda content: content.pop("points"), "list of points"),
        (lambda content: content.update(points=[]), "at least 2 nodes"),
        (lambda content: content.update(points=[1, 2]), "point 0 must be an object"),
        (lambda content: content.update(joint_names="slew"), "joint_names must be a list"),
        (lambda content: content["joint_names"].__setitem__(1, "bloom"), "joint_names are .*bloom"),
        (
            lambda content: content["joint_names"].__setitem__(1, "slew"),
            "joint_names are slew, slew",
        ),
        (lambda content: content["points"][1].pop("velocities"), "point 1: velocities must"),
        (
            lambda content: content["points"][2].update(positions=[1.0]),
            r"point 2: positions must have shape \(5,\)",
        ),
        (
            lambda content: content["points"][2].update(positions=["1"] * 5),
            "point 2: positions must be numbers",
        ),
        (
            lambda content: content["points"][1]["positions"].__setitem__(0, 10**400),
            "point 1: positions",
        ),
        (
            lambda content: content["points"][1]["positions"].__setitem__(0, float("nan")),
            "must be finite",
        ),
        (lambda content: content["points"][1].update(time=True), "point 1: time must be a number"),
        (
            lambda content: content["points"][1].update(time=-1.0),
            "time says -1.0 s, but time_from_start",
        ),
        (lambda content: content["points"][1].update(jerks=None), "point 1: jerks must"),
        (
            lambda content: content["points"][2].update(base={}),
            "base must be an object at every point",
        ),
        (
            lambda content: [p.update(base={"x": 0.0}) for p in content["points"]],
            "point 0: base y must be a number",
        ),
        (
            lambda content: [p.pop("time") and p.pop("time_from_start") for p in content["points"]],
            "sec and nanosec",
        ),
        (
            lambda content: content["points"][3]["positions"].__setitem__(1, 9.0),
            "node .*, joint 'boom'",
        ),
    ],
)
def test_bad_json_is_refused_with_the_offender(tmp_path: Path, change: Any, message: str) -> None:
    with pytest.raises(zs.ZmpSqpError, match=message):
        zs.Trajectory.from_json(changed_json(tmp_path, change), MACHINE)


@pytest.mark.parametrize("text", ["", "{", "[]", "null", "\xff", "[" * 100_000, "1" * 5000])
def test_what_is_no_json_object_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "motion.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(zs.ZmpSqpError, match=r"motion\.json"):
        zs.Trajectory.from_json(path, MACHINE)
    with pytest.raises(zs.ZmpSqpError, match="cannot read"):
        zs.Trajectory.from_json(tmp_path / "nothing.json", MACHINE)


def edited(
    tmp_path: Path, edit: dict[tuple[int, str], str] | None = None, *, header: str | None = None
) -> Path:
    """A good file with some entries (row, column) replaced, or another header."""
    path = tmp_path / "motion.csv"
    random_trajectory(jerks=False).to_csv(path)
    rows = [line.split(",") for line in path.read_text().splitlines()]
    for (row, column), text in (edit or {}).items():
        rows[row][rows[0].index(column)] = text
    lines = [",".join(row) for row in rows]
    if header is not None:
        lines[0] = header
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        ({(3, "boom.position"): "9.0"}, r"node 2.*'boom'"),
        ({(4, "slew.velocity"): "9.0"}, r"node 3.*'slew'"),
        ({(2, "head.acceleration"): "50"}, r"node 2.*'head'"),
        ({(3, "time"): "0.0"}, "times"),
        ({(1, "time"): "0.5"}, "times must start at 0"),
        ({(3, "stick.position"): "nan"}, "finite"),
        ({(3, "stick.position"): "inf"}, "finite"),
        ({(3, "stick.position"): "far"}, r"row 4.*far"),
        ({(3, "stick.position"): ""}, "row 4"),
        ({(3, "stick.position"): "1.0,2.0"}, "row 4"),
        ({(0, "tilt.position"): "lift.position"}, "tilt.position"),
        ({(0, "tilt.position"): "slew.position"}, "slew.position"),
        ({(0, "tilt.jerk"): "lift.jerk"}, "tilt.jerk"),
    ],
)
def test_files_that_are_no_consistent_motion_are_refused(
    tmp_path: Path, edit: dict[tuple[int, str], str], message: str
) -> None:
    with pytest.raises(zs.TrajectoryError, match=message):
        zs.Trajectory.from_csv(edited(tmp_path, edit), MACHINE)


@pytest.mark.parametrize(
    "content", [b"", b"time\n", b"\xff\xfe\x00", b"a,b\n1,2\n", b'"time', b"\x00"]
)
def test_files_that_are_no_trajectory_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "motion.csv").write_bytes(content)
    with pytest.raises(zs.TrajectoryError, match=r"motion\.csv"):
        zs.Trajectory.from_csv(tmp_path / "motion.csv", MACHINE)


def test_a_file_with_one_node_alone_is_refused(tmp_path: Path) -> None:
    path = edited(tmp_path)
    path.write_text("\n".join(path.read_text().splitlines()[:2]) + "\n")
    with pytest.raises(zs.TrajectoryError, match="at least 2 nodes"):
        zs.Trajectory.from_csv(path, MACHINE)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(zs.TrajectoryError, match=r"nothing\.csv"):
        zs.Trajectory.from_csv(tmp_path / "nothing.csv", MACHINE)


def test_a_file_of_another_machine_is_refused(tmp_path: Path) -> None:
    with pytest.raises(zs.TrajectoryError, match=r"slider\.position"):
        zs.Trajectory.from_csv(edited(tmp_path), zs.load_machine("slider"))


# --- misuse -------------------------------------------------------------------------------------


@pytest.mark.parametrize("t", [-0.1, 100.0, np.nan, np.inf, "soon", None, [[0.1]], [0.1, -1.0]])
def test_times_outside_or_that_are_none_are_refused(trajectory: zs.Trajectory, t: object) -> None:
    with pytest.raises(zs.TrajectoryError):
        trajectory(t)


def test_times_outside_by_rounding_are_taken(trajectory: zs.Trajectory) -> None:
    np.testing.assert_array_equal(
        trajectory(trajectory.duration * (1 + 1e-15))[0], trajectory(trajectory.duration)[0]
    )


def test_inconsistent_arrays_are_refused() -> None:
    good = random_trajectory(jerks=False)
    fields = [good.times, good.positions, good.velocities, good.accelerations]
    for i, bad in (
        (0, good.times[::-1]),
        (0, good.times + 1.0),
        (0, good.times[:-1]),
        (1, good.positions + np.eye(8, 5)),
        (2, good.velocities[:, :4]),
        (2, good.velocities * np.nan),
        (3, good.accelerations[:-1]),
        (3, good.accelerations + 1.0),
        (1, "here"),
        (1, None),
    ):
        changed = [bad if i == at else field for at, field in enumerate(fields)]
        with pytest.raises(zs.TrajectoryError):
            zs.Trajectory(MACHINE.joint_names, *changed)
