"""Inverse dynamics of a machine at many corners of payload and slope, from a few models."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.blas import scipy_linalg
from zmp_sqp.cached import cached_property
from zmp_sqp.mechanics.body_poses import BodyPoses, dynamic_parameters
from zmp_sqp.mechanics.ground import Slope
from zmp_sqp.mechanics.wrench import WRENCH
from zmp_sqp.planning.constraints.protocol import StageModel
from zmp_sqp.planning.program.body_differences import BodyDifferences
from zmp_sqp.planning.program.driving.model import DrivingModel
from zmp_sqp.planning.program.model import ArmModel

__all__ = ["CornerEfforts", "CornerModels"]

RANK = 1e-9  # relative to the first pivot of the QR factorisation: smaller ones are rounding
DROPPED = 1e-12  # weights are of order one: smaller ones are rounding, set to zero


@dataclass(frozen=True, eq=False)
class CornerModels:
    r"""V models of one machine, whose efforts are linear combinations of those of B basis models.

    Inverse dynamics is linear in the inertial parameters \pi of the bodies (Atkeson, An &
    Hollerbach 1986). Where the differences of all corners from the first one are combinations of
    those of D corners, so are the efforts and their derivatives, exactly:

    .. math:: \pi_v = \pi_0 + \sum_d C_{vd} (\pi_d - \pi_0) \quad \Rightarrow \quad
              e_v = e_0 + \sum_d C_{vd} (e_d - e_0)

    For example, two masses of a payload with its centre of mass at the eight corners of a box need
    seven differences. While the base stands, the wrenches of the differences follow from the
    kinematics of the bodies that differ (`BodyDifferences`), and the first model is the only one
    whose inverse dynamics is computed. Where the base drives, that of all D + 1 models is.

    Gravity at corner v differs by \delta_v from that of the first. In the wrench this adds the
    weight of the machine's mass m_v at its centre of mass c_v:

    .. math:: f_v = \dots - S m_v \delta_v, \quad \tau_v = \dots - S\, m_v c_v \times \delta_v

    The derivatives of m_v c_v by the joint positions equal those of the force by the joint
    accelerations. For joint efforts there is no such closed form. They are linear in the products
    of \pi and gravity, so that where they are needed the basis is chosen for these products, and
    \delta_v is zero.

    Attributes:
        models: Inverse dynamics at the V corners.
        basis: The B models that are evaluated.
        weights: Weights of the efforts of the basis models, and of the D differences where these
            are not among the basis models, shape (V, B [+ D]).
        tilts: Differences delta of gravity, in the root frame (for a driving machine at yaw zero),
            shape (V, 3) [m/s^2].
        parameters: Dynamic parameters of the bodies at each corner, see `dynamic_parameters`, shape
            (V, J, 10).
        differences: The D differences; None where the basis has joint efforts or all V models.
    """

    models: tuple[StageModel, ...]
    basis: tuple[StageModel, ...]
    weights: Array
    tilts: Array
    parameters: Array
    differences: BodyDifferences | None = None

    @classmethod
    def of(cls, models: Sequence[StageModel]) -> CornerModels:
        """Choose a basis for the models.

        It holds all of them where they are not models of one machine, or where their gravity
        differs by more than a constant vector, as over different terrains.
        """
        parameters = _of_machines(models)
        gravity = _gravities(models)
        if gravity is None or not _differ_in_inertia_only(models):
            one = np.eye(len(models))
            return cls(tuple(models), tuple(models), one, np.zeros((len(models), 3)), parameters)
        if any(model.joint_efforts for model in models):
            scaled = _scaled(parameters.reshape(len(models), -1)), _scaled(gravity)
            with_one = [np.hstack([part, np.ones((len(part), 1))]) for part in scaled]
            both = np.einsum("vi,vj->vij", *with_one)
            chosen, weights = _basis(both.reshape(len(models), -1))
            basis = tuple(models[b] for b in chosen)
            return cls(tuple(models), basis, weights, np.zeros_like(gravity), parameters)
        change = parameters - parameters[0]
        chosen, shares = _basis(_scaled(change.reshape(len(models), -1)))
        tilts = gravity - gravity[0]
        differences = BodyDifferences.of(models[0], change[chosen])
        basis = (models[0],)
        first = np.ones((len(models), 1))
        if not isinstance(models[0], ArmModel):
            basis = (models[0], *(_on_ground_of(models[b], models[0]) for b in chosen))
            first = first - shares.sum(axis=1, keepdims=True)
        weights = np.hstack([first, shares])
        return cls(tuple(models), basis, weights, tilts, parameters, differences)

    def efforts(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None = None
    ) -> Array:
        """S times the efforts at all corners, shape (V, K, R).

        Args:
            q, w, alpha, S, positions: As for `StageModel.efforts`.
        """
        of_basis = [model.efforts(q, w, alpha, S, positions) for model in self.basis]
        poses = self._poses(q)
        if self._kinematic and poses:
            of_basis.extend(self._kinematic.efforts(poses, w, alpha, S))
        found = _combined(self.weights, np.stack(of_basis))
        if self.tilts.any():
            self._tilt(found, S, self._mass_moments(poses), self.tilts_at(q))
        return found

    def linearize(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None = None
    ) -> CornerEfforts:
        """S times the efforts at all corners, with their derivatives.

        Args:
            q, w, alpha, S, positions: As for `StageModel.efforts`.
        """
        found = [model.effort_derivatives(q, w, alpha, S, positions) for model in self.basis]
        of_basis = [part for part, _ in found]
        jacobian = np.stack([part for _, part in found], axis=1)  # (K, B, R, s)
        poses = self._poses(q)
        if self._kinematic and poses:
            changes, by_state = self._kinematic.derivatives(poses, w, alpha, S)
            of_basis.extend(changes)
            jacobian = np.concatenate([jacobian, by_state], axis=1)
        efforts = _combined(self.weights, np.stack(of_basis))
        moments, tilts = None, None
        if self.tilts.any():
            moments, tilts = self._mass_moments(poses), self.tilts_at(q)
            self._tilt(efforts, S, moments, tilts)
        return CornerEfforts(self, S, efforts, jacobian, moments, tilts)

    def wrench_hessian(
        self, corner: Indices, q: Array, w: Array, alpha: Array, S: float, weights: Array
    ) -> Array | None:
        """Hessian of weights . S (f, tau), each state at its own corner; None if not known.

        Args:
            corner: Index of the corner of each state, shape (K,).
            q, w, alpha, S, weights: As for `StageModel.wrench_hessian`.
        """
        model = self.basis[0]
        if self._kinematic is None or not isinstance(model, ArmModel):
            return None
        gravity, parameters = model.gravity + self.tilts[corner], self.parameters[corner]
        return model.wrench_hessian(q, w, alpha, S, weights, gravity=gravity, parameters=parameters)

    @cached_property
    def masses(self) -> Array:
        """Mass of the machine at each corner, shape (V,) [kg]."""
        return np.asarray(self.parameters[:, :, 0].sum(axis=1))

    @property
    def _kinematic(self) -> BodyDifferences | None:
        """Differences whose wrenches follow from kinematics."""
        return self.differences if isinstance(self.basis[0], ArmModel) else None

    def _poses(self, q: Array) -> BodyPoses | None:
        """Poses of the bodies that differ, where they or the centre of mass are needed."""
        if self.differences is None or not (self._kinematic or self.tilts.any()):
            return None
        return self.differences.poses(q[:, : self.arm])

    def _tilt(self, efforts: Array, S: float, moments: Array, tilts: Array) -> None:
        """Add what differences of gravity add to efforts (V, K, R), in place."""
        efforts[:, :, :3] -= S * self.masses[:, None, None] * tilts
        efforts[:, :, 3:WRENCH] -= S * _cross(moments, tilts)

    @property
    def size(self) -> int:
        """Number n of coordinates."""
        return self.basis[0].size

    @property
    def drives(self) -> bool:
        """Whether the base drives, so that gravity turns with the last coordinate, the yaw."""
        return isinstance(self.basis[0], DrivingModel)

    @property
    def arm(self) -> int:
        """Number of coordinates that determine joints."""
        return self.basis[0].coordinates.size

    def tilts_at(self, q: Array) -> Array:
        """`tilts` in the root frame at K states: (V, K, 3) if the base drives, else (V, 1, 3)."""
        tilts = self.tilts[:, None]
        if not self.drives:
            return tilts
        cos, sin = np.cos(q[:, -1]), np.sin(q[:, -1])
        x, y, z = tilts[:, :, 0], tilts[:, :, 1], tilts[:, :, 2]
        return np.stack(np.broadcast_arrays(cos * x + sin * y, cos * y - sin * x, z), axis=2)

    def _mass_moments(self, poses: BodyPoses | None) -> Array:
        """Mass times centre of mass of each corner's machine, root frame, (V, K, 3) [kg m]."""
        if poses is None or self.differences is None:
            raise RuntimeError("CornerModels: gravity differs between corners without differences")
        changes = self.differences.first_moments(poses)
        return poses.first_moment + _combined(self.weights[:, 1:], changes)


