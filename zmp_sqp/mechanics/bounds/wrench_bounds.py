"""Rigorous bounds on the ground reaction wrench and on how fast it can change, from norms alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.bounds.norms import ORDERS, leibniz, turning
from zmp_sqp.mechanics.machine import Machine

__all__ = ["WrenchBound", "wrench_bounds", "wrench_curvature_bound", "wrench_size_bound"]


@dataclass(frozen=True, slots=True, eq=False)
class WrenchBound:
    """Upper bounds on the ground reaction, or on a time derivative of it, over K stretches of time.

    Attributes:
        force: Of |f| or |d^2 f / dt^2|, shape (K,) [N, or N/s^2].
        moment: Of |tau| or |d^2 tau / dt^2| about the root origin, shape (K,) [N m, or N m/s^2].
    """

    force: Array
    moment: Array


def wrench_curvature_bound(
    machine: Machine,
    v: Array,
    a: Array,
    j: Array,
    *,
    reach: Array,
    gravity: float,
    base: Array | None = None,
) -> WrenchBound:
    r"""Second time derivatives of the wrench in any motion whose rates, accelerations and jerks stay below these.

    With c_i the bodies' centres of mass and L_i their angular momenta,

    .. math::
        \ddot f = \sum m_i c_i^{(4)}, \quad
        \ddot \tau = \sum m_i ((c_i - o) \times (\ddot c_i - g))'' + \dddot L_i

    in axes that stand still, about the root origin o, which may move. In root axes R, which turn
    with \Omega, a vector W has

    .. math::
        |(R^T W)''| = |W'' - 2 \Omega \times W' - \Omega' \times W + \Omega \times (\Omega \times
        W)|
                    \le |W''| + 2 |\Omega| |W'| + (|\Omega'| + |\Omega|^2) |W|

    The norms of all derivatives follow from root to tip: a vector b fixed in a body that turns with
        w has
    :math:`b' = w \times b`, hence by Leibniz :math:`|b^{(k+1)}| \le \sum_j \binom{k}{j} |w^{(j)}|
    |b^{(k-j)}|`; a joint adds its axis times the rate to w; an inertia tensor in world axes has
    :math:`|I'| \le 2 |w| |I|`.

    Args:
        machine: The machine.
        v: Largest |rate| of each joint in each stretch, shape (K, n) [rad/s or m/s].
        a: Largest |acceleration|, shape (K, n).
        j: Largest |jerk|, shape (K, n); higher derivatives are zero.
        reach: Largest |coordinate|, shape (K, n); matters for sliding joints alone [m].
        gravity: Norm of gravity [m/s^2].
        base: Bounds on the motion of the root, see `root_bounds`, shape (2, 4, K); None stands
            still.
    """
    return wrench_bounds(machine, v, a, j, reach=reach, gravity=gravity, base=base)[1]


def wrench_size_bound(
    machine: Machine,
    v: Array,
    a: Array,
    j: Array,
    *,
    reach: Array,
    gravity: float,
    base: Array | None = None,
) -> WrenchBound:
    r"""The wrench itself in any such motion, arguments as in `wrench_curvature_bound`.

    It is the sum of the absolute values of all that inverse dynamics adds up, so that rounding
    errors are a small multiple of machine precision times this.
    """
    return wrench_bounds(machine, v, a, j, reach=reach, gravity=gravity, base=base)[0]


def wrench_bounds(
    machine: Machine,
    v: Array,
    a: Array,
    j: Array,
    *,
    reach: Array,
    gravity: float,
    base: Array | None = None,
) -> tuple[WrenchBound, WrenchBound]:
    """Both `wrench_size_bound` and `wrench_curvature_bound`, for little more than one of them."""
    model = machine.model
    count = len(v)
    zero = np.zeros(count)
    rates = np.zeros((ORDERS + 1, model.nv, count))  # [0] coordinate, [1] rate, ...
    for k, values in enumerate((reach, v, a, j)):
        rates[k, machine.index_v] = values.T
    drive, turn = (list(part) for part in (np.zeros((2, 4, count)) if base is None else base))
    # |w^(k)|, k = 0..3, of the root: the same as of what it hangs on
    spin: list[list[Array]] = [turn]
    place: list[list[Array]] = [[zero] * ORDERS]  # |(p - o)^(k)|, k = 0..4, of the joint origins
    orders = (0, 2) if base is None else (0, 1, 2)
    unit: list[list[Array]] = [turning(turn)]  # |u^(k)| of a unit vector fixed in the body
    largest = [
        float(value)
        for value in np.linalg.eigvalsh([body.inertia for body in model.inertias])[:, -1]
    ]
    # |f^(k)|, |tau^(k)| in axes that stand still
    force, moment = (dict.fromkeys(orders, zero) for _ in range(2))
    for joint in range(1, model.njoints):
        parent = model.parents[joint]
        turned = unit[parent]
        offset = float(np.linalg.norm(model.jointPlacements[joint].translation))
        origin = [place[parent][k] + turned[k] * offset for k in range(ORDERS)]
        own = spin[parent]
        if joint > 1:  # the root itself moves as the base does
            q = rates[:, model.joints[joint].idx_v]
            slides = model.joints[joint].shortname().startswith(("JointModelP", "JointModelMimicP"))
            if slides:
                extra = [leibniz(turned, q, k) for k in range(ORDERS)]
                origin = [origin[k] + extra[k] for k in range(ORDERS)]
            else:
                own = [spin[parent][k] + leibniz(turned, q[1:], k) for k in range(ORDERS - 1)]
        spin.append(own)
        place.append(origin)
        inertia = model.inertias[joint]
        body = turned if own is spin[parent] else turning(own)
        unit.append(body)
        lever = float(np.linalg.norm(inertia.lever))
        centre = [origin[k] + body[k] * lever for k in range(ORDERS)]
        push = [centre[2] + drive[1] + gravity, centre[3] + drive[2], centre[4] + drive[3]]
        for k in orders:
            force[k] = force[k] + inertia.mass * push[k]
            moment[k] = moment[k] + inertia.mass * leibniz(centre, push, k)
        if largest[joint] > 0.0:
            tensor = [np.full(count, largest[joint])]
            for k in range(3):
                tensor.append(2.0 * leibniz(own, tensor, k))
            for k in orders:
                moment[k] = moment[k] + leibniz(tensor, own, k + 1)
    if base is None:
        return WrenchBound(force[0], moment[0]), WrenchBound(force[2], moment[2])
    once, none = 2.0 * turn[0], turn[1] + turn[0] ** 2  # what turning root axes add
    second = (part[2] + once * part[1] + none * part[0] for part in (force, moment))
    return WrenchBound(force[0], moment[0]), WrenchBound(*second)
