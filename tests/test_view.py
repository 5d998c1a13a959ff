"""The live view over HTTP: what it answers, to whom, and that it saves what it has planned."""

import http.client
import json
import re
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
import zmp_sqp.cli as cli
from zmp_sqp.errors import MachineError, ScenarioError
from zmp_sqp.mechanics import shipped_machines
from zmp_sqp.planning.search.answer import Status
from zmp_sqp.scenario import load_scenario, shipped_scenarios
from zmp_sqp.view import (
    Session,
    ViewServer,
    subject_of_machine,
    subject_of_plan,
    subject_of_scenario,
)
from zmp_sqp.view.desk import Desk, Superseded
from zmp_sqp.view.server import LARGEST, TOKEN

LEVEL = {"roll_deg": 0.0, "pitch_deg": 0.0}
BLOCKED = "hold = {boom = -0.5236, stick = -2.0944, tilt = 0.5236, head = -1.5708}\n"


@contextmanager
def serving(session: Session, save_to: Path | None = None) -> Iterator[ViewServer]:
    server = ViewServer(session, save_to=save_to)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,))
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@pytest.fixture(scope="module")
def server() -> Iterator[ViewServer]:
    with serving(Session(subject_of_scenario("paper_1"))) as started:
        yield started


def send(
    server: ViewServer, path: str, body: bytes | str, method: str = "POST", **headers: str
) -> tuple[int, Any, http.client.HTTPMessage]:
    """Status, content and headers of an answer; header names have _ for -."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=120)
    given = {"Content-Type": "application/json", TOKEN: server.token}
    given |= {name.replace("_", "-"): value for name, value in headers.items()}
    connection.request(method, path, body, given)
    answer = connection.getresponse()
    text = answer.read().decode()
    connection.close()
    is_json = answer.headers.get_content_type() == "application/json"
    return answer.status, json.loads(text) if is_json else text, answer.headers


def ask(server: ViewServer, path: str, **content: Any) -> dict[str, Any]:
    status, answer, _ = send(server, path, json.dumps(content))
    assert status == 200, answer
    return answer


def blocked(folder: Path) -> Path:
    """A slew that tips the machine over however slow it is, though it stands at both ends."""
    text = load_scenario("paper_1").path.read_text(encoding="utf-8")
    text = text.replace("point_masses = true", BLOCKED + "point_masses = true", 1)
    text = text.replace("start_deg = [0.0, -30.0, -120.0, 30.0, -90.0]", "start_deg = [0.0]")
    text = text.replace("goal_deg = [180.0, -30.0, -120.0, 30.0, -90.0]", "goal_deg = [180.0]")
    path = folder / "blocked.toml"
    path.write_text(text.replace("mass = 4000.0", "mass = 6000.0"), encoding="utf-8")
    return path


# --- who is answered ------------------------------------------------------------------------


def test_it_listens_on_loopback_alone(server: ViewServer) -> None:
    assert server.socket.getsockname()[0] == "127.0.0.1"
    assert server.url.startswith(f"http://127.0.0.1:{server.server_port}/?token=")
    others = {
        found[4][0]
        for found in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)
        if not found[4][0].startswith("127.")
    }
    for address in others:
        with pytest.raises(OSError, match=r"refused|unreachable|timed out"):
            socket.create_connection((address, server.server_port), timeout=2.0)


def test_the_page_needs_the_token_and_loads_nothing(server: ViewServer) -> None:
    status, page, headers = send(server, f"/?token={server.token}", "", "GET")
    assert status == 200
    policy = headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert headers["Referrer-Policy"] == "no-referrer"
    assert "http://" not in page.replace("http://www.w3.org/", "")
    for address in ("/", "/?token=", "/?token=x", f"/?token={server.token}x"):
        status, answer, _ = send(server, address, "", "GET")
        assert (status, server.token in str(answer)) == (403, False)
    status, answer, _ = send(server, f"/../etc/passwd?token={server.token}", "", "GET")
    assert status == 404


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "127.0.0.1:1", ""])
def test_other_names_for_this_computer_are_refused(server: ViewServer, host: str) -> None:
    """A page may point a name of its own to 127.0.0.1 and would then be of the same origin."""
    for method, path in (("GET", f"/?token={server.token}"), ("POST", "/plan")):
        status, answer, _ = send(server, path, "{}", method, Host=host)
        assert status == 403
        assert "this computer alone" in answer["error"]


def test_localhost_is_this_computer(server: ViewServer) -> None:
    host = f"localhost:{server.server_port}"
    assert send(server, "/rest", "{}", Host=host, Origin=f"http://{host}")[0] == 200


@pytest.mark.parametrize(
    ("headers", "expected"),
    [
        ({TOKEN: ""}, 403),
        ({TOKEN: "guess"}, 403),
        ({TOKEN: "gu\xe9ss"}, 403),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Content-Type": "text/plain"}, 415),  # what a form of another page can send
        ({"Content-Length": "x"}, 411),
        ({"Content-Length": "-1"}, 411),
        ({"Content-Length": str(LARGEST + 1)}, 413),
        ({"Content-Length": "9" * 400}, 413),
    ],
)
def test_requests_of_others_are_refused(
    server: ViewServer, headers: dict[str, str], expected: int
) -> None:
    status, answer, _ = send(server, "/plan", "{}", **headers)
    assert status == expected
    assert len(answer["error"].split()) > 3


def test_nothing_else_is_served(server: ViewServer) -> None:
    assert send(server, "/etc/passwd", "{}")[0] == 404
    assert send(server, "/plan", "", "GET")[0] == 404
    assert send(server, "/plan", "{}", "PUT")[0] == 501


# --- bad input ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("junk", "no JSON"),
        ("", "no JSON"),
        (b"\xff\xfe", "no JSON"),
        ("[" * 30_000, "no JSON"),
        ("[]", "JSON object"),
        ("null", "JSON object"),
        ('{"values": 3}', "table from controls"),
        ('{"values": [1, 2]}', "table from controls"),
        ('{"values": {"margin": NaN}}', "NaN is no number"),
        ('{"values": {"margin": Infinity}}', "Infinity is no number"),
        ('{"values": {"margin": 1e999}}', "margin must lie within"),
        ('{"values": {"margin": -0.1}}', "margin must lie within"),
        ('{"values": {"payload": 1e300}}', "payload must lie within"),
        ('{"values": {"payload": ' + "9" * 400 + "}}", "payload must lie within"),
        ('{"values": {"payload": ' + "9" * 5000 + "}}", "no JSON"),
        ('{"values": {"margin": "0.1"}}', "margin must be a number"),
        ('{"values": {"margin": true}}', "margin must be a number"),
        ('{"values": {"margin": null}}', "margin must be a number"),
        ('{"values": {"margin": [0.1]}}', "margin must be a number"),
        ('{"values": {"goal": [1, 2, 3, 4, 5]}}', "no control 'goal'"),
        ('{"values": {"goal.elbow": 1}}', "no control 'goal.elbow'"),
        ('{"values": {"goal.boom": 200}}', "goal.boom must lie within"),
        ('{"values": {"machine.urdf": "/etc/passwd"}}', "no control 'machine.urdf'"),
        ('{"settle": "yes"}', "true or false"),
        ('{"tables": 1}', "true or false"),
    ],
)
def test_bad_input_gets_a_sentence(server: ViewServer, body: str, words: str) -> None:
    paths = ("/rest",) if "tables" in str(body) else ("/plan", "/text")
    for path in ("/plan",) if "settle" in str(body) else paths:
        status, answer, _ = send(server, path, body)
        assert status == 400
        assert words in answer["error"]
        assert len(answer["error"]) < 2000
    assert ask(server, "/plan")["state"] == "safe"  # it still works


def test_random_requests_never_fail_inside(server: ViewServer) -> None:
    rng = np.random.default_rng(5)
    keys = [*server.session.subject.controls, "goal", "x", "limits.effort"]
    values = [0, -1, 1e6, 2.5, None, "a", [], {}, True, 10**30, -20.0, 45.0]
    statuses = set()
    for _ in range(60):
        chosen = {str(k): values[rng.integers(len(values))] for k in rng.choice(keys, 2)}
        path = str(rng.choice(["/plan", "/rest", "/text", "/advice"]))
        status, answer, _ = send(server, path, json.dumps({"values": chosen}))
        statuses.add(status)
        assert status in (200, 400), answer
    assert statuses == {200, 400}


# --- plans ----------------------------------------------------------------------------------


def problem_with_goal(degrees: float, **changes: Any) -> zs.Problem:
    problem = load_scenario("paper_1").problem
    goal = problem.goal.copy()
    goal[0] = np.deg2rad(degrees)
    own = {"margin": problem.margin, "ground": problem.ground} | changes
    return zs.Problem(problem.machine, problem.start, goal, intervals=problem.intervals, **own)


def test_a_settled_plan_is_that_of_plan(server: ViewServer) -> None:
    answer = ask(server, "/plan", values={"goal.slew": 160.0, "margin": 0.2}, settle=True)
    expected = zs.plan(problem_with_goal(160.0, margin=0.2))
    assert answer["state"] == "safe"
    assert answer["duration"] == expected.duration
    assert answer["margin"] == expected.certificate.margin
    assert f'<data value="{expected.duration!r}">' in answer["verdict"]
    assert answer["record"]["plan"]["duration"] == pytest.approx(expected.duration, abs=1e-9)


def test_a_quick_plan_is_certified_and_nearly_as_fast(server: ViewServer) -> None:
    """While it is dragged: each answer is proven, and leads to the goal that was asked for."""
    for degrees in (178.0, 171.0, 163.0, 160.0):
        answer = ask(server, "/plan", values={"goal.slew": degrees})
        if answer["state"] == "searching":  # on a machine with much else to do
            continue
        assert answer["state"] == "safe"
        best = zs.plan(problem_with_goal(degrees)).duration
        assert best * (1.0 - 1e-3) <= answer["duration"] <= best * 1.01
        slew = next(c for c in answer["record"]["plan"]["charts"] if c["title"] == "slew")
        assert slew["values"][-1] == pytest.approx(np.deg2rad(degrees), abs=1e-5)
        assert min(answer["record"]["plan"]["margin"]) >= -1e-6
        assert 0.0 < answer["milliseconds"]["plan"] <= answer["milliseconds"]["all"]


def test_every_setting_reaches_the_problem(server: ViewServer) -> None:
    """Against a problem made by hand, not by scenario files."""
    values = {
        "goal.boom": -40.0,
        "start.stick": -110.0,
        "ground.roll": -10.0,
        "ground.pitch": 3.0,
        "payload": 2000.0,
        "margin": 0.3,
        "limits.velocity": 80.0,
        "limits.acceleration": 150.0,
    }
    answer = ask(server, "/plan", values=values, settle=True)
    tree = zs.Payload(2000.0, (0.0, 0.0, 3.323), "head")  # a point mass, as the scenario asks
    machine = zs.load_machine("feller_buncher").with_payload(tree).with_point_masses()
    limits = machine.limits
    machine = machine.with_limits(
        velocity=0.8 * limits.velocity, acceleration=1.5 * limits.acceleration
    )
    problem = zs.Problem(
        machine,
        np.deg2rad([0.0, -30.0, -110.0, 30.0, -90.0]),
        np.deg2rad([180.0, -40.0, -120.0, 30.0, -90.0]),
        ground=zs.Slope(roll=np.deg2rad(-10.0), pitch=np.deg2rad(3.0)),
        margin=0.3,
    )
    assert answer["duration"] == pytest.approx(zs.plan(problem).duration, rel=1e-9)
    plain = ask(server, "/plan", settle=True)["duration"]
    assert abs(answer["duration"] - plain) > 0.1


def test_a_goal_that_tips_over_is_refused_with_the_reason(server: ViewServer) -> None:
    for settle in (False, True):
        answer = ask(server, "/plan", values={"goal.slew": 90.0}, settle=settle)
        assert answer["state"] == "refused"
        assert "No safe motion" in answer["verdict"]
        assert "tips over at rest at the goal" in answer["verdict"]
        assert "Safe" not in answer["verdict"]
        assert answer["record"]["broken"] is True
        assert answer["record"]["plan"]["margin"][0] < 0.0


def test_a_motion_that_is_not_safe_is_marked(tmp_path: Path) -> None:
    session = Session(subject_of_scenario(blocked(tmp_path)))
    quick = session.plan({}, settle=False)
    assert quick["state"] == "searching"
    assert quick["record"] is None
    assert "Safe" not in quick["verdict"]
    answer = session.plan({}, settle=True)
    assert answer["state"] == "unsafe"
    assert answer["duration"] is None
    assert "No safe motion" in answer["verdict"]
    assert "tips the machine over" in answer["verdict"]
    assert answer["record"]["broken"] is True
    assert min(answer["record"]["plan"]["margin"]) < -0.5


def test_advice_names_a_payload_that_would_do(tmp_path: Path) -> None:
    session = Session(subject_of_scenario(blocked(tmp_path)))
    answer = session.advice({})
    found = re.search(r"(\d+) kg", answer["words"])
    assert found is not None, answer
    lighter = float(found[1])
    assert 0.0 < lighter < 6000.0
    assert session.plan({"payload": lighter}, settle=True)["state"] == "safe"
    assert session.advice({"payload": 100.0})["words"] == "<p>There is a safe motion.</p>"


def test_a_budget_that_runs_out_grows_and_shrinks_again(tmp_path: Path) -> None:
    """Over terrain the first motion takes longer than those that start from it."""
    subject = subject_of_scenario("terrain")
    session = Session(subject, budget=0.02)
    states = [session.plan({"margin": 0.02}, settle=False)["state"] for _ in range(3)]
    assert states == ["searching"] * 3
    assert session._quick.allowed == pytest.approx(0.08)  # four times what was asked for
    session = Session(subject, budget=5.0)
    assert session.plan({"margin": 0.02}, settle=False)["state"] == "safe"
    assert session._quick.allowed == 5.0


@pytest.mark.parametrize("status", [Status.STOP, Status.KEPT])
def test_a_stop_or_an_older_motion_is_no_answer(
    monkeypatch: pytest.MonkeyPatch, status: Status
) -> None:
    """They are certified, too, but do not lead to the goal."""
    session = Session(subject_of_scenario("paper_1"))
    other = zs.plan(problem_with_goal(120.0, margin=0.0, ground=zs.Slope()))
    assert other.success
    found = zs.Plan.__new__(zs.Plan)
    for name in zs.Plan.__dataclass_fields__:
        object.__setattr__(found, name, getattr(other, name))
    object.__setattr__(found, "status", status)
    monkeypatch.setattr(zs.Planner, "plan", lambda *given, **more: found)
    answer = session.plan({}, settle=False)
    assert (answer["state"], answer["record"]) == ("searching", None)


def test_a_machine_at_rest_is_where_its_sliders_put_it(server: ViewServer) -> None:
    q = np.deg2rad([60.0, -20.0, -100.0, 30.0, -90.0])
    names = server.session.subject.machine.joint_names
    pose = {f"pose.{name}": float(np.rad2deg(x)) for name, x in zip(names, q, strict=True)}
    values = pose | {"ground.roll": -5.0, "payload": 3000.0}
    answer = ask(server, "/rest", values=values, tables=True)
    tree = zs.Payload(3000.0, (0.0, 0.0, 3.323), "head")
    machine = zs.load_machine("feller_buncher").with_payload(tree).with_point_masses()
    still, slope = np.zeros(5), zs.Slope(roll=np.deg2rad(-5.0))
    assert answer["state"] == "rest"
    margin = zs.stability_margin(machine, q, still, still, slope)
    assert answer["margin"] == pytest.approx(float(margin), abs=1e-6)
    shown = answer["record"]["plan"]["zmp"][0]
    np.testing.assert_allclose(shown, zs.zmp(machine, q, still, still, slope), atol=1e-5)
    assert "stick" in answer["inspection"]
    assert ask(server, "/rest", values=values | {"ground.roll": -28.0})["state"] == "tips"


# --- newest wins ----------------------------------------------------------------------------


def test_of_the_requests_that_wait_only_the_newest_is_done() -> None:
    desk, done, began, go = Desk(), [], threading.Event(), threading.Event()

    def work(number: int) -> None:
        try:
            with desk.turn() as still_wanted:
                if number == 0:
                    began.set()
                    go.wait(60.0)
                    with pytest.raises(Superseded):
                        still_wanted()
                else:
                    still_wanted()
                done.append(number)
        except Superseded:
            done.append(-number)

    threads = []
    for number in range(6):
        threads.append(threading.Thread(target=work, args=(number,)))
        threads[-1].start()
        assert began.wait(60.0)
        while desk._count <= number:
            time.sleep(1e-3)
    go.set()
    for thread in threads:
        thread.join(60.0)
    assert done[0] == 0
    assert sorted(done) == [-4, -3, -2, -1, 0, 5]


def test_a_newer_request_ends_a_long_search(monkeypatch: pytest.MonkeyPatch) -> None:
    began = threading.Event()

    def endless(problem: zs.Problem, *, progress: Any, **options: Any) -> None:
        began.set()
        while True:
            time.sleep(1e-3)
            progress(None)

    monkeypatch.setattr("zmp_sqp.view.session.plan", endless)
    with serving(Session(subject_of_scenario("paper_1"), budget=30.0)) as started:
        answers: list[Any] = []
        slow = threading.Thread(target=lambda: answers.append(ask(started, "/plan", settle=True)))
        slow.start()
        assert began.wait(60.0)
        assert ask(started, "/plan", values={"margin": 0.1})["state"] == "safe"
        slow.join(60.0)
        assert answers == [{"state": "superseded"}]


def test_the_end_of_the_view_ends_a_long_search(monkeypatch: pytest.MonkeyPatch) -> None:
    began, ended = threading.Event(), threading.Event()

    def endless(problem: zs.Problem, *, progress: Any, **options: Any) -> None:
        began.set()
        try:
            while True:
                time.sleep(1e-3)
                progress(None)
        finally:
            ended.set()

    monkeypatch.setattr("zmp_sqp.view.session.plan", endless)
    with serving(Session(subject_of_scenario("paper_1"))) as started:
        slow = threading.Thread(target=lambda: ask(started, "/plan", settle=True))
        slow.start()
        assert began.wait(60.0)
    assert ended.wait(60.0)
    slow.join(60.0)


# --- scenarios ------------------------------------------------------------------------------


def test_a_saved_scenario_gives_the_same_plan(tmp_path: Path) -> None:
    """Through the command line, from another folder, with paths, payload and limits changed."""
    (tmp_path / "there").mkdir()
    source = blocked(tmp_path / "there")
    urdf = shipped_machines()["feller_buncher"]
    for name in (urdf.name, "feller_buncher.joint_limits.yaml"):
        (tmp_path / "there" / name).write_bytes(urdf.with_name(name).read_bytes())
    text = source.read_text().replace('name = "feller_buncher"', f'urdf = "{urdf.name}"')
    source.write_text(text)
    values = {"payload": 2500.0, "goal.slew": 140.0, "margin": 0.15, "limits.velocity": 60.0}
    values["ground.roll"] = -8.0
    target = tmp_path / "saved.toml"
    with serving(Session(subject_of_scenario(source)), target) as started:
        shown = ask(started, "/plan", values=values, settle=True)
        assert ask(started, "/save", values=values) == {"saved": str(target)}
        (tmp_path / "elsewhere.toml").write_text(ask(started, "/text", values=values)["text"])
    assert shown["state"] == "safe"
    assert 'urdf = "there/feller_buncher.urdf"' in target.read_text()
    (tmp_path / "moved").mkdir()
    (tmp_path / "elsewhere.toml").rename(tmp_path / "moved" / "elsewhere.toml")  # absolute paths
    for path in (target, tmp_path / "moved" / "elsewhere.toml"):
        out = tmp_path / "out"
        assert cli.main(["plan", str(path), "--out", str(out), "--no-figures"]) == 0
        result = json.loads((out / "plan.json").read_text())
        assert result["duration"] == shown["duration"]
        assert result["margin"] == shown["margin"]


@pytest.mark.parametrize("name", shipped_scenarios())
def test_an_untouched_scenario_is_saved_as_the_same_problem(name: str, tmp_path: Path) -> None:
    session = Session(subject_of_scenario(name))
    (tmp_path / "same.toml").write_text(session.text({}, tmp_path / "same.toml"))
    ours, theirs = load_scenario(tmp_path / "same.toml"), load_scenario(name)
    for key in ("start", "goal", "start_velocity", "goal_velocity"):
        assert np.array_equal(getattr(ours.problem, key), getattr(theirs.problem, key))
    for key in ("margin", "intervals", "model", "constraints", "tipping_fraction"):
        assert getattr(ours.problem, key) == getattr(theirs.problem, key)
    assert (ours.title, ours.qp_solver) == (theirs.title, theirs.qp_solver)
    assert ours.problem.machine.mass == theirs.problem.machine.mass


def test_nothing_is_saved_without_save(server: ViewServer, tmp_path: Path) -> None:
    status, answer, _ = send(server, "/save", "{}")
    assert status == 400
    assert "--save" in answer["error"]
    with serving(Session(subject_of_scenario("paper_1")), tmp_path / "no" / "x.toml") as started:
        status, answer, _ = send(started, "/save", "{}")
    assert status == 400
    assert "cannot be written" in answer["error"]


def test_a_machine_alone_can_be_looked_at_planned_and_saved(tmp_path: Path) -> None:
    subject = subject_of_machine(
        {"machine": {"name": "forwarder_crane"}, "ground": LEVEL}, tmp_path / "crane.toml"
    )
    session = Session(subject)
    answer = session.rest({}, tables=True)
    assert answer["state"] == "rest"
    assert "telescope" in answer["inspection"]
    values = {"payload": 400.0, "goal.slew": 60.0, "goal.telescope": 1.0}
    planned = session.plan(values, settle=True)
    assert planned["state"] == "safe"
    path = tmp_path / "crane.toml"
    path.write_text(session.text(values, path), encoding="utf-8")
    problem = load_scenario(path).problem
    assert zs.plan(problem).duration == planned["duration"]
    assert problem.machine.mass == pytest.approx(zs.load_machine("forwarder_crane").mass + 400.0)


def test_a_machine_without_limits_or_polygon_is_shown_and_not_planned(tmp_path: Path) -> None:
    (tmp_path / "bare.urdf").write_text(
        """<robot name="bare"><link name="base"><inertial><mass value="100"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <link name="arm"><inertial><origin xyz="1 0 0"/><mass value="10"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>
        <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
    )
    table = {"urdf": "bare.urdf"}
    session = Session(subject_of_machine({"machine": table, "ground": LEVEL}, tmp_path / "x.toml"))
    answer = session.rest({}, tables=True)
    assert answer["state"] == "rest"
    assert "missing" in answer["inspection"]
    assert "no support polygon" in answer["verdict"]
    refused = session.plan({}, settle=True)
    assert refused["state"] == "refused"
    assert "limit" in refused["verdict"]


