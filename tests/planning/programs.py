"""Grid, tolerances, bounds, points and Lagrangian gradient for tests of transcriptions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tests.checks import central_differences
from zmp_sqp.planning.constraints.protocol import ConstraintRows, StageModel
from zmp_sqp.planning.constraints.tip_over import Contact, TipOverRows
from zmp_sqp.planning.program.driving.transcription import DrivingTranscription
from zmp_sqp.planning.program.rows import BoundConstraints, CornerRows, StageRows
from zmp_sqp.planning.program.transcription import PathBounds, Transcription

__all__ = [
    "CURVATURE",
    "DERIVATIVE",
    "REFERENCE",
    "ROUNDING",
    "N",
    "Program",
    "anywhere",
    "check_curvature_along_closed_gaps",
    "closed",
    "lagrangian_gradient",
    "path_bounds",
    "stage_rows",
]

Program = Transcription | DrivingTranscription
DERIVATIVE = 2e-7  # error of central differences with a step of 1e-6, on rows of order one
CURVATURE = 1e-5  # relative error of central differences of gradients
ROUNDING = 1e-12
N = 4
REFERENCE = 2.3  # [s]


def stage_rows(*models: StageModel, others: Sequence[ConstraintRows] = ()) -> StageRows:
    """Rows of tip-over with 0.05 m of margin and of contact, one corner per model, then others."""
    corners = []
    for model in models:
        contact = Contact().rows(model.machine, model.coordinates)
        rows = (("tip_over", TipOverRows.of(model.machine, 0.05)), ("contact", contact))
        corners.append(CornerRows(model, rows))
    common = tuple(("other", rows) for rows in others)
    return StageRows(BoundConstraints(tuple(corners), common), REFERENCE)


def path_bounds(n: int, *, lower: float, upper: float) -> PathBounds:
    """Bounds of n coordinates, of the order of magnitude of the tests' points."""
    return PathBounds(
        position_lower=np.full(n, lower),
        position_upper=np.full(n, upper),
        velocity=np.full(n, 0.8),
        acceleration=np.linspace(1.0, 1.6, n),
        least_duration=1.0,
    )


def closed(nlp: Program, seed: int = 0) -> np.ndarray:
    """A point with random accelerations and closed gaps, which does not end at the goal."""
    controls = np.random.default_rng(seed).normal(0.0, 3.0, (N, nlp.hold.controls, nlp.n))
    return nlp.pack(controls, 1.3 * REFERENCE**2)


def anywhere(nlp: Program, seed: int = 0) -> np.ndarray:
    """A random point with open gaps."""
    x = closed(nlp, seed)
    x[:-1] += np.random.default_rng(seed + 1).normal(0.0, 0.1, len(x) - 1)
    return x


def lagrangian_gradient(nlp: Program, at: np.ndarray, y: np.ndarray, z: np.ndarray) -> Any:
    """Gradient of f + phi + y.c_E + z.c_I, with one multiplier for every equality."""
    here = nlp.linearize(at)
    return here.gradient + here.tie_gradient + here.A.T @ y + here.C.T @ z


def check_curvature_along_closed_gaps(nlp: Program) -> None:
    """Compare Z'HZ with differences, with multipliers on all inequality rows.

    This is what the SQP uses, middle control points included.
    """
    x, rng = closed(nlp, 3), np.random.default_rng(2)
    lin = nlp.linearize(x)
    Z, y = lin.basis.Z, np.zeros(len(lin.at.equalities))
    z = rng.uniform(0.0, 1.0, len(lin.at.inequalities))
    found = Z.T @ nlp.hessian(x, y[lin.basis.eliminated :], z, convex=False) @ Z
    expected = central_differences(
        lambda move: Z.T @ lagrangian_gradient(nlp, x + Z @ move, y, z), np.zeros(Z.shape[1])
    )
    np.testing.assert_allclose(
        found, expected, atol=CURVATURE * max(1.0, float(np.abs(expected).max()))
    )
