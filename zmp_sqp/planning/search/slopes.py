"""From constant accelerations to linear ones: the controls to start from, and which slopes are left free."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from zmp_sqp.arrays import Array
from zmp_sqp.planning.program.driving.transcription import DrivingTranscription
from zmp_sqp.planning.program.hold import slope_ties
from zmp_sqp.planning.program.solution import MotionProgram
from zmp_sqp.sqp.result import SQPResult

__all__ = ["free_slopes", "linear_controls"]

# up to so many, each interval's slope is free; beyond, most follow from their neighbours
FEW_CONTROLS = 120
WORTH = 1e-4  # what a slope must promise to be set free: fall of the objective per scaled control
AT_LIMIT = 1e-3  # scaled controls closer to their limit have no room for a slope


def linear_controls(controls: Array) -> tuple[sp.csr_array | None, Array]:
    """Ties of the slopes, or None where each is free, and linear controls (N, 2, n) that obey them.

    Args:
        controls: Of the constant hold, shape (N, 1, n).
    """
    if controls.size <= FEW_CONTROLS:
        return None, np.repeat(controls, 2, axis=1)
    ties = slope_ties(controls[:, 0])
    return ties, (ties @ controls.ravel()).reshape(-1, 2, controls.shape[2])


def free_slopes(
    ties: sp.csr_array, linear: MotionProgram, constant: MotionProgram, found: SQPResult
) -> sp.csr_array:
    """The ties with one more free variable for every interval whose slope would shorten the motion.

    The pattern of ties, smooth here and a switch there, is that of a motion with constant
    accelerations. A faster one switches elsewhere and pays for it, but only with slopes that move
    the ZMP from an edge, and that the acceleration's own limit leaves room for: derivatives of the
    Lagrangian by the slopes tell which. Multipliers of the rates have no say, as a slope leaves
    rates at the nodes as they are; those of position limits are left out.

    Args:
        ties: As from `linear_controls`.
        linear: The program with linear accelerations, none of them tied.
        constant: The program with constant ones, at the same reference.
        found: Its solution.
    """
    layout = linear.inner.layout if isinstance(linear, DrivingTranscription) else linear.layout  # type: ignore[attr-defined]
    controls, S = constant.unpack(found.x)[2:]
    lin = linear.linearize(linear.pack(np.repeat(controls, 2, axis=1), S))
    basis, rows = lin.basis, layout.wrench_rows  # rows: the same in both programs
    if basis is None:  # it is what ties act on
        return ties
    gradient = lin.C[:rows].T @ found.z[:rows] + lin.A[basis.eliminated :].T @ found.y
    first, last = np.moveaxis((basis.Z.T @ gradient)[:-1].reshape(layout.N, 2, layout.n), 1, 0)
    limits = lin.at.inequalities[layout.control_rows].reshape(2, layout.N, 2, layout.n)
    room = (limits < -AT_LIMIT).all(axis=(0, 2))
    worthy = (np.abs(last - first) > 2.0 * WORTH) & room
    index = np.arange(ties.shape[0]).reshape(layout.N, 2, layout.n)
    count = int(worthy.sum())
    ends = np.append(index[:, 0][worthy], index[:, 1][worthy])
    entries = np.repeat([-1.0, 1.0], count), (ends, np.tile(np.arange(count), 2))
    return sp.csr_array(sp.hstack([ties, sp.csr_array(entries, shape=(len(index.ravel()), count))]))
