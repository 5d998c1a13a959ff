"""What a verdict rests on: every assumption is said, and nothing that is not so."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np

import zmp_sqp as zs
from zmp_sqp.scenario import load_scenario
from zmp_sqp.show.basis import Basis, basis_fields, basis_lines


def test_a_bare_machine_says_that_it_is_level_and_empty() -> None:
    basis = Basis.of(zs.load_machine("feller_buncher"), zs.Slope(), 0.0)
    assert (basis.ground, basis.payload, basis.margin) == ("level", "none", 0.0)
    assert basis.uncertainties == ()
    assert "the ground" in basis.exact
    assert "the payload" not in basis.exact
    assert "joint torques and forces" in basis.not_looked_at
    text = "\n".join(basis_lines(basis))
    assert "payload         none" in text
    assert "0 m asked for" in text
    assert "point masses" not in text


def test_a_problem_says_payload_slope_and_mass_model() -> None:
    basis = Basis.of_problem(load_scenario("paper_1").problem)
    assert basis.ground == "slope with a roll of -20 and a pitch of 0 degrees"
    assert basis.payload == "4,000 kg at (0, 0, 3.323) m of head"
    assert basis.machine.endswith("point masses")
    assert {"the payload", "the ground"} <= set(basis.exact)


def test_constraints_and_base_count_as_looked_at() -> None:
    torque = Basis.of_problem(load_scenario("torque").problem)
    assert "constraint torque_limits" in torque.looked_at
    assert "joint torques and forces" not in torque.not_looked_at
    assert "limits of the base" in Basis.of_problem(load_scenario("retreat").problem).looked_at


def test_what_is_uncertain_is_not_called_exact() -> None:
    problem = replace(
        load_scenario("paper_1").problem,
        tipping_fraction=0.9,
        payload_uncertainty=0.1,
        payload_com_uncertainty=0.05,
        slope_uncertainty=0.01,
    )
    basis = Basis.of_problem(problem)
    assert len(basis.uncertainties) == 4
    assert not {"the payload", "the ground"} & set(basis.exact)


def test_limits_that_are_not_given_are_named() -> None:
    machine = zs.load_machine("feller_buncher")
    absent = np.array([np.nan, *machine.limits.acceleration[1:]])
    machine = replace(machine, limits=replace(machine.limits, acceleration=absent))
    basis = Basis.of(machine, zs.Slope(), 0.0)
    assert "accelerations of slew (no limit given)" in basis.not_looked_at
    assert "joint accelerations" in basis.looked_at


def test_fields_are_json_with_the_keys_of_the_class() -> None:
    basis = Basis.of_problem(load_scenario("terrain").problem, motion=["as in the file"])
    fields = json.loads(json.dumps(basis_fields(basis)))
    assert fields["ground"].startswith("heightmap of 27 x 25 samples")
    assert fields["motion"] == ["as in the file"]
    assert "  motion          as in the file" in basis_lines(basis)
