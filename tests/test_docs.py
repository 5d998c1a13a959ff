"""The code in docs runs, and what docs name is there."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest

import zmp_sqp as zs
import zmp_sqp.cli as cli
from tests.test_packaging import LAYERS, LEAVES

ROOT = Path(__file__).resolve().parents[1]
DOCS = sorted((ROOT / "docs").glob("*.md"))
ARCHITECTURE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
YOUR_MACHINE = (ROOT / "docs" / "your-machine.md").read_text(encoding="utf-8")
BLOCKS = re.compile(r"^```(python|sh|xml|yaml|toml)\n(.*?)^```", re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("path", DOCS, ids=lambda path: path.name)
def test_every_block_runs(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Files are written, commands run with the exit code that is expected, Python is executed."""
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"__name__": "__main__"}
    text = path.read_text(encoding="utf-8")
    for found in BLOCKS.finditer(text):
        language, block = found.groups()
        if language in ("xml", "yaml", "toml"):
            name = block.split("\n", 1)[0].strip("#<!-> ")
            Path(name).write_text(block, encoding="utf-8")
        elif language == "sh":
            for line in block.splitlines():
                run_line(line)
        else:
            above = text.count("\n", 0, found.start(2))  # so that a traceback names the page's line
            code = "\n" * above + block
            exec(compile(code, str(path), "exec", dont_inherit=True), names)
    capsys.readouterr()


def run_line(line: str) -> None:
    """Run a line `zmp-sqp ... # exit code N`; without the comment, the exit code must be 0."""
    program, *arguments = shlex.split(line, comments=True)
    assert program == "zmp-sqp", line
    expected = re.search(r"# exit code (\d)", line)
    assert cli.main(arguments) == (int(expected.group(1)) if expected else 0), line


def test_the_pages_have_code() -> None:
    assert len(BLOCKS.findall(ARCHITECTURE)) >= 4
    commands = {
        line.split()[1]
        for language, block in BLOCKS.findall(YOUR_MACHINE)
        for line in block.splitlines()
        if language == "sh"
    }
    assert commands >= {"inspect", "init", "plan", "check"}


def test_the_api_page_has_every_public_name_once() -> None:
    page = (ROOT / "docs" / "api.rst").read_text(encoding="utf-8")
    named = re.findall(r"^\.\. auto\w+:: (?:zmp_sqp\.)?(\w+)$", page, re.MULTILINE)
    assert sorted(named) == sorted(zs.__all__)


def test_the_table_of_speed_is_that_of_the_benchmark() -> None:
    from benchmarks.before_after import PAGE, RESULTS, page_table

    recorded = json.loads(RESULTS.read_text(encoding="utf-8"))
    assert page_table(recorded) in PAGE.read_text(encoding="utf-8")


@pytest.mark.parametrize("path", DOCS, ids=lambda path: path.name)
def test_every_file_that_docs_name_is_there(path: Path) -> None:
    links = re.findall(r"\]\(([^)#]+)\)", path.read_text(encoding="utf-8"))
    missing = [
        link for link in links if not link.startswith("http") and not (path.parent / link).exists()
    ]
    assert not missing


def test_the_page_on_architecture_has_a_row_for_every_wing() -> None:
    rows = "".join(line for line in ARCHITECTURE.splitlines() if line.startswith("| `"))
    wings = [name.removeprefix("zmp_sqp.") for name in (*LAYERS, *LEAVES)]
    assert not [wing for wing in wings if f"`{wing}`" not in rows]


def test_only_the_registry_imports_the_torque_limits() -> None:
    """What the page says of its diff: one file, and one line that names it."""
    importing = [
        path.relative_to(ROOT / "zmp_sqp").as_posix()
        for path in (ROOT / "zmp_sqp").rglob("*.py")
        if re.search(r"^\s*(from|import) .*constraints\.torque\b", path.read_text(), re.MULTILINE)
    ]
    assert importing == ["planning/constraints/registry.py"]
    registry = (ROOT / "zmp_sqp" / "planning" / "constraints" / "registry.py").read_text()
    line = next(line for line in registry.splitlines() if "TorqueLimits" in line)
    assert f"+{line}" in ARCHITECTURE