def test_limits_that_are_missing_are_filled_in(tmp_path: Path) -> None:
    urdf = shipped_machines()["forwarder_crane"]
    (tmp_path / "crane.urdf").write_bytes(urdf.read_bytes())  # without its joint_limits.yaml
    path = tmp_path / "crane.toml"
    table = {"urdf": "crane.urdf", "limits": {"acceleration": {"jib": 0.9}}}
    session = Session(subject_of_machine({"machine": table, "ground": LEVEL}, path))
    assert "missing.acceleration" in session.subject.controls
    assert "limits.acceleration" not in session.subject.controls
    refused = session.plan({}, settle=True)
    assert refused["state"] == "refused"
    assert "acceleration limit" in refused["verdict"]
    values = {"missing.acceleration": 0.7}
    planned = session.plan(values, settle=True)
    assert planned["state"] == "safe"
    path.write_text(session.text(values, path), encoding="utf-8")
    problem = load_scenario(path).problem
    assert problem.machine.limits.acceleration.tolist() == [0.7, 0.7, 0.9, 0.7]
    assert zs.plan(problem).duration == planned["duration"]


# --- what is viewed -------------------------------------------------------------------------


def test_a_plan_is_viewed_with_its_scenario_and_margin(tmp_path: Path) -> None:
    assert (
        cli.main(["plan", "paper_1", "--margin", "0.1", "--out", str(tmp_path), "--no-figures"])
        == 0
    )
    subject = subject_of_plan(tmp_path / "plan.json")
    assert subject.controls["margin"].value == 0.1
    result = json.loads((tmp_path / "plan.json").read_text())
    answer = Session(subject).plan({}, settle=True)
    assert (answer["duration"], answer["margin"]) == (result["duration"], result["margin"])


