"""Built tables against direct solutions, and the reuse of stored ones."""

from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from calibration.build import build_or_load, build_table, inputs_sha256, is_current
from calibration.grasp.continuation import advance
from calibration.grasp.equilibrium import GraspSystem, excursion_drive, grasp_system, load_drive
from calibration.grasp.specification import GraspSpec
from calibration.hand.finger import Reals
from calibration.hand.parameters import load_hand
from calibration.motion_table import MotionTable, Status
from calibration.objects import Disc, GraspObject, load_object
from drivers.errors import MechanicsError

HAND, CYLINDER = load_hand("t42pp"), load_object("cylinder40")


def directly(system: GraspSystem, mean_m: float, difference_m: float) -> Reals:
    """State solved without the table, in small steps from first contact."""
    drive, w = excursion_drive(system), system.first_state()[None]
    origin = drive.rows @ w[0]
    for share in np.linspace(0, 1, 13)[1:]:
        here, there = (origin + at * np.array([[mean_m, difference_m]]) for at in (share - 1 / 12, share))
        w = advance(system, w, drive, here, there)
    state: Reals = w[0]
    return state


@pytest.mark.parametrize("split", [0.0, 0.1])
def test_table_equals_direct_solutions_at_random_points(
    split: float, symmetric_table: MotionTable, split_table: MotionTable
) -> None:
    """By excursion to 1 nm and 0.1 µrad; by load, whose curve flattens towards its end, to 3 µm and 50 µrad."""
    table = split_table if split else symmetric_table
    system = grasp_system(HAND, CYLINDER, GraspSpec(onset_split=split))
    rng = np.random.default_rng(3)
    for mean, difference in zip(rng.uniform(1e-4, 5e-3, 8), rng.uniform(-1.9e-3, 1.9e-3, 8), strict=True):
        w = directly(system, mean, difference)
        motion, load = w[4:7] - system.start.object_pose, float(w[-2:].mean())
        forces = (system.contact_rows() @ w)[[0, 2]]
        for sample, error_m, error_rad, error_N in (
            (table.at_excursion(mean, difference), 1e-9, 1e-7, 1e-4),
            (table.at_load(load, difference), 3e-6, 5e-5, 5e-3),
        ):
            assert sample.status is Status.INSIDE
            assert sample.planar_motion[:2] == pytest.approx(motion[:2], abs=error_m)
            assert sample.planar_motion[2] == pytest.approx(motion[2], abs=error_rad)
            assert sample.tension == pytest.approx(w[-2:], abs=error_N)
            assert sample.contact_force == pytest.approx(forces, abs=error_N)


def test_symmetric_table_is_symmetric(symmetric_table: MotionTable) -> None:
    """Equal winding moves along y only; exchanging the fingers mirrors the motion."""
    for mean in np.linspace(1e-4, 7.8e-3, 40):
        x, y, angle = symmetric_table.at_excursion(mean, 0.0).planar_motion
        assert abs(x) < 1e-12
        assert abs(angle) < 1e-11
        assert y < 0
    one, other = symmetric_table.at_excursion(2e-3, 7e-4), symmetric_table.at_excursion(2e-3, -7e-4)
    assert one.planar_motion == pytest.approx(np.array(other.planar_motion) * [-1, 1, -1], abs=1e-10)
    assert one.tension == pytest.approx(other.tension[::-1], abs=1e-8)


def test_demo_path_lies_well_inside(symmetric_table: MotionTable, split_table: MotionTable) -> None:
    """Equal winding to 80 N mean load moves the object by more than 13 mm, with room to spare, stable, no slip."""
    for table in (symmetric_table, split_table):
        sample = table.at_load(80.0, 0.0)
        assert sample.status is Status.INSIDE
        assert np.hypot(*sample.planar_motion[:2]) > 0.013
        assert table.mean_load_end_N(0.0) > 95
        assert sample.required_friction < 0.3
        inside = table.arrays["excursion.validity"] == 2
        assert (table.arrays["excursion.stability"][inside] > 0).all()
        assert table.header.solver["largest_residual"] < 1e-10


def test_domain_ends_where_a_distal_joint_meets_its_stop(symmetric_table: MotionTable) -> None:
    """The stored end curve is the excursion at which a distal joint is at 1.8 rad."""
    system = grasp_system(HAND, CYLINDER, GraspSpec())
    for difference in (0.0, 1e-3, -1.5e-3):
        end = symmetric_table.mean_excursion_end_m(difference)
        assert directly(system, end, difference)[[1, 3]].max() == pytest.approx(np.radians(103.1324), abs=1e-6)
    assert all(event.endswith("distal stop") for event in symmetric_table.header.column_end)


