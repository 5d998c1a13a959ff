"""Uncertain payload and slope as a finite set of corners.

A motion that is safe at all corners is safe for every payload and slope between them.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number, frozen_array, shortened
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.ground import Ground, Slope
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.workspace import workspace_of

__all__ = ["Corner", "com_box", "corners", "leaning_corners"]

MOST_FOUND = 8  # sets of corners that are kept for a thread
FARTHEST_COM = 10.0  # [m] largest uncertainty of a payload's centre of mass; more is an error


@dataclass(frozen=True, slots=True, eq=False)
class Corner:
    """One extreme combination of payload and gravity.

    Attributes:
        machine: Machine with the payload of this corner.
        ground: Ground with the gravity of this corner.
        text: Description of the corner for messages; empty where nothing is uncertain.
        spread: Mass of the payload times the largest squared displacement of its centre of mass
            [kg m^2]. Between corners, the moment of the ground reaction can exceed that of the
            corners by `moment_of_spread`, which grows with this number.
    """

    machine: Machine
    ground: Ground
    text: str = ""
    spread: float = 0.0


@dataclass(frozen=True, slots=True)
class LeaningSlope(Slope):
    """Slope whose gravity does not follow from roll and pitch but is given.

    The base still moves in the plane of the nominal roll and pitch.

    Attributes:
        gravity_at_zero: Gravity in the root frame of a machine at yaw = 0 [m/s^2].
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
    r"""Extreme payloads and gravities such that a ZMP constraint at all of them holds between them.

    Let W be the ground reaction wrench and \mu a factor on mass and inertia of the payload. W is
    affine in \mu for fixed gravity g, and affine in g for fixed \mu. Hence an inequality
    c . W(\mu, g) <= 0 that holds at the corners holds everywhere between them:

    .. math::
        \mu \in \{1 - u, \; (1 + u) / f\}, \qquad
        g \in \operatorname{conv} \{\tau \, h_i : \tau \in \{\cos \delta, 1\}\}

    Here u is the payload's uncertainty, f the tipping fraction (ISO 10567: the rated load is a
    fraction of the load at which the machine tips), and h_i are the corners of a pyramid, see
    `leaning_corners`, that contains every gravity within an angle \delta of the nominal one.

    The payload's centre of mass may be anywhere in a box about its nominal position. The corners of
    this box cover the whole box except for terms in the squares of its sides, see
    `moment_of_spread`.

    Args:
        machine: Machine with its payload.
        ground: Nominal ground; must be a Slope if the slope is uncertain.
        tipping_fraction: f, above 0 and at most 1.
        payload_uncertainty: u, at least 0 and below 1.
        slope_uncertainty: delta, largest angle between actual and nominal ground, in any direction
            [rad].
        payload_com_uncertainty: Half the sides of the box, in the axes of the frame that carries
            the payload, shape (3,) [m]; None is zero.
        every: Whether to include both values of \tau, as a proof needs. Otherwise only the smaller
            one is included, which is nearly always the worse one.

    Raises:
        ProblemError: The payload is uncertain but there is none; its centre of mass is uncertain
            but there is not exactly one payload; or the slope is uncertain but is no Slope.
    """
    box = np.zeros(3) if payload_com_uncertainty is None else payload_com_uncertainty
    asked = machine, ground, tipping_fraction, payload_uncertainty, slope_uncertainty, box, every
    if slope_uncertainty != 0.0 and type(ground) is not Slope:
        return _corners(*asked)  # the ground's gravity may change in place
    numbers = tipping_fraction, payload_uncertainty, slope_uncertainty, box.tobytes(), every
    key = (id(machine), workspace_of(machine.model).version, id(ground), *numbers)
    return _LATEST.corners_of(key, lambda: _Found.of(machine, ground, _corners(*asked)))


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    """Corners that were found before: to make 16 machines takes as long as a certificate.

    Attributes:
        given: Machine and ground; holding them keeps their identities from being reused.
        corners: The corners.
        versions: Versions of the workspaces of the corners' machines.
    """

    given: tuple[Machine, Ground]
    corners: tuple[Corner, ...]
    versions: tuple[int, ...]

    @classmethod
    def of(cls, machine: Machine, ground: Ground, found: tuple[Corner, ...]) -> _Found:
        """Corners as they are now."""
        return cls((machine, ground), found, _versions(found))

    @property
    def is_unchanged(self) -> bool:
        """Whether no model of the corners was changed in place."""
        return self.versions == _versions(self.corners)


def _versions(found: tuple[Corner, ...]) -> tuple[int, ...]:
    machines = {id(corner.machine): corner.machine for corner in found}
    return tuple(workspace_of(machine.model).version for machine in machines.values())


class _Latest(threading.local):
    """The latest corners of a thread, as long as its workspaces are."""

    def __init__(self) -> None:
        self.found: OrderedDict[tuple[Any, ...], _Found] = OrderedDict()

    def corners_of(self, key: tuple[Any, ...], make: Callable[[], _Found]) -> tuple[Corner, ...]:
        """Corners that are known by a key, made anew where they are not there or have changed."""
        found = self.found.get(key)
        if found is None or not found.is_unchanged:
            self.found[key] = found = make()
        self.found.move_to_end(key)
        if len(self.found) > MOST_FOUND:
            self.found.popitem(last=False)
        return found.corners


_LATEST = _Latest()


