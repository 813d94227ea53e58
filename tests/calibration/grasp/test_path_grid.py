"""Grids of equilibria: on the branch that leads from first contact, with domains that end where something happens."""

from collections.abc import Callable

import numpy as np
import pytest
from msgspec.structs import replace

from calibration.grasp.constraints import gaps
from calibration.grasp.continuation import advance
from calibration.grasp.equilibrium import GraspSystem, grasp_system
from calibration.grasp.path_grid import PathGrid, solve_path_grid
from calibration.grasp.specification import GraspSpec
from calibration.hand.finger import Reals
from calibration.hand.parameters import Hand, load_hand
from calibration.objects import load_object
from drivers.errors import MechanicsError


def solved(system: GraspSystem, nodes: int = 13) -> PathGrid:
    return solve_path_grid(system, nodes=nodes, columns=nodes, difference_range_m=2e-3)


def rubbing(hand: Hand) -> Hand:
    """The same hand with friction in the tendon routing."""
    finger = replace(hand.right, routing_friction=0.1)
    return replace(hand, right=finger, left=finger)


def end_states(system: GraspSystem, grid: PathGrid) -> Reals:
    """States (columns, size) at the ends, solved from the grid's."""
    axes = grid.solutions.axes
    target = axes.origin + np.column_stack([grid.domain.end_m, axes.difference_m])
    states = system.solve(grid.domain.end_w, axes.drive, target)
    assert states.converged.all()
    return states.w


@pytest.mark.parametrize("name", ["t42pp", "t42ff"])
def test_nodes_lie_on_the_branch_from_first_contact(name: str) -> None:
    """A node anywhere equals what continuation in small steps straight from first contact leads to."""
    system = grasp_system(load_hand(name), load_object("cylinder40"), GraspSpec(onset_split=0.1))
    grid = solved(system)
    axes = grid.solutions.axes
    assert not grid.left_out.any()
    for row, column in ((2, 1), (6, 11), (9, 5)):
        w = system.first_state()[None]
        goal = axes.targets(np.array([row]), np.array([column]))
        for share in np.linspace(0, 1, 31)[1:]:
            here, there = (axes.origin + at * (goal - axes.origin) for at in (share - 1 / 30, share))
            w = advance(system, w, axes.drive, here, there)
        assert grid.solutions.w[row, column] / system.column_scale == pytest.approx(
            w[0] / system.column_scale, abs=1e-9
        )


def test_a_collision_ends_the_path_by_name() -> None:
    """The mustard bottle is so deep that a proximal phalanx meets it before any stop (paper (11)); the end is where
    their distance is zero, to a nanometre."""
    system = grasp_system(load_hand("t42pp"), load_object("mustard"), GraspSpec(onset_split=0.1))
    grid = solved(system)
    assert set(grid.domain.end_event) == {"left proximal phalanx meets the object"}
    distance = next(gap for gap in gaps(system) if gap.name == grid.domain.end_event[0])
    assert np.abs(distance.at(end_states(system, grid))).max() < 1e-9


def test_a_fingertip_that_runs_off_its_side_ends_the_path_by_name() -> None:
    """A square gripped near its far edge: the contact reaches the corner."""
    system = grasp_system(load_hand("t42pp"), load_object("rectangle40"), GraspSpec(object_offset_m=-0.019))
    grid = solved(system)
    assert any("side end" in name for name in grid.domain.end_event)


@pytest.mark.parametrize(
    ("spec", "name", "value"),
    [
        (GraspSpec(load_cap_N=60.0), "load cap", lambda system, w: (system.load_rows() @ w.T).max(0) - 60.0),
        (GraspSpec(), "distal stop", lambda system, w: w[:, [1, 3]].max(1) - system.upper_rad[1]),
    ],
)
def test_ends_are_where_the_event_is(spec: GraspSpec, name: str, value: Callable[[GraspSystem, Reals], Reals]) -> None:
    """Stops and caps are met exactly at the stored ends."""
    system = grasp_system(load_hand("t42pp"), load_object("cylinder40"), spec)
    grid = solved(system)
    assert all(event.endswith(name) for event in grid.domain.end_event)
    assert np.abs(value(system, end_states(system, grid))).max() < 1e-6


def test_a_column_begins_where_both_fingers_press() -> None:
    """Beside the equal difference one finger comes first; the domain begins where the other presses too."""
    system = grasp_system(load_hand("t42ff"), load_object("cylinder40"), GraspSpec())
    grid = solved(system)
    axes, start = grid.solutions.axes, grid.domain.start_m
    assert start[6] == 0.0
    assert (start[[0, -1]] > 1e-6).all()
    for column in (0, 12):
        w = system.solve(
            grid.solutions.w[:1, column],
            axes.drive,
            np.array([axes.origin + np.array([start[column], axes.difference_m[column]])]),
        ).w[0]
        assert min((system.contact_rows() @ w)[[0, 2]]) == pytest.approx(0.0, abs=1e-9)


def test_unwinding_needs_less_load_at_the_same_place() -> None:
    """Routing friction opens a band of loads between the branches (hand-mechanics reference 4); the symmetric path of
    pins is the same, since geometry leaves it no choice."""
    hand, thing = rubbing(load_hand("t42pp")), load_object("cylinder40")
    winding = solved(grasp_system(hand, thing, GraspSpec()))
    unwinding = solved(grasp_system(hand, thing, GraspSpec(branch="unwinding")))
    middle = 6
    for row in (3, 6, 9):
        more, less = winding.solutions.w[row, middle], unwinding.solutions.w[row, middle]
        further = unwinding.solutions.axes.mean_m[row] - winding.solutions.axes.mean_m[row]
        expected = more + further * winding.solutions.nodes.along_0[row, middle]
        assert abs(further) < 1e-7
        assert less[-2:].max() < 0.95 * more[-2:].min()
        assert less[4:7] == pytest.approx(expected[4:7], abs=1e-9)
    assert not unwinding.left_out.any()


def test_a_grasp_that_begins_inside_a_finger_is_refused() -> None:
    """Bodies that overlap at first contact: the reason at once, not an empty table."""
    system = grasp_system(load_hand("t42pp"), load_object("cylinder30"), GraspSpec(onset_split=0.4))
    with pytest.raises(MechanicsError, match="left distal phalanx meets the object"):
        solved(system)
