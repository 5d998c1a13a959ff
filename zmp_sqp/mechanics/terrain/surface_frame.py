"""Tangent frame and curvature of a surface z = h(x, y), with derivatives by x and y."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.terrain.jet import multiply, reciprocal_sqrt

__all__ = ["SurfaceFrame"]

# Orders of differentiation (by x, by y) of h that form the jets of h_x, h_y, h_xx, h_xy, h_yy.
_ORDERS = np.array([[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]])  # six entries of a jet
_FUNCTIONS = np.array([[1, 0], [0, 1], [2, 0], [1, 1], [0, 2]])  # h_x, h_y, h_xx, h_xy, h_yy
_BY_X, _BY_Y = (_ORDERS[:, None, :] + _FUNCTIONS[None, :, :]).transpose(2, 0, 1)  # (6, 5) each


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceFrame:
    r"""Frame E = R_y(pitch) R_x(roll) whose z axis is the normal, at K points of the surface.

    .. math::
        E = \begin{pmatrix}
            1/A & -pr/(AW) & -p/W \\
            0 & A/W & -r/W \\
            p/A & r/(AW) & 1/W
        \end{pmatrix}, \quad
        p = h_x, \; r = h_y, \; A = \sqrt{1 + p^2}, \; W = \sqrt{1 + p^2 + r^2}

    Hence tan(pitch) = -p and tan(roll) = r/A, and the frame's x axis is vertically above the map's
    x axis. All attributes are jets: values with first and second derivatives by x and y, see the
    module `jet`.

    Attributes:
        flat: (E_11, E_12, E_22), the tangent axes as seen on the map, shape (6, 3, K).
        vertical: Third row of E, the vertical unit vector in the frame, shape (6, 3, K).
        lean: tan(roll), shape (6, 1, K).
        hessian: (h_xx, h_xy, h_yy), shape (6, 3, K) [1/m].
    """

    flat: Array
    vertical: Array
    lean: Array
    hessian: Array

    @classmethod
    def of_derivatives(cls, derivatives: Array) -> SurfaceFrame:
        """Frame at K points, from the derivatives of the surface there.

        Args:
            derivatives: Entry [:, i, j] is h differentiated i times by x and j times by y, shape
                (K, 5, 5) [m^(1 - i - j)].
        """
        jets = np.ascontiguousarray(derivatives[:, _BY_X, _BY_Y].transpose(1, 2, 0))  # (6, 5, K)
        gradient = jets[:, :2]
        norms = np.cumsum(multiply(gradient, gradient), axis=1)
        norms[0] += 1.0  # A^2, W^2
        inverse = reciprocal_sqrt(norms)  # 1/A, 1/W
        # p/A, r/A, A
        by_a = multiply(np.concatenate([gradient, norms[:, :1]], axis=1), inverse[:, :1])
        # p/W, r/(AW), A/W
        by_w = multiply(np.concatenate([gradient[:, :1], by_a[:, 1:]], axis=1), inverse[:, 1:])
        skew = -multiply(by_a[:, 1], by_w[:, 0])
        return cls(
            flat=np.stack([inverse[:, 0], skew, by_w[:, 2]], axis=1),
            vertical=np.stack([by_a[:, 0], by_w[:, 1], inverse[:, 1]], axis=1),
            lean=by_a[:, 1:2],
            hessian=jets[:, 2:],
        )

    def rotations(self) -> Array:
        """Rotation matrices E from the tangent frame to the axes of the map, shape (K, 3, 3)."""
        e11, e12, e22 = self.flat[0]
        e31, e32, e33 = self.vertical[0]
        normal_x, normal_y = -e31 * e22, e31 * e12 - e11 * e32
        rows = [[e11, e12, normal_x], [np.zeros_like(e11), e22, normal_y], [e31, e32, e33]]
        return np.ascontiguousarray(np.array(rows).transpose(2, 0, 1))

    def curvature(self) -> Array:
        r"""Curvature: rotation of the frame per metre of displacement along its own axes.

        Let B be the upper left 2 x 2 block of E. A displacement u in the tangent plane is B u on
        the map and rotates the frame by

        .. math::
            \mathrm{vee}(E^T dE) =
                (II_{2 \cdot} u, \; -II_{1 \cdot} u, \; \tan(roll) \, II_{1 \cdot} u), \quad
            II = B^T \nabla^2 h B / W

        with the second fundamental form II, which is positive where the ground is hollow.

        Returns:
            Jets of (II_11, II_12, II_22, tan(roll) II_11, tan(roll) II_12), shape (6, 5, K)
            [rad/m].
        """
        half = multiply(self.hessian[:, [0, 0, 1, 1, 2]], self.flat[:, [0, 1, 1, 2, 2]])
        # nabla^2 h times the second column of B
        cross = half[:, 1] + half[:, 3], half[:, 2] + half[:, 4]
        full = multiply(
            np.stack([half[:, 0], cross[0], *cross], axis=1), self.flat[:, [0, 0, 1, 2]]
        )
        full[:, 2] += full[:, 3]
        second = multiply(full[:, :3], self.vertical[:, 2:])
        return np.concatenate([second, multiply(second[:, :2], self.lean)], axis=1)
