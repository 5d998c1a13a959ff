"""`pytest --machine y-forward|raised|both`: the suite on a rewritten feller-buncher."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.not_rewritten import reason_to_skip
from tests.rewritten import REWRITINGS, Rewriting


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--machine", choices=REWRITINGS, help="rewrite the feller-buncher's URDF")


def pytest_configure(config: pytest.Config) -> None:
    how = config.getoption("--machine")
    if how:
        worker = os.environ.get("PYTEST_XDIST_WORKER", "alone")
        folder = Path(config.rootpath) / "out" / "rewritten" / how / worker
        folder.mkdir(parents=True, exist_ok=True)
        Rewriting(folder, **REWRITINGS[how]).install()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    how = config.getoption("--machine")
    for item in items if how else ():
        why = reason_to_skip(item.nodeid, turned="turn" in REWRITINGS[how])
        if why:
            item.add_marker(pytest.mark.skip(reason=why))
