"""What a verdict rests on: ground, payload, margin, limits and all that is taken as exact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from zmp_sqp.mechanics import Heightmap, Machine, Slope
from zmp_sqp.mechanics.ground import Ground
from zmp_sqp.planning import PathConstraint, Problem

if TYPE_CHECKING:
    from rich.table import Table

__all__ = [
    "BASIS_KEYS",
    "Basis",
    "basis_fields",
    "basis_lines",
    "basis_table",
    "uncertainties_of_problem",
]

BASIS_KEYS = """\
  rests_on                  what the verdict rests on, in words: machine, ground, payload, margin
                            [m]; lists: uncertainties, looked_at, not_looked_at, exact (taken as
                            exact), motion (how it follows from a file)
"""
TIP_OVER = ("tip-over (ZMP)", "contact with the ground")
KINDS = {
    "positions": ("position_lower", "position_upper"),
    "velocities": ("velocity",),
    "accelerations": ("acceleration",),
}
# what machines are limited by beside tip-over, and the constraints that look at it
TOPICS = {
    "joint torques and forces": ("torque_limits",),
    "hydraulic flow and power": ("pump_flow", "pump_power"),
    "grip of the tracks": ("friction_cone",),
    "collisions": ("clearance", "collision", "collisions"),
    "jerk": ("jerk_limits",),
    "soil": (),
    "loads that swing": (),
    "strength of the structure": (),
}
UNCERTAIN = {
    "tipping_fraction": "the payload divided by {:g}",
    "payload_uncertainty": "mass and inertia of the payload off by up to {:.3g} times their value",
    "slope_uncertainty": "direction of gravity off by up to {:.3g} rad",
}
COM = "payload_com_uncertainty"
TITLE = "The verdict rests on"
INDENT = 16  # columns of the names in `basis_lines`


@dataclass(frozen=True, slots=True)
class Basis:
    """What a verdict on a motion rests on, in words.

    Attributes:
        machine: Name, mass and mass model.
        ground: The ground.
        payload: All payloads, or "none".
        margin: Distance asked for between ZMP and every edge [m].
        uncertainties: What the verdict holds for beside the nominal payload and ground.
        looked_at: Limits and constraints that the verdict is about.
        not_looked_at: Limits that are not given, and limits of machines that nothing here looks at.
        exact: What is taken as exact.
        motion: How the motion follows from a file and how far it departs from it; empty for a
            planned motion.
    """

    machine: str
    ground: str
    payload: str
    margin: float
    uncertainties: tuple[str, ...]
    looked_at: tuple[str, ...]
    not_looked_at: tuple[str, ...]
    exact: tuple[str, ...]
    motion: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        machine: Machine,
        ground: Ground,
        margin: float,
        *,
        constraints: Sequence[PathConstraint] = (),
        base: bool = False,
        uncertainties: Mapping[str, Any] | None = None,
        motion: Sequence[str] = (),
    ) -> Basis:
        """Basis of a certificate.

        Args:
            machine: Machine without uncertainties.
            ground: Ground without uncertainties.
            margin: Distance asked for between ZMP and every edge [m].
            constraints: Constraints beside tip-over and the joint limits.
            base: Whether the base's limits are looked at.
            uncertainties: Keyword arguments of `Problem` by name.
            motion: Attribute of the class.
        """
        given = uncertainties or {}
        names = [constraint.name for constraint in constraints]
        looked_at, lacking = _limits(machine)
        looked_at += [f"constraint {name}" for name in names]
        if base:
            looked_at.append("limits of the base")
        lacking += [topic for topic, by in TOPICS.items() if not set(by) & set(names)]
        return cls(
            machine=_machine_in_words(machine),
            ground=_ground_in_words(ground),
            payload=_payload_in_words(machine),
            margin=float(margin),
            uncertainties=_uncertainties_in_words(given),
            looked_at=(*TIP_OVER, *looked_at),
            not_looked_at=tuple(lacking),
            exact=_exact(machine, given),
            motion=tuple(motion),
        )

    @classmethod
    def of_problem(cls, problem: Problem, motion: Sequence[str] = ()) -> Basis:
        """Basis of the plan of a problem, and of the certificate that `certify_for` makes for it.

        Args:
            problem: The problem.
            motion: Attribute of the class.
        """
        return cls.of(
            problem.machine,
            problem.ground,
            problem.margin,
            constraints=problem.own_constraints,
            base=problem.base is not None,
            uncertainties=uncertainties_of_problem(problem),
            motion=motion,
        )


def uncertainties_of_problem(problem: Problem) -> dict[str, Any]:
    """Uncertainties of a problem by the names of its attributes."""
    return {name: getattr(problem, name) for name in (*UNCERTAIN, COM)}


def basis_fields(basis: Basis) -> dict[str, Any]:
    """Basis as an object for JSON, with the keys of `BASIS_KEYS`."""
    return {
        key: list(value) if isinstance(value, tuple) else value
        for key, value in asdict(basis).items()
    }


def basis_lines(basis: Basis) -> list[str]:
    """Basis as lines of text, one per attribute that says something."""
    rows = [
        f"  {'' if number else head:<{INDENT}}{line}"
        for head, text in _rows(basis)
        for number, line in enumerate(text.split("\n"))
    ]
    return [TITLE, *rows]


def basis_table(basis: Basis) -> Table:
    """Basis for the terminal: `basis_lines`, wrapped within their column."""
    from rich.table import Table

    table = Table.grid(padding=(0, 2, 0, 2))
    table.title, table.title_style, table.title_justify = TITLE, "", "left"
    for head, text in _rows(basis):
        table.add_row(head, text)
    return table


def _rows(basis: Basis) -> list[tuple[str, str]]:
    """Name and text of every attribute that says something."""
    words = {
        "machine": basis.machine,
        "ground": basis.ground,
        "payload": basis.payload,
        "margin": f"{basis.margin:g} m asked for between ZMP and every edge",
    }
    lists = {
        field.name: getattr(basis, field.name) for field in fields(Basis) if field.name not in words
    }
    words |= {
        name: ("\n" if name == "motion" else "; ").join(entries)
        for name, entries in lists.items()
        if entries
    }
    heads = {"looked_at": "looked at", "not_looked_at": "not looked at", "exact": "taken as exact"}
    return [(heads.get(name, name), text) for name, text in words.items()]


def _limits(machine: Machine) -> tuple[list[str], list[str]]:
    """Joint limits that are looked at, and those that are not given, in words."""
    found, lacking = [], []
    for kind, keys in KINDS.items():
        values = np.array([getattr(machine.limits, key) for key in keys])
        absent = [
            machine.joint_names[i] for i in np.flatnonzero(np.isnan(values).any(axis=0)).tolist()
        ]
        if len(absent) < machine.size:
            found.append(kind)
        if absent:
            lacking.append(f"{kind} of {', '.join(absent)} (no limit given)")
    return [f"joint {kind}" for kind in found], lacking


def _machine_in_words(machine: Machine) -> str:
    """Name and mass of a machine, and whether its bodies are point masses."""
    bodies = [body for body in machine.model.inertias if body.mass > 0.0]
    points = all(not frame.inertia.inertia.any() for frame in machine.model.frames)
    kind = ", point masses" if bodies and points else ""
    loaded = " with payload" if machine.payload_mass > 0.0 else ""
    return f"{machine.name}, {machine.mass:,.0f} kg{loaded}{kind}"


def _ground_in_words(ground: Ground) -> str:
    """The ground: level, sloped by roll and pitch, a heightmap, or the user's own."""
    if isinstance(ground, Heightmap):
        rows, columns = ground.heights.shape
        return f"heightmap of {columns} x {rows} samples, {ground.resolution:g} m apart"
    if not isinstance(ground, Slope):
        return type(ground).__name__
    if ground.roll == 0.0 and ground.pitch == 0.0:
        return "level"
    roll, pitch = (np.degrees(angle) + 0.0 for angle in (ground.roll, ground.pitch))
    return f"slope with a roll of {roll:.4g} and a pitch of {pitch:.4g} degrees"


