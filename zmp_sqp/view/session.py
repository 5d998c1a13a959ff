"""Session of a live view: it plans, inspects and writes scenarios for the values on the page."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.errors import MachineWarning, ProblemWarning, ZmpSqpError, in_keys
from zmp_sqp.mechanics import Machine
from zmp_sqp.mechanics.inspection import Inspection, inspect
from zmp_sqp.planning import Plan, diagnose, plan
from zmp_sqp.report.parts import machine_parts
from zmp_sqp.report.record import urdf_of
from zmp_sqp.scenario import Scenario, scenario_of
from zmp_sqp.scenario.scene import build_ground
from zmp_sqp.scenario.text import scenario_text
from zmp_sqp.view.answers import (
    plan_answer,
    pose_answer,
    pose_record,
    refusal,
    unfinished_answer,
)
from zmp_sqp.view.controls import checked_values
from zmp_sqp.view.desk import Desk
from zmp_sqp.view.inspection_page import inspection_html
from zmp_sqp.view.memory import KeptMachine, QuickPlanner
from zmp_sqp.view.stance import Stance
from zmp_sqp.view.subject import Subject, relocated

__all__ = ["BUDGET", "Session"]

BUDGET = 0.25  # [s] of a plan while something is dragged
ATTEMPT = 1.0  # [s] at most with another payload or slope, before a newer request is heard
POSE = "shown"  # name of the pose of the sliders


class Session:
    """Answers to the requests of a page, one at a time, the newest first.

    Attributes:
        subject: What the view is about.
        desk: Queue of the requests.
        parts: What is drawn of the machine, without payloads.
    """

    def __init__(self, subject: Subject, budget: float = BUDGET) -> None:
        """Begin a session; `budget` is the time of a plan while something is dragged [s]."""
        self.subject = subject
        self.desk = Desk()
        table, folder = subject.content["machine"], subject.path.parent
        drawn = machine_parts(subject.machine, *urdf_of(table, folder))
        self.parts = [part for part in drawn if not part["payload"]]
        self._drawn = {part["joint"] for part in self.parts}
        self._quick = QuickPlanner(budget)
        self._kept = KeptMachine()

    def plan(self, given: object, *, settle: bool) -> dict[str, Any]:
        """Plan for the values of a request.

        Args:
            given: Values by key of the control, see `checked_values`; others are as they were.
            settle: Whether to search as long as `zmp-sqp plan` does, in place of a budget. A newer
                request ends such a search.

        Returns:
            The answer, see `plan_answer`; `milliseconds` has what it took.

        Raises:
            ScenarioError: The values are refused as such.
            Superseded: A newer request has come.
        """
        values = checked_values(given, self.subject.controls)
        with self._turn() as (still_wanted, said):
            began = time.perf_counter()
            try:
                scenario = self._scenario(values)
            except ZmpSqpError as cause:
                answer = refusal(self._words(cause) + self._hint(values), self._firmness(values))
                return self._with_times(answer, began, time.perf_counter() - began, said)
            start = time.perf_counter()
            allowed = self._quick.allowed
            found: Plan | None
            found = _settled(scenario, still_wanted) if settle else self._quick.plan(scenario)
            took = time.perf_counter() - start
            if found is None:
                answer = unfinished_answer(allowed)
            else:
                answer = plan_answer(found, self._drawn, settled=settle)
            return self._with_times(answer, began, took, said)

    def rest(self, given: object, *, tables: bool) -> dict[str, Any]:
        """Inspect the machine at rest in the pose of a request.

        Args:
            given: Values by key of the control; those of the group `pose` are the pose.
            tables: Whether to add the tables of `zmp-sqp inspect`.

        Returns:
            The answer, see `pose_answer`.

        Raises:
            ScenarioError: The values are refused as such.
            Superseded: A newer request has come.
        """
        values = checked_values(given, self.subject.controls)
        with self._turn() as (_, said):
            began = time.perf_counter()
            try:
                answer = self._rest(values, tables=tables)
            except ZmpSqpError as cause:
                answer = refusal(self._words(cause), None)
            return self._with_times(answer, began, time.perf_counter() - began, said)

    def advice(self, given: object) -> dict[str, Any]:
        """Look for a lighter payload or a gentler slope with which there is a safe motion.

        Args:
            given: Values by key of the control, for which no safe motion was found.

        Returns:
            `state` advice, and `words`, as HTML.

        Raises:
            ScenarioError: The values are refused as such.
            Superseded: A newer request has come.
        """
        values = checked_values(given, self.subject.controls)
        with self._turn() as (still_wanted, said):
            began = time.perf_counter()
            try:
                found = _settled(self._scenario(values), still_wanted)
                if found.success:
                    words = "There is a safe motion."
                else:
                    words = diagnose(
                        found, time_budget=ATTEMPT, progress=lambda _: still_wanted()
                    ).message.removeprefix(found.message)
            except ZmpSqpError as cause:
                words = self._words(cause)
            answer = {"state": "advice", "words": f"<p>{escape(words)}</p>"}
            return self._with_times(answer, began, time.perf_counter() - began, said)

    def text(self, given: object, target: Path | None) -> str:
        """Scenario file for the values of a request, which `zmp-sqp plan` reads.

        Args:
            given: Values by key of the control; others are as they were.
            target: File that it is for, to which paths are relative; None makes them absolute.

        Raises:
            ScenarioError: The values are refused as such.
        """
        subject = self.subject
        values = checked_values(given, subject.controls)
        folder = None if target is None else target.resolve().parent
        content = relocated(subject.content_with(values), subject.path.parent, folder)
        source = " ".join(subject.path.name.split())
        heading = (
            f"Saved by `zmp-sqp view`, from {source}. Plan it with `zmp-sqp plan THIS_FILE`.\n"
            "Metres, kilograms, seconds and radians; degrees where a key ends in _deg."
        )
        return scenario_text(content, subject.machine, heading)

    def _scenario(self, values: Mapping[str, float]) -> Scenario:
        """Checked scenario; raises ZmpSqpError if it is refused."""
        content = self.subject.content_with(values)
        return scenario_of(content, self.subject.path, build=self._kept.build)

    def _rest(self, values: Mapping[str, float], *, tables: bool) -> dict[str, Any]:
        subject = self.subject
        machine, stance = self._stance(values, "start")
        poses = {POSE: subject.pose(values, "pose")}
        found = self._inspection(machine, stance, poses)
        answer = pose_answer(machine, stance, found.poses[0], self._drawn, self._asked(values))
        if tables:
            named = self._inspection(machine, stance, subject.poses)
            answer["inspection"] = inspection_html(named, subject.warnings)
        return answer

    def _firmness(self, values: Mapping[str, float]) -> dict[str, Any] | None:
        """Picture of the machine at rest at start or goal, where it stands less firmly.

        None if it cannot be made.
        """
        found = []
        for end in ("start", "goal"):
            try:
                machine, stance = self._stance(values, end)
                pose = {end: self.subject.pose(values, end)}
                report = self._inspection(machine, stance, pose).poses[0]
                found.append((report.margin, machine, stance, report))
            except ZmpSqpError:
                return None
        _, machine, stance, report = min(found, key=lambda one: np.nan_to_num(one[0], nan=-np.inf))
        record = pose_record(machine, stance, report, self._drawn, self._asked(values))
        return record | {"broken": True, "pose": report.name}

    def _stance(self, values: Mapping[str, float], end: str) -> tuple[Machine, Stance]:
        """Machine with its payload, and where it stands at the start or goal of its base."""
        content = self.subject.content_with(values)
        folder = self.subject.path.parent
        machine = self._kept.build(content["machine"], folder)
        return machine, Stance.of(content, build_ground(content.get("ground", {}), folder), end=end)

    def _inspection(self, machine: Machine, stance: Stance, poses: Any) -> Inspection:
        tip, place = self.subject.tip
        return inspect(machine, stance.gravity_only, tip=tip, tip_offset=place, poses=poses)

    def _asked(self, values: Mapping[str, float]) -> float:
        asked = self.subject.content_with(values).get("plan", {}).get("margin", 0.0)
        return float(asked)

    def _words(self, cause: ZmpSqpError) -> str:
        """Message of an error without the path of the scenario."""
        return in_keys(str(cause)).removeprefix(f"{self.subject.path}: ")

    def _hint(self, values: Mapping[str, float]) -> str:
        """What the page itself can do about limits that are missing; empty if none are."""
        lacking = any(
            control.group == "missing" and not values.get(key)
            for key, control in self.subject.controls.items()
        )
        return ". The sliders under 'Limits that are missing' fill them in." if lacking else ""

    @contextmanager
    def _turn(self) -> Iterator[tuple[Callable[[], None], list[Any]]]:
        """Turn at the desk, with the warnings that are given meanwhile."""
        with self.desk.turn() as still_wanted, warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            yield still_wanted, said

    def _with_times(
        self, answer: dict[str, Any], began: float, took: float, said: list[Any]
    ) -> dict[str, Any]:
        """Answer with what it took [ms], and warnings."""
        noted = dict.fromkeys(
            str(warning.message)
            for warning in (*self._kept.said, *said)
            if issubclass(warning.category, MachineWarning | ProblemWarning)
        )
        return answer | {
            "milliseconds": {
                "plan": round(1e3 * took, 1),
                "all": round(1e3 * (time.perf_counter() - began), 1),
            },
            "warnings": [in_keys(text) for text in noted if text not in self.subject.warnings],
        }


def _settled(scenario: Scenario, still_wanted: Callable[[], None]) -> Plan:
    """Plan as `zmp-sqp plan` makes it, as long as it is wanted."""
    return plan(
        scenario.problem,
        qp_solver=scenario.qp_solver,
        progress=lambda _: still_wanted(),
        announce=lambda _: still_wanted(),
    )
