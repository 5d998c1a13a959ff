"""Zero moment point by differences of forward kinematics alone, without inverse dynamics.

Newton and Euler for all bodies i, with accelerations of their centres of mass as second differences
of positions, and angular momenta about them, R I R^T w, as first differences:

    f = sum m_i (c_i'' - g),  tau_O = sum m_i c_i x (c_i'' - g) + (R_i I_i R_i^T w_i)'
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin

import zmp_sqp as zs

__all__ = ["SHORTEST", "zmp_by_differences"]

STEP = 2e-4  # [s] least error of second differences: rounding 1e-16 / STEP^2 against STEP^2
SHORTEST = 1e-3  # [s] interval in which differences still have enough digits
INSIDE = 0.02  # of an interval: stencils must not reach across its ends


def zmp_by_differences(
    path: Path, machine: zs.Machine, trajectory: zs.Trajectory, ground: zs.Slope, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Times within the intervals, shape (K,), and the ZMP there, shape (K, 2) [m].

    Args:
        path: The URDF, which Pinocchio reads by itself.
        machine: Gives planned and held joints, and the height of the support plane.
        trajectory: The motion.
        ground: The slope.
        count: Number of times.
    """
    model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    ends = trajectory.times
    shares = np.linspace(INSIDE, 1.0 - INSIDE, max(count // (len(ends) - 1), 1))
    spans = np.diff(ends)
    long = spans > min(SHORTEST, 0.5 * spans.max())
    t = (ends[:-1, None] + shares * spans[:, None])[long].ravel()
    h = np.minimum(STEP, 0.4 * INSIDE * np.repeat(spans[long], len(shares)))
    stencil = t[:, None] + h[:, None] * np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    q = trajectory(stencil.ravel())[0]
    joints = _all_joints(path, machine, q)
    position, rotation, bodies = _placements(model, joints, stencil.shape)
    m = np.array([body.mass for body in bodies])
    inertia = np.array([body.inertia for body in bodies])
    c = position[:, 2]
    acceleration = (position[:, 4] - 2.0 * c + position[:, 0]) / h[:, None, None] ** 2
    push = m[:, None] * (acceleration - ground.gravity())
    spins = [_spin(rotation[:, k], rotation[:, k + 2], h) for k in (0, 2)]  # at -h/2 and h/2
    turned = [
        np.einsum("kbij,bjl,kbml,kbm->kbi", rotation[:, k], inertia, rotation[:, k], spin)
        for k, spin in zip((1, 3), spins, strict=True)
    ]
    tau = (np.cross(c, push) + (turned[1] - turned[0]) / h[:, None, None]).sum(axis=1)
    f = push.sum(axis=1)
    tau = tau - np.cross([0.0, 0.0, machine.support.height], f)
    return t, np.column_stack([-tau[:, 1], tau[:, 0]]) / f[:, 2:]


def _all_joints(path: Path, machine: zs.Machine, q: np.ndarray) -> dict[str, np.ndarray]:
    """Coordinates of all joints of the URDF by name, mimics included."""
    found = {name: q[:, i] for i, name in enumerate(machine.joint_names)}
    found |= {name: np.full(len(q), value) for name, value in machine.held.items()}
    mimics = {
        joint.get("name"): joint.find("mimic")
        for joint in ET.parse(path).getroot().findall("joint")
        if joint.find("mimic") is not None and joint.get("name") not in found
    }
    while mimics:
        ready = {name: one for name, one in mimics.items() if one.get("joint") in found}
        if not ready:
            break
        for name, one in ready.items():
            factor, offset = float(one.get("multiplier", 1)), float(one.get("offset", 0))
            found[name] = factor * found[one.get("joint")] + offset
            del mimics[name]
    return found


def _placements(
    model: pin.Model, joints: dict[str, np.ndarray], shape: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray, list[pin.Inertia]]:
    """Centres of mass and rotations of all bodies, by forward kinematics."""
    data, count = model.createData(), int(np.prod(shape))
    full = np.tile(pin.neutral(model), (count, 1))
    for name, values in joints.items():
        if not model.existJointName(name):
            continue
        joint = model.joints[model.getJointId(name)]
        if joint.nq == 1:
            full[:, joint.idx_q] = values
        elif joint.nv == 1:
            full[:, joint.idx_q], full[:, joint.idx_q + 1] = np.cos(values), np.sin(values)
    moved = [i for i in range(1, model.njoints) if model.inertias[i].mass > 0.0]
    bodies = [model.inertias[i] for i in moved]
    position, rotation = np.empty((count, len(moved), 3)), np.empty((count, len(moved), 3, 3))
    for k, configuration in enumerate(full):
        pin.forwardKinematics(model, data, configuration)
        position[k] = [data.oMi[i].act(body.lever) for i, body in zip(moved, bodies, strict=True)]
        rotation[k] = [data.oMi[i].rotation for i in moved]
    return position.reshape(*shape, -1, 3), rotation.reshape(*shape, -1, 3, 3), bodies


def _spin(before: np.ndarray, after: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Angular velocities that turn rotations into others within the time h, (K, B, 3)."""
    turn = after @ before.swapaxes(-1, -2)
    axis = 0.5 * np.stack(
        [
            turn[..., 2, 1] - turn[..., 1, 2],
            turn[..., 0, 2] - turn[..., 2, 0],
            turn[..., 1, 0] - turn[..., 0, 1],
        ],
        axis=-1,
    )  # times the sine of the angle
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    longer = np.where(sine > 1e-9, np.arcsin(np.minimum(sine, 1.0)) / np.maximum(sine, 1e-9), 1.0)
    return axis * longer / h[:, None, None]
