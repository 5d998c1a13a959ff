"""Clipping of negative curvature: against eigenvalues that are known beforehand."""

from __future__ import annotations

import numpy as np
import pytest

from zmp_sqp.arrays import Array
from zmp_sqp.planning.program.clipping import SIGN, clipped

ROUNDING = 1e-12
SIGN_ERROR = 1.3e-3  # of the polynomials where an eigenvalue is above LEAST times the norm
LEAST = 1e-3


def with_eigenvalues(values: Array, seed: int) -> tuple[Array, Array]:
    """Symmetric matrices with given eigenvalues (K, r), and their eigenvectors."""
    rng = np.random.default_rng(seed)
    count, size = values.shape
    vectors = np.linalg.qr(rng.normal(size=(count, size, size)))[0]
    matrices = vectors @ (values[:, :, None] * vectors.transpose(0, 2, 1))
    return 0.5 * (matrices + matrices.transpose(0, 2, 1)), vectors


def along(vectors: Array, matrices: Array) -> Array:
    """Matrices (K, r, r) in the basis of eigenvectors."""
    return vectors.transpose(0, 2, 1) @ matrices @ vectors


@pytest.mark.parametrize("size", [1, 5, 16, 27])
@pytest.mark.parametrize("share", [0.0, 0.07, 0.3, 0.5, 1.0])
def test_negative_eigenvalues_are_scaled_and_others_kept(share: float, size: int) -> None:
    rng = np.random.default_rng(size)
    values = rng.choice([-1.0, 1.0], (8, size)) * 10.0 ** rng.uniform(-2.0, 4.0, (8, size))
    values[0] = np.abs(values[0])
    values[1] = -np.abs(values[1])
    H, vectors = with_eigenvalues(values, size)
    found = clipped(H, share)
    norm = np.linalg.norm(H, axis=(1, 2))
    assert np.abs(found - found.transpose(0, 2, 1)).max() < ROUNDING * norm.max()
    after = along(vectors, found)
    rotated = after - after.diagonal(axis1=1, axis2=2)[:, None] * np.eye(size)
    assert np.abs(rotated).max() < ROUNDING * norm.max()
    after = after.diagonal(axis1=1, axis2=2)
    exact = np.where(values > 0.0, values, (1.0 - share) * values)
    large = np.abs(values) > LEAST * norm[:, None]
    off = np.abs(after - exact)
    rounding = ROUNDING * norm.max()
    assert (off <= 0.5 * share * SIGN_ERROR * np.abs(values) + rounding)[large].all()
    # a small one is at least not made more negative, and a positive one loses half at most
    assert (off <= 0.5 * share * np.abs(values) * (1.0 + SIGN_ERROR) + rounding).all()


def test_all_clipped_means_positive_semidefinite() -> None:
    H = np.random.default_rng(3).normal(size=(40, 16, 16))
    H = H + H.transpose(0, 2, 1)
    assert np.linalg.eigvalsh(clipped(H, 1.0)).min() > -ROUNDING


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_zero_matrices_stay_zero_and_any_unit_gives_the_same(share: float) -> None:
    H = np.random.default_rng(4).normal(size=(3, 6, 6))
    H = H + H.transpose(0, 2, 1)
    H[1] = 0.0
    found = clipped(H, share)
    assert not found[1].any()
    np.testing.assert_allclose(clipped(2.0**40 * H, share), 2.0**40 * found, rtol=1e-9, atol=1e-3)


def test_the_polynomials_are_as_close_to_the_sign_as_they_say() -> None:
    x = np.concatenate([np.geomspace(1e-12, LEAST, 2001), np.geomspace(LEAST, 1.0, 200_001)])
    sign = x
    for a, b, c in SIGN:
        sign = sign * (a + b * sign**2 + c * sign**4)
    assert np.abs(sign - 1.0)[x >= LEAST].max() < SIGN_ERROR
    assert sign.min() > 0.0
    assert sign.max() < 1.0 + SIGN_ERROR
