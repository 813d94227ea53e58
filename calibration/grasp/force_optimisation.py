"""Grasping force optimisation by a general constrained solver: confirms the minimal effort found along the path.

min sqrt(Σ N²) over joints, pose, contact forces, excursions and tendon loads, under the balance of forces, contacts on
the surface, friction cones, joint limits and the load cap; SLSQP with exact derivatives. It starts anywhere and knows
nothing of the path. Source: paper II-C (6)–(10); hand-mechanics reference 7 and 11.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import Bounds, NonlinearConstraint, minimize

from calibration.grasp.equilibrium import GraspSystem, excursion_drive
from calibration.grasp.force import PER_CONTACT, check_effort
from calibration.grasp.friction import STANDARD_GRAVITY_M_PER_S2
from calibration.hand.finger import Reals
from drivers.errors import MechanicsError

TOLERANCE = 1e-8
"""Largest scaled violation of a constraint that counts as solved."""


def optimised_effort(
    system: GraspSystem,
    guess: Reals,
    mass_kg: float,
    contact_friction: float,
    *,
    at_stop: Reals | None = None,
    equal_winding: bool = True,
) -> Reals:
    """State (size,) of least sqrt(Σ N²) that lifts the object, near any state `guess` (size,) of the grasp.

    Joints that are at a stop (`at_stop` (joints,), ±1) stay there, all others keep their limits. With `equal_winding`
    both excursions since first contact are equal, else the tendon loads are free of one another. Errors:
    MechanicsError if the optimiser finds no solution, or a mass or coefficient is out of range.
    """
    check_effort(mass_kg, contact_friction)
    held = np.zeros(system.joints) if at_stop is None else at_stop
    scale = system.column_scale
    out_of_plane_N = mass_kg * STANDARD_GRAVITY_M_PER_S2 / PER_CONTACT
    drive = excursion_drive(system)
    difference = float(drive.rows[1] @ system.first_state())
    equations = [*np.flatnonzero(held == 0), *range(system.joints, system.size - 2)]
    if equal_winding:
        equations.append(system.size - 1)
    contacts, force_N = system.contact_rows(), float(scale[system.unknowns])

    def balance(x: Reals) -> Reals:
        w = (x * scale)[None]
        target = np.array([[float(drive.rows[0] @ w[0]), difference]])
        found: Reals = system.residual_vector(w, system.terms(w), drive, target, None)[0, equations]
        return found

    def balance_slope(x: Reals) -> Reals:
        w = (x * scale)[None]
        found: Reals = system.matrix(w, system.terms(w), drive)[0, equations]
        return found

    def cones(x: Reals) -> Reals:
        forces = contacts @ (x * scale)
        found: Reals = contact_friction * forces[::2] - np.hypot(forces[1::2], out_of_plane_N)
        return found / force_N

    def cones_slope(x: Reals) -> Reals:
        along = (contacts @ (x * scale))[1::2]
        shares = along / np.hypot(along, out_of_plane_N)
        found: Reals = contact_friction * contacts[::2] - shares[:, None] * contacts[1::2]
        return found * scale / force_N

    def size(x: Reals) -> float:
        return float(np.linalg.norm(contacts[::2] @ (x * scale))) / force_N

    def size_slope(x: Reals) -> Reals:
        normal = contacts[::2] @ (x * scale)
        found: Reals = normal @ contacts[::2] / np.linalg.norm(normal) * scale / force_N
        return found

    lower, upper = np.full(system.size, -np.inf), np.full(system.size, np.inf)
    lower[: system.joints] = np.where(held > 0, system.upper_rad, system.lower_rad)
    upper[: system.joints] = np.where(held < 0, system.lower_rad, system.upper_rad)
    lower[-2:], upper[-2:] = 0.0, system.load_cap_N
    best = minimize(
        size,
        guess / scale,
        jac=size_slope,
        method="SLSQP",
        bounds=Bounds(lower / scale, upper / scale),
        constraints=(
            NonlinearConstraint(balance, 0.0, 0.0, jac=balance_slope),
            NonlinearConstraint(cones, 0.0, np.inf, jac=cones_slope),
        ),
        options={"ftol": 1e-14, "maxiter": 300},
    )
    if np.abs(balance(best.x)).max() > TOLERANCE or cones(best.x).min() < -TOLERANCE:
        raise MechanicsError("mass_kg", f"no state of the grasp was found that lifts {mass_kg:g} kg.")
    state: Reals = best.x * scale
    return state
