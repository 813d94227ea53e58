"""Friction of the table under a grasped object: sliding and sticking, step by step.

From one state of a path to the next, the object that stands on a table minimises E(z) + D(Δ), Δ = (Δx, Δy, Δθ) its
displacement in the step, with

    D(Δ) = sqrt(F² (Δx² + Δy²) + M² Δθ²),   F = μ_t m g,   M = F · mean distance of the pressed patch from its centroid,

the support function of the ellipsoidal limit surface (f_x² + f_y²)/F² + τ²/M² ≤ 1: the table's wrench on the object
is −∂D, on that surface while the object slides and inside it while it sticks. D is smoothed over `STICK_M`, so that
sticking needs no case of its own. Newton's method works on the state and on the wrench as an unknown of its own, which
keeps it from overshooting between sticking and sliding. A path depends on its history: steps of 0.05 to 0.1 mm of
winding. Source: paper II-D and III-C; hand-mechanics reference 8.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibration.grasp.equilibrium import Drive, GraspSystem, States
from calibration.grasp.equilibrium_newton import STEP_LIMIT, hold_stops, solved
from calibration.grasp.path import NO_EQUILIBRIUM
from calibration.hand.finger import Reals
from calibration.objects import GraspObject
from drivers.errors import MechanicsError

STANDARD_GRAVITY_M_PER_S2 = 9.80665
STICK_M = 1e-7
"""Displacement over which the wrench builds up from zero to sliding; three orders below a step."""
SMALLEST = 1e-30
ITERATIONS = 25
ContactLaw = Callable[[Reals, Reals, Reals], None]
TOLERANCE = 1e-9
"""Largest scaled residual: what rounding of the object's place leaves of the wrench while it sticks."""


@dataclass(frozen=True)
class Sliding:
    """Limits of the table's wrench: `force_N` F against translation, `moment_Nm` M against rotation."""

    force_N: float
    moment_Nm: float

    @property
    def weights(self) -> Reals:
        """(F, F, M)."""
        return np.array([self.force_N, self.force_N, self.moment_Nm])

    def length(self, pressed: Reals) -> float:
        """D (J) of a displacement already multiplied by `weights`, smoothed; > 0."""
        return float(np.sqrt(pressed @ pressed + max(self.force_N * STICK_M, SMALLEST) ** 2))


def sliding(grasped: GraspObject, mass_kg: float | None = None) -> Sliding:
    """Limits for an object on its support, of its own mass unless another is given.

    Errors: MechanicsError for an object without a support, or a mass that is not ≥ 0.
    """
    mass_kg = grasped.mass_kg if mass_kg is None else mass_kg
    if grasped.support is None:
        raise MechanicsError("object.support", f"{grasped.name} has no [support] to slide on.", help="Give it one.")
    if not 0 <= mass_kg < np.inf:
        raise MechanicsError("mass_kg", f"{mass_kg!r} is not ≥ 0 kg.")
    force_N = grasped.support.friction * mass_kg * STANDARD_GRAVITY_M_PER_S2
    return Sliding(force_N, force_N * grasped.shape.mean_pressure_distance_m)


@dataclass(frozen=True)
class OnTable:
    """The rule of a path (`path.Rule`) of an object that stands on a table."""

    system: GraspSystem
    limits: Sliding
    without_solution: str = NO_EQUILIBRIUM

    def wrench(self, before: Reals, after: Reals) -> Reals:
        """Wrench (3,) of the table on the object when state `after` (size,) follows `before`; N, N, N m."""
        pose = slice(self.system.joints, self.system.unknowns)
        pressed = self.limits.weights * (after[pose] - before[pose])
        wrench: Reals = -self.limits.weights * pressed / self.limits.length(pressed)
        return wrench

    def slope(self, before: Reals, last: Reals | None, drive: Drive, held: Reals) -> Reals:
        """From the last two states; where there are none, or nothing led, that of frictionless equilibria."""
        travelled = 0.0 if last is None else float(drive.rows[0] @ (before - last))
        if last is None or travelled == 0:
            tangent: Reals = self.system.tangent(before[None], drive, held[None])[0, :, 0]
            return tangent
        secant: Reals = (before - last) / travelled
        return secant

    def solve(self, before: Reals, guess: Reals, drive: Drive, target: Reals) -> States:
        """State that minimises energy and dissipation from `before` on, joints at their stops."""
        if self.limits.force_N == 0:
            return self.system.solve(guess[None], drive, target[None], stops=True)
        return incremental(self.system, before, guess, drive, target, self.limits)


def incremental(
    system: GraspSystem,
    before: Reals,
    guess: Reals,
    drive: Drive,
    target: Reals,
    limits: Sliding,
    contact_law: ContactLaw = lambda w, F, K: None,
) -> States:
    """Newton's method on one step from `before` (size,) with the table's wrench; `contact_law` may put other laws in
    the place of rolling into the scaled residual (1, size) and matrix (1, size, size)."""
    pose = slice(system.joints, system.unknowns)
    scales = np.outer(system.row_scale[pose], system.column_scale[pose])
    weights = limits.weights
    w = guess[None].copy()
    torque, active = np.zeros((2, 1, system.joints))
    share = np.zeros(3)  # wrench / limits, an unknown of its own: at most 1 in size
    residual = np.inf
    for _ in range(ITERATIONS):
        pressed = weights * (w[0, pose] - before[pose])
        length = limits.length(pressed)
        terms = system.terms(w)
        F = system.residual_vector(w, terms, drive, target[None], -(weights * pressed / length)[None])
        K = system.matrix(w, terms, drive)
        growth = (np.eye(3) - np.outer(share, pressed) / length) * weights / length
        K[0, pose, pose] += weights[:, None] * growth * scales
        contact_law(w, F, K)
        hold_stops(system, w, torque, active, np.array([0]), F, K)
        residual = float(np.abs(F).max())
        if residual < TOLERANCE or not np.isfinite(residual):
            break
        step = -solved(K, F[:, :, None])[0, :, 0]
        step *= min(1.0, STEP_LIMIT / max(float(np.abs(step[: system.unknowns]).max()), 1e-300))
        step *= system.column_scale
        w[0] += step
        share = pressed / length + growth @ step[pose]
        share /= max(1.0, float(np.linalg.norm(share)))
    return States(w, torque, active, np.array([residual < TOLERANCE]), np.array([residual]))