def test_beyond_all_stops_the_pose_is_frozen_and_the_force_rises(symmetric_table: MotionTable) -> None:
    """Above the stop load the sample equals an equilibrium solved with the stops."""
    system = grasp_system(HAND, CYLINDER, GraspSpec())
    end = symmetric_table.mean_excursion_end_m(0.0)
    drive = load_drive(system)
    w = directly(system, end, 0.0)
    poses = []
    for load in (106.0, 120.0):
        sample = symmetric_table.at_load(load, 0.0)
        assert sample.status is Status.FROZEN
        states = system.solve(w[None], drive, np.array([[load, float(drive.rows[1] @ w)]]), stops=True)
        assert states.converged[0]
        assert sample.contact_force == pytest.approx((system.contact_rows() @ states.w[0])[[0, 2]], abs=1e-4)
        assert sample.planar_motion == pytest.approx(states.w[0, 4:7] - system.start.object_pose, abs=1e-6)
        poses.append(sample.planar_motion)
        assert np.abs(sample.jacobian).max() < 1e-9
    assert poses[0] == poses[1]
    assert symmetric_table.at_excursion(end + 1e-3, 0.0).status is Status.FROZEN
    assert symmetric_table.at_excursion(end + 1e-3, 1e-3).status is Status.OUTSIDE
    assert symmetric_table.at_load(129.0, 0.0).status is Status.OUTSIDE  # above the load cap


def test_a_load_cap_ends_the_domain() -> None:
    """With a cap of 60 N the end curve is where the more loaded tendon carries 60 N."""
    table = build_table(HAND, CYLINDER, GraspSpec(onset_split=0.1, load_cap_N=60.0, supported=False), nodes=13)
    for difference in table.arrays["excursion.axis_1"][::3]:
        sample = table.at_excursion(table.mean_excursion_end_m(difference) - 1e-9, difference)
        assert sample.tension.max() == pytest.approx(60.0, abs=1e-3)
    assert {*table.header.column_end} <= {"right load cap", "left load cap"}


def test_stored_table_is_reused_until_an_input_changes(tmp_path: Path) -> None:
    """Same inputs: read back; another input, or a damaged file: built again."""
    path = tmp_path / "table.npz"
    first, reused = build_or_load(path, HAND, CYLINDER, nodes=9)
    assert not reused
    again, reused = build_or_load(path, HAND, CYLINDER, nodes=9)
    assert reused
    assert again.inputs_sha256 == first.inputs_sha256
    assert is_current(again)
    _, reused = build_or_load(path, HAND, CYLINDER, GraspSpec(onset_split=0.05), nodes=9)
    assert not reused
    path.write_bytes(path.read_bytes()[:-5])
    assert build_or_load(path, HAND, CYLINDER, GraspSpec(onset_split=0.05), nodes=9)[1] is False


def test_every_input_counts_in_the_hash() -> None:
    """Another mass, preset, split or grid is another table."""
    hashes = {
        inputs_sha256(HAND, CYLINDER, GraspSpec()),
        inputs_sha256(load_hand("t42pp", "nominal"), CYLINDER, GraspSpec()),
        inputs_sha256(HAND, replace(CYLINDER, mass_kg=0.2), GraspSpec()),
        inputs_sha256(HAND, CYLINDER, GraspSpec(onset_split=1e-9)),
        inputs_sha256(HAND, CYLINDER, GraspSpec(), nodes=43),
    }
    assert len(hashes) == 5


@pytest.mark.parametrize("nodes", [8, 402, -1])
def test_bad_requests_are_refused(nodes: int) -> None:
    """A grid too coarse or too fine, and an object without the support that the grasp claims."""
    with pytest.raises(MechanicsError, match="nodes"):
        build_table(HAND, CYLINDER, nodes=nodes)
    with pytest.raises(MechanicsError, match="has no \\[support\\]"):
        build_table(HAND, GraspObject("ball", Disc(0.04), 0.1))


def test_progress_rises_to_one() -> None:
    """Long work shows how far it is."""
    heard: list[float] = []
    build_table(HAND, CYLINDER, nodes=9, progress=heard.append)
    assert heard == sorted(heard)
    assert heard[-1] == 1.0


