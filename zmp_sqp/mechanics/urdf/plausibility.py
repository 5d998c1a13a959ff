"""What in a URDF is hardly meant so: said in warnings, because the file is taken as it is."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from zmp_sqp.mechanics.ground import GRAVITY
from zmp_sqp.mechanics.inertia import lacking_moment
from zmp_sqp.mechanics.urdf.elements import Body, Joint

__all__ = ["first", "massless_chains", "unphysical_inertias"]

# share of the largest principal moment up to which a violated triangle inequality is rounding of a
# CAD export: a thin plate has I_1 + I_2 = I_3 exactly
ROUNDING = 1e-2
# [m per rad/s^2] shift of the ZMP below which an impossible inertia does not matter: less than the
# distance to which a certificate is exact; it spares the placeholders of nearly massless links
HARMLESS = 1e-6
MOST_NAMED = 3  # links or joints that one message names


def unphysical_inertias(bodies: Mapping[str, Body]) -> str:
    """Sentence about the links whose inertia no body can have; empty if there are none."""
    weight = GRAVITY * sum(body.mass for body in bodies.values())
    found = {}
    for link, body in bodies.items():
        lacking = lacking_moment(body.inertia)
        largest = float(np.abs(body.inertia).max())
        if lacking > max(ROUNDING * largest, HARMLESS * weight):
            found[link] = lacking
    if not found:
        return ""
    named = [
        f"link {link!r} has the principal moments "
        f"{', '.join(f'{moment:.4g}' for moment in np.linalg.eigvalsh(bodies[link].inertia))} "
        f"kg m^2, of which the largest exceeds the sum of the others by {lacking:.3g}"
        for link, lacking in sorted(found.items(), key=lambda item: -item[1])
    ]
    shift = (
        f", which shifts the ZMP by up to {1e3 * sum(found.values()) / weight:.2g} mm per rad/s^2 "
        "from where the nearest possible inertias would have it"
        if weight > 0.0
        else ""
    )
    return (
        f"no body can have these rotational inertias: {first(named, '; ')}. "
        f"They are used as given{shift}"
    )


def massless_chains(bodies: Mapping[str, Body], joints: Sequence[Joint], planned: set[str]) -> str:
    """Sentence about planned joints that move no mass at all; empty if there are none.

    A forgotten <inertial> makes an unsafe motion look safe.
    """
    heavy = {link for link, body in bodies.items() if body.mass > 0.0}
    carrier = {joint.child: joint.parent for joint in joints}
    moved = set()
    for link in heavy:
        while link not in moved:
            moved.add(link)
            link = carrier.get(link, link)
    mimics = {joint.name: joint.mimic for joint in joints}
    moving: set[str] = set()  # joints that move mass, themselves or through joints that mimic them
    for joint in joints:
        name = joint.name if joint.child in moved else ""
        while name and name not in moving:
            moving.add(name)
            mimic = mimics.get(name)
            name = "" if mimic is None else mimic.joint
    light = [joint for joint in joints if joint.name in planned and joint.name not in moving]
    if not light:
        return ""
    named = first([f"{joint.name!r} (link {joint.child!r})" for joint in light])
    return (
        f"nothing that these joints move has a mass: {named}. If the links lack an <inertial>, "
        "margins look better than they are"
    )


def first(texts: Iterable[str], separator: str = ", ") -> str:
    """The first few of several texts, and how many more there are."""
    texts = list(texts)
    more = len(texts) - MOST_NAMED
    return separator.join(texts[:MOST_NAMED]) + (f"{separator}and {more} more" if more > 0 else "")
