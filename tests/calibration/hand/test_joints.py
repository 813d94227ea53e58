"""The flexure's model against the exact elastica: a boundary-value solution, and a chain of 400 rigid links."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_bvp
from scipy.linalg import eigh, solve_banded

from calibration.hand.bundle import Reals
from calibration.hand.joints import (
    flexure_angles,
    flexure_end,
    flexure_stiffness_Nm_per_rad,
    flexure_under_tip_load,
    joint_model,
)
from calibration.hand.parameters import FlexureJoint
from drivers.errors import MechanicsError

LENGTH_M, EI_NM2 = 0.010, 7.26e-4
Load = tuple[float, float, float]
"""Moment · L / EI and force (x, y) · L² / EI at the end."""


def flexure(coordinates: int) -> FlexureJoint:
    return FlexureJoint(
        length_m=LENGTH_M, bending_stiffness_Nm2=EI_NM2, coordinates=coordinates, flexion_limit_deg=(-90, 90)
    )


def modelled(load: Load, coordinates: int) -> tuple[complex, float]:
    """End (m) and end angle (rad) of the model."""
    m, f_x, f_y = load
    a = flexure_under_tip_load(flexure(coordinates), m * EI_NM2 / LENGTH_M, complex(f_x, f_y) * EI_NM2 / LENGTH_M**2)
    return complex(flexure_end(LENGTH_M, coordinates).at(a[None]).value[0]), float(a[0])


@cache
def elastica(load: Load) -> tuple[complex, float]:
    """End and end angle by collocation: M' = f_x sin θ − f_y cos θ, θ' = M, in units of length and EI."""
    m, f_x, f_y = load
    along = np.linspace(0, 1, 41)
    guess = np.zeros((4, along.size))
    for share in np.linspace(0.1, 1, 10):

        def rates(s: Reals, y: Reals, share: float = share) -> Reals:
            theta, moment = y[0], y[1]
            change = share * (f_x * np.sin(theta) - f_y * np.cos(theta))
            return np.vstack([moment, change, np.cos(theta), np.sin(theta)])

        def ends(first: Reals, last: Reals, share: float = share) -> Reals:
            return np.array([first[0], first[2], first[3], last[1] - share * m])

        found = solve_bvp(rates, ends, along, guess, tol=1e-4 if share < 1 else 1e-9, max_nodes=20000)
        assert found.success
        along, guess = found.x, found.y
    return LENGTH_M * complex(guess[2, -1], guess[3, -1]), float(guess[0, -1])


def chain(load: Load, links: int = 400) -> tuple[complex, float]:
    """End and end angle of a chain of rigid links with springs between them, half a link's worth at both ends."""
    m, force = load[0], complex(load[1], load[2])
    angle, share = np.zeros(links + 1), 0.0
    spring = np.full(links + 1, float(links))
    spring[[0, -1]] *= 2
    while share < 1:
        share = min(1.0, share + 0.1)
        for _ in range(30):
            links_end = share * np.conj(force) * np.exp(1j * angle[:-1]) / links
            turned = spring * np.diff(angle, prepend=0.0)
            unbalanced = turned - np.append(turned[1:], share * m)
            unbalanced[:-1] -= (1j * links_end).real
            diagonal = spring + np.append(spring[1:], 0.0)
            diagonal[:-1] += links_end.real
            off = np.concatenate([[0.0], -spring[1:]])
            step = solve_banded((1, 1), np.array([off, diagonal, np.roll(off, -1)]), unbalanced)
            angle -= step
            if np.abs(step).max() < 1e-12:
                break
        else:
            raise AssertionError("the chain found no equilibrium")
    return LENGTH_M * complex(np.exp(1j * angle[:-1]).mean()), float(angle[-1])


TABLE: list[tuple[Load, float, list[tuple[float, float]]]] = [
    ((np.pi / 2, 0, 0), 90.0, [(0, 0), (0, 0), (0, 0), (0, 0)]),
    ((0, 0, 2), 44.8, [(1117, 2.9), (9.2, -0.065), (0.10, 0), (0.02, 0)]),
    ((0, 0, 4), 64.2, [(1429, 8.3), (49, -0.43), (0.98, 0.006), (0.11, 0)]),
    ((0, 0, 8), 78.8, [(1688, 16.0), (149, -1.6), (6.1, 0.053), (0.22, 0.001)]),
    ((0, -2, 2), 74.7, [(1973, 1.9), (4.0, -0.03), (1.6, -0.007), (0.30, -0.001)]),
    ((0, 3, 4), 41.6, [(883, 7.3), (43, -0.50), (1.7, 0.014), (0.01, 0)]),
    ((1.2, -1.5, 0), 107.3, [(1033, -1.6), (34, 0.046), (3.5, -0.016), (0.02, 0)]),
    ((3, 6, -1), 66.1, [(1066, -13.6), (74, -0.72), (4.0, 0.010), (0.03, -0.001)]),
    ((2.4, 0, -1.2), 138.5, [(371, 1.2), (93, -0.41), (2.2, 0.004), (0.22, -0.002)]),
]
"""Load, end angle (deg), then position error (µm) and end angle error (deg) for 1 to 4 coordinates (reference 3.1)."""