@dataclass(frozen=True, slots=True, eq=False)
class CornerEfforts:
    """Efforts at K states and all corners, with derivatives that are formed on demand.

    Attributes:
        corners: Models of the corners.
        S: Squared duration [s^2].
        efforts: S times the efforts, shape (V, K, R).
        jacobian: Jacobian by (q, w, alpha, S [, positions]) of the efforts that `weights` combines,
            shape (K, B [+ D], R, 3n + 1 [+ 2]).
        moments: Mass times centre of mass, shape (V, K, 3) [kg m]; None where gravity is equal at
            all corners.
        tilts: Differences of gravity, shape (V, K, 3) or (V, 1, 3) [m/s^2]; None where gravity is
            equal at all corners.
    """

    corners: CornerModels
    S: float
    efforts: Array
    jacobian: Array
    moments: Array | None
    tilts: Array | None

    def derivatives(self, corner: Indices, state: Indices, rows: Array) -> Array:
        """Derivatives of L linear forms of the efforts, shape (L, 3n + 1 [+ 2]).

        They are by (q, w, alpha, S [, positions]).

        Args:
            corner, state: Indices of the corner and the state of each form, shape (L,) each.
            rows: Coefficients of the R efforts, shape (L, R).
        """
        weights = self.corners.weights[corner]
        found = _products(self.jacobian, state, weights, rows)
        if self.tilts is None or self.moments is None:
            return found
        n, arm = self.corners.size, self.corners.arm
        tilt = self.tilts[corner, state if self.corners.drives else 0]
        mass, moment = self.corners.masses[corner], self.moments[corner, state]
        force, about = rows[:, :3], rows[:, 3:WRENCH]
        lever = _cross(tilt, about)  # about . (moment x tilt) = moment . lever
        by_joints = _products(self._by_acceleration, state, weights, lever)
        found[:, :arm] -= self.S * by_joints
        found[:, 3 * n] -= mass * _dot(force, tilt) + _dot(moment, lever)
        if self.corners.drives:
            turned = _turned(tilt)
            by_yaw = mass * _dot(force, turned) + _dot(moment, _cross(turned, about))
            found[:, n - 1] -= self.S * by_yaw
        return found

    @property
    def _by_acceleration(self) -> Array:
        """Jacobian of the combined forces by joint accelerations, (K, B [+ D], 3, arm) [kg m].

        Equals the Jacobian of mass times centre of mass by joint positions.
        """
        n = self.corners.size
        return self.jacobian[:, :, :3, 2 * n : 2 * n + self.corners.arm]

    def change(self, step: Array) -> Array:
        """First-order change of the efforts, shape (V, K, R).

        Args:
            step: Change of (q, w, alpha, S [, positions]), shape (K, 3n + 1 [+ 2]).
        """
        corners = self.corners
        found = _combined(corners.weights, _times(self.jacobian, step))
        if self.tilts is None or self.moments is None:
            return found
        n, arm = corners.size, corners.arm
        moved = _times(self._by_acceleration, step[:, :arm])
        by_S = step[:, 3 * n, None]
        tilt = self.tilts
        change = by_S * tilt
        if corners.drives:
            change = change + self.S * step[:, n - 1, None] * _turned(tilt)
        found[:, :, :3] -= corners.masses[:, None, None] * change
        found[:, :, 3:WRENCH] -= _cross(self.moments, change)
        found[:, :, 3:WRENCH] -= self.S * _cross(_combined(corners.weights, moved), tilt)
        return found


