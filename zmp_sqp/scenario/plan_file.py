"""A plan.json as input: the scenario that it holds, for which its motion was planned."""

from __future__ import annotations

import json
import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from zmp_sqp.arrays import finite_number, shortened
from zmp_sqp.errors import ScenarioError, ZmpSqpError
from zmp_sqp.scenario.load import SHIPPED, Scenario, scenario_of

__all__ = ["PlanFile"]

LARGEST = 64 << 20  # [bytes]
WRITER = "`zmp-sqp plan SCENARIO --out DIR`"
KEYS: dict[str, type | tuple[type, ...]] = {  # that a check needs
    "scenario": str,
    "scenario_text": str,
    "success": bool,
    "message": str,
    "margin_asked": (int, float),
    "trajectory": (dict, type(None)),
}


@dataclass(frozen=True, slots=True, eq=False)
class PlanFile:
    """Content of a plan.json.

    Attributes:
        path: Path of the file.
        content: What it holds.
    """

    path: Path
    content: dict[str, Any] = field(repr=False)

    @classmethod
    def read(cls, path: str | Path, *, needs_motion: bool = True) -> PlanFile:
        """Read and check a file.

        Args:
            path: Path of the file.
            needs_motion: Whether a plan without success is refused.

        Raises:
            ScenarioError: The file is no plan.json with a motion; the message names it and says
                what is wrong.
            OSError: It cannot be read.
        """
        path = Path(path)
        if path.stat().st_size > LARGEST:
            raise ScenarioError(f"{path}: larger than 64 MB, so it is no plan.json")
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except (ValueError, RecursionError) as cause:  # not JSON, or not UTF-8
            raise ScenarioError(f"{path}: not a JSON file: {cause}") from None
        if not isinstance(content, dict) or "success" not in content or "scenario" not in content:
            raise ScenarioError(
                f"{path}: not a plan.json, which {WRITER} writes; a motion alone needs its machine "
                "or scenario beside it"
            )
        if lacking := [key for key in KEYS if key not in content]:
            raise ScenarioError(
                f"{path}: made by an earlier version, it lacks {', '.join(lacking)}; plan again"
            )
        for key, kind in KEYS.items():
            if not isinstance(content[key], kind):
                raise ScenarioError(
                    f"{path}: {key} cannot be {shortened(content[key])}: the file is damaged"
                )
        if needs_motion and content["trajectory"] is None:
            raise ScenarioError(f"{path}: it holds no motion: {content['message']}")
        return cls(path, content)

    def scenario(self) -> Scenario:
        """Scenario of the plan, with the margin that was asked for.

        Paths in it are relative to the folder of the scenario file, if that is still there, else to
        that of the plan.

        Raises:
            ScenarioError: The text is no scenario, or a file that it names is not there; the
                message says so.
        """
        tables = self.tables()
        try:
            found = scenario_of(tables, self.place)
            return replace(found, problem=replace(found.problem, margin=self.margin))
        except ZmpSqpError as cause:
            raise ScenarioError(
                f"{self.path}: the scenario in it cannot be used; if files that it names lie "
                f"elsewhere, give it by --scenario: {cause}"
            ) from cause

    def tables(self) -> dict[str, Any]:
        """Unchecked tables of the scenario; raises ScenarioError if its text is no TOML."""
        try:
            return tomllib.loads(self.content["scenario_text"])
        except ValueError as cause:
            raise ScenarioError(f"{self.path}: its scenario_text is no TOML: {cause}") from None

    @property
    def margin(self) -> float:
        """Margin that was asked for [m]; raises ScenarioError if it is not finite."""
        asked = self.content["margin_asked"]
        return finite_number(asked, name=f"{self.path}: margin_asked", error=ScenarioError)

    @property
    def place(self) -> Path:
        """Path of the scenario file, to which paths in it are relative."""
        name = f"{Path(self.content['scenario']).name}.toml"
        given = self.content.get("scenario_path")
        if isinstance(given, str) and "\0" not in given and Path(given).is_file():
            return Path(given)
        if given is None and (SHIPPED / name).is_file():
            return SHIPPED / name
        return self.path.with_name(name)
