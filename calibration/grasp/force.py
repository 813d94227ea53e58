"""Grasping force: the least that holds an object of known mass, and what the hand can exert at all.

An underactuated hand can exert only the forces of its own equilibria, so minimal effort is the first point of the
path of equal winding at which both friction cones hold, sqrt(f_o² + f_t²) ≤ μ N: lifted, each contact carries
f_o = m g / 2 out of the plane; on the table f_o = 0 and the table's drag is in the path itself.
`force_optimisation` asks a general optimiser the same question. Sums are N right + N left, N. Source: paper II-C
(6)–(12), (15); hand-mechanics reference 7 and 13.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from calibration.grasp.constraints import gaps
from calibration.grasp.equilibrium import GraspSystem
from calibration.grasp.friction import STANDARD_GRAVITY_M_PER_S2, OnTable, sliding
from calibration.grasp.path import Path, first_crossing, trace
from calibration.hand.finger import Reals
from drivers.errors import MechanicsError

COARSE_STEP_M = 2e-4
"""Winding between two points of a path that only places on it are looked for on; they are solved anew."""
PER_CONTACT = 2


@dataclass(frozen=True)
class Effort:
    """Contact forces at one state of a path."""

    w: Reals
    """(size,)"""
    load_N: tuple[float, float]
    """tendon loads, right and left"""
    normal_N: tuple[float, float]
    along_N: tuple[float, float]
    """N and f_t at the right and the left contact"""
    motion: tuple[float, float, float]
    """object motion since first contact, m, m, rad"""

    @property
    def sum_N(self) -> float:
        """N right + N left."""
        return sum(self.normal_N)

    @property
    def norm_N(self) -> float:
        """Objective of (6): sqrt(Σ N²)."""
        return math.hypot(*self.normal_N)


@dataclass(frozen=True)
class ForceLevels:
    """(15): sums of the contacts' normal forces; None where there is no such state."""

    f_min_N: float | None
    """least that holds the object; None if nothing below the load cap does, or if its mass is not known"""
    f_e_N: float | None
    """when the reconfiguration stops: both fingers at a stop; None if the path ends before"""
    f_max_N: float
    """at the load cap, or where the path ends before it"""
    statement: str
    """what this means, in a sentence"""
    minimal: Effort | None
    stopped: Effort | None
    largest: Effort


def least_normal_force_N(mass_kg: float, friction: float, along_N: float = 0.0) -> float:
    """N* at each contact of a lifted object: sqrt((m g / 2)² + f_t²)/μ."""
    return math.hypot(mass_kg * STANDARD_GRAVITY_M_PER_S2 / PER_CONTACT, along_N) / friction


def cone_margin_N(contact_force_N: Reals, friction: float, out_of_plane_N: float = 0.0) -> Reals:
    """Smaller of both contacts' μ N − sqrt(f_o² + f_t²), (5); forces (B, 4) right N, f_t, left N, f_t; (B,)."""
    normal, along = contact_force_N[:, ::2], contact_force_N[:, 1::2]
    margin: Reals = (friction * normal - np.hypot(along, out_of_plane_N)).min(1)
    return margin


def squeeze_path(system: GraspSystem, mass_kg: float | None, *, lifted: bool, step_m: float = COARSE_STEP_M) -> Path:
    """Path of equal winding up to the load cap or a collision; on the table with its drag, if object and mass say
    what it is."""
    dragged = not lifted and mass_kg is not None and system.object.support is not None
    rule = OnTable(system, sliding(system.object, mass_kg)) if dragged else None
    return trace(system, step_m=step_m, clearances=gaps(system), rule=rule)


def minimal_effort(path: Path, mass_kg: float, contact_friction: float, *, lifted: bool) -> Effort | None:
    """First state of `path` at which both friction cones hold; None if there is none.

    Where they hold from first contact on (an object on a table that hardly drags), that is first contact itself.
    Errors: MechanicsError for a mass or coefficient that is out of range.
    """
    check_effort(mass_kg, contact_friction)
    out_of_plane_N = mass_kg * STANDARD_GRAVITY_M_PER_S2 / PER_CONTACT if lifted else 0.0
    rows = path.system.contact_rows()

    def margin(w: Reals) -> Reals:
        return cone_margin_N(w @ rows.T, contact_friction, out_of_plane_N)

    found = first_crossing(path, margin, start=1)
    if found is None:
        return None
    index, w = found
    return effort(path, path.w[0] if index == 1 and w is path.w[1] else w)