def _products(jacobian: Array, state: Indices, weights: Array, rows: Array) -> Array:
    """Products of L linear forms of the efforts with the Jacobian at corner and state, (L, s).

    The forms of one state are grouped, so that there is one matrix product per state.

    Args:
        jacobian: Jacobian of the basis models' efforts, shape (K, B, R, s).
        state: Index of the state of each form, shape (L,).
        weights: Weights of the basis models at the corner of each form, shape (L, B).
        rows: Coefficients of the efforts, shape (L, R).
    """
    K, B, R, width = jacobian.shape
    factors = (weights[:, :, None] * rows[:, None, :]).reshape(len(rows), B * R)
    counts = np.bincount(state, minlength=K)
    slot = np.empty(len(state), dtype=np.intp)
    slot[np.argsort(state, kind="stable")] = np.arange(len(state)) - np.repeat(
        np.cumsum(counts) - counts, counts
    )
    stacked = np.zeros((K, int(counts.max(initial=0)), B * R))
    stacked[state, slot] = factors
    products = stacked @ jacobian.reshape(K, B * R, width)
    return np.asarray(products[state, slot])


def _times(jacobian: Array, step: Array) -> Array:
    """Jacobians (K, B, R, s) times steps (K, s), shape (B, K, R)."""
    K, B, R, width = jacobian.shape
    found = jacobian.reshape(K, B * R, width) @ step[:, :, None]
    return np.ascontiguousarray(found.reshape(K, B, R).transpose(1, 0, 2))


