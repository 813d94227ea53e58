"""The drag of the support on a grid, against incremental minimisation and the limit surface."""

import numpy as np
import pytest
from msgspec.structs import replace

from calibration.grasp.equilibrium import GraspSystem, grasp_system
from calibration.grasp.friction import OnTable, sliding
from calibration.grasp.path import trace
from calibration.grasp.path_grid import PathGrid, solve_path_grid
from calibration.grasp.path_grid_drag import SupportDrag
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.objects import load_object

Case = tuple[GraspSystem, SupportDrag, PathGrid]
CASES = {
    "pins, split": ("t42pp", "cylinder40", 0.1, GraspSpec(onset_split=0.1)),
    "flexure, heavy, split": ("t42pf", "mustard", 0.6, GraspSpec(onset_split=0.1)),
}


@pytest.fixture(scope="module", params=list(CASES))
def case(request: pytest.FixtureRequest) -> Case:
    hand, thing, mass_kg, spec = CASES[request.param]
    system = grasp_system(load_hand(hand), replace(load_object(thing), mass_kg=mass_kg), spec)
    limits = sliding(system.object)
    drag = SupportDrag(limits.force_N, limits.moment_Nm)
    return system, drag, solve_path_grid(system, nodes=41, columns=9, difference_range_m=2e-3, drag=drag)


def test_equals_incremental_minimisation(case: Case) -> None:
    """Equal windings: the poses of steps that minimise energy and dissipation one by one (hand-mechanics reference 8).
    Those are of first order in the step, so the two finer ones are extrapolated."""
    system, _, grid = case
    axes = grid.solutions.axes
    means = axes.mean_m[4:36:4]
    poses = []
    for step_m in (1e-4, 5e-5):
        path = trace(system, step_m=step_m, past_stops=False, rule=OnTable(system, sliding(system.object)))
        mean_m = path.excursion_m.mean(1) - path.excursion_m[0].mean()
        poses.append(np.column_stack([np.interp(means, mean_m, path.motion[:, k]) for k in range(3)]))
    limit = 2 * poses[1] - poses[0]
    motion = grid.solutions.w[4:36:4, 4, system.joints : system.unknowns] - system.start.object_pose
    assert np.abs(motion - limit)[:, :2].max() < 3e-6
    assert np.abs(motion - limit)[:, 2].max() < 5e-5


def test_the_wrench_lies_on_the_limit_surface_against_the_motion(case: Case) -> None:
    """Sliding: (f_x² + f_y²)/F² + τ²/M² = 1, and no power but lost power."""
    system, drag, grid = case
    solved = grid.solutions
    assert solved.wrench is not None
    known = solved.solved
    wrench = solved.wrench.value[known]
    size = np.linalg.norm(wrench / drag.limits, axis=1)
    assert size == pytest.approx(np.ones(size.size), abs=1e-4)
    motion = solved.nodes.along_0[known][:, system.joints : system.unknowns]
    assert ((wrench * motion).sum(1) < 0).all()


def test_every_node_balances_its_wrench(case: Case) -> None:
    """Residual of all equations with the stored wrench; what is left of the object's balance is below 1e-9 N."""
    system, _, grid = case
    solved = grid.solutions
    assert solved.wrench is not None
    known = solved.solved
    w, drive = solved.w[known], solved.axes.drive
    F = system.residual_vector(w, system.terms(w), drive, w @ drive.rows.T, solved.wrench.value[known])
    assert (
        np.abs(F[:, system.joints : system.unknowns] / system.row_scale[system.joints : system.unknowns]).max() < 1e-9
    )


def test_motion_begins_at_first_contact(case: Case) -> None:
    """Friction holds the object where it was touched: the pose at the beginning of equal winding is that of first
    contact, while the loads have jumped."""
    system, drag, grid = case
    w = grid.solutions.w[0, 4]
    motion = w[system.joints : system.unknowns] - system.start.object_pose
    assert np.abs(motion[:2]).max() < 1e-5
    assert (w[-2:] - system.start.tendon_load_N).mean() > drag.force_N


def test_unwinding_is_dragged_the_other_way() -> None:
    """Letting out, the object slides back: the wrench is reversed, the load below that without drag."""
    spec = GraspSpec(branch="unwinding")
    system = grasp_system(load_hand("t42pp"), load_object("cylinder40"), spec)
    limits = sliding(system.object)
    drag = SupportDrag(limits.force_N, limits.moment_Nm)
    free, dragged = (
        solve_path_grid(system, nodes=13, columns=9, difference_range_m=2e-3, drag=one) for one in (None, drag)
    )
    assert dragged.solutions.wrench is not None
    assert dragged.solutions.wrench.value[6, 4] == pytest.approx([0.0, -limits.force_N, 0.0], abs=1e-6)
    assert dragged.solutions.w[6, 4, -1] < free.solutions.w[6, 4, -1]
