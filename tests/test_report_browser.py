"""A report in a real browser: it opens without a network, plays, and shows the plan's numbers."""

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import zmp_sqp as zs
import zmp_sqp.cli as cli
from tests.chromium import PATIENCE, chromium
from zmp_sqp.report import make_page
from zmp_sqp.scenario import load_scenario


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("plan")
    arguments = ["plan", "paper_1", "--margin", "0.1", "--out", str(folder), "--no-figures"]
    assert cli.main(arguments) == 0
    return json.loads((folder / "plan.json").read_text())


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as started:
        yield started


@pytest.fixture
def page(
    browser: Any, result: dict[str, Any], tmp_path: Path, request: pytest.FixtureRequest
) -> Iterator[Any]:
    """The report of one plan, or of as many as the test's parameter says; it must not complain."""
    (tmp_path / "report.html").write_text(make_page([result] * getattr(request, "param", 1)))
    context = browser.new_context(offline=True, viewport={"width": 1100, "height": 800})
    context.set_default_timeout(PATIENCE)
    opened, complaints, requests = context.new_page(), [], []
    opened.on("console", lambda message: complaints.append(message.text))
    opened.on("pageerror", lambda error: complaints.append(str(error)))
    opened.on("request", lambda asked: requests.append(asked.url))
    opened.goto((tmp_path / "report.html").as_uri())
    yield opened
    assert requests == [(tmp_path / "report.html").as_uri()]
    assert complaints == []
    context.close()


def marker(page: Any) -> list[float]:
    """Position of the zero moment point on the map [m]."""
    return page.eval_on_selector(
        "[data-marker=zmp]", "circle => [Number(circle.dataset.x), Number(circle.dataset.y)]"
    )


def pixels(page: Any) -> bytes:
    return page.locator(".canvas canvas").first.screenshot()


def test_play_moves_the_machine_and_pause_stops_it(page: Any) -> None:
    before = pixels(page)
    page.select_option("#speed", "2")
    page.click("#play")
    give_up = time.monotonic() + 1e-3 * PATIENCE
    while page.evaluate("zmpReport.time()") < 1.0 and time.monotonic() < give_up:
        page.wait_for_timeout(50)
    page.click("#play")
    stopped = page.evaluate("zmpReport.time()")
    assert stopped >= 1.0
    assert pixels(page) != before
    page.wait_for_timeout(200)
    assert page.evaluate("zmpReport.time()") == stopped
    page.keyboard.press("Home")
    assert page.evaluate("zmpReport.time()") == 0.0
    assert pixels(page) == before


def test_the_zmp_marker_is_where_the_plan_has_it(
    page: Any, result: dict[str, Any], tmp_path: Path
) -> None:
    problem = load_scenario("paper_1").problem
    (tmp_path / "motion.json").write_text(json.dumps(result["trajectory"]))
    motion = zs.Trajectory.from_json(tmp_path / "motion.json", problem.machine)
    for k in (31, 151, 333):
        at = result["record"]["plan"]["times"][k] + 1e-6
        page.evaluate(f"zmpReport.seek({at!r})")
        expected = zs.trajectory_zmp(problem.machine, motion, at, problem.ground)
        np.testing.assert_allclose(marker(page), expected, atol=1e-3)
        shown = page.evaluate("zmpReport.views[0].plan.marker.position.toArray()")
        np.testing.assert_allclose(shown[:2], expected, atol=1e-3)


def test_the_payload_is_where_forward_kinematics_has_it(
    page: Any, result: dict[str, Any], tmp_path: Path
) -> None:
    """Seen from above in the frame of gravity: the whole chain of rotations of the 3-D view."""
    problem = load_scenario("paper_1").problem
    machine, record = problem.machine, result["record"]
    (tmp_path / "motion.json").write_text(json.dumps(result["trajectory"]))
    motion = zs.Trajectory.from_json(tmp_path / "motion.json", machine)
    number, part = next((i, part) for i, part in enumerate(record["parts"]) if part["payload"])
    among = sum(other["joint"] == part["joint"] for other in record["parts"][:number])
    up = -problem.ground.gravity()
    lean = pin.Quaternion.FromTwoVectors(up / np.linalg.norm(up), np.array([0.0, 0.0, 1.0]))
    frame = next(f for f in machine.model.frames if f.type == pin.FrameType.OP_FRAME)
    data = machine.model.createData()
    for at in (0.0, 1.7, 4.2):
        page.evaluate(f"zmpReport.seek({at})")
        pin.forwardKinematics(machine.model, data, machine.configuration(motion(at)[0][None])[0])
        com = data.oMi[frame.parentJoint] * frame.placement * frame.inertia.lever
        com = com - [0.0, 0.0, machine.support.height]
        shown = page.evaluate(
            "([joint, i]) => { const view = zmpReport.views[0];"
            " view.scene.updateMatrixWorld(true);"
            " return view.plan.bodies[joint].children[i].matrixWorld.elements.slice(12, 15); }",
            [part["joint"], among],
        )
        np.testing.assert_allclose(shown, lean.matrix() @ com, atol=5e-3)


