"""Problems with one joint whose optimum is known in closed form, and a machine of many joints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import quad

from benchmarks.problems.scene import GRAVITY, NamedProblem, Scene

__all__ = [
    "CRANE_HEIGHT",
    "SLIDER_HEIGHT",
    "double_integrator",
    "double_integrator_time",
    "slew",
    "slew_time",
    "slider",
    "slider_time",
    "stack_of_slides",
]

# --- slider: a mass at constant height ----------------------------------------------------------

SLIDER_HEIGHT = 2.0  # [m] urdf/slider.urdf
SLIDER_SHARE = 1100.0 / 1000.0  # total mass M over the sliding mass m


def slider_time(half_length: float, s: float) -> float:
    r"""Optimal duration from -s to s, rest to rest: T* = 2 sqrt(h/g) acosh(a / (a - s)).

    The ZMP is (m/M)(x - (h/g) x''). It is inside the foot where |x - (h/g) x''| <= a, with
    a = half_length M/m. The fastest motion keeps the ZMP on the rear edge until x = 0, that is
    x'' = (g/h)(x + a), and is symmetric about that moment. The first half is
    x + a = (a - s) cosh(t sqrt(g/h)), which reaches x = 0 after sqrt(h/g) acosh(a / (a - s)).
    """
    a = half_length * SLIDER_SHARE
    return float(2.0 * np.sqrt(SLIDER_HEIGHT / GRAVITY) * np.arccosh(a / (a - s)))


def slider(*, intervals: int = 100, s: float = 0.3, half_length: float = 0.5) -> NamedProblem:
    """A mass slides at constant height; the ZMP is on the rear edge, then on the front one."""
    foot = ((-half_length, -2.0), (half_length, -2.0), (half_length, 2.0), (-half_length, 2.0))
    scene = Scene("slider", foot)
    problem = scene.problem([-s], [s], intervals=intervals)
    return NamedProblem(f"slider_{intervals}", scene, problem, slider_time(half_length, s))


# --- slew on a round foot -----------------------------------------------------------------------

# urdf/slewing_crane.urdf: 1000 kg turn at a radius of 2 m on a base of 1000 kg. The common centre
# of mass turns at a radius of 1 m, so rho = (radius of the foot) / (1 m).
CRANE_HEIGHT = 3.0  # [m] of the turning mass


def slew_time(
    rho: float,
    angle: float,
    *,
    max_velocity: float = np.inf,
    max_acceleration: float = np.inf,
    h: float = CRANE_HEIGHT,
) -> float:
    r"""Optimal duration of a turn from rest to rest: Song & Sharf 2020, eqs. (12)-(18).

    The ZMP stays within the round foot where the angular acceleration is at most
    f(w) = (g/h) sqrt(rho^2 - (1 + h w^2/g)^2), a function of the rate w alone. The fastest turn
    accelerates with f, coasts at the largest rate for which f is real, and brakes with f. A ramp
    from 0 to w takes the time int dw/f and covers the angle int w dw/f. Where two full ramps cover
    more than the angle, bisection finds the lower peak rate.
    """
    top = min(float(np.sqrt((rho - 1.0) * GRAVITY / h)), max_velocity)

    def ramp(peak: float) -> tuple[float, float]:
        # substituting w = top sin(phi) removes the singularity of 1/f at w = top
        def integrand(phi: float) -> float:
            w = top * np.sin(phi)
            f = (GRAVITY / h) * np.sqrt(max(rho**2 - (1.0 + h * w**2 / GRAVITY) ** 2, 1e-300))
            return float(top * np.cos(phi) / min(f, max_acceleration))

        end = float(np.arcsin(min(peak / top, 1.0)))
        options: dict[str, Any] = {"limit": 200, "epsabs": 1e-11, "epsrel": 1e-11}
        time = quad(integrand, 0.0, end - 1e-9, **options)[0]
        angle = quad(lambda phi: integrand(phi) * top * np.sin(phi), 0.0, end - 1e-9, **options)[0]
        return time, angle

    time, covered = ramp(top)
    if 2.0 * covered <= angle:
        return 2.0 * time + (angle - 2.0 * covered) / top
    low, high = 0.0, top
    for _ in range(60):
        peak = 0.5 * (low + high)
        low, high = (peak, high) if 2.0 * ramp(peak)[1] < angle else (low, peak)
    return 2.0 * ramp(low)[0]


def slew(
    *,
    radius: float,
    limited: bool = False,
    intervals: int = 100,
    angle: float = np.pi,
    corners: int = 200,
) -> NamedProblem:
    """Half a turn on a foot that is a polygon inscribed in a circle of the given radius.

    Args:
        radius: [m].
        limited: The joint has the paper's limits, else none.
        intervals: N.
        angle: [rad].
        corners: Of the polygon.
    """
    turn = 2.0 * np.pi * np.arange(corners) / corners
    disc = tuple((radius * float(np.cos(t)), radius * float(np.sin(t))) for t in turn)
    limits = {"velocity": np.pi / 4, "acceleration": np.pi / 2} if limited else {}
    scene = Scene("slewing_crane", disc, limits=limits)
    most = {f"max_{key}": value for key, value in limits.items()}
    name = f"slew_{radius}{'_limited' if limited else ''}_{intervals}"
    problem = scene.problem([0.0], [angle], intervals=intervals)
    return NamedProblem(name, scene, problem, slew_time(radius, angle, **most))


# --- double integrator: a machine that cannot tip -----------------------------------------------

BIG_FOOT = ((-1e2, -1e2), (1e2, -1e2), (1e2, 1e2), (-1e2, 1e2))


def double_integrator_time(
    distance: float, *, max_velocity: float, max_acceleration: float
) -> float:
    """Optimal duration from rest to rest: D/v + v/a if D >= v^2/a, else 2 sqrt(D/a)."""
    if distance >= max_velocity**2 / max_acceleration:
        return distance / max_velocity + max_velocity / max_acceleration
    return float(2.0 * np.sqrt(distance / max_acceleration))


def double_integrator(
    *, distance: float, max_velocity: float, max_acceleration: float, intervals: int
) -> NamedProblem:
    """The slider on a foot of 2 km: only its joint limits are left."""
    room = {"position_lower": -10.0, "position_upper": 10.0}
    limits = {"velocity": max_velocity, "acceleration": max_acceleration, **room}
    scene = Scene("slider", BIG_FOOT, limits=limits)
    optimum = double_integrator_time(
        distance, max_velocity=max_velocity, max_acceleration=max_acceleration
    )
    problem = scene.problem([-0.5 * distance], [0.5 * distance], intervals=intervals)
    return NamedProblem(f"double_integrator_{distance}", scene, problem, optimum)


# --- many joints ----------------------------------------------------------------------------------


def stack_of_slides(folder: Path, joints: int) -> Path:
    """URDF of a heavy base that carries one slide upon another, along x and y in turn."""
    box = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    parts = [f'<link name="base"><inertial><mass value="100"/>{box}</inertial></link>']
    for k in range(joints):
        parent, axis = f"slide_{k - 1}" if k else "base", "0 1 0" if k % 2 else "1 0 0"
        parts.append(
            f'<joint name="joint_{k}" type="prismatic"><parent link="{parent}"/>'
            f'<child link="slide_{k}"/><origin xyz="0 0 0.1"/><axis xyz="{axis}"/>'
            f'<limit lower="-0.1" upper="0.1" velocity="1" effort="1"/></joint>'
            f'<link name="slide_{k}"><inertial><mass value="1"/>{box}</inertial></link>'
        )
    path = folder / f"stack_of_{joints}.urdf"
    path.write_text(f'<robot name="stack">{"".join(parts)}</robot>', encoding="utf-8")
    return path