def test_sources_that_cannot_be_viewed_are_refused(tmp_path: Path) -> None:
    (tmp_path / "junk.json").write_text("{}")
    with pytest.raises(ScenarioError, match=r"not a plan\.json"):
        subject_of_plan(tmp_path / "junk.json")
    (tmp_path / "bytes.json").write_bytes(b"\xff\xff")
    with pytest.raises(ScenarioError, match="not a JSON file"):
        subject_of_plan(tmp_path / "bytes.json")
    with pytest.raises(ScenarioError, match="no such scenario"):
        subject_of_scenario(tmp_path / "none.toml")
    with pytest.raises(MachineError):
        subject_of_machine({"machine": {"urdf": "none.urdf"}, "ground": LEVEL}, tmp_path / "x.toml")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere.toml"], "no such scenario"),
        (["nowhere"], "no machine 'nowhere'"),
        (["nowhere.urdf"], "nowhere.urdf"),
        (["paper_1", "--roll", "5"], "--roll belongs to a URDF"),
        (["paper_1", "--payload", "5"], "--payload belongs to a URDF"),
        (["paper_1", "--port", "99999"], "--port must lie within"),
        (["paper_1", "--budget", "nan"], "--budget must lie within"),
        (["paper_1", "--budget", "0"], "--budget must lie within"),
        (["paper_1", "--save", "no/where.toml"], "no such folder"),
        (["feller_buncher", "--payload", "5"], "belong together"),
    ],
)
def test_the_command_refuses_what_makes_no_sense(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["view", "--no-browser", *arguments]) == 2
    assert words in capsys.readouterr().err