@pytest.mark.parametrize(("load", "end_angle_deg", "errors"), TABLE)
def test_accuracy_is_what_the_reference_says(
    load: Load, end_angle_deg: float, errors: list[tuple[float, float]]
) -> None:
    """Position and angle errors against the elastica, row by row, for 1 to 4 coordinates."""
    end, angle = elastica(load)
    assert np.degrees(angle) == pytest.approx(end_angle_deg, abs=0.051)
    for coordinates, (error_um, error_deg) in enumerate(errors, start=1):
        found, turned = modelled(load, coordinates)
        assert 1e6 * abs(found - end) == pytest.approx(error_um, rel=0.06, abs=0.03), coordinates
        assert np.degrees(turned - angle) == pytest.approx(error_deg, rel=0.06, abs=0.0011), coordinates


@given(direction=st.floats(-np.pi, np.pi), size=st.floats(0, 6), m=st.floats(-1.2, 1.2))
def test_three_coordinates_follow_a_chain_of_400_links(direction: float, size: float, m: float) -> None:
    """≤ 10 µm and 0.06° for end angles up to 80°, for any load that presses no harder than 1.5 EI/L² along x."""
    force = size * np.exp(1j * direction)
    load = (m, max(float(force.real), -1.5), float(force.imag))
    end, angle = chain(load)
    if abs(angle) <= np.radians(80):
        found, turned = modelled(load, 3)
        assert abs(found - end) <= 10e-6
        assert abs(turned - angle) <= np.radians(0.06)


def test_the_two_exact_solutions_agree() -> None:
    """Collocation and chain know nothing of each other; the reference found them 0.03 µm apart."""
    for load in (TABLE[2][0], TABLE[7][0]):
        (end, angle), (there, turned) = elastica(load), chain(load)
        assert abs(end - there) < 0.04e-6
        assert angle == pytest.approx(turned, abs=1e-5)


@pytest.mark.parametrize(
    ("coordinates", "locked", "load", "tolerance"),
    [
        (1, False, 3.0, 1e-9),
        (2, False, 2.4860, 5e-5),
        (3, False, np.pi**2 / 4, 2e-4),
        (4, False, np.pi**2 / 4, 2e-6),
        (2, True, 10.0, 1e-9),
        (3, True, 10.0, 1e-9),
        (4, True, np.pi**2, 2e-5),
    ],
)
def test_buckling_load(coordinates: int, locked: bool, load: float, tolerance: float) -> None:
    """Cantilever and locked end: 0.014 % above Euler's load with 3 coordinates; values of reference 3.1."""
    model = joint_model(flexure(coordinates))
    hessian = model.bend.at(np.zeros((1, coordinates))).hessian[0].real
    first = 1 if locked else 0
    stiffness = np.diag(model.stiffness_Nm_per_rad)[first:, first:]
    critical_N = eigh(stiffness, -hessian[first:, first:], eigvals_only=True)[0]
    assert critical_N * LENGTH_M**2 / EI_NM2 == pytest.approx(load, rel=tolerance)


def test_pressing_beyond_buckling_is_refused() -> None:
    """Straight compression has no stable equilibrium on its path from 2.47 EI/L² on; said, not returned."""
    unit_N = EI_NM2 / LENGTH_M**2
    assert flexure_under_tip_load(flexure(3), 0.0, complex(-2.4 * unit_N)) == pytest.approx(np.zeros(3), abs=1e-12)
    with pytest.raises(MechanicsError, match="buckles"):
        flexure_under_tip_load(flexure(3), 0.0, complex(-2.6 * unit_N))


@given(a=st.tuples(st.floats(-np.pi / 2, np.pi / 2), st.floats(-1.5, 1.5), st.floats(-1, 1)))
def test_quadrature_is_exact(a: tuple[float, float, float]) -> None:
    """Eight points against forty, with angles integrated from the curvature by NumPy's own Legendre series."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    angle = np.polynomial.legendre.Legendre(np.array(a)).integ(lbnd=-1)(nodes) / 2
    exact = LENGTH_M * complex((weights * np.exp(1j * angle)).sum() / 2)
    assert abs(complex(flexure_end(LENGTH_M, 3).at(np.array([a])).value[0]) - exact) < 5e-12


@given(angle=st.floats(0.01, np.pi / 2))
def test_one_coordinate_is_a_circular_arc(angle: float) -> None:
    """d = L (exp(ia) − 1)/(ia)."""
    arc = LENGTH_M * (np.exp(1j * angle) - 1) / (1j * angle)
    assert abs(complex(flexure_end(LENGTH_M, 1).at(np.array([[angle]])).value[0]) - arc) < 1e-14


@pytest.mark.parametrize("coordinates", range(1, 7))
def test_energy_is_that_of_bending(coordinates: int) -> None:
    """½ ∫ EI κ² ds, κ the slope of the angles; only the first coordinate turns the end."""
    a = np.random.default_rng(coordinates).normal(size=coordinates)
    nodes, weights = np.polynomial.legendre.leggauss(20)
    along, step = (nodes + 1) / 2, 1e-4
    slope = (flexure_angles(along + step, coordinates) - flexure_angles(along - step, coordinates)) / (2 * step)
    energy_J = 0.5 * EI_NM2 / LENGTH_M * float((weights / 2) @ (slope @ a) ** 2)
    stiffness = flexure_stiffness_Nm_per_rad(LENGTH_M, EI_NM2, coordinates)
    assert 0.5 * float(stiffness @ a**2) == pytest.approx(energy_J, rel=1e-6)
    assert flexure_angles(np.array([0.0, 1.0]), coordinates) == pytest.approx(
        np.eye(2, coordinates)[[1, 0]] * [[0], [1]]
    )
