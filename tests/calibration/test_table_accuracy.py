"""How right a table is between its nodes: 1000 random places of each against equilibria solved there."""

import numpy as np
import pytest
from msgspec.structs import replace

from calibration.build import build_table
from calibration.grasp.continuation import advance
from calibration.grasp.equilibrium import GraspSystem, excursion_drive, grasp_system
from calibration.grasp.specification import GraspSpec
from calibration.hand.finger import Reals
from calibration.hand.parameters import load_hand
from calibration.motion_table import MotionTable, Status
from calibration.objects import load_object

POINTS = 1000
LARGEST_M, LARGEST_RAD = 5e-6, np.radians(0.005)
CASES = {
    "pins": ("t42pp", "cylinder40", GraspSpec(supported=False)),
    "pins, split, box": ("t42pp", "rubiks_cube", GraspSpec(onset_split=0.1, supported=False)),
    "pin and flexure": ("t42pf", "strawberry", GraspSpec(onset_split=-0.1, supported=False)),
    "flexures": ("t42ff", "cylinder40", GraspSpec(supported=False)),
    "flexures, split, box": ("t42ff", "rectangle40", GraspSpec(onset_split=0.1, supported=False)),
}


@pytest.fixture(scope="module", params=list(CASES))
def case(request: pytest.FixtureRequest) -> tuple[GraspSystem, MotionTable]:
    hand, thing, spec = CASES[request.param]
    return (
        grasp_system(load_hand(hand), load_object(thing), spec),
        build_table(load_hand(hand), load_object(thing), spec),
    )


def nodes(system: GraspSystem, table: MotionTable) -> Reals:
    """States (rows, columns, size) put together again from what the table holds."""
    arrays = table.arrays
    value = arrays["excursion.value"]
    pose = value[:, :, [0, 1, 5]] + system.start.object_pose
    forces = -value[:, :, [8, 10, 9, 11]]
    mean, difference = arrays["excursion.axis_0"][:, None], arrays["excursion.axis_1"]
    excursion = [
        excursion + mean + half * difference
        for excursion, half in zip(system.start.tendon_excursion_m, (0.5, -0.5), strict=True)
    ]
    return np.concatenate(
        [arrays["excursion.joint_rad"], pose, forces, np.stack(excursion, axis=2), value[:, :, 6:8]], axis=2
    )


def places(table: MotionTable) -> tuple[Reals, Reals]:
    """Random means and differences (m) of the domain, at least one cell from its edges."""
    rng = np.random.default_rng(11)
    mean, difference = table.arrays["excursion.axis_0"], table.arrays["excursion.axis_1"]
    across = rng.uniform(difference[1], difference[-2], POINTS)
    start, end = (np.interp(across, difference, table.arrays[f"excursion.{edge}"]) for edge in ("start", "end"))
    return start + mean[1] + rng.random(POINTS) * (end - start - 2 * mean[1]), across


def test_both_grids_tell_the_pose_between_their_nodes(case: tuple[GraspSystem, MotionTable]) -> None:
    """By excursion, and by the mean load solved there: within 5 µm and 0.005°."""
    system, table = case
    drive, states = excursion_drive(system), nodes(system, table)
    origin = drive.rows @ system.first_state()
    mean, across = places(table)
    axis_0, axis_1 = table.arrays["excursion.axis_0"], table.arrays["excursion.axis_1"]
    row = np.rint(mean / axis_0[1]).astype(int)
    column = np.rint((across - axis_1[0]) / (axis_1[1] - axis_1[0])).astype(int)
    w = advance(
        system,
        states[row, column],
        drive,
        origin + np.column_stack([axis_0[row], axis_1[column]]),
        origin + np.column_stack([mean, across]),
    )
    assert np.isfinite(w).all()
    poses = w[:, system.joints : system.unknowns] - system.start.object_pose
    loads = w[:, -2:].mean(1)
    load_axis = table.arrays["load.axis_0"]
    start, end = (np.interp(across, axis_1, table.arrays[f"load.{edge}"]) for edge in ("start", "end"))
    step = load_axis[1] - load_axis[0]
    asked = (loads > start + step) & (loads < end - step)
    assert asked.mean() > 0.7
    for index in range(POINTS):
        samples = [table.at_excursion(mean[index], across[index])]
        if asked[index]:
            samples.append(table.at_load(loads[index], across[index]))
        for sample in samples:
            assert sample.status is Status.INSIDE
            away = np.array(sample.planar_motion) - poses[index]
            assert np.hypot(*away[:2]) < LARGEST_M
            assert abs(away[2]) < LARGEST_RAD


def test_the_header_states_the_error(case: tuple[GraspSystem, MotionTable]) -> None:
    """What the build found at places of its own is of the promised size, and no wanted node is missing."""
    solver = case[1].header.solver
    assert 0 < solver["interpolation_error_m"] < LARGEST_M
    assert 0 < solver["load_interpolation_error_m"] < LARGEST_M
    assert 0 < solver["interpolation_error_rad"] < LARGEST_RAD
    assert 0 < solver["load_interpolation_error_rad"] < LARGEST_RAD
    assert min(solver["interpolation_places"], solver["load_interpolation_places"]) > 200
    assert solver["failed_nodes"] == 0


def test_domain_reaches_the_event_that_ends_it(case: tuple[GraspSystem, MotionTable]) -> None:
    """No equilibrium that the hand can reach is left out: every cell below the end has its four corners."""
    table = case[1]
    axis, end = table.arrays["excursion.axis_0"], table.arrays["excursion.end"]
    states = np.isfinite(table.arrays["excursion.value"][:, :, 0])
    for column in range(end.size - 1):
        needed = axis[:-1] < max(end[column], end[column + 1])
        assert states[:-1, column : column + 2][needed].all()
        assert states[1:, column : column + 2][needed].all()


def test_a_supported_table_is_as_right() -> None:
    """With the support's drag, at the build's own places, of which there are enough to say so."""
    thing = replace(load_object("cylinder40"), mass_kg=0.3)
    solver = build_table(load_hand("t42pf"), thing, GraspSpec(onset_split=0.1)).header.solver
    assert solver["interpolation_error_m"] < LARGEST_M
    assert solver["load_interpolation_error_m"] < LARGEST_M
    assert solver["load_interpolation_error_rad"] < LARGEST_RAD
    assert min(solver["interpolation_places"], solver["load_interpolation_places"]) > 200
    assert solver["failed_nodes"] == 0