def test_a_port_that_is_taken_is_said(
    server: ViewServer, capsys: pytest.CaptureFixture[str]
) -> None:
    port = str(server.server_port)
    assert cli.main(["view", "paper_1", "--no-browser", "--port", port]) == 2
    assert f"--port {port}: Address already in use" in capsys.readouterr().err


def test_a_browser_that_waits_for_the_page_gets_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A browser in the terminal does not return before it is ended."""
    seen: list[int] = []

    def browse(url: str) -> bool:
        with urllib.request.urlopen(url, timeout=60.0) as page:
            seen.append(page.status)
        raise KeyboardInterrupt

    monkeypatch.setattr("webbrowser.open", browse)
    assert cli.main(["view", "paper_1"]) == 0
    assert seen == [200]
    assert "ended" in capsys.readouterr().out


def test_ctrl_c_ends_it_cleanly() -> None:
    command = [sys.executable, "-u", "-m", "zmp_sqp.cli", "view", "paper_1", "--no-browser"]
    running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert running.stdout is not None
    address = running.stdout.readline()
    assert "http://127.0.0.1:" in address
    running.stdout.readline()
    time.sleep(0.3)
    running.send_signal(2)
    said, complaints = running.communicate(timeout=60)
    assert (running.returncode, complaints) == (0, "")
    assert "ended" in said
