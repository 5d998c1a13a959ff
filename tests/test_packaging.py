"""Imports run one way, functions are short and files small."""

import ast
import tomllib
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE, BENCHMARKS = ROOT / "zmp_sqp", ROOT / "benchmarks"


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}
BESIDE = {module_name(path): path for path in sorted(BENCHMARKS.rglob("*.py"))}  # not shipped


def imports(name: str) -> set[str]:
    """Every module that `name` imports, also inside functions; of the package, its files."""
    path = (MODULES | BESIDE)[name]
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = (
                package.split(".")[: len(package.split(".")) + 1 - node.level] if node.level else []
            )
            source = ".".join([*above, *([node.module] if node.module else [])])
            for alias in node.names:
                submodule = f"{source}.{alias.name}"
                found.add(submodule if submodule in MODULES else source)
    return found - {name}


def own(name: str) -> set[str]:
    return {target for target in imports(name) if target in MODULES}


def within(name: str, *packages: str) -> bool:
    return any(name == package or name.startswith(f"{package}.") for package in packages)


FOUNDATION = {f"zmp_sqp.{name}" for name in ("arrays", "blas", "cached", "errors", "lazy", "locks")}
LAYERS = {  # what a wing may import besides itself and the foundation
    "zmp_sqp.mechanics": (),
    "zmp_sqp.sqp": (),
    "zmp_sqp.motion": ("zmp_sqp.mechanics",),
    "zmp_sqp.planning.constraints": ("zmp_sqp.mechanics", "zmp_sqp.motion"),
    "zmp_sqp.planning.problem": (
        "zmp_sqp.mechanics",
        "zmp_sqp.motion",
        "zmp_sqp.planning.constraints",
    ),
    "zmp_sqp.planning.program": (
        "zmp_sqp.mechanics",
        "zmp_sqp.motion",
        "zmp_sqp.sqp",
        "zmp_sqp.planning.constraints",
        "zmp_sqp.planning.problem",
    ),
    "zmp_sqp.planning.proof": (
        "zmp_sqp.mechanics",
        "zmp_sqp.motion",
        "zmp_sqp.planning.constraints",
        "zmp_sqp.planning.problem",
    ),
    "zmp_sqp.planning.closed_forms": (
        "zmp_sqp.mechanics",
        "zmp_sqp.motion",
    ),
    "zmp_sqp.planning.search": (
        "zmp_sqp.mechanics",
        "zmp_sqp.motion",
        "zmp_sqp.sqp",
        "zmp_sqp.planning",
    ),
    "zmp_sqp.rigorous": (
        "zmp_sqp.mechanics",
        "zmp_sqp.motion",
        "zmp_sqp.planning.constraints",
        "zmp_sqp.planning.problem",
    ),
    "zmp_sqp.charts": ("zmp_sqp.mechanics", "zmp_sqp.motion", "zmp_sqp.planning"),
    "zmp_sqp.control": (
        "zmp_sqp.mechanics",
        "zmp_sqp.motion",
        "zmp_sqp.sqp",
        "zmp_sqp.planning",
    ),
    "zmp_sqp.studies": ("zmp_sqp.mechanics", "zmp_sqp.planning"),
    "zmp_sqp.simulation": ("zmp_sqp.mechanics", "zmp_sqp.motion", "zmp_sqp.planning"),
}


@pytest.mark.parametrize("layer", LAYERS)
def test_imports_run_one_way(layer):
    allowed = (layer, *LAYERS[layer])
    members = [name for name in MODULES if within(name, layer)]
    wrong = {
        f"{name} -> {target}"
        for name in members
        for target in own(name) - FOUNDATION
        if not within(target, *allowed)
    }
    assert members
    assert not wrong


def test_the_foundation_stands_on_itself_alone():
    assert not {f"{name} -> {target}" for name in FOUNDATION for target in own(name) - FOUNDATION}


def test_the_sqp_knows_no_robot():
    outside = {
        f"{name} -> {target}"
        for name in MODULES
        if within(name, "zmp_sqp.sqp")
        for target in imports(name)
    }
    assert not {
        edge
        for edge in outside
        if edge.split(" -> ")[1].split(".")[0] in {"pinocchio", "pin", "mujoco", "yaml"}
    }


LEAVES = (
    "zmp_sqp.__main__",
    "zmp_sqp.cli",
    "zmp_sqp.commands",
    "zmp_sqp.paper",
    "zmp_sqp.plots",
    "zmp_sqp.report",
    "zmp_sqp.scenario",
    "zmp_sqp.show",
    "zmp_sqp.view",
)


def test_only_leaves_import_leaves_and_nobody_the_command_line():
    edges = {(name, target) for name in MODULES for target in own(name)}
    assert not {
        (name, target)
        for name, target in edges
        if within(target, *LEAVES) and not within(name, *LEAVES)
    } - {("zmp_sqp", "zmp_sqp.plots")}  # for type checkers; imported at first use
    assert not {
        (name, target)
        for name, target in edges
        if within(target, "zmp_sqp.cli") and name not in ("zmp_sqp.cli", "zmp_sqp.__main__")
    }


def test_the_package_imports_neither_benchmarks_nor_tests():
    assert not {
        f"{name} -> {target}"
        for name in MODULES
        for target in imports(name)
        if within(target, "benchmarks", "tests")
    }


def test_benchmarks_import_nothing_from_tests():
    assert "benchmarks.problems.arm" in BESIDE
    assert not {
        f"{name} -> {target}"
        for name in BESIDE
        for target in imports(name)
        if within(target, "tests")
    }


def test_no_import_cycles():
    # raises CycleError with the cycle
    TopologicalSorter({name: own(name) for name in MODULES}).prepare()


LONGEST_FUNCTION = 60  # lines
LONGER = {  # functions that may be longer, with the reason
}


def test_functions_are_at_most_60_lines_long():
    lengths = {
        f"{name}.{node.name}": node.end_lineno - node.lineno + 1
        for name, path in (MODULES | BESIDE).items()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    }
    long = {name for name, length in lengths.items() if length > LONGEST_FUNCTION}
    assert long <= set(LONGER)
    assert set(LONGER) <= long  # an exception that is no longer needed leaves the list


def test_every_shipped_file_is_below_one_mebibyte():
    shipped = [
        path for folder in (PACKAGE, ROOT / "urdf") for path in folder.rglob("*") if path.is_file()
    ]
    assert not [
        path for path in shipped if "__pycache__" not in path.parts and path.stat().st_size >= 2**20
    ]


def bounds() -> dict[str, str]:
    """Lower bound of each direct dependency in pyproject.toml, by name in lower case."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    asked = [*project["dependencies"], *(line for lines in extras.values() for line in lines)]
    return {name.lower(): bound for name, _, bound in (line.partition(">=") for line in asked)}


def test_constraints_oldest_are_the_lower_bounds():
    """`make oldest` runs the suite with what the bounds in pyproject.toml promise."""
    lines = (ROOT / "constraints-oldest.txt").read_text(encoding="utf-8").splitlines()
    pinned = dict(line.split("==") for line in lines if line and not line.startswith("#"))
    assert pinned
    given = bounds()
    ours = {name.lower(): version for name, version in pinned.items() if name.lower() in given}
    assert ours == {name: given[name] for name in ours}
    needed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    names = {line.partition(">=")[0].lower() for line in needed["dependencies"]}
    assert names | {"matplotlib", "mujoco", "pillow"} <= set(ours)
