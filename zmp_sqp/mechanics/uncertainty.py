"""What is uncertain about payload and slope, as corners: what holds at all of them holds for everything between."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number, frozen_array, shortened
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.ground import Ground, Slope
from zmp_sqp.mechanics.machine import Machine

__all__ = ["Corner", "com_box", "corners", "leaning_corners"]

FARTHEST_COM = 10.0  # [m]


@dataclass(frozen=True, slots=True, eq=False)
class Corner:
    """One extreme of what is uncertain.

    Attributes:
        machine: With the payload of this extreme.
        ground: With its gravity.
        text: What is special about it, in words; empty where nothing is uncertain.
        spread: Mass of the payload times the squared distance by which its centre of mass may be
            off [kg m^2]: what lies between such corners is as safe as they are but for
            `moment_of_spread`.
    """

    machine: Machine
    ground: Ground
    text: str = ""
    spread: float = 0.0


@dataclass(frozen=True, slots=True)
class LeaningSlope(Slope):
    """A slope whose gravity at yaw zero is given rather than computed; the plane and its frame stay.

    Attributes:
        gravity_at_zero: In the root frame at yaw zero [m/s^2].
    """

    gravity_at_zero: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def gravity_at_yaws(self, yaw: Array) -> Array:
        """Gravity in the root frame at headings (K,) in the plane, shape (K, 3) [m/s^2]."""
        x, y, z = self.gravity_at_zero
        cos, sin = np.cos(yaw), np.sin(yaw)
        return np.column_stack([cos * x + sin * y, cos * y - sin * x, np.full_like(yaw, z)])


def corners(
    machine: Machine,
    ground: Ground,
    *,
    tipping_fraction: float,
    payload_uncertainty: float,
    slope_uncertainty: float,
    payload_com_uncertainty: Array | None = None,
    every: bool = False,
) -> tuple[Corner, ...]:
    r"""Extremes of payload and slope between which the rows of the wrench are affine.

    The ground reaction is affine in a factor \mu on the payload's mass (and inertia) and in gravity
    g, each for itself, so that a row c . W(\mu, g) <= 0 that holds at all corners of a box of (\mu,
    g) holds in all of it:

    .. math::
        \mu \in \{1 - u, \; (1 + u) / f\}, \qquad
        g \in \operatorname{conv} \{\tau \, h_i : \tau \in \{\cos \delta, 1\}\}

    with the payload's uncertainty u, the tipping fraction f (ISO 10567: the rated load is a share
    of the one that tips), and the corners h_i of a pyramid about every gravity that is off by an
    angle of up to \delta. The payload's centre of mass may be anywhere in a box about where it
    should be; the corners of that box are exact but for the squares of its sides, see
    `moment_of_spread`.

    Args:
        machine: With its payload.
        ground: A Slope if the slope is uncertain.
        tipping_fraction: f, above 0 and at most 1.
        payload_uncertainty: u, at least 0 and below 1.
        slope_uncertainty: delta, by which the ground may lean more or less than it should, in any
            direction [rad].
        payload_com_uncertainty: Half the sides of the box in the axes of the frame that carries the
            payload, shape (3,) [m]; None is zero.
        every: Both \tau, as a proof needs, instead of the smaller alone, which is nearly always the
            worse one.

    Raises:
        ProblemError: There is no payload to be uncertain of, more than one whose centre of mass is,
            or no Slope.
    """
    box = np.zeros(3) if payload_com_uncertainty is None else payload_com_uncertainty
    loads = [(machine, "")]
    if tipping_fraction < 1.0 or payload_uncertainty > 0.0:
        if machine.payload_mass == 0.0:
            which = "tipping_fraction" if tipping_fraction < 1.0 else "payload_uncertainty"
            raise ProblemError(
                f"{which} needs a payload, but machine {machine.name!r} carries none"
            )
        factors = (1.0 - payload_uncertainty, (1.0 + payload_uncertainty) / tipping_fraction)
        loads = [
            (machine.with_payload_scaled(mu), f"payload {mu * machine.payload_mass:.0f} kg")
            for mu in factors
        ]
    if box.any():
        if machine.payload_count != 1:
            count = machine.payload_count
            raise ProblemError(
                f"payload_com_uncertainty needs one payload, but machine {machine.name!r} carries {count}"
            )
        offsets = [
            np.array(signs) * box
            for signs in product(*((-1.0, 1.0) if side > 0.0 else (0.0,) for side in box))
        ]
        loads = [
            (
                load.with_payload_moved(offset),
                ", ".join(part for part in (heavy, _displaced(offset)) if part),
            )
            for load, heavy in loads
            for offset in offsets
        ]
    square = float(box @ box)
    grounds: list[tuple[Ground, str]] = [(ground, "")]
    if slope_uncertainty > 0.0:
        if not isinstance(ground, Slope):
            raise ProblemError(f"slope_uncertainty needs a Slope, not {type(ground).__name__}")
        grounds = []
        for gravity, roll, pitch in leaning_corners(ground, slope_uncertainty):
            text = f"the slope off by roll {roll:+.1f} and pitch {pitch:+.1f} degrees"
            for tau in (np.cos(slope_uncertainty), 1.0) if every else (np.cos(slope_uncertainty),):
                x, y, z = (float(part) for part in tau * gravity)
                grounds.append((LeaningSlope(ground.roll, ground.pitch, (x, y, z)), text))
    return tuple(
        Corner(
            load,
            plane,
            ", ".join(part for part in (heavy, leaning) if part),
            load.payload_mass * square,
        )
        for load, heavy in loads
        for plane, leaning in grounds
    )


def com_box(given: Any, *, name: str) -> Array:
    """Half the sides of the box that a centre of mass is in, shape (3,) [m].

    Args:
        given: Scalar for a cube, or one per axis.
        name: How errors call it.

    Raises:
        ProblemError: Neither one nor three finite numbers, a negative one, or one of more than ten
            metres.
    """
    box = (
        np.full(3, finite_number(given, name=name, error=ProblemError))
        if np.ndim(given) == 0
        else given
    )
    if np.shape(box) != (3,):
        raise ProblemError(
            f"{name} must be one number, or three for x, y and z, not {shortened(given)}"
        )
    box = frozen_array(box, name=name, shape=(3,), error=ProblemError, labels=("x", "y", "z"))
    if not ((box >= 0.0) & (box <= FARTHEST_COM)).all():
        raise ProblemError(
            f"{name} must lie within [0, {FARTHEST_COM:g}] m along each axis, not {shortened(given)}"
        )
    return box


def _displaced(offset: Array) -> str:
    x, y, z = offset + 0.0  # no negative zeros
    return f"its centre off by ({x:+.2f}, {y:+.2f}, {z:+.2f}) m"


def leaning_corners(ground: Slope, delta: float) -> list[tuple[Array, float, float]]:
    r"""Corners h_i of a pyramid, shape (3,) each [m/s^2], and the changes of roll and pitch they stand for [degrees].

    Gravity at an angle of up to \delta to the nominal one, u, is \tau times a point within \tan
    \delta of u in the plane through u and across it, with \cos \delta <= \tau <= 1. The pyramid
    stands on the square about that disc.
    """
    nominal = ground.gravity()
    strength = float(np.linalg.norm(nominal))
    down, half = nominal / strength, np.tan(delta)
    ahead = np.cross([0.0, 1.0, 0.0], -down)
    ahead /= np.linalg.norm(ahead)
    left = np.cross(-down, ahead)
    leaning = float(
        np.degrees(delta)
    )  # to pitch down leans gravity ahead, to roll up on the left leans it to the right
    return [
        (strength * (down + half * (i * ahead + j * left)), -j * leaning, i * leaning)
        for i in (-1.0, 1.0)
        for j in (-1.0, 1.0)
    ]
