"""Yaw and rate of the way within the intervals, and what they are made of: what leads a base from node to node."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.mechanics.ground import Terrain
from zmp_sqp.planning.program.driving.moves import COURSE
from zmp_sqp.planning.program.transcription import Transcription

__all__ = ["Course"]

SIMPSON = np.array([[1.0], [4.0], [1.0]]) / 6.0  # at start, middle and end of an interval


class Course:
    """The course (yaw, then rate of the way, at start, middle and end of each interval) in a program's variables.

    Each interval's is linear in c of them: psi_k, w_k (way, yaw), u_k (way, yaw), psi_{k+1},
    w_{k+1} (way).
    """

    def __init__(self, inner: Transcription) -> None:
        """Of a program whose last two coordinates are the way and the yaw."""
        self.inner, self.N, self.n, self.hold = inner, inner.N, inner.n, inner.hold
        self._map, self._columns = self._linear_map()

    def of(self, inner: Array) -> tuple[Array, Array]:
        """Yaw and rate of the way at start, middle and end of the intervals, shape (3, N) each."""
        q, w, controls, _ = self.inner.unpack(inner)
        h = 1.0 / self.N
        _, once, twice = self.hold.shapes(0.5)
        yaw = q[:-1, -1] + 0.5 * h * w[:-1, -1] + h**2 * controls[:, :, -1] @ twice
        rate = w[:-1, -2] + h * controls[:, :, -2] @ once
        return np.stack([q[:-1, -1], yaw, q[1:, -1]]), np.stack([w[:-1, -2], rate, w[1:, -2]])

    def rates_by_controls(self) -> Array:
        """Rates of the way at starts, middles and ends by its controls, unscaled, shape (3, N, N c)."""
        at_nodes = self.inner.layout.sums[1]  # (N + 1, N c)
        own = np.kron(np.eye(self.N), self.hold.shapes(0.5)[1][None]) / self.N
        return np.stack([at_nodes[:-1], at_nodes[:-1] + own, at_nodes[1:]])

    def _linear_map(self) -> tuple[Array, Indices]:
        """How the course (`COURSE`) follows from some of the inner program's variables, (6, c), and these, (N, c)."""
        inner, N, h, c = self.inner, self.N, 1.0 / self.N, self.hold.controls
        _, once, twice = self.hold.shapes(0.5)
        (rate_way, rate_yaw), (push_way, push_yaw) = inner.rate_scale[-2:], inner.control_scale[-2:]
        # by psi_k, w_k (way, yaw), u_k (way, yaw), psi_{k+1}, w_{k+1} (way)
        to_course = np.zeros((COURSE, 5 + 2 * c))
        to_course[:2, 0] = to_course[2, 3 + 2 * c] = 1.0
        to_course[1, 2], to_course[1, 3 + c : 3 + 2 * c] = (
            0.5 * h * rate_yaw,
            h**2 * twice * push_yaw,
        )
        to_course[3:5, 1] = to_course[5, 4 + 2 * c] = rate_way
        to_course[4, 3 : 3 + c] = h * once * push_way
        layout, index = inner.layout, np.arange(inner.layout.size)
        q, rates = (index[part].reshape(N + 1, self.n) for part in (layout.positions, layout.rates))
        controls = index[layout.controls].reshape(N, c, self.n)
        columns = [
            q[:-1, -1],
            rates[:-1, -2:],
            controls[:, :, -2],
            controls[:, :, -1],
            q[1:, -1],
            rates[1:, -2],
        ]
        return to_course, np.column_stack(columns)

    def slopes(self, slopes: Array) -> sp.csr_array:
        """Derivatives by the inner program's variables, (2 N, inner size), from those by the course, (N, 2, 8)."""
        to_course, columns = self._map, self._columns
        data, width = slopes[:, :, 2:] @ to_course, to_course.shape[1]
        pointers = width * np.arange(2 * self.N + 1)
        indices = np.repeat(columns, 2, axis=0).ravel()
        return sp.csr_array(
            (data.ravel(), indices, pointers), shape=(2 * self.N, self.inner.layout.size)
        )

    def curvature(
        self, terrain: Terrain, p: Array, inner: Array, weights: Array, *, convex: bool
    ) -> sp.csr_array:
        r"""Second derivatives of the moves times weights (N, 2), by the inner program's variables.

        With G the rate of the place per way, which turns with the yaw like a vector, they are Simpson's rule on

        .. math:: \partial^2 (w\, \mu \cdot G) = \begin{pmatrix} -w\, \mu \cdot G & \mu \cdot G_\psi \\
                  \mu \cdot G_\psi & 0 \end{pmatrix} \quad \text{by } (\psi, w)

        but for what the ground's own curvature adds.
        """
        (psi, w), N = self.of(inner), self.N
        low, high = terrain.extent
        places = np.clip(np.vstack([p[:-1], 0.5 * (p[:-1] + p[1:]), p[1:]]), low, high)
        unit = np.column_stack([np.ones(3 * N), np.zeros(3 * N)])
        found = terrain.ground_rates(np.column_stack([places, psi.ravel()]), unit)
        along, across = (
            np.einsum("skc,kc->sk", part.reshape(3, N, 2), weights) * SIMPSON / N
            for part in (found.rates, found.jacobian[:, :, 2])
        )
        of_course = np.zeros((N, COURSE, COURSE))
        stage = np.arange(3)
        of_course[:, stage, stage] = (-w * along).T
        of_course[:, stage, stage + 3] = of_course[:, stage + 3, stage] = across.T
        if convex:
            values, vectors = np.linalg.eigh(of_course)
            of_course = (vectors * np.maximum(values, 0.0)[:, None, :]) @ vectors.transpose(0, 2, 1)
        to_course, columns = self._map, self._columns
        blocks, width = to_course.T @ of_course @ to_course, to_course.shape[1]
        rows = np.repeat(columns, width, axis=1).ravel()
        size = self.inner.layout.size
        entries = sp.coo_array(
            (blocks.ravel(), (rows, np.tile(columns, (1, width)).ravel())), (size, size)
        )
        return sp.csr_array(entries)
