"""Imports all that the default backend may use, so that nothing loads within a time budget."""

import scipy.sparse

from zmp_sqp.blas import scipy_linalg
from zmp_sqp.sqp.backends import auto, piqp, proxqp

__all__ = ["auto", "piqp", "proxqp", "scipy"]

scipy_linalg()
