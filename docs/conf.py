"""Settings of Sphinx for the book: `make docs` writes it to out/docs.

Equations become MathML, which browsers draw themselves, so that the book opens without a network.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import zmp_sqp as zs  # noqa: E402 - of this folder

project = "zmp_sqp"
author = copyright = "The zmp_sqp authors"
version = release = zs.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
default_role = "code"  # docstrings have `names` in single backticks

autodoc_default_options = {"members": True}
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False

toc_object_entries_show_parents = "hide"
html_theme = "furo"
html_title = f"zmp_sqp {release}"
html_static_path = ["_static"]
html_css_files = ["book.css"]
html_math_renderer = "mathml"
html_show_sourcelink = False
html_copy_source = False


# pages of the book that show Markdown outside of this folder; other such files are downloads
PAGES = {"../urdf/README.md": "first-machines.md"}
OUTSIDE = re.compile(r"\]\((\.\./[^)#]+\.md)\)")


def _link_outside(app: Any, name: str, text: list[str]) -> None:
    """Lead links to Markdown outside of this folder to pages and files."""
    text[0] = OUTSIDE.sub(lambda found: f"]({PAGES.get(found[1], f'path:{found[1]}')})", text[0])


def _keep_bars(app: Any, what: str, name: str, it: Any, options: Any, lines: list[str]) -> None:
    """Keep |q| an absolute value, which reStructuredText takes for a substitution."""
    inside = None  # indentation of the directive, such as an equation, that is left as it is
    for i, line in enumerate(lines):
        indent = len(line) - len(line.lstrip())
        if line.strip() and inside is not None and indent <= inside:
            inside = None
        if inside is None and line.lstrip().startswith(".. "):
            inside = indent
        if inside is None:
            parts = re.split(r"(`[^`]*`)", line)
            lines[i] = "".join(p if p[:1] == "`" else p.replace("|", r"\|") for p in parts)


def _keep_colons(app: Any, what: str, name: str, it: Any, options: Any, lines: list[str]) -> None:
    """Keep "Unit: rad, or m" of a property one sentence, of which napoleon makes type and text."""
    kind = ":type: "
    found = [i for i, line in enumerate(lines) if line.startswith(kind)]
    if what == "property" and found:
        lines[0] = f"{lines.pop(found[-1]).removeprefix(kind)}: {lines[0]}"


def _readable(
    app: Any, what: str, name: str, it: Any, options: Any, signature: str | None, returned: Any
) -> tuple[str | None, Any]:
    """Write defaults that a dataclass makes anew as "...", which Sphinx can read."""
    return signature and signature.replace("<factory>", "..."), returned


def _write_math(writer: Any, node: Any, display: str) -> None:
    """Put an equation into the page as MathML, in place of its node."""
    from docutils.nodes import SkipNode
    from latex2mathml.converter import convert

    equation = convert(node.astext(), display=display)
    writer.body.append(f'<p class="math">{equation}</p>\n' if display == "block" else equation)
    raise SkipNode


def setup(app: Any) -> None:
    """Register the writer of equations, and what makes text fit for Sphinx."""
    app.connect("source-read", _link_outside)
    app.connect("autodoc-process-docstring", _keep_bars, priority=400)  # before napoleon's
    app.connect("autodoc-process-docstring", _keep_colons, priority=600)  # after napoleon's
    app.connect("autodoc-process-signature", _readable)
    app.add_html_math_renderer(
        "mathml",
        inline_renderers=(lambda writer, node: _write_math(writer, node, "inline"), None),
        block_renderers=(lambda writer, node: _write_math(writer, node, "block"), None),
    )