def effort(path: Path, w: Reals) -> Effort:
    """Forces and motion at a state (size,) of `path`."""
    system = path.system
    normal_right, along_right, normal_left, along_left = (system.contact_rows() @ w).tolist()
    right, left = (system.load_rows() @ w).tolist()
    x, y, angle = (w[system.joints : system.unknowns] - path.pose[0]).tolist()
    return Effort(w, (right, left), (normal_right, normal_left), (along_right, along_left), (x, y, angle))


def contact_force_levels(
    system: GraspSystem, mass_kg: float | None, contact_friction: float, lifted: bool
) -> ForceLevels:
    """f_min, f_e and f_max of a grasp. Errors: MechanicsError for a mass or coefficient that is out of range."""
    return force_levels(squeeze_path(system, mass_kg, lifted=lifted), mass_kg, contact_friction, lifted)


def force_levels(path: Path, mass_kg: float | None, contact_friction: float, lifted: bool) -> ForceLevels:
    """f_min, f_e and f_max on a path that was followed up to the load cap."""
    minimal = None if mass_kg is None else minimal_effort(path, mass_kg, contact_friction, lifted=lifted)
    stopped = _stopped(path)
    last = int(np.argmax(path.contact_force_N[:, [0, 2]].sum(1)))
    largest = effort(path, path.w[last])
    f_min, f_e = minimal.sum_N if minimal else None, stopped.sum_N if stopped else None
    statement = _statement(path, mass_kg, contact_friction, lifted, f_min, f_e, largest.sum_N)
    return ForceLevels(f_min, f_e, largest.sum_N, statement, minimal, stopped, largest)


def check_effort(mass_kg: float, contact_friction: float) -> None:
    """MechanicsError for a mass or coefficient that is out of range."""
    if not 0 <= mass_kg < math.inf:
        raise MechanicsError("mass_kg", f"{mass_kg!r} is not ≥ 0 kg.")
    if not 0 < contact_friction <= 5:
        raise MechanicsError("contact_friction", f"{contact_friction!r} is not > 0 and ≤ 5.")


def _stopped(path: Path) -> Effort | None:
    """Where both fingers have met a stop."""
    right, left = ((path.at_stop[:, part] != 0).any(1) for part in path.system.parts)
    both = np.flatnonzero(right & left)
    return effort(path, path.w[both[0]]) if both.size else None


def _statement(
    path: Path,
    mass_kg: float | None,
    friction: float,
    lifted: bool,
    f_min: float | None,
    f_e: float | None,
    f_max: float,
) -> str:
    cap = "load cap" in path.end
    end = f"at the load cap of {path.load_N[-1].max():.1f} N" if cap else f"where the path ends ({path.end})"
    where = "lifted" if lifted else "on the table"
    stop = (
        f"the reconfiguration stops at f_e = {f_e:.2f} N"
        if f_e is not None
        else "the reconfiguration does not stop before"
    )
    if mass_kg is None:
        return f"Without a mass there is no minimal effort; {stop}; f_max = {f_max:.2f} N {end}."
    if f_min is None:
        need = f"; f_o alone asks for {PER_CONTACT * least_normal_force_N(mass_kg, friction):.2f} N" if lifted else ""
        return (
            f"Nothing below the load cap holds the object ({mass_kg * 1e3:.0f} g, friction {friction:g}) {where}: "
            f"f_max = {f_max:.2f} N {end}{need}."
        )
    if f_e is None:
        return (
            f"The object is held {where} from f_min = {f_min:.2f} N on; {stop} f_max = {f_max:.2f} N {end}: it moves "
            "for as long as the hand squeezes harder."
        )
    if f_min > f_e:
        return (
            f"f_min = {f_min:.2f} N is above f_e = {f_e:.2f} N: {where}, the object is held only after the "
            f"reconfiguration has stopped, so minimal effort does not spare any of its motion; f_max = {f_max:.2f} N "
            f"{end}."
        )
    return (
        f"f_min = {f_min:.2f} N ≤ f_e = {f_e:.2f} N ≤ f_max = {f_max:.2f} N ({end}): {where}, the object is held "
        "before the reconfiguration stops."
    )
