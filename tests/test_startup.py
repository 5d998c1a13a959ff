"""What starts quickly: modules that load at first use only, and names that are found then."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import json
import os
import pickle
import subprocess
import sys
import threading
import warnings
from pathlib import Path

import pytest

import zmp_sqp as zs
from zmp_sqp.locks import without_warnings

ROOT = Path(__file__).resolve().parents[1]
BASE = "import numpy, pinocchio"
PLANNING = """
import zmp_sqp as zs
from zmp_sqp.scenario import load_scenario
assert zs.plan(load_scenario("paper_1").problem).success
"""
LAZY = ("zmp_sqp", "zmp_sqp.mechanics", "zmp_sqp.motion", "zmp_sqp.planning")
# packages of others, each slow to import, that few programs need
SOLVERS = ("casadi", "daqp", "flint", "proxsuite", "qpsolvers")
PICTURES = ("matplotlib", "mpl_toolkits", "PIL", "mujoco", "rich")
FILES = ("rosbags", "xacro", "difflib", "argparse", "subprocess", "zipfile", "csv")
WORKERS = ("concurrent", "multiprocessing", "dask", "distributed")
WINGS = [
    "charts",
    "cli",
    "commands",
    "control",
    "paper",
    "rigorous",
    "show",
    "simulation",
    "studies",
    "view",
]
NEVER = (*SOLVERS, *PICTURES, *FILES, *WORKERS, *(f"zmp_sqp.{wing}" for wing in WINGS))
READING = ("zmp_sqp.motion.reading", "zmp_sqp.motion.exporting", "zmp_sqp.mechanics.terrain")
# what a plan needs, but not every program that imports the package
AT_IMPORT = (
    *NEVER,
    *READING,
    *("piqp", "scipy", "threadpoolctl", "tomllib", "yaml", "zmp_sqp.scenario", "zmp_sqp.sqp"),
    *(f"zmp_sqp.planning.{part}" for part in ("closed_forms", "program", "search")),
)
# what other plans need, but not one that is found at the lower bound of its duration
IN_A_PLAN = (
    *NEVER,
    *READING,
    *(f"scipy.{part}" for part in ("interpolate", "linalg", "optimize", "spatial", "special")),
    *("zmp_sqp.planning.closed_forms", "zmp_sqp.planning.search.diagnosis"),
)


def modules(code: str) -> set[str]:
    """Names of the modules that a new process has loaded at the end of some code."""
    listed = f"{code}\nimport sys, json; print(json.dumps(sorted(sys.modules)))"
    run = subprocess.run(
        [sys.executable, "-c", listed], cwd=ROOT, capture_output=True, text=True, timeout=120
    )
    assert run.returncode == 0, run.stderr
    return set(json.loads(run.stdout))


def among(loaded: set[str], names: tuple[str, ...]) -> list[str]:
    return sorted(
        module
        for module in loaded
        if any(module == name or module.startswith(f"{name}.") for name in names)
    )


def test_importing_the_package_loads_no_solver_file_format_or_wing_that_few_programs_need():
    loaded = modules("import zmp_sqp")
    assert among(loaded, ("zmp_sqp.planning.problem", "zmp_sqp.planning.proof"))
    assert among(loaded - modules(BASE), AT_IMPORT) == []


def test_a_plan_at_its_lower_bound_loads_only_what_it_uses():
    loaded = modules(PLANNING)
    assert {"piqp", "scipy.sparse", "zmp_sqp.planning.search.planner"} <= loaded
    assert among(loaded - modules(f"{BASE}, scipy.sparse"), IN_A_PLAN) == []


def test_planning_in_the_loop_loads_all_solvers_beforehand():
    loaded = modules("import zmp_sqp as zs; zs.Planner")
    assert {"daqp", "piqp", "proxsuite", "scipy.linalg", "scipy.sparse"} <= loaded
    later = modules(f"import zmp_sqp as zs; zs.Planner\n{PLANNING}")
    assert among(later - loaded, ("scipy", "piqp", "daqp", "proxsuite", "zmp_sqp.sqp")) == []


def test_loading_takes_nothing_from_a_time_budget_or_the_time_of_a_plan():
    code = """
import sys, time
import zmp_sqp as zs

class SlowImport:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name == "scipy.sparse":
            time.sleep(1.0)

sys.meta_path.insert(0, SlowImport)
from zmp_sqp.scenario import load_scenario
problem = load_scenario("paper_1").problem
zs.plan
assert "scipy.sparse" not in sys.modules
began = time.perf_counter()
first = zs.plan(problem, time_budget={budget})
took = time.perf_counter() - began
assert "scipy.sparse" in sys.modules
assert ("daqp" in sys.modules) == ({budget} is not None)
again = zs.plan(problem)
assert first.success and first.duration == again.duration
assert took - first.solve_time >= 1.0, (first.solve_time, took)
"""
    for budget in (None, 5.0):
        modules(code.format(budget=budget))


def imported(package: str) -> dict[str, set[str]]:
    """Names by module that a package imports for type checkers alone."""
    tree = ast.parse(Path(importlib.import_module(package).__file__ or "").read_text("utf-8"))
    blocks = [node for node in tree.body if isinstance(node, ast.If)]
    lines = [line for block in blocks for line in block.body if isinstance(line, ast.ImportFrom)]
    assert lines
    found = {line.module or "": {alias.name for alias in line.names} for line in lines}
    return found | {f"{package}.{name}": set() for name in found.pop(package, ())}  # modules


def found_at_first_use(package: str) -> dict[str, set[str]]:
    """Names by module of the call of `at_first_use`."""
    tree = ast.parse(Path(importlib.import_module(package).__file__ or "").read_text("utf-8"))
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    (table,) = (ast.literal_eval(call.args[1]) for call in calls if len(call.args) == 2)
    return {module: set(names.split()) for module, names in table.items()}


@pytest.mark.parametrize("package", LAZY)
def test_type_checkers_see_the_names_that_are_imported_at_first_use(package):
    assert found_at_first_use(package) == imported(package)
    module = importlib.import_module(package)
    for source, names in imported(package).items():
        for name in names:
            assert name in module.__all__
            # the import system would put the module in place of the name
            assert importlib.util.find_spec(f"{package}.{name}") is None
            assert getattr(module, name) is getattr(importlib.import_module(source), name)


@pytest.mark.parametrize("package", LAZY)
def test_every_public_name_is_listed_before_its_first_use(package):
    code = f"import {package} as it; assert set(it.__all__) <= set(dir(it)), dir(it)"
    assert package in modules(code)


def test_a_star_import_has_all_names_and_wings_are_attributes():
    code = """
