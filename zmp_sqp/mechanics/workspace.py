"""Memory of Pinocchio for models, kept from call to call as long as a model does not change."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass
from itertools import count
from typing import Any

import pinocchio as pin

__all__ = ["Workspace", "workspace_of"]

MOST_WORKSPACES = 64  # per thread; a problem with uncertain payloads has a model for each of them
_versions = count()


@dataclass(frozen=True, slots=True)
class Workspace:
    """Memory of Pinocchio for one model.

    Attributes:
        model: The model; holding it keeps its identity from being reused.
        known: Copy of the model as it was when the workspace was made.
        version: Number that no other workspace has: results that depend on the model's numbers may
            be kept under it.
        data: Memory for the model itself.
        pool: Memory for calls in parallel, which has copies of the model.
    """

    model: Any
    known: Any
    version: int
    data: Any
    pool: Any


class _Workspaces(threading.local):
    """The latest workspaces of a thread: threads must not share them."""

    def __init__(self) -> None:
        self.latest: OrderedDict[int, Workspace] = OrderedDict()


_WORKSPACES = _Workspaces()


def workspace_of(model: Any) -> Workspace:
    """Workspace of a model: a new one where its inertias or placements were changed in place.

    To compare two models takes a microsecond.
    """
    latest = _WORKSPACES.latest
    found = latest.get(id(model))
    if found is not None and model == found.known:
        latest.move_to_end(id(model))
        return found
    made = Workspace(
        model, model.copy(), next(_versions), model.createData(), pin.ModelPool(model, 1)
    )
    latest[id(model)] = made
    latest.move_to_end(id(model))
    if len(latest) > MOST_WORKSPACES:
        latest.popitem(last=False)
    return made
