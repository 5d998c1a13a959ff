"""Fastest slew from rest with the ZMP in a circle, in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ellipkinc

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.ground import GRAVITY
from zmp_sqp.planning.closed_forms.slew_circle import SlewInsight

__all__ = ["SlewRamp"]

# share of the peak rate left out where there is no coasting: a little coast then costs 5e-9 of T
SHAVE = 1e-4


@dataclass(frozen=True, slots=True)
class SlewRamp:
    r"""Speeding up from rest: at the joint's limit a first, then along the circle; slowing down is the mirror image.

    On the circle the slew is a pendulum, :math:`\ddot\theta = (g/h) \rho \cos(\varphi_0 + 2
    \theta)`. With
    :math:`w = w_{top} \sin\psi` the quadratures :math:`t = \int dw / \alpha(w), \theta = \int w \,
    dw / \alpha(w)` lose their singularity at the top rate (the slew gets there in finite time) and
    have a closed form:

    .. math::
        t = \sqrt{h / (g (\rho + 1))} \, F(\psi | m), \quad m = -(\rho - 1) / (\rho + 1), \qquad
        \theta = \tfrac12 \arcsin((1 + h w^2 / g) / \rho) - \tfrac12 \arcsin(1 / \rho)

    F is the incomplete elliptic integral of the first kind.

    Attributes:
        insight: The slewing part.
        radius: Of the supporting circle; larger than the ZMP's at rest [m].
        velocity: Limit of the joint [rad/s].
        acceleration: Limit of the joint [rad/s^2].
        angle: Of the whole slew, speeding up and slowing down, positive [rad].
    """

    insight: SlewInsight
    radius: float
    velocity: float
    acceleration: float
    angle: float

    @property
    def rho(self) -> float:
        """Radius of the circle over that of the ZMP at rest, above 1 [-]."""
        return self.insight.reserve(self.radius)

    @property
    def top(self) -> float:
        """Rate at which the ZMP runs on the circle without acceleration [rad/s]."""
        return self.insight.top_rate(self.radius)

    @property
    def handover(self) -> float:
        """psi where the circle takes over from the joint's acceleration limit; 0 if it rules from the start [rad]."""
        pull = self.insight.height * self.acceleration / GRAVITY
        excess = np.sqrt(max(self.rho**2 - pull**2, 0.0)) - 1.0  # h w^2 / g there
        return float(np.arcsin(np.sqrt(max(excess, 0.0) / (self.rho - 1.0))))

    @property
    def peak(self) -> float:
        """Rate at which the ramp ends: the least of top rate, rate limit, and what half the angle allows [rad/s]."""
        half, limit = 0.5 * self.angle, self.top * np.sin(self.handover)
        first = 0.5 * limit**2 / self.acceleration
        if half <= first:
            return float(min(np.sqrt(2.0 * self.acceleration * half), self.velocity))
        phase = self._phase(self.handover) + 2.0 * (half - first)
        if phase >= 0.5 * np.pi:
            return min(self.top, self.velocity)
        reached = np.sqrt(GRAVITY / self.insight.height * max(self.rho * np.sin(phase) - 1.0, 0.0))
        return float(min(reached, self.top, self.velocity))

    def psi(self, rate: float) -> float:
        """Angle with w = w_top sin(psi) [rad]."""
        return float(np.arcsin(min(rate / self.top, 1.0)))

    def time(self, psi: Any) -> Any:
        """From rest to the rate w_top sin(psi) [s]."""
        m = -(self.rho - 1.0) / (self.rho + 1.0)
        scale = np.sqrt(self.insight.height / (GRAVITY * (self.rho + 1.0)))
        swing = ellipkinc(np.maximum(psi, self.handover), m) - ellipkinc(self.handover, m)
        return self.top * np.sin(np.minimum(psi, self.handover)) / self.acceleration + scale * swing

    def covered(self, psi: float) -> float:
        """Angle turned from rest to the rate w_top sin(psi) [rad]."""
        first = self.top * np.sin(min(psi, self.handover))
        swung = self._phase(max(psi, self.handover)) - self._phase(self.handover)
        return float(0.5 * first**2 / self.acceleration + 0.5 * swung)

    def duration(self) -> float:
        """Of the whole slew: ramp, coast, ramp [s]."""
        peak = self.peak
        psi = self.psi(peak)
        return float(2.0 * self.time(psi) + max(self.angle - 2.0 * self.covered(psi), 0.0) / peak)

    def nodes(self, count: int) -> tuple[Array, Array]:
        """Times [s] and accelerations [rad/s^2] at the count + 1 nodes of a ramp, the handover among them.

        Along the circle alpha(t) is concave. Its chords are lower, the rates that they give too,
        and the bound falls with the rate: accelerations that run linearly from node to node keep
        the ZMP in the circle all the way.
        """
        peak, start = self.peak, self.handover
        if self.angle - 2.0 * self.covered(self.psi(peak)) < SHAVE * self.angle:
            peak *= 1.0 - SHAVE
        end = self.psi(peak)
        along, first = np.array([end]), count  # intervals at the joint's limit
        if end > start:
            first = (
                int(np.clip(round(count * self.time(start) / self.time(end)), 1, count - 1))
                if start
                else 0
            )
            along = np.linspace(start, end, count - first + 1)
        ruled = np.arcsin(np.sin(along[0]) * np.linspace(0.0, 1.0, first + 1)[:-1])
        psi = np.concatenate([ruled, along])
        rise = np.sqrt(
            (self.rho - 1.0) * (self.rho + 1.0 + (self.rho - 1.0) * np.sin(psi) ** 2)
        ) * np.cos(psi)
        push = np.minimum(GRAVITY / self.insight.height * rise, self.acceleration)
        if first:
            push[: first + 1] = self.acceleration
        return np.asarray(self.time(psi)), push

    def _phase(self, psi: float) -> float:
        """Angle phi_0 + 2 theta of the pendulum: arcsin((1 + h w^2/g) / rho) without its loss of digits at the top."""
        u = 1.0 + (self.rho - 1.0) * np.sin(psi) ** 2
        return float(np.arctan2(u, np.sqrt((self.rho - 1.0) * (self.rho + u)) * np.cos(psi)))
