"""Joints of a finger: pins, and flexures by the smooth curvature model.

A flexure of length L bends with curvature κ(u) = Σ a_i P_i(2u − 1) / L, u ∈ [0, 1] along it, P_i the Legendre
polynomials. Its angle is Σ a_i Φ_i(u), Φ_i the integrals of the P_i: a_0 is the end angle, all others are pure changes
of shape. Its end stands at L ∫ exp(iθ) du, by 8-point Gauss–Legendre quadrature a bundle of 8 terms; its elastic
energy is EI/(2L) Σ a_i²/(2i + 1). A pin is the same joint without length. Here in the joint's own frame: x along the
joint at rest, origin at its root. Source: hand-mechanics reference 3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.hand.bundle import Bundle, Reals
from calibration.hand.parameters import FlexureJoint, PinJoint
from drivers.errors import MechanicsError

QUADRATURE_POINTS = 8
"""4e-6 µm error of the end of a 10 mm flexure bent by 90° (reference 3)."""
LOAD_STEP = 0.25
"""Largest dimensionless load (m L / EI, f L² / EI) added at once when a lone flexure is loaded."""
ITERATIONS = 30
TOLERANCE = 1e-13
"""Largest unbalanced moment of a lone flexure, per EI / L."""


@dataclass(frozen=True)
class JointModel:
    """One joint with n coordinates, the first of them its angle.

    `bend`: its end relative to its root, in the frame of its root at rest. Energy: ½ Σ `stiffness_Nm_per_rad` q².
    Stops `lower_rad`, `upper_rad` (n,), ±inf for changes of shape.
    """

    bend: Bundle
    stiffness_Nm_per_rad: Reals
    lower_rad: Reals
    upper_rad: Reals

    @property
    def size(self) -> int:
        """Number of coordinates n."""
        return self.stiffness_Nm_per_rad.size

    @property
    def angle_row(self) -> Reals:
        """(n,) end angle per coordinate: 1 for the first, else 0."""
        row: Reals = np.eye(1, self.size)[0]
        return row


def joint_model(joint: PinJoint | FlexureJoint) -> JointModel:
    """Model of a joint from its parameters."""
    if isinstance(joint, PinJoint):
        bend = Bundle(0j, np.zeros(0), np.zeros(0), np.zeros((0, 1)))
        stiffness = np.array([joint.stiffness_Nm_per_rad])
    else:
        bend = flexure_end(joint.length_m, joint.coordinates)
        stiffness = flexure_stiffness_Nm_per_rad(joint.length_m, joint.bending_stiffness_Nm2, joint.coordinates)
    lower, upper = np.full(stiffness.size, -np.inf), np.full(stiffness.size, np.inf)
    lower[0], upper[0] = joint.flexion_limit_rad
    return JointModel(bend, stiffness, lower, upper)


def flexure_angles(along: Reals, coordinates: int) -> Reals:
    """Φ_i at `along` (m,), fractions of the flexure's length: angle there = Φ · a; (m, coordinates)."""
    x = 2 * np.asarray(along, float) - 1
    legendre = np.polynomial.legendre.legvander(x, coordinates)
    order = np.arange(1, coordinates)
    shapes = (legendre[:, 2:] - legendre[:, : coordinates - 1]) / (2 * (2 * order + 1))
    return np.column_stack([along, shapes])


def flexure_end(length_m: float, coordinates: int) -> Bundle:
    """End of a flexure relative to its root."""
    nodes, weights = np.polynomial.legendre.leggauss(QUADRATURE_POINTS)
    return Bundle(0j, length_m * weights / 2, np.zeros(QUADRATURE_POINTS), flexure_angles((nodes + 1) / 2, coordinates))


def flexure_stiffness_Nm_per_rad(length_m: float, bending_stiffness_Nm2: float, coordinates: int) -> Reals:
    """EI/L · (1, 1/3, 1/5, …): (coordinates,)."""
    return np.asarray(bending_stiffness_Nm2 / length_m / (2 * np.arange(coordinates) + 1.0), np.float64)


def flexure_under_tip_load(joint: FlexureJoint, moment_Nm: float, force_N: complex) -> Reals:
    """Coordinates (n,) of a lone flexure, clamped at its root, under a moment and a force at its end; stops ignored.

    The force keeps its direction in the root's frame: `force_N` = f_x + i f_y, x along the straight flexure. It is
    raised in steps from zero, so of several equilibria the one that the load leads to is found. Errors: MechanicsError
    where the path of equilibria cannot be followed (a straight flexure beyond its buckling load).
    """
    end = flexure_end(joint.length_m, joint.coordinates)
    stiffness = flexure_stiffness_Nm_per_rad(joint.length_m, joint.bending_stiffness_Nm2, joint.coordinates)
    unit_Nm = joint.bending_stiffness_Nm2 / joint.length_m
    steps = max(1, int(np.ceil((abs(moment_Nm) + abs(force_N) * joint.length_m) / unit_Nm / LOAD_STEP)))
    a = np.zeros(joint.coordinates)
    for share in np.arange(1, steps + 1) / steps:
        for _ in range(ITERATIONS):
            jet = end.at(a[None, :])
            unbalanced = stiffness * a - share * (np.conj(force_N) * jet.gradient[0]).real
            unbalanced[0] -= share * moment_Nm
            if np.abs(unbalanced).max() < TOLERANCE * unit_Nm:
                break
            K = np.diag(stiffness) - share * (np.conj(force_N) * jet.hessian[0]).real
            a = a - np.linalg.solve(K, unbalanced)
        else:
            raise MechanicsError(
                "force_N", f"no equilibrium of the flexure was found at {share:.0%} of the load.", help="Load it less."
            )
        if np.linalg.eigvalsh(np.diag(stiffness) - share * (np.conj(force_N) * jet.hessian[0]).real)[0] <= 0:
            raise MechanicsError("force_N", f"the flexure buckles below {share:.0%} of the load.", help="Load it less.")
    return a