import zmp_sqp
from zmp_sqp import *
assert set(zmp_sqp.__all__) <= set(globals())
"""
    modules(code)
    wings = ["charts", "control", "mechanics", "motion", "planning", "plots", "rigorous", "studies"]
    for wing in wings:
        modules(f"import zmp_sqp; assert zmp_sqp.{wing}.__name__ == 'zmp_sqp.{wing}'")


def test_other_attributes_are_refused_in_pythons_words():
    with pytest.raises(AttributeError, match="module 'zmp_sqp' has no attribute 'Plann'"):
        zs.Plann  # noqa: B018 - the attribute is asked for
    with pytest.raises(ImportError, match="cannot import name 'Plann'"):
        from zmp_sqp import Plann  # noqa: F401
    assert not hasattr(zs.planning, "nothing")


def test_values_of_classes_that_load_late_are_unpickled_in_a_new_process():
    found = pickle.dumps((zs.Status.OPTIMAL, zs.SlewInsight, zs.Planner, zs.plan_many))
    code = f"import pickle; print(pickle.loads({found!r})[0].name)"
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=120
    )
    assert run.stdout.split() == ["OPTIMAL"], run.stderr


THREADS = """
import json
import pathlib
import threading
from concurrent.futures import ThreadPoolExecutor
from threadpoolctl import threadpool_info
import numpy
from zmp_sqp.blas import one_blas_thread, scipy_linalg

def seen():
    return sorted(one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas")

maps = pathlib.Path("/proc/self/maps")
mapped = maps.is_file() and "openblas" in maps.read_text()
found = {"before": seen(), "mapped": mapped}
with one_blas_thread():
    found["inside"] = seen()
    scipy_linalg()
    found["loaded inside"] = seen()
    with one_blas_thread():
        found["nested"] = seen()
    found["still inside"] = seen()
found["after"] = seen()
with one_blas_thread():
    found["again"] = seen()
found["at the end"] = seen()

# threads that overlap: the first to enter is the first to leave
first_left, second_in = threading.Event(), threading.Event()

def first():
    with one_blas_thread():
        found["in a thread"] = seen()
        second_in.wait(60.0)
    first_left.set()

def second():
    with one_blas_thread():
        second_in.set()
        first_left.wait(60.0)
        found["first thread left"] = seen()

with ThreadPoolExecutor(2) as pool:
    for one in [pool.submit(first), pool.submit(second)]:
        one.result()
found["after threads"] = seen()
print(json.dumps(found))
"""


def test_a_blas_that_loads_within_the_limit_gets_it_too_and_loses_it_with_the_others():
    env = {key: value for key, value in os.environ.items() if not key.endswith("_NUM_THREADS")}
    run = subprocess.run(
        [sys.executable, "-c", THREADS],
        cwd=ROOT,
        env=env | {"OPENBLAS_NUM_THREADS": "2"},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout)
    assert found["before"] or not found["mapped"]  # threadpoolctl 3.4 sees none of the wheels' BLAS
    if 2 not in found["before"]:
        pytest.skip("BLAS has one thread on this computer")
    limited = ("inside", "loaded inside", "nested", "still inside", "again")
    limited += ("in a thread", "first thread left")
    assert {key: set(found[key]) for key in limited} == {key: {1} for key in limited}
    assert found["after"] == found["at the end"] == found["after threads"]
    assert set(found["after"]) == {2}
    assert len(found["loaded inside"]) >= len(found["inside"])


def test_only_one_module_imports_the_linear_algebra_of_scipy():
    importing = {
        path.name
        for path in (ROOT / "zmp_sqp").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if (isinstance(node, ast.Import) and "scipy.linalg" in {name.name for name in node.names})
        or (isinstance(node, ast.ImportFrom) and (node.module or "").startswith("scipy.linalg"))
    }
    assert importing == {"blas.py"}


def test_threads_leave_the_filters_of_warnings_as_they_were() -> None:
    before, entered, left = list(warnings.filters), threading.Event(), threading.Event()

    def first() -> None:
        with without_warnings():
            entered.set()
            left.wait(0.3)  # time for the second one, which has to wait

    def second() -> None:
        entered.wait(30.0)
        with without_warnings():
            left.set()

    threads = [threading.Thread(target=work) for work in (first, second)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert list(warnings.filters) == before