def test_an_extreme_grasp_gives_an_honest_table() -> None:
    """30 % split: contacts part and a phalanx meets the object; every sample is finite and has its status, and
    what is inside presses with both fingers, pulls with both tendons and keeps within the load cap."""
    table = build_table(HAND, CYLINDER, GraspSpec(onset_split=0.3, supported=False), nodes=21)
    (low, high), (left, right) = table.excursion_range
    rng = np.random.default_rng(5)
    seen = set()
    for mean, difference in zip(rng.uniform(low, high, 400), rng.uniform(left, right, 400), strict=True):
        sample = table.at_excursion(mean, difference)
        seen.add(sample.status)
        assert np.isfinite(sample.rows).all()
        if sample.status is Status.INSIDE:
            assert sample.contact_force.min() > -1e-3
            assert sample.tension.min() > -1e-2
            assert sample.tension.max() < 128 + 1e-2
    assert {Status.INSIDE, Status.OUTSIDE} <= seen


def test_a_supported_table_drags_from_the_first_touch_on(supported_table: MotionTable) -> None:
    """On its support the object needs more load at every winding; what the cycle compares its motors with at contact
    stays that of free closing, and the pose goes on from there."""
    lifted = build_table(HAND, CYLINDER, GraspSpec(supported=False), nodes=13)
    header = supported_table.header.contact
    assert header == lifted.header.contact
    for mean in (0.0, 1e-3, 4e-3, 7e-3):
        dragged, free = supported_table.at_excursion(mean, 0.0), lifted.at_excursion(mean, 0.0)
        assert dragged.tension.min() > free.tension.max() + 0.3
        assert dragged.planar_motion == pytest.approx(free.planar_motion, abs=2e-6)
    assert supported_table.at_excursion(0.0, 0.0).planar_motion == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert supported_table.at_load(float(np.mean(header.tension_N)), 0.0).status is Status.BEFORE_CONTACT
    wrench = supported_table.arrays["excursion.support_wrench"][5, 20]
    assert wrench == pytest.approx([0.0, 0.3 * 0.1 * 9.80665, 0.0], abs=1e-6)


def test_what_stands_still_in_the_room_does_not_drag(supported_table: MotionTable) -> None:
    """Of a compensated grasp the table is that of a lifted object, though it stands on the support it would rub on."""
    kept_still = build_table(HAND, CYLINDER, GraspSpec(compensated=True), nodes=13)
    lifted = build_table(HAND, CYLINDER, GraspSpec(supported=False), nodes=13)
    for name in ("excursion.value", "load.value", "excursion.end"):
        assert kept_still.arrays[name] == pytest.approx(lifted.arrays[name], abs=0.0, nan_ok=True)
    assert (
        kept_still.at_excursion(4e-3, 0.0).tension.max() < supported_table.at_excursion(4e-3, 0.0).tension.min() - 0.3
    )
    assert kept_still.header.inputs_sha256 not in (lifted.header.inputs_sha256, supported_table.header.inputs_sha256)


def test_flexures_creep_on_beyond_their_stops_and_the_table_says_so() -> None:
    """Their shapes stay soft: the frozen pose moves with the load, as equilibria with stops say, to 5 µm."""
    hand = load_hand("t42ff")
    table = build_table(hand, CYLINDER, GraspSpec(supported=False), nodes=13)
    system = grasp_system(hand, CYLINDER, GraspSpec(supported=False))
    w, drive = directly(system, table.mean_excursion_end_m(0.0), 0.0), load_drive(system)
    top_N = float(table.arrays["frozen.end_N"][6])
    assert 120 < top_N <= 128
    for load in (100.0, top_N):
        states = system.solve(w[None], drive, np.array([[load, float(drive.rows[1] @ w)]]), stops=True)
        sample = table.at_load(load, 0.0)
        assert sample.status is Status.FROZEN
        assert states.converged[0]
        motion = states.w[0, system.joints : system.unknowns] - system.start.object_pose
        assert sample.planar_motion == pytest.approx(motion, abs=6e-6)
        assert sample.jacobian[1, 0] < 0


def test_a_load_cap_below_first_contact_is_refused_at_once() -> None:
    """No long computation for a grasp that cannot begin: the reason names what to change."""
    with pytest.raises(MechanicsError, match=r"10\.0 N") as caught:
        build_table(HAND, CYLINDER, GraspSpec(load_cap_N=10.0))
    assert caught.value.help


def test_a_table_file_is_small(split_table: MotionTable, tmp_path: Path) -> None:
    """41 × 41 nodes with all fields in less than 2 MB."""
    split_table.save(tmp_path / "table.npz")
    assert (tmp_path / "table.npz").stat().st_size < 2e6
