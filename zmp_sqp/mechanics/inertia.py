"""Rotational inertias: whether a body can have them, and how large they are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array, frozen_array
from zmp_sqp.errors import MachineError

__all__ = ["checked_inertia", "lacking_moment", "spatial_inertia", "spectral_norm"]

# largest violation of the triangle inequality that counts as rounding of a CAD export, as a
# fraction of the largest moment (a thin plate has I_1 + I_2 = I_3 exactly)
ROUNDING = 1e-3
# largest difference of mirrored entries, as a fraction of the largest entry
SYMMETRY = 1e-9


def checked_inertia(values: Any, *, name: str, semidefinite: bool = False) -> Array:
    r"""Read-only copy of a rotational inertia, after a check that some body can have it.

    .. math:: I = I^T, \quad I_1, I_2, I_3 > 0, \quad I_i + I_j \geq I_k

    with the principal moments I_1, I_2, I_3.

    Args:
        values: Rotational inertia about the centre of mass, shape (3, 3) [kg m^2].
        name: Name of the inertia in error messages.
        semidefinite: Whether zero moments are allowed (a thin rod has none about its own axis).

    Raises:
        MachineError: Not numbers, not symmetric, not positive (semi-)definite, or in violation of
            the triangle inequality.
    """
    inertia = frozen_array(values, name=name, shape=(3, 3), error=MachineError)
    scale = float(np.abs(inertia).max())
    if np.abs(inertia - inertia.T).max() > SYMMETRY * scale:
        raise MachineError(f"{name} must be symmetric, not {inertia.tolist()}")
    moments = np.linalg.eigvalsh(inertia)  # ascending
    spelled = ", ".join(f"{moment:.6g}" for moment in moments)
    rounding = 1e-12 * scale  # error of eigvalsh
    if moments[0] < -rounding or (moments[0] <= rounding and not semidefinite):
        kind = "semi-definite" if semidefinite else "definite"
        raise MachineError(
            f"{name} must be positive {kind}, but its principal moments are {spelled} kg m^2"
        )
    if moments[0] + moments[1] < moments[2] * (1.0 - ROUNDING):
        raise MachineError(
            f"{name} violates the triangle inequality: of its principal moments {spelled} kg m^2 "
            "the largest is more than the sum of the others, so no distribution of mass has it"
        )
    return inertia


def lacking_moment(inertia: Array) -> float:
    r"""Moment that a rotational inertia lacks for being that of a body.

    .. math:: \max(I_3 - I_1 - I_2, 0), \quad I_1 \leq I_2 \leq I_3

    It is zero if and only if the principal moments satisfy the triangle inequality, which implies
    that none of them is negative.

    Args:
        inertia: Symmetric matrix, shape (3, 3) [kg m^2].

    Returns:
        Lacking moment [kg m^2]; errors of rounding count.
    """
    least, middle, largest = np.linalg.eigvalsh(inertia)
    return float(max(largest - middle - least, 0.0))


def spectral_norm(inertias: Any) -> Array:
    """Largest magnitude of the eigenvalues of symmetric matrices (..., 3, 3), shape (...).

    For an inertia tensor I it bounds |I w| <= norm |w|, also where I has negative eigenvalues.
    """
    return np.asarray(np.abs(np.linalg.eigvalsh(inertias)[..., [0, -1]]).max(axis=-1))


def spatial_inertia(mass: float, com: Array, inertia: Array) -> Any:
    """Spatial inertia of a body as a `pin.Inertia`, whose constructor refuses indefinite inertias.

    Args:
        mass: Mass, at least 0 [kg].
        com: Centre of mass, shape (3,) [m].
        inertia: Symmetric rotational inertia about the centre of mass, shape (3, 3) [kg m^2].
    """
    body = pin.Inertia.Zero()
    body.mass, body.lever = mass, com
    body.inertia = 0.5 * (inertia + inertia.T)  # what is not symmetric to the last bit is refused
    return body
