"""The live view in a real browser: it plans again while a slider moves, and stays on loopback."""

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from tests.chromium import PATIENCE, chromium
from tests.test_view import LEVEL, blocked, serving
from zmp_sqp.scenario import load_scenario, scenario_of
from zmp_sqp.view import Session, Subject, ViewServer, subject_of_machine, subject_of_scenario


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as started:
        yield started


class Opened:
    """A page of a live view, and what it has asked for and complained about."""

    def __init__(self, context: Any, server: ViewServer) -> None:
        self.server = server
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self.answers: list[dict[str, Any]] = []
        self.page = context.new_page()
        self.page.on("console", lambda message: self.complaints.append(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda asked: self.requests.append(asked.url))
        session = server.session
        plan, rest = session.plan, session.rest
        session.plan = lambda *given, **more: self.noted(plan(*given, **more))
        session.rest = lambda *given, **more: self.noted(rest(*given, **more))
        self.page.goto(server.url)
        self.settle()

    def noted(self, answer: dict[str, Any]) -> dict[str, Any]:
        self.answers.append(answer)
        return answer

    def settle(self) -> dict[str, Any]:
        """Wait for the answer to the newest change; returns it."""
        newest = self.page.evaluate("zmpView.newest()")
        self.page.wait_for_selector(
            f".live[data-settled=true][data-shown='{newest}']:not(.stale)", state="attached"
        )
        return self.answers[-1]

    def drag(self, control: str, value: float) -> None:
        """Move a slider as a pointer does."""
        self.page.eval_on_selector(
            f'[data-control="{control}"]',
            "(slider, value) => { slider.value = value;"
            " slider.dispatchEvent(new Event('input', { bubbles: true })); }",
            value,
        )

    def marker(self) -> list[float]:
        """Position of the zero moment point on the map [m]."""
        return self.page.eval_on_selector(
            "[data-marker=zmp]", "dot => [Number(dot.dataset.x), Number(dot.dataset.y)]"
        )

    def verdict(self) -> str:
        return str(self.page.inner_text(".verdict"))


@pytest.fixture
def view(browser: Any, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Opened]:
    """A view of paper_1, or of what the test's parameter makes; it must not complain."""
    make = getattr(request, "param", lambda folder: subject_of_scenario("paper_1"))
    subject: Subject = make(tmp_path)
    with serving(Session(subject, budget=5.0), tmp_path / "saved.toml") as server:
        context = browser.new_context(viewport={"width": 1300, "height": 850})
        context.set_default_timeout(PATIENCE)
        opened = Opened(context, server)
        yield opened
        context.close()
    own = f"http://127.0.0.1:{server.server_port}/"
    assert [url for url in opened.requests if not url.startswith((own, "blob:", "data:"))] == []
    assert opened.complaints == []


def test_a_slider_that_moves_plans_again(view: Opened) -> None:
    before = view.verdict()
    assert "4.5014 s" in before
    view.drag("goal.slew", 160.0)
    answer = view.settle()
    expected = zs.plan(
        scenario_of(
            view.server.session.subject.content_with({"goal.slew": 160.0}), Path("x.toml")
        ).problem
    )
    assert answer["duration"] == expected.duration
    assert view.verdict() != before
    shown = float(view.page.get_attribute(".line data", "value"))
    assert shown == expected.duration
    assert f"{expected.duration:.4f} s" in view.verdict()
    assert "Planned in" in view.page.inner_text(".times")
    # the goal was dragged: the machine is shown there, and the ZMP with it
    assert view.page.evaluate("zmpReport.time()") == pytest.approx(expected.duration, abs=1e-6)
    problem, motion = expected.problem, expected.trajectory
    at_goal = zs.trajectory_zmp(problem.machine, motion, motion.duration, problem.ground)
    np.testing.assert_allclose(view.marker(), at_goal, atol=1e-3)


def test_the_zmp_follows_slope_and_time(view: Opened) -> None:
    places = []
    for roll in (-20.0, -10.0, 0.0):
        view.drag("ground.roll", roll)
        view.settle()
        view.page.evaluate("zmpReport.seek(1.5)")
        places.append(view.marker())
        problem = load_scenario("paper_1").problem
        slope = zs.Slope(roll=np.deg2rad(roll))
        plan = zs.plan(zs.Problem(problem.machine, problem.start, problem.goal, ground=slope))
        expected = zs.trajectory_zmp(problem.machine, plan.trajectory, 1.5, slope)
        np.testing.assert_allclose(places[-1], expected, atol=2e-2)  # drawn from samples
        shown = view.page.evaluate("zmpReport.views[0].plan.marker.position.toArray()")
        np.testing.assert_allclose(shown[:2], places[-1], atol=1e-6)
    assert abs(places[0][1] - places[2][1]) > 0.1


def test_a_goal_that_tips_over_is_never_shown_as_safe(view: Opened) -> None:
    pixels = view.page.locator(".canvas canvas").screenshot()
    view.drag("goal.slew", 90.0)
    answer = view.settle()
    assert answer["state"] == "refused"
    assert "No safe motion" in view.verdict()
    assert "tips over at rest at the goal" in view.verdict()
    assert "Safe" not in view.verdict()
    assert "refused" in view.page.get_attribute(".verdict", "class")
    assert "tips over" in view.page.inner_text(".now")
    assert view.page.locator(".canvas canvas").screenshot() != pixels
    view.drag("goal.slew", 180.0)
    view.settle()
    assert "Safe, proven for all times" in view.verdict()


def test_what_is_shown_is_stale_while_a_new_plan_is_made(view: Opened) -> None:
    """The answer is held back: until it comes, nothing on the page says safe without a mark."""
    held: list[Any] = []
    holding = [True]
    view.page.route("**/plan", lambda route: held.append(route) if holding else route.continue_())
    view.drag("payload", 4500.0)
    view.page.wait_for_selector(".live.stale .badge:not([hidden])")
    assert "Stale" in view.page.inner_text(".badge")
    lead = "getComputedStyle(document.querySelector('.words'), '::before').content"
    assert "Before the change" in view.page.evaluate(lead)
    while not held:
        view.page.wait_for_timeout(20)
    holding.clear()
    for route in held:
        route.continue_()
    assert view.settle()["state"] == "safe"
    assert view.page.is_hidden(".badge")


def test_the_newest_of_many_changes_wins(view: Opened) -> None:
    count = len(view.answers)
    for degrees in np.arange(179.0, 159.0, -1.0).tolist():
        view.drag("goal.slew", degrees)
    answer = view.settle()
    slew = next(c for c in answer["record"]["plan"]["charts"] if c["title"] == "slew")
    assert slew["values"][-1] == pytest.approx(np.deg2rad(160.0), abs=1e-5)
    assert len(view.answers) - count < 20  # those in between were dropped


@pytest.mark.parametrize(
    "view", [lambda folder: subject_of_scenario(blocked(folder))], indirect=True
)
def test_the_least_violating_motion_is_red(view: Opened) -> None:
    assert view.answers[-1]["state"] == "unsafe"
    assert "No safe motion" in view.verdict()
    assert "violates its constraints least" in view.verdict()
    assert view.page.locator(".map .trail.out").count() > 0
    view.page.evaluate("zmpReport.seek(zmpReport.span / 2)")
    assert "tips over" in view.page.inner_text(".now")
    colours = view.page.evaluate(
        "zmpReport.views[0].plan.materials.map(({ material }) => material.color.toArray())"
    )
    assert all(red > max(green, blue) for red, green, blue in colours)
    view.page.click("#advise")
    view.page.wait_for_selector(".advice p")
    assert "kg" in view.page.inner_text(".advice")
    view.drag("payload", 100.0)
    assert view.settle()["state"] == "safe"
    assert view.page.inner_text(".advice") == ""


def test_the_number_box_and_the_keyboard_work(view: Opened) -> None:
    view.page.fill('[data-box="payload"]', "3210")
    view.settle()
    assert view.page.evaluate("zmpView.values()") == {"payload": 3210}
    before = view.page.evaluate("zmpReport.time()")
    view.page.focus('[data-control="goal.slew"]')
    view.page.keyboard.press("ArrowLeft")
    view.settle()
    assert view.page.evaluate("zmpView.values()")["goal.slew"] == 179.5
    assert view.page.input_value('[data-box="goal.slew"]') == "179.5"
    assert view.page.evaluate("zmpReport.time()") >= before
    newest = view.page.evaluate("zmpView.newest()")
    for wrong in ("1e9", "-3"):
        view.page.fill('[data-box="payload"]', wrong)
        assert view.page.get_attribute('[data-box="payload"]', "aria-invalid") == "true"
    assert view.page.evaluate("zmpView.newest()") == newest  # nothing was asked for
    view.page.click("#reset")
    view.settle()
    assert view.page.evaluate("zmpView.values()") == {}


def test_saving_writes_what_is_shown(view: Opened, tmp_path: Path) -> None:
    view.drag("goal.slew", 165.0)
    answer = view.settle()
    view.page.click("#save-file")
    view.page.wait_for_selector(".said:has-text('Saved to')")
    with view.page.expect_download() as download:
        view.page.click("#save-scenario")
    download.value.save_as(tmp_path / "downloaded.toml")
    for name in ("saved.toml", "downloaded.toml"):
        assert zs.plan(load_scenario(tmp_path / name).problem).duration == answer["duration"]
    content = tomllib.loads((tmp_path / "saved.toml").read_text())
    assert content["motion"]["goal_deg"][0] == 165.0


@pytest.mark.parametrize(
    "view",
    [
        lambda folder: subject_of_machine(
            {"machine": {"name": "forwarder_crane"}, "ground": LEVEL}, folder / "crane.toml"
        )
    ],
    indirect=True,
)
def test_a_machine_is_moved_at_rest_and_then_planned(view: Opened) -> None:
    assert "Stands at rest" in view.verdict()
    assert "telescope" in view.page.inner_text(".inspection")
    machine, still = zs.load_machine("forwarder_crane"), np.zeros(4)
    view.page.click("[data-pose=zero]")
    view.settle()
    zero = machine.pose("zero") if "zero" in machine.poses else np.array([0.0, 0.0, -0.1, 0.0])
    np.testing.assert_allclose(
        view.marker(), zs.zmp(machine, zero, still, still, zs.Slope()), atol=1e-4
    )
    view.drag("pose.slew", 90.0)
    view.settle()
    aside = zero + np.array([np.pi / 2, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(
        view.marker(), zs.zmp(machine, aside, still, still, zs.Slope()), atol=1e-4
    )
    view.page.click("[data-take=goal]")
    view.page.click("[data-mode=motion]")
    answer = view.settle()
    assert answer["state"] == "safe"
    assert "Safe, proven for all times" in view.verdict()
    slew = next(c for c in answer["record"]["plan"]["charts"] if c["title"] == "slew")
    assert slew["values"][-1] == pytest.approx(np.pi / 2, abs=1e-5)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_phone_has_no_sideways_scrolling_and_dark_mode_is_dark(browser: Any, scheme: str) -> None:
    with serving(Session(subject_of_scenario("paper_1"))) as server:
        context = browser.new_context(viewport={"width": 360, "height": 740}, color_scheme=scheme)
        context.set_default_timeout(PATIENCE)
        opened = Opened(context, server)
        wide = "[document.documentElement.scrollWidth, document.documentElement.clientWidth]"
        scrolled, shown = opened.page.evaluate(wide)
        assert scrolled <= shown
        paper = opened.page.evaluate("getComputedStyle(document.body).backgroundColor")
        darkest = max(map(int, paper.strip("rgb()").split(",")))
        assert (darkest < 64) == (scheme == "dark")
        opened.page.locator('[data-control="goal.head"]').scroll_into_view_if_needed()
        view, slider = (
            opened.page.locator(part).bounding_box()
            for part in (".view", '[data-control="goal.head"]')
        )
        # the machine stays in sight while a slider below is dragged
        assert view["y"] >= -1.0
        assert view["y"] + view["height"] <= slider["y"] + 1.0
        context.close()


def test_a_planner_that_is_gone_is_said(browser: Any) -> None:
    with serving(Session(subject_of_scenario("paper_1"))) as server:
        context = browser.new_context()
        context.set_default_timeout(PATIENCE)
        opened = Opened(context, server)
    opened.page.route("**/plan", lambda route: route.abort("connectionrefused"))
    opened.drag("goal.slew", 170.0)
    opened.page.wait_for_selector(".live.stale[data-state=lost]")
    assert "does not answer" in opened.page.inner_text(".times")
    assert opened.page.is_visible(".badge")
    context.close()
