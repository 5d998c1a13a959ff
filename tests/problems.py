"""Named problems with their optimum and where it comes from, and a generator of seeded random ones.

Each problem is first a `Scene`: the bare numbers. The library builds its machine from them, and
`tests.checks` builds its own model of the same machine, so that neither can borrow the other's
mistakes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import quad

import zmp_sqp as zs

__all__ = [
    "CRANE_HEIGHT",
    "GRAVITY",
    "HARD",
    "PAPER_GOAL",
    "PAPER_START",
    "NamedProblem",
    "Recipe",
    "Scene",
    "Tree",
    "double_integrator",
    "double_integrator_time",
    "paper_1",
    "paper_scene",
    "random_problem",
    "random_scene",
    "slew",
    "slew_time",
    "slider",
    "slider_time",
]

URDF = Path(__file__).resolve().parents[1] / "urdf"
GRAVITY = 9.81  # [m/s^2]

# --- what a problem is made of
# ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Tree:
    """Payload at the feller-buncher's head: uniform stem of 8 m, held as in Table I of the paper (urdf/README.md)."""

    mass: float  # [kg]
    com: tuple[float, float, float] = (0.0, 0.0, 8.0 / 2.0 - 0.677)  # [m] in the head's frame
    length: float = 8.0  # [m]
    radius: float = 0.25  # [m]
    frame: str = "head"

    @property
    def inertia(self) -> np.ndarray:
        """About its centre of mass: m l^2 / 12 across, m r^2 / 2 along [kg m^2]."""
        across, along = self.mass * self.length**2 / 12.0, self.mass * self.radius**2 / 2.0
        return np.diag([across, across, along])


@dataclass(frozen=True)
class Scene:
    """A machine on its ground, in bare numbers."""

    machine: str  # URDF's stem
    vertices: tuple[tuple[float, float], ...]  # of the support polygon, counter-clockwise [m]
    tree: Tree | None = None
    roll: float = 0.0  # [rad]
    pitch: float = 0.0  # [rad]
    point_masses: bool = False
    limits: Mapping[str, Any] = field(default_factory=dict)

    @property
    def urdf(self) -> Path:
        return URDF / f"{self.machine}.urdf"

    @property
    def ground(self) -> zs.Slope:
        return zs.Slope(roll=self.roll, pitch=self.pitch)

    def load(self) -> zs.Machine:
        """The library's machine."""
        machine = zs.load_machine(
            self.machine, support=zs.SupportPolygon(self.vertices), limits=self.limits
        )
        if self.tree is not None:
            tree = self.tree
            machine = machine.with_payload(
                zs.Payload(tree.mass, tree.com, tree.frame, tree.inertia)
            )
        return machine.with_point_masses() if self.point_masses else machine

    def problem(self, start: Any, goal: Any, **options: Any) -> zs.Problem:
        return zs.Problem(self.load(), start=start, goal=goal, ground=self.ground, **options)


@dataclass(frozen=True)
class NamedProblem:
    """A problem, the scene it was made from, and its optimal duration [s] (None where nobody knows it)."""

    name: str
    scene: Scene
    problem: zs.Problem
    optimum: float | None


# --- test 1 of the paper
# ----------------------------------------------------------------------------------------------

PAPER_START = np.array([0.0, -np.pi / 6, -2.0 * np.pi / 3, np.pi / 6, -np.pi / 2])  # eq. (22)
PAPER_GOAL = np.array([np.pi, -np.pi / 6, -2.0 * np.pi / 3, np.pi / 6, -np.pi / 2])  # eq. (23)
FOOTPRINT = ((-2.5, -1.615), (2.5, -1.615), (2.5, 1.615), (-2.5, 1.615))  # 5 m x 3.23 m


def paper_scene(*, point_masses: bool = True) -> Scene:
    """20 degrees to the left, 4 t of tree."""
    return Scene(
        "feller_buncher", FOOTPRINT, Tree(4000.0), roll=np.deg2rad(-20.0), point_masses=point_masses
    )


def paper_1(*, point_masses: bool = True, **options: Any) -> NamedProblem:
    r"""Test 1 of Song & Sharf 2020.

    The slew decides: pi at most at pi/4 rad/s with pi/2 rad/s^2 takes D/v + v/a = 4 + 0.5 = 4.5 s,
        and the ZMP can be
    kept inside meanwhile. On a grid of N = 50 the switching times are missed by a little: 4.50402
    s.
    """
    scene = paper_scene(point_masses=point_masses)
    name = "paper_1" if point_masses else "paper_1_rigid"
    return NamedProblem(name, scene, scene.problem(PAPER_START, PAPER_GOAL, **options), 4.5)


# --- slider: a mass at constant height
# --------------------------------------------------------------------------------

SLIDER_HEIGHT = 2.0  # [m] urdf/slider.urdf
SLIDER_SHARE = 1100.0 / 1000.0  # total mass over the slider's


def slider_time(half_length: float, s: float) -> float:
    r"""T* = 2 sqrt(h/g) acosh(a / (a - s)) from -s to s, rest to rest.

    The ZMP is (m/M)(x - (h/g) x''), so |x - (h/g) x''| <= a = half_length M/m. Fastest is x'' =
    (g/h)(x + a), the unstable pendulum on the rear edge, until x = 0, and its mirror image from
    there: x + a = (a - s) cosh(t sqrt(g/h)) reaches x = 0 after sqrt(h/g) acosh(a / (a - s)).
    """
    a = half_length * SLIDER_SHARE
    return float(2.0 * np.sqrt(SLIDER_HEIGHT / GRAVITY) * np.arccosh(a / (a - s)))


