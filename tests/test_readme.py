"""The README's code prints what the README says, and what is named beside it is there."""

import contextlib
import io
import re
import tomllib
from pathlib import Path

import pytest
import yaml

import zmp_sqp as zs

ROOT = Path(__file__).parents[1]
BLOCKS = re.compile(r"```(\w*)\n(.*?)```", re.DOTALL)


def blocks():
    return [
        (language, text)
        for language, text in BLOCKS.findall((ROOT / "README.md").read_text(encoding="utf-8"))
    ]


def test_the_code_prints_what_the_readme_says():
    found = blocks()
    at = next(i for i, (language, _) in enumerate(found) if language == "python")
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(found[at][1], "README.md", "exec"), {})
    assert printed.getvalue() == found[at + 1][1]


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md"])
def test_every_file_and_heading_that_is_named_is_there(page):
    links = re.findall(r"\]\(([^)#]*)(?:#([^)]*))?\)", (ROOT / page).read_text(encoding="utf-8"))
    links = [(ROOT / (name or page), heading) for name, heading in links]
    assert len(links) > 5
    assert not [path for path, _ in links if not path.exists()]
    assert not [(path, sought) for path, sought in links if sought and sought not in slugs(path)]


def slugs(path: Path) -> set[str]:
    """What links call the headings of a page."""
    headings = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_the_citation_is_of_this_version():
    found = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= set(found)
    assert found["version"] == zs.__version__
    assert (
        found["license"]
        == tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["license"]
    )


def test_the_public_workflow_runs_what_has_to_hold_on_the_oldest_python_that_is_allowed():
    text = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    job = yaml.safe_load(text)["jobs"]["run"]
    assert {"run": ".ci/run"} in job["steps"]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert f">={job['strategy']['matrix']['python'][0]}" == project["requires-python"]


def test_the_first_python_block_is_short():
    code = next(text for language, text in blocks() if language == "python")
    lines = [line for line in code.splitlines() if line.strip() and not line.startswith("import")]
    assert len(lines) <= 12
