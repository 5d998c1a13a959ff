"""Scenario files: one planning problem each, written in TOML."""

from zmp_sqp.scenario.load import (
    SHIPPED,
    Scenario,
    load_scenario,
    read_content,
    scenario_of,
    shipped_scenarios,
    sliding_joints,
)
from zmp_sqp.scenario.schema import SCHEMA

__all__ = [
    "SCHEMA",
    "SHIPPED",
    "Scenario",
    "load_scenario",
    "read_content",
    "scenario_of",
    "shipped_scenarios",
    "sliding_joints",
]
