"""Fastest speeding up of a slew with the ZMP in a circle, in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.ground import GRAVITY
from zmp_sqp.planning.closed_forms.slew_circle import SlewInsight

__all__ = ["SlewRamp"]

# Share by which the peak rate is lowered if there is no coasting, so that there is a little: that
# costs 5e-9 of the duration.
SHAVE = 1e-4


@dataclass(frozen=True, slots=True)
class SlewRamp:
    r"""Speeding up of a slew from rest: at the joint's acceleration limit, then along the circle.

    Slowing down is the mirror image. With the ZMP on the circle, the slew moves like a pendulum,

    .. math:: \ddot\theta = (g/h) \rho \cos(\varphi_0 + 2 \theta), \quad \sin\varphi_0 = 1 / \rho

    Time and angle are integrals over the rate w, singular at the top rate w_top although the slew
    reaches it in finite time. Substituting w = w_top sin(psi) removes the singularity:

    .. math::
        t &= \int dw / \alpha(w) = \sqrt{h / (g (\rho + 1))} \, F(\psi | m),
        \quad m = -(\rho - 1) / (\rho + 1)

        \theta &= \int w \, dw / \alpha(w)
        = \tfrac12 \arcsin((1 + h w^2 / g) / \rho) - \tfrac12 \arcsin(1 / \rho)

    F is the incomplete elliptic integral of the first kind.

    Attributes:
        insight: Lumped turning part of the machine; gives h.
        radius: Radius of the circle [m], larger than that of the ZMP at rest.
        velocity: Rate limit of the slew [rad/s].
        acceleration: Acceleration limit of the slew [rad/s^2].
        angle: Angle of the whole slew, slowing down included, positive [rad].
    """

    insight: SlewInsight
    radius: float
    velocity: float
    acceleration: float
    angle: float

    @property
    def rho(self) -> float:
        """Radius of the circle over that of the ZMP at rest, above 1."""
        return self.insight.reserve(self.radius)

    @property
    def top(self) -> float:
        """Rate w_top at which a slew without acceleration has its ZMP on the circle [rad/s]."""
        return self.insight.top_rate(self.radius)

    @property
    def handover(self) -> float:
        """Angle psi above which the circle, not the joint, limits the acceleration [rad].

        It is 0 if the circle limits it from the start.
        """
        share = self.insight.height * self.acceleration / GRAVITY  # h a / g
        excess = np.sqrt(max(self.rho**2 - share**2, 0.0)) - 1.0  # h w^2 / g at the handover
        return float(np.arcsin(np.sqrt(max(excess, 0.0) / (self.rho - 1.0))))

    @property
    def peak(self) -> float:
        """Rate at which speeding up ends [rad/s].

        It is the least of top rate, rate limit, and the rate reached after half the angle.
        """
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
        """Angle psi with w = w_top sin(psi) [rad].

        Args:
            rate: Rate w of the slew [rad/s].
        """
        return float(np.arcsin(min(rate / self.top, 1.0)))

    def time(self, psi: Any) -> Any:
        """Time from rest to the rate w_top sin(psi) [s]."""
        from scipy.special import ellipkinc  # slow to import, and only needed here

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
        """Duration of the whole slew: speeding up, coasting, slowing down [s]."""
        peak = self.peak
        psi = self.psi(peak)
        return float(2.0 * self.time(psi) + max(self.angle - 2.0 * self.covered(psi), 0.0) / peak)

    def nodes(self, count: int) -> tuple[Array, Array]:
        """Nodes of the speeding up: times [s] and accelerations [rad/s^2], shape (count + 1,) each.

        The handover is one of the nodes. Accelerations that are linear in time between the nodes
        keep the ZMP in the circle at all times: along the circle alpha(t) is concave, so that its
        chords lie below it; so do the rates that they give; and the bound falls with the rate.

        Args:
            count: Number of intervals.
        """
        peak, start = self.peak, self.handover
        if self.angle - 2.0 * self.covered(self.psi(peak)) < SHAVE * self.angle:
            peak *= 1.0 - SHAVE
        end = self.psi(peak)
        # angles psi along the circle, and number of intervals at the joint's limit before them
        along, first = np.array([end]), count
        if end > start:
            first = (
                int(np.clip(round(count * self.time(start) / self.time(end)), 1, count - 1))
                if start
                else 0
            )
            along = np.linspace(start, end, count - first + 1)
        at_limit = np.arcsin(np.sin(along[0]) * np.linspace(0.0, 1.0, first + 1)[:-1])
        psi = np.concatenate([at_limit, along])
        # h alpha / g on the circle
        rise = np.sqrt(
            (self.rho - 1.0) * (self.rho + 1.0 + (self.rho - 1.0) * np.sin(psi) ** 2)
        ) * np.cos(psi)
        alpha = np.minimum(GRAVITY / self.insight.height * rise, self.acceleration)
        if first:
            alpha[: first + 1] = self.acceleration
        return np.asarray(self.time(psi)), alpha

    def _phase(self, psi: float) -> float:
        """Angle phi_0 + 2 theta = arcsin((1 + h w^2 / g) / rho) of the pendulum [rad].

        It is computed by arctan2, because arcsin loses digits near the top rate.
        """
        u = 1.0 + (self.rho - 1.0) * np.sin(psi) ** 2
        return float(np.arctan2(u, np.sqrt((self.rho - 1.0) * (self.rho + u)) * np.cos(psi)))
