"""Measured states: brought within the limits where they miss them by little."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.machine import Machine

__all__ = ["widened_limits", "with_room_to_stop", "within_limits"]

# [rad or m] excess over a position limit, and relative excess over a velocity limit, that is
# measurement noise or tracking error
POSITION_NOISE, RATE_NOISE = 0.01, 0.05
WIDER = 1e-6  # relative: rounding must not leave a widened limit


def within_limits(machine: Machine, q: Array, v: Array) -> tuple[Array, Array]:
    """State within the limits that is nearest to a measured one, joint by joint.

    A joint that runs along its limit is measured now and then a little outside. Positions are moved
    by `POSITION_NOISE` at most, and rates by `RATE_NOISE`; also rates that leave no room to stop
    before the position limit. Where that is not enough, the state stays as it is.

    Args:
        machine: The machine.
        q: Joint coordinates, shape (n,) [rad or m].
        v: Joint rates, shape (n,) [rad/s or m/s].
    """
    limits = machine.limits
    near_q = np.clip(q, limits.position_lower, limits.position_upper)
    near_q = np.where(np.abs(near_q - q) <= POSITION_NOISE, near_q, q)
    ahead = np.where(v > 0.0, limits.position_upper - near_q, near_q - limits.position_lower)
    can_stop = np.sqrt(2.0 * limits.acceleration * np.clip(ahead, 0.0, None))
    most = np.minimum(limits.velocity, can_stop)
    near_v = np.clip(v, -most, most)
    near_v = np.where(np.abs(near_v - v) <= RATE_NOISE * limits.velocity, near_v, v)
    return near_q, near_v


def with_room_to_stop(machine: Machine, q: Array, v: Array) -> Machine:
    """The machine, with limits widened where a state is outside them or cannot stop within them.

    Velocity limits are raised to the rates of the state, and position limits moved to where the
    joints come to rest when they brake with their largest accelerations.

    Args:
        machine: The machine.
        q: Joint coordinates, shape (n,) [rad or m].
        v: Joint rates, shape (n,) [rad/s or m/s].
    """
    limits = machine.limits
    rest = q + 0.5 * v * np.abs(v) / limits.acceleration
    slack = WIDER * (1.0 + np.abs(rest - q))
    lower = np.minimum(limits.position_lower, np.minimum(q, rest) - slack)
    upper = np.maximum(limits.position_upper, np.maximum(q, rest) + slack)
    inside = (rest >= limits.position_lower) & (rest <= limits.position_upper)
    inside &= (q >= limits.position_lower) & (q <= limits.position_upper)
    velocity = np.maximum(limits.velocity, np.abs(v))
    if inside.all() and np.array_equal(velocity, limits.velocity):
        return machine
    changed = {
        "position_lower": np.where(inside, limits.position_lower, lower),
        "position_upper": np.where(inside, limits.position_upper, upper),
        "velocity": velocity,
    }
    return replace(machine, limits=limits.updated(changed, machine.joint_names))


def widened_limits(given: Machine, widened: Machine) -> str:
    """Sentence that says which limits of the machine a stop passes; empty if it passes none.

    Args:
        given: The machine.
        widened: The same with limits from `with_room_to_stop`.
    """
    found, moved = [], []
    for j, name in enumerate(given.joint_names):
        position, rate = given.joint_units[j], f"{given.joint_units[j]}/s"
        for kind, unit, words in (
            ("position_lower", position, "lower position limit"),
            ("position_upper", position, "upper position limit"),
            ("velocity", rate, "velocity limit"),
        ):
            old, new = (float(getattr(one.limits, kind)[j]) for one in (given, widened))
            if old != new and kind != "velocity":
                outwards = np.floor if kind == "position_lower" else np.ceil
                moved.append(f"{kind}={{{name!r}: {outwards(1e4 * new) / 1e4:.4f}}}")
            if old != new:
                found.append(f"{words} of joint {name!r} ({old:.4g} {unit}, here {new:.4g} {unit})")
    if not found:
        return ""
    limits = f"machine.with_limits({', '.join(moved)})"
    onward = f" To plan on from there, give limits that hold it: {limits}." if moved else ""
    passed = f"this one passes the {', the '.join(found)}"
    return f"No motion from this state keeps all limits; {passed}.{onward}"