def slider(*, intervals: int = 100, s: float = 0.3, half_length: float = 0.5) -> NamedProblem:
    """ZMP active from the first to the last moment, on the rear edge and then on the front edge."""
    foot = ((-half_length, -2.0), (half_length, -2.0), (half_length, 2.0), (-half_length, 2.0))
    scene = Scene("slider", foot)
    problem = scene.problem([-s], [s], intervals=intervals)
    return NamedProblem(f"slider_{intervals}", scene, problem, slider_time(half_length, s))


# --- slew on a round foot
# ---------------------------------------------------------------------------------------------

# [m] urdf/slewing_crane.urdf: 1000 kg at 2 m on a base of 1000 kg, so rho = R / (1 m)
CRANE_HEIGHT = 3.0


def slew_time(
    rho: float,
    angle: float,
    *,
    max_velocity: float = np.inf,
    max_acceleration: float = np.inf,
    h: float = CRANE_HEIGHT,
) -> float:
    r"""Quadrature of Song & Sharf 2020, eqs. (12)-(18) (paper.md), from rest to rest.

    The ZMP's radius gives |alpha| <= f(w) = (g/h) sqrt(rho^2 - (1 + h w^2/g)^2), which depends on
    the rate alone and is symmetric: accelerate with f, coast at the largest rate with f >= 0, brake
    with f. The ramp takes int dw/f(w) and covers int w dw/f(w). If two ramps go further than the
    angle, the peak rate is lower: found by bisection.
    """
    top = min(float(np.sqrt((rho - 1.0) * GRAVITY / h)), max_velocity)

    def ramp(peak: float) -> tuple[float, float]:
        # w = top sin(phi) takes the root singularity at w = top away
        def slope(phi: float) -> float:
            w = top * np.sin(phi)
            f = (GRAVITY / h) * np.sqrt(max(rho**2 - (1.0 + h * w**2 / GRAVITY) ** 2, 1e-300))
            return float(top * np.cos(phi) / min(f, max_acceleration))

        end = float(np.arcsin(min(peak / top, 1.0)))
        options: dict[str, Any] = {"limit": 200, "epsabs": 1e-11, "epsrel": 1e-11}
        time = quad(slope, 0.0, end - 1e-9, **options)[0]
        covered = quad(lambda phi: slope(phi) * top * np.sin(phi), 0.0, end - 1e-9, **options)[0]
        return time, covered

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
    """Half a turn on an inscribed polygon, with nothing else limiting or with the paper's limits too."""
    turn = 2.0 * np.pi * np.arange(corners) / corners
    disc = tuple((radius * float(np.cos(t)), radius * float(np.sin(t))) for t in turn)
    limits = {"velocity": np.pi / 4, "acceleration": np.pi / 2} if limited else {}
    scene = Scene("slewing_crane", disc, limits=limits)
    most = {f"max_{key}": value for key, value in limits.items()}
    name = f"slew_{radius}{'_limited' if limited else ''}_{intervals}"
    problem = scene.problem([0.0], [angle], intervals=intervals)
    return NamedProblem(name, scene, problem, slew_time(radius, angle, **most))


# --- double integrator: a machine that cannot tip
# ---------------------------------------------------------------------

BIG_FOOT = ((-1e3, -1e3), (1e3, -1e3), (1e3, 1e3), (-1e3, 1e3))


def double_integrator_time(
    distance: float, *, max_velocity: float, max_acceleration: float
) -> float:
    """D/v + v/a if D >= v^2/a, else 2 sqrt(D/a)."""
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


# --- random problems
# --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Recipe:
    """From what a random problem is drawn."""

    name: str
    payload: tuple[float, float]  # [kg]
    slope: float  # [rad] largest roll and pitch, each way
    margin: tuple[float, float]  # [m] least and largest static stability margin of start and goal


ORDINARY = Recipe("ordinary", (500.0, 4000.0), np.deg2rad(25.0), (0.05, np.inf))
# heavier, steeper, poses near the edge
HARD = Recipe("hard", (2000.0, 6500.0), np.deg2rad(28.0), (0.02, 0.30))
TRIES = 2000  # poses drawn at once; a ground on which none of them stands is drawn again


def random_scene(seed: int, recipe: Recipe = ORDINARY) -> tuple[Scene, np.ndarray]:
    """Scene and two poses (2, n) that stand by themselves, uniform within the joint limits (slew: half a turn)."""
    rng = np.random.default_rng([2020, seed])
    while True:
        roll, pitch = rng.uniform(-recipe.slope, recipe.slope, 2)
        scene = Scene(
            "feller_buncher", FOOTPRINT, Tree(rng.uniform(*recipe.payload)), roll=roll, pitch=pitch
        )
        machine = scene.load()
        lower, upper = (
            np.array(machine.limits.position_lower),
            np.array(machine.limits.position_upper),
        )
        lower[0], upper[0] = -np.pi, np.pi
        poses = rng.uniform(lower, upper, (TRIES, machine.size))
        still = np.zeros_like(poses)
        margins = zs.stability_margin(machine, poses, still, still, scene.ground)
        standing = poses[(margins >= recipe.margin[0]) & (margins <= recipe.margin[1])]
        if len(standing) >= 2:
            return scene, standing[:2]


def random_problem(seed: int, recipe: Recipe = ORDINARY, **options: Any) -> NamedProblem:
    """Rest to rest between two random poses; the same seed is the same problem for ever."""
    scene, (start, goal) = random_scene(seed, recipe)
    return NamedProblem(f"{recipe.name}_{seed}", scene, scene.problem(start, goal, **options), None)
