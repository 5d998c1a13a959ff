"""The README's code runs and prints what the README says, to the last digit."""

import contextlib
import io
import re
from pathlib import Path

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


def test_every_file_that_the_readme_names_is_there():
    links = re.findall(r"\]\(([^)#]+)\)", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert links
    assert not [
        link for link in links if not link.startswith("http") and not (ROOT / link).exists()
    ]


def test_the_first_python_block_is_short():
    code = next(text for language, text in blocks() if language == "python")
    lines = [line for line in code.splitlines() if line.strip() and not line.startswith("import")]
    assert len(lines) <= 12
