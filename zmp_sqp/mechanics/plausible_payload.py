"""Payloads that are hardly meant so: said in warnings, with the unit that was likely meant."""

from __future__ import annotations

import numpy as np

from zmp_sqp.mechanics.payload import Payload
from zmp_sqp.mechanics.support import SupportPolygon

__all__ = ["payload_doubts"]

# payloads of machines heavier than HEAVY and of less than LIGHT of their mass may be in tonnes
HEAVY, LIGHT = 1000.0, 2.5e-4  # [kg], share
TONNE, MILLIMETRE = 1000.0, 1e-3  # [kg], [m]
MANY = 5.0  # times the machine's mass: a payload above that is hardly carried
FAR = 20.0  # times the reach of the support polygon: a payload's centre is hardly farther away


def payload_doubts(payload: Payload, mass: float, support: SupportPolygon | None) -> list[str]:
    """Sentences about a payload whose numbers look like other units; empty if it is plausible.

    Args:
        payload: The payload, in kg and m.
        mass: Mass of the machine without it [kg].
        support: The support polygon, whose size the lengths are compared with; None compares none.
    """
    doubts = []
    share = payload.mass / mass if mass > 0.0 else np.nan
    if mass >= HEAVY and share < LIGHT and TONNE * payload.mass <= mass:
        doubts.append(
            f"a payload of {payload.mass:g} kg is {100.0 * share:.2g} % of the machine's "
            f"{mass:,.0f} kg; if it is meant in tonnes, give {TONNE * payload.mass:g} kg"
        )
    if share > MANY:
        doubts.append(
            f"a payload of {payload.mass:,g} kg is {share:.3g} times as heavy as the machine with "
            f"its {mass:,.0f} kg; masses are in kg"
        )
    far = float(np.linalg.norm(payload.com))
    if support is not None and far > FAR * support.reach:
        nearer = ", ".join(f"{MILLIMETRE * entry:g}" for entry in payload.com)
        doubts.append(
            f"a payload with its centre of mass {far:,.4g} m from frame {payload.frame!r} is "
            f"{far / support.reach:.3g} times as far away as the machine's support polygon "
            f"reaches; if it is meant in millimetres, give com = [{nearer}] m"
        )
    return doubts