def _combined(weights: Array, of_basis: Array) -> Array:
    """Linear combinations (V, ...) of values of the basis models (B, ...)."""
    shape = of_basis.shape[1:]
    found = weights @ of_basis.reshape(len(of_basis), math.prod(shape))
    return np.asarray(found.reshape(len(weights), *shape))


def _cross(a: Array, b: Array) -> Array:
    """`np.cross` of vectors along the last axis, several times as fast."""
    found = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        found[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return found


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("li,li->l", a, b))


def _turned(tilt: Array) -> Array:
    """Derivative by the yaw of a vector in the root frame that is constant in the world."""
    return np.stack([tilt[..., 1], -tilt[..., 0], np.zeros_like(tilt[..., 0])], axis=-1)


def _of_machines(models: Sequence[StageModel]) -> Array:
    """Inertial parameters of each joint's body: mass, first and second moments, (V, J, 10)."""
    found: dict[int, Array] = {}
    for machine in (model.machine for model in models):
        if id(machine) not in found:
            found[id(machine)] = dynamic_parameters(machine)
    return np.stack([found[id(model.machine)] for model in models])


def _scaled(values: Array) -> Array:
    """Columns (V, ...) of values that differ between rows, scaled to order one."""
    columns = values[:, (values != values[0]).any(axis=0)]
    return np.asarray(columns / np.abs(columns).max(axis=0, initial=0.0))


def _basis(values: Array) -> tuple[Indices, Array]:
    """Indices (B,) of rows that span all V rows, and the weights (V, B) of the combinations."""
    if values.shape[1] == 0:
        return np.zeros(0, dtype=np.intp), np.zeros((len(values), 0))
    triangle, pivots = scipy_linalg().qr(values.T, mode="r", pivoting=True)
    size = np.abs(np.diag(triangle))
    chosen = np.sort(pivots[: int((size > RANK * size[0]).sum())])
    weights = np.linalg.lstsq(values[chosen].T, values.T, rcond=None)[0].T
    weights[np.abs(weights) < DROPPED] = 0.0
    return chosen, np.ascontiguousarray(weights)


def _differ_in_inertia_only(models: Sequence[StageModel]) -> bool:
    """Whether the models are of one kind and their machines differ in inertia alone."""
    first = models[0]
    machine, checked = first.machine.model, {id(first.machine)}
    placements = [np.array(placement.homogeneous) for placement in machine.jointPlacements]

    def is_like_first(model: StageModel) -> bool:
        other = model.machine.model
        same = (
            type(model) is type(first)
            and model.joint_efforts == first.joint_efforts
            and model.machine.joint_names == first.machine.joint_names
            and model.machine.coupling.equals(first.machine.coupling)
            and list(other.parents) == list(machine.parents)
            and np.array_equal(model.coordinates.G, first.coordinates.G)
        )
        if not same or id(model.machine) in checked:
            return same
        checked.add(id(model.machine))
        return all(
            np.array_equal(ours, theirs.homogeneous)
            for ours, theirs in zip(placements, other.jointPlacements, strict=True)
        )

    return all(is_like_first(model) for model in models)


def _gravities(models: Sequence[StageModel]) -> Array | None:
    """Gravity of each model at yaw zero, up to a common vector, shape (V, 3) [m/s^2].

    None where the models' gravity differs by more than a constant, as over different terrains.
    """
    standing = [model.gravity for model in models if isinstance(model, ArmModel)]
    if len(standing) == len(models):
        return np.array(standing)
    terrains = [model.terrain for model in models if isinstance(model, DrivingModel)]
    if len(terrains) < len(models):
        return None
    if all(terrain is terrains[0] for terrain in terrains):
        return np.zeros((len(models), 3))
    slopes = [terrain for terrain in terrains if isinstance(terrain, Slope)]
    return np.array([slope.gravity() for slope in slopes]) if len(slopes) == len(models) else None


def _on_ground_of(model: StageModel, other: StageModel) -> StageModel:
    """Copy of a model on the ground of another one."""
    if isinstance(model, ArmModel) and isinstance(other, ArmModel):
        return replace(model, gravity=other.gravity)
    if isinstance(model, DrivingModel) and isinstance(other, DrivingModel):
        return replace(model, terrain=other.terrain)
    return model
