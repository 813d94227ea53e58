"""The equations of a grasp against central differences, and what its states are made of, for every kind of finger."""

from collections.abc import Callable

import numpy as np
import pytest
from msgspec.structs import replace

from calibration.grasp.equilibrium import GraspSystem, excursion_drive, grasp_system, load_drive, spool_drive
from calibration.grasp.specification import GraspSpec
from calibration.hand.finger import Reals
from calibration.hand.parameters import Hand, StraightTendonAtFlexure, StraightTendonAtPin, load_hand
from calibration.objects import load_object


def curved(name: str) -> Hand:
    """A hand whose tendons run straight past both joints, rub and stretch."""
    hand = load_hand(name, "nominal")
    joints = {}
    for key, joint in zip(("proximal_joint", "distal_joint"), hand.right.joints, strict=True):
        straight = StraightTendonAtFlexure() if hasattr(joint, "length_m") else StraightTendonAtPin(0.012, 0.012)
        joints[key] = replace(joint, tendon=straight, flexion_limit_deg=(0.0, 65.0))
    finger = replace(hand.right, routing_friction=0.1, tendon_stiffness_N_per_m=4e4, **joints)
    return replace(hand, right=finger, left=replace(finger, routing_friction=0.2))


SYSTEMS = {
    "pins": lambda: grasp_system(load_hand("t42pp"), load_object("cylinder40"), GraspSpec(onset_split=0.1)),
    "pin and flexure on a side": lambda: grasp_system(load_hand("t42pf"), load_object("rubiks_cube"), GraspSpec()),
    "flexures": lambda: grasp_system(load_hand("t42ff"), load_object("strawberry"), GraspSpec(onset_split=-0.1)),
    "pins, curved tendons": lambda: grasp_system(curved("t42pp"), load_object("cylinder40"), GraspSpec()),
    "flexures, curved tendons": lambda: grasp_system(curved("t42ff"), load_object("sphere30"), GraspSpec()),
}


@pytest.fixture(scope="module", params=list(SYSTEMS))
def system(request: pytest.FixtureRequest) -> GraspSystem:
    make: Callable[[], GraspSystem] = SYSTEMS[request.param]
    return make()


def near(system: GraspSystem, seed: int) -> Reals:
    """A state (1, size) near first contact, no equilibrium."""
    moved = np.random.default_rng(seed).normal(size=system.size) * system.column_scale * 0.05
    return (system.first_state() + moved)[None]


def residual(system: GraspSystem, w: Reals) -> Reals:
    wrench = np.array([[0.3, -0.2, 0.004]])
    return system.residual_vector(w, system.terms(w), excursion_drive(system), np.zeros((1, 2)), wrench)


def test_matrix_is_the_slope_of_the_equations(system: GraspSystem) -> None:
    """Every entry of the scaled matrix against central differences of the residual, to 1e-9."""
    w = near(system, 1)
    K = system.matrix(w, system.terms(w), excursion_drive(system))[0]
    for column in range(system.size):
        step = np.eye(system.size)[column] * system.column_scale[column] * 1e-4
        fine = (residual(system, w + step) - residual(system, w - step))[0] / 2e-4
        coarse = (residual(system, w + 2 * step) - residual(system, w - 2 * step))[0] / 4e-4
        assert (4 * fine - coarse) / 3 == pytest.approx(K[:, column], abs=1e-9)


def test_second_derivative_is_the_slope_of_the_matrix(system: GraspSystem) -> None:
    """Along any two directions, to 1e-9 of its size."""
    w, rng = near(system, 2), np.random.default_rng(3)
    u, v = rng.normal(size=(2, 1, system.size)) * system.column_scale

    def along(at: Reals) -> Reals:
        K = system.matrix(at, system.terms(at), excursion_drive(system))
        found: Reals = (K @ (v / system.column_scale)[:, :, None])[0, :, 0]
        return found

    fine, coarse = ((along(w + h * u) - along(w - h * u)) / (2 * h) for h in (1e-4, 2e-4))
    second = system.second(w, system.terms(w), u, v)[0]
    assert (4 * fine - coarse) / 3 == pytest.approx(second, abs=2e-9 * np.abs(second).max())


def test_first_contact_is_an_equilibrium_without_contact_force(system: GraspSystem) -> None:
    """Free closing balances by itself: the exact start of every path, whatever the tendons' law and friction."""
    w = system.first_state()[None]
    drive = excursion_drive(system)
    free = system.residual_vector(w, system.terms(w), drive, w @ drive.rows.T, None)
    assert np.abs(free).max() < 1e-12
    assert np.abs(system.contact_rows() @ w[0]).max() == 0.0


def test_rows_give_what_they_name(system: GraspSystem) -> None:
    """Excursions, loads, joint angles, and the spools' excursions with the tendons' stretch."""
    w = near(system, 4)[0]
    excursion, load = system.excursion_rows() @ w, system.load_rows() @ w
    assert system.joint_angle_rows() @ w == pytest.approx(w[list(system.joint_columns)])
    stretch = load / [finger.tendon_stiffness_N_per_m for finger in system.fingers]
    assert system.spool_rows() @ w == pytest.approx(excursion + stretch)
    assert excursion_drive(system).rows @ w == pytest.approx([excursion.mean(), excursion[0] - excursion[1]])
    assert load_drive(system).rows @ w == pytest.approx([load.mean(), excursion[0] - excursion[1]])
    spool = system.spool_rows() @ w
    assert spool_drive(system).rows @ w == pytest.approx([spool.mean(), spool[0] - spool[1]])
