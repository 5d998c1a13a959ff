"""Numbers that look like another unit: taken as given, with a warning that says which."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

import zmp_sqp as zs
import zmp_sqp.cli as cli
from tests.test_cli import TIPPING
from zmp_sqp.mechanics.plausible_payload import payload_doubts

COM = (0.0, 0.0, 3.323)


@pytest.mark.parametrize(
    ("mass", "com", "words"),
    [
        (1.5, COM, r"1\.5 kg is 0\.006\d % of the machine's .* in tonnes, give 1500 kg"),
        (500e3, COM, "times as heavy as the machine"),
        (4000.0, (0.0, 0.0, 3323.0), r"in millimetres, give com = \[0, 0, 3\.323\] m"),
    ],
)
def test_an_implausible_payload_is_asked_about(mass: float, com: tuple, words: str) -> None:
    machine = zs.load_machine("feller_buncher")
    with pytest.warns(zs.MachineWarning, match=words):
        loaded = machine.with_payload(zs.Payload(mass, com, "head"))
    assert loaded.payload_mass == pytest.approx(mass)  # it is taken as it is given


@pytest.mark.parametrize("mass", [20.0, 500.0, 16000.0])
def test_a_plausible_payload_is_not(mass: float) -> None:
    machine = zs.load_machine("feller_buncher")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        machine.with_payload(zs.Payload(mass, COM, "head"))


def test_a_light_payload_of_a_light_machine_is_no_tonnage() -> None:
    payload = zs.Payload(0.01, (0.0, 0.0, 0.1), "slider")
    assert payload_doubts(payload, 500.0, None) == []
    assert len(payload_doubts(payload, 5000.0, None)) == 1


def test_angles_of_many_turns_may_be_degrees() -> None:
    unlimited = {"position_lower": {"slew": -np.inf}, "position_upper": {"slew": np.inf}}
    machine = zs.load_machine("feller_buncher", limits=unlimited)
    pose = [-0.8, -2.0, 0.7, 0.0]
    with pytest.warns(zs.ProblemWarning, match=r"goal of joint 'slew' is 90 rad.*it is 1\.571 rad"):
        zs.Problem(machine, [0.0, *pose], [90.0, *pose])


def test_a_slope_in_degrees_is_recognised() -> None:
    with pytest.raises(zs.MachineError, match=r"in degrees, -20 is -0\.3491 rad"):
        zs.Slope(roll=-20.0)


def test_the_command_line_prints_warnings_as_lines(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "tonnes.toml"
    path.write_text(TIPPING.replace("mass = 4000", "mass = 4"), encoding="utf-8")
    assert cli.main(["plan", str(path), "--json", "-"]) == 0
    printed, said = capsys.readouterr()
    assert printed.startswith("{")
    lines = [line for line in said.splitlines() if "warning" in line]
    assert len(lines) == 1
    assert lines[0].startswith("zmp-sqp: warning: a payload of 4 kg is ")
    assert ".py" not in said
