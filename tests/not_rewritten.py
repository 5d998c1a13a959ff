"""Tests that say nothing about a feller-buncher whose URDF was rewritten, and why.

`pytest --machine` skips them. Keys are beginnings of test ids.
"""

from __future__ import annotations

__all__ = ["reason_to_skip"]

ALWAYS = {
    "tests/planning/test_rewritten.py": "rewrites the machine itself",
    "tests/planning/test_backends.py::test_a_problem_has_the_same_bits": (
        "compares with new processes, which load the shipped URDF"
    ),
    "tests/planning/test_quintics.py::test_certificates_of_motions_with_linear_acc": (
        "recorded to 1e-12 m, and guaranteed margins depend on the root by up to 2e-8 m"
    ),
}
WARNS = "asks for the file that a warning points at, which is where load_machine is replaced"
ROOT = "states a height or the ZMP's plane about the root's own origin"
ALWAYS |= {
    "tests/mechanics/test_contacts.py::test_sizes_in_other_units_are_warned_of": WARNS,
    "tests/mechanics/test_mass_and_inertia.py::test_impossible_inertias_are_one_warning": WARNS,
    "tests/mechanics/test_urdf.py::test_feller_buncher_stands_on_a_rectangle": ROOT,
    "tests/mechanics/test_zmp.py::test_zmp_is_the_centroidal_momentum_rate": ROOT,
}
DRIVES = "a base drives along the root's x axis, which is this machine's side"
STATED = "states roll, pitch or the name of an edge in the root's own axes"
OTHER = "another machine on a slope, which is stated about that machine's axes"
TURNED = {
    "tests/planning/test_base_bound.py": DRIVES,
    "tests/planning/test_driving.py::test_the_zmp_is_that_of_the_bodies_poses": DRIVES,
    "tests/planning/test_driving_problems.py": DRIVES,
    "tests/planning/test_slew.py::test_the_centre_moves_against_the_base": DRIVES,
    "tests/planning/test_terrain.py": DRIVES,
    "tests/planning/test_torque.py::test_a_machine_that_drives_keeps_its_torques_too": DRIVES,
    "tests/planning/test_certificate.py::test_the_least_sample_is_where_and_when": STATED,
    "tests/planning/test_diagnosis.py::test_a_plan_that_was_not_found_says_what_would_do": STATED,
    "tests/planning/test_edge_cases.py::test_a_problem_without_solution_is_a_status": STATED,
    "tests/planning/test_patience.py::test_the_motion_told_of_is_the_least": STATED,
    "tests/planning/test_robustness.py::test_corners_lean_as_their_words_say": STATED,
    "tests/planning/test_robustness.py::test_the_certificate_names_the_worst_corner": STATED,
    "tests/planning/test_detour.py::test_an_arm_on_a_tiny_base": OTHER,
    "tests/planning/test_mimic_motions.py": OTHER,
    "tests/planning/test_torque.py::test_on_a_slope_gravity_helps_one_way": OTHER,
}


def reason_to_skip(nodeid: str, *, turned: bool) -> str:
    """Why a test says nothing about a rewritten machine; empty if it does.

    Args:
        nodeid: Id of the test.
        turned: Whether the machine's front is the root's y axis.
    """
    known = {**ALWAYS, **TURNED} if turned else ALWAYS
    return next((why for start, why in known.items() if nodeid.startswith(start)), "")