def _payload_in_words(machine: Machine) -> str:
    """Mass, centre of mass and carrying frame of every payload, or "none"."""
    model = machine.model
    words = []
    for frame in model.frames:
        if frame.type != pin.FrameType.OP_FRAME or frame.inertia.mass <= 0.0:
            continue
        com = ", ".join(f"{entry + 0.0:.4g}" for entry in frame.inertia.lever)
        carrier = model.frames[frame.parentFrame].name
        words.append(f"{frame.inertia.mass:,.6g} kg at ({com}) m of {carrier}")
    return "; ".join(words) if words else "none"


def _uncertainties_in_words(given: Mapping[str, Any]) -> tuple[str, ...]:
    """Uncertainties that are not zero, in words."""
    words = []
    for name, text in UNCERTAIN.items():
        value = float(given.get(name, _nothing(name)))
        if value != _nothing(name):
            words.append(text.format(value))
    box = np.atleast_1d(np.asarray(given.get(COM, 0.0), dtype=np.float64))
    if box.any():
        sides = ", ".join(f"{side:g}" for side in box)
        words.append(f"centre of mass of the payload off by up to ({sides}) m along (x, y, z)")
    return tuple(words)


def _exact(machine: Machine, given: Mapping[str, Any]) -> tuple[str, ...]:
    """What is taken as exact: all but what is uncertain."""
    words = ["masses, lengths and support polygon of the machine"]
    of_payload = {name: value for name, value in given.items() if name != "slope_uncertainty"}
    if machine.payload_count and not _uncertainties_in_words(of_payload):
        words.append("the payload")
    if not given.get("slope_uncertainty", 0.0):
        words.append("the ground")
    return (*words, "the joints follow the motion", "machine and ground are rigid")


def _nothing(name: str) -> float:
    """Value of an uncertainty that says that nothing is uncertain."""
    return 1.0 if name == "tipping_fraction" else 0.0
