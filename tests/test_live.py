"""Live line: what a search is about, on a terminal only; an interrupt leaves what is done."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

import zmp_sqp as zs
from tests.test_cli import STRETCHED
from zmp_sqp.commands.live import LiveLine, Steps
from zmp_sqp.scenario import load_scenario

pty = pytest.importorskip("pty")
LONGEST = 60.0  # [s]


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    path = tmp_path / "stretched.toml"
    # long enough for several pictures of the live line, of which there are 12 a second
    path.write_text(STRETCHED.replace("intervals = 20", "intervals = 200"), encoding="utf-8")
    return path


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "zmp_sqp.cli", *arguments]


class Terminal:
    """A process whose standard error is a terminal."""

    def __init__(self, *arguments: str) -> None:
        self.screen, other = pty.openpty()
        self.seen = ""
        environment = os.environ | {"TERM": "xterm", "COLUMNS": "120"}
        # a file, because a pipe that nobody reads meanwhile takes no more than 64 KiB
        output, printed = tempfile.mkstemp()
        self.printed = Path(printed)
        self.process = subprocess.Popen(
            command(*arguments), stdout=output, stderr=other, env=environment, text=True
        )
        os.close(output)
        os.close(other)

    def read(self, until: str = "") -> str:
        """What the terminal has shown until a text was shown, or until the process ends."""
        end = time.monotonic() + LONGEST
        while time.monotonic() < end and not (until and until in self.seen):
            try:
                part = os.read(self.screen, 4096)
            except OSError:  # the other side is closed
                break
            self.seen += part.decode(errors="replace")
        return self.seen

    def end(self) -> tuple[int, str]:
        """Exit code, and what was printed on standard output."""
        self.process.wait(timeout=LONGEST)
        os.close(self.screen)
        printed = self.printed.read_text(encoding="utf-8")
        self.printed.unlink()
        return self.process.returncode, printed


def test_a_terminal_shows_stage_iterations_and_violation(scenario: Path) -> None:
    terminal = Terminal("plan", str(scenario), "--json", "-")
    shown = terminal.read()
    code, printed = terminal.end()
    assert code == 1
    for words in ("explore: ", "iteration ", "least violation ", "diagnose: trying with a payload"):
        assert words in shown
    assert json.loads(printed)["success"] is False


def test_a_pipe_shows_no_live_line(scenario: Path) -> None:
    done = subprocess.run(
        command("plan", str(scenario), "--no-diagnosis", "--json", "-"),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert "iteration " not in done.stderr
    assert "\x1b" not in done.stderr + done.stdout
    assert json.loads(done.stdout)["success"] is False


def test_an_interrupted_diagnosis_leaves_the_plan(scenario: Path, tmp_path: Path) -> None:
    terminal = Terminal("plan", str(scenario), "--out", str(tmp_path / "out"))
    assert "diagnose: " in terminal.read(until="diagnose: ")
    terminal.process.send_signal(signal.SIGINT)
    shown = terminal.read()
    code, printed = terminal.end()
    assert code == 130
    assert "interrupted, without: a payload or slope" in printed
    assert "still tips the machine over" in printed
    assert "Traceback" not in shown + printed
    result = json.loads((tmp_path / "out" / "plan.json").read_text())
    assert result["success"] is False
    assert result["diagnosis"] is None


def test_an_interrupted_search_ends_quietly(tmp_path: Path) -> None:
    path = tmp_path / "long.toml"
    path.write_text(STRETCHED.replace("intervals = 20", "intervals = 400"), encoding="utf-8")
    terminal = Terminal("plan", str(path))
    assert "iteration " in terminal.read(until="iteration ")
    terminal.process.send_signal(signal.SIGINT)
    shown = terminal.read()
    code, printed = terminal.end()
    assert (code, printed) == (130, "")
    assert "Traceback" not in shown
    assert "\x1b[?25h" in shown  # the cursor is back


def test_stages_are_announced_in_their_order(scenario: Path) -> None:
    announced: list[str] = []
    problem = load_scenario(scenario).problem
    plan = zs.plan(problem, announce=announced.append)
    stages = list(dict.fromkeys(words.partition(":")[0] for words in announced))
    assert stages == ["explore", "prove"]
    for run in plan.runs:
        if run.purpose != "probe at the bound":
            assert any(f"{run.purpose}, {run.intervals} intervals" in words for words in announced)


def test_the_line_has_the_least_violation_of_the_run() -> None:
    shown: list[str] = []
    line = LiveLine(shown.append)
    line.say("explore: one")
    plan = zs.plan(load_scenario("paper_1").problem)
    for record in plan.history:
        line.count(record)
    assert f"iteration {len(plan.history)}; " in shown[-1]
    assert f"{min(record.violation for record in plan.history):.1e}" in shown[-1]
    line.say("explore: two")
    assert "violation" not in shown[-1]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["check", "PLAN"], ["reading the motion", "proving: 50 intervals"]),
        (["inspect", "feller_buncher"], ["reading the machine", "poses"]),
        (["tradeoff", "paper_1", "--count", "2", "--workers", "1"], ["largest margin at rest"]),
        (
            ["chart", "feller_buncher", "--payload-frame", "head", "--radii", "4", "5"],
            ["load chart"],
        ),
        (
            ["envelope", "paper_1", "--x", "ground.roll_deg", "0", "5", "2", "--workers", "1"],
            ["posing problems", "18/18"],
        ),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else None,
)
def test_every_long_command_says_what_it_is_about(
    arguments: list[str], words: list[str], tmp_path: Path
) -> None:
    if "PLAN" in arguments:
        plan = ["plan", "paper_1", "--no-figures", "--out", str(tmp_path)]
        subprocess.run(command(*plan), check=True, capture_output=True)
    given = [str(tmp_path / "plan.json") if word == "PLAN" else word for word in arguments]
    terminal = Terminal(*given)
    shown = terminal.read()
    code, printed = terminal.end()
    assert code == 0, shown
    for word in words:
        assert word in shown
    assert "\x1b" not in printed  # standard output is a file
    piped = subprocess.run(command(*given), capture_output=True, text=True, check=True)
    assert "\x1b" not in piped.stderr
    for word in words:
        assert word not in piped.stderr


def test_an_interrupted_second_opinion_leaves_the_certificate(tmp_path: Path) -> None:
    pytest.importorskip("flint")
    plan = ["plan", "torque", "--no-figures", "--intervals", "200", "--out", str(tmp_path)]
    subprocess.run(command(*plan), check=True, capture_output=True)
    path, result = tmp_path / "plan.json", tmp_path / "check.json"
    before = path.read_bytes()
    terminal = Terminal("check", str(path), "--rigorous", "--json", str(result))
    assert "second opinion: stretch" in terminal.read(until="second opinion: stretch")
    terminal.process.send_signal(signal.SIGINT)
    shown = terminal.read()
    code, printed = terminal.end()
    assert code == 130
    assert "interrupted, without: second opinion" in printed
    assert "Safe at all times" in printed
    assert "Traceback" not in shown + printed
    found = json.loads(result.read_text(encoding="utf-8"))
    assert found["safe"] is True
    assert found["rigorous"] is None
    assert path.read_bytes() == before


def test_steps_after_a_ctrl_c_are_left_out_and_named() -> None:
    steps, ran = Steps(), []

    def interrupted(_: LiveLine) -> str:
        raise KeyboardInterrupt

    assert steps.run("one", lambda _: "done", lambda: "not") == "done"
    assert not steps.interrupted
    assert list(steps.lines()) == []
    assert steps.run("two", interrupted, lambda: "not") == "not"
    assert steps.run("three", lambda _: ran.append("three"), lambda: None) is None
    assert ran == []
    assert steps.interrupted
    assert list(steps.lines()) == ["interrupted, without: two, three"]