@pytest.mark.parametrize("page", [1, 2], indirect=True)
def test_the_cursor_moves_in_all_plots(page: Any, result: dict[str, Any]) -> None:
    paths = "charts => charts.map((chart) => chart.querySelector('.cursor').getAttribute('d'))"
    page.evaluate("zmpReport.seek(1.0)")
    before = page.eval_on_selector_all("[data-chart]", paths)
    page.keyboard.press("ArrowRight")
    after = page.eval_on_selector_all("[data-chart]", paths)
    count = len(result["record"]["plan"]["charts"])
    assert len(before) % count == 0
    assert len(before) >= count
    assert all(old != new for old, new in zip(before, after, strict=True))
    chart = page.locator("[data-chart]").first
    chart.scroll_into_view_if_needed()
    box = chart.bounding_box()
    page.mouse.click(box["x"] + 0.6 * box["width"], box["y"] + 0.5 * box["height"])
    share = (0.6 * 320.0 - 46.0) / (312.0 - 46.0)
    assert page.evaluate("zmpReport.time()") == pytest.approx(share * result["duration"], rel=0.02)


def test_the_verdict_and_the_saved_data_are_those_of_the_plan(
    page: Any, result: dict[str, Any], tmp_path: Path
) -> None:
    values = page.eval_on_selector_all(".line data", "all => all.map((one) => Number(one.value))")
    assert values[:3] == [result["duration"], result["lower_bound"], result["margin"]]
    with page.expect_download() as download:
        page.click("#save")
    download.value.save_as(tmp_path / "saved.json")
    assert json.loads((tmp_path / "saved.json").read_text()) == result


def test_a_phone_has_no_sideways_scrolling_and_dark_mode_is_dark(
    browser: Any, result: dict[str, Any], tmp_path: Path
) -> None:
    (tmp_path / "report.html").write_text(make_page([result, result]))
    context = browser.new_context(
        offline=True, viewport={"width": 360, "height": 740}, color_scheme="dark"
    )
    opened = context.new_page()
    opened.goto((tmp_path / "report.html").as_uri())
    wide = "[document.documentElement.scrollWidth, document.documentElement.clientWidth]"
    scrolled, shown = opened.evaluate(wide)
    assert scrolled <= shown
    paper = opened.evaluate("getComputedStyle(document.body).backgroundColor")
    assert max(map(int, paper.strip("rgb()").split(","))) < 64
    context.close()


def test_what_is_guaranteed_is_a_line_with_its_value(page: Any, result: dict[str, Any]) -> None:
    for name in ("tip_over", "contact"):
        chart = page.locator(f"[data-chart='constraint:{name}']")
        found = next(one for one in result["guarantees"] if one["name"] == name)
        words = chart.locator(".guaranteedwords").text_content()
        amount, unit = words.removeprefix("guaranteed: ").split(" ", 1)
        scale = {"mm": 1e-3, "m": 1.0, "kN": 1e3, "N": 1.0}[unit]
        assert float(amount) * scale == pytest.approx(found["value"], rel=6e-3)
        line, curve = (
            chart.locator(kind).evaluate("it => [it.getBBox().y, it.getBBox().height]")
            for kind in ("path.guaranteed", "path.curve >> nth=0")
        )
        assert line[1] == 0.0
        # the lower end of the curve touches the line: y points down
        assert line[0] == pytest.approx(sum(curve), abs=1.5)


def test_a_stability_blind_drive_moves_with_its_base(browser: Any, tmp_path: Path) -> None:
    arguments = ["plan", "retreat", "--out", str(tmp_path), "--no-figures"]
    assert cli.main(arguments) == 0
    drive = json.loads((tmp_path / "plan.json").read_text())
    (tmp_path / "report.html").write_text(make_page([drive]))
    context = browser.new_context(offline=True, viewport={"width": 1100, "height": 800})
    context.set_default_timeout(PATIENCE)
    opened = context.new_page()
    opened.goto((tmp_path / "report.html").as_uri())
    blind = drive["record"]["blind"]
    for share in (0.0, 0.4, 1.0):
        k = int(share * (len(blind["times"]) - 1))
        opened.evaluate(f"zmpReport.seek({blind['times'][k]})")
        root, rest, shift = (
            opened.evaluate(f"zmpReport.views[0].blind.{where}.position.toArray()")
            for where in ("root", "marker.parent", "shift")
        )
        np.testing.assert_allclose(root, blind["root"][k][:3], atol=1e-4)
        np.testing.assert_allclose(rest, root)  # polygon and ZMP go with it
        assert shift == [0.0, 0.0, 0.0]
    assert np.linalg.norm(np.subtract(blind["root"][-1][:2], blind["root"][0][:2])) > 5.0
    context.close()
