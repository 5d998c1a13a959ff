"""Clipping of the negative curvature of symmetric matrices."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array

__all__ = ["clipped"]

# coefficients (a, b, c) of odd polynomials x (a + b x^2 + c x^4) whose composition is within 0.0013
# of the sign of x for 0.001 <= |x| <= 1, and between 0 and the sign below (Amsel, Persson, Musco
# and Gower, "The Polar Express", 2025, arXiv 2505.16932, algorithm 1)
SIGN = (
    (8.28721201814563, -23.595886519098837, 17.300387312530933),
    (4.107059111542203, -2.9478499167379106, 0.5448431082926601),
    (3.9486908534822946, -2.908902115962949, 0.5518191394370137),
    (3.3184196573706015, -2.488488024314874, 0.51004894012372),
    (2.300652019954817, -1.6689039845747493, 0.4188073119525673),
    (1.891301407787398, -1.2679958271945868, 0.37680408948524835),
)


def clipped(blocks: Array, share: float) -> Array:
    r"""Symmetric matrices whose negative eigenvalues are scaled by 1 - share.

    .. math:: H + \tfrac12 \text{share} \, (|H| - H), \quad |H| = \operatorname{sign}(H) \, H

    With a share below 1 the matrix sign is that of polynomials, which takes a third of the time of
    eigenvalues. Then eigenvalues of magnitude above 0.001 times the Frobenius norm are right to
    0.07 % of themselves; smaller negative ones are scaled by a factor between 1 - share and
    1 - share / 2, and smaller positive ones by one between 1 - share / 2 and 1. With share 1 the
    result is positive semidefinite to rounding.

    Args:
        blocks: Symmetric matrices, shape (K, r, r).
        share: Share of the negative eigenvalues that is removed, 0 to 1.
    """
    if share == 0.0:
        return blocks
    if share < 1.0:
        magnitude = _sign(blocks) @ blocks
        return blocks + 0.5 * share * (0.5 * (magnitude + magnitude.transpose(0, 2, 1)) - blocks)
    values, vectors = np.linalg.eigh(blocks)
    kept = np.maximum(values, 0.0)
    return np.asarray((vectors * kept[:, None, :]) @ vectors.transpose(0, 2, 1))


def _sign(blocks: Array) -> Array:
    """Approximate sign of symmetric matrices (K, r, r), by the polynomials `SIGN`."""
    count, size, _ = blocks.shape
    norm = np.sqrt(np.einsum("kij,kij->k", blocks, blocks))
    X = blocks / np.where(norm > 0.0, norm, 1.0)[:, None, None]
    diagonal = slice(None, None, size + 1)
    for a, b, c in SIGN:
        squared = X @ X
        factor = c * squared
        factor.reshape(count, -1)[:, diagonal] += b
        factor = factor @ squared
        factor.reshape(count, -1)[:, diagonal] += a
        X = factor @ X
    return X
