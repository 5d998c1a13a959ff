"""Plans that several tests look at are made once per process."""

from __future__ import annotations

from functools import cache

import zmp_sqp as zs
from tests.problems import NamedProblem, paper_1, random_problem


@cache
def planned_paper_1(point_masses: bool) -> tuple[NamedProblem, zs.Plan]:
    named = paper_1(point_masses=point_masses)
    return named, zs.plan(named.problem)


@cache
def planned_random(seed: int) -> tuple[NamedProblem, zs.Plan]:
    named = random_problem(seed)
    return named, zs.plan(named.problem)