def _corners(
    machine: Machine,
    ground: Ground,
    tipping_fraction: float,
    payload_uncertainty: float,
    slope_uncertainty: float,
    box: Array,
    every: bool,
) -> tuple[Corner, ...]:
    """`corners`, made anew."""
    loads = _with_displaced_payloads(
        _with_scaled_payloads(machine, tipping_fraction, payload_uncertainty), box
    )
    grounds = _leaning_grounds(ground, slope_uncertainty, every=every)
    square = float(box @ box)
    return tuple(
        Corner(load, plane, _joined(heavy, leaning), spread)
        for load, heavy in loads
        for spread in [load.payload_mass * square if square > 0.0 else 0.0]
        for plane, leaning in grounds
    )


def _with_scaled_payloads(
    machine: Machine, tipping_fraction: float, payload_uncertainty: float
) -> list[tuple[Machine, str]]:
    """The machine with its lightest and heaviest payload, each with a description."""
    if tipping_fraction >= 1.0 and payload_uncertainty <= 0.0:
        return [(machine, "")]
    if machine.payload_mass == 0.0:
        which = "tipping_fraction" if tipping_fraction < 1.0 else "payload_uncertainty"
        raise ProblemError(f"{which} needs a payload, but machine {machine.name!r} carries none")
    factors = (1.0 - payload_uncertainty, (1.0 + payload_uncertainty) / tipping_fraction)
    return [
        (machine.with_payload_scaled(mu), f"payload {mu * machine.payload_mass:.0f} kg")
        for mu in factors
    ]


def _with_displaced_payloads(
    loads: list[tuple[Machine, str]], box: Array
) -> list[tuple[Machine, str]]:
    """Each machine with its payload's centre of mass at each corner of the box +-box."""
    if not box.any():
        return loads
    machine, _ = loads[0]
    if machine.payload_count != 1:
        raise ProblemError(
            f"payload_com_uncertainty needs one payload, but machine {machine.name!r} carries "
            f"{machine.payload_count}"
        )
    offsets = [
        np.array(signs) * box
        for signs in product(*((-1.0, 1.0) if side > 0.0 else (0.0,) for side in box))
    ]
    return [
        (load.with_payload_moved(offset), _joined(heavy, _displaced(offset)))
        for load, heavy in loads
        for offset in offsets
    ]


def _leaning_grounds(
    ground: Ground, slope_uncertainty: float, *, every: bool
) -> list[tuple[Ground, str]]:
    """The ground with each of its extreme gravities, each with a description."""
    if slope_uncertainty <= 0.0:
        return [(ground, "")]
    if not isinstance(ground, Slope):
        raise ProblemError(f"slope_uncertainty needs a Slope, not {type(ground).__name__}")
    factors = (np.cos(slope_uncertainty), 1.0) if every else (np.cos(slope_uncertainty),)
    grounds: list[tuple[Ground, str]] = []
    for gravity, roll, pitch in leaning_corners(ground, slope_uncertainty):
        text = f"the slope off by roll {roll:+.1f} and pitch {pitch:+.1f} degrees"
        for tau in factors:
            x, y, z = (float(part) for part in tau * gravity)
            grounds.append((LeaningSlope(ground.roll, ground.pitch, (x, y, z)), text))
    return grounds


def _joined(*texts: str) -> str:
    """Those texts that are not empty, separated by commas."""
    return ", ".join(text for text in texts if text)


def com_box(given: Any, *, name: str) -> Array:
    """Box about a nominal centre of mass: half the lengths of its sides, shape (3,) [m].

    Args:
        given: Half sides as the user gave them: a scalar for a cube, or one number per axis [m].
        name: Name of the value in error messages.

    Raises:
        ProblemError: Not one or three finite numbers, a negative one, or one above ten metres.
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
            f"{name} must lie within [0, {FARTHEST_COM:g}] m along each axis, "
            f"not {shortened(given)}"
        )
    return box


def _displaced(offset: Array) -> str:
    """Displacement of a payload's centre of mass in words."""
    x, y, z = offset + 0.0  # no negative zeros
    return f"its centre off by ({x:+.2f}, {y:+.2f}, {z:+.2f}) m"


def leaning_corners(ground: Slope, delta: float) -> list[tuple[Array, float, float]]:
    r"""Corners of a pyramid that contains all gravities within an angle of the nominal one.

    With the nominal gravity g, every gravity of the same magnitude at an angle of at most \delta to
    g equals \tau p, where \cos \delta <= \tau <= 1 and p lies in the plane through g perpendicular
    to g, within |g| \tan \delta of g. The corners h_i are those of the square around this disc.

    Args:
        ground: Nominal slope.
        delta: Largest angle \delta [rad].

    Returns:
        For each of the four corners: h_i in the root frame at yaw = 0, shape (3,) [m/s^2], and the
        changes of roll and pitch that it corresponds to [degrees].
    """
    nominal = ground.gravity()
    strength = float(np.linalg.norm(nominal))
    down, half = nominal / strength, np.tan(delta)
    ahead = np.cross([0.0, 1.0, 0.0], -down)
    ahead /= np.linalg.norm(ahead)
    left = np.cross(-down, ahead)
    leaning = float(np.degrees(delta))
    # pitching the nose down tilts gravity forwards; rolling the left side up tilts it to the right
    return [
        (strength * (down + half * (i * ahead + j * left)), -j * leaning, i * leaning)
        for i in (-1.0, 1.0)
        for j in (-1.0, 1.0)
    ]
