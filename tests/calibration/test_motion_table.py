"""The table's look-up, checks and hand-over."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.motion_table import MotionTable, Status, TableSample, rates
from calibration.objects import load_object
from calibration.table_file import read_file, write_file
from drivers.errors import InputError, TableError


def all_of(sample: TableSample) -> list[Any]:
    return [sample.status, sample.object_pose.tolist(), sample.jacobian.tolist(), sample.tension.tolist()]


@settings(max_examples=60, deadline=None)
@given(mean=st.floats(1e-4, 5.5e-3), difference=st.floats(-1.9e-3, 1.9e-3))
def test_both_indices_tell_the_same_pose(split_table: MotionTable, mean: float, difference: float) -> None:
    """`at_load` inverts `at_excursion`, and the rates agree when the indices move together."""
    native = split_table.at_excursion(mean, difference)
    by_load = split_table.at_load(float(native.tension.mean()), difference)
    if by_load.status is Status.INSIDE:
        assert by_load.planar_motion[:2] == pytest.approx(native.planar_motion[:2], abs=3e-6)
        assert by_load.planar_motion[2] == pytest.approx(native.planar_motion[2], abs=6e-5)
        load_rate = native.rows[1, 6:8].mean() * 1e-3
        assert rates(by_load, (load_rate, 0.0)) == pytest.approx(rates(native, (1e-3, 0.0)), rel=5e-3, abs=1e-5)
    else:
        assert native.tension.mean() > 95


@settings(max_examples=60, deadline=None)
@given(
    mean=st.floats(1e-4, 5.5e-3),
    difference=st.floats(-1.8e-3, 1.8e-3),
    way=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
)
def test_rates_are_the_speed_of_the_pose(
    split_table: MotionTable, mean: float, difference: float, way: tuple[float, float]
) -> None:
    """Velocity for index rates equals the change of pose along them."""
    step = 1e-7
    ahead, behind = (split_table.at((mean + s * step * way[0], difference + s * step * way[1])) for s in (1, -1))
    speed = (ahead.object_pose - behind.object_pose) / (2 * step)
    assert rates(split_table.at((mean, difference)), way) == pytest.approx(speed, rel=1e-5, abs=2e-4)


def test_sample_has_the_agreed_shape(split_table: MotionTable) -> None:
    """6-D pose with x, y and rotation about z filled; Jacobian per index; two tendons; motion relative to contact."""
    sample = split_table.at(np.array([0.002, 0.0003]))
    assert sample.object_pose.shape == sample.motion.shape == (6,)
    assert sample.jacobian.shape == (6, 2)
    assert sample.tension.shape == sample.contact_force.shape == (2,)
    assert not sample.motion[2:5].any()
    assert sample.object_pose - split_table.contact_pose == pytest.approx(sample.motion)
    assert sample.planar_motion == tuple(sample.motion[[0, 1, 5]])
    friction = np.abs(sample.contact_tangential / sample.contact_force).max()
    assert sample.required_friction == pytest.approx(friction)


def test_contact_data_are_those_of_free_closing(split_table: MotionTable) -> None:
    """What the cycle compares its motors with: excursion × free stiffness = load, right finger loaded more."""
    assert split_table.contact_tension_N == pytest.approx(
        split_table.contact_excursion_m * split_table.free_closing_stiffness_N_per_m
    )
    assert split_table.contact_tension_N[0] / split_table.contact_tension_N[1] == pytest.approx(1.1 / 0.9)
    start = split_table.at_excursion(1e-9, 0.0)
    assert start.tension == pytest.approx(split_table.contact_tension_N, abs=1e-4)
    assert start.object_pose == pytest.approx(split_table.contact_pose, abs=1e-7)


def test_before_contact_nothing_moves(split_table: MotionTable) -> None:
    """Below first contact: contact pose, zero motion and Jacobian, on both indices."""
    for sample in (split_table.at_excursion(-1e-4, 5e-4), split_table.at_load(5.0, 0.0), split_table.at((-1.0, 9.0))):
        assert sample.status is Status.BEFORE_CONTACT
        assert sample.object_pose.tolist() == split_table.contact_pose.tolist()
        assert not sample.motion.any()
        assert not sample.jacobian.any()
        assert sample.required_friction == 0.0


def test_outside_gives_the_edge_and_says_so(split_table: MotionTable) -> None:
    """Beyond the domain the value is that of its edge, with zero Jacobian: never an extrapolation."""
    end = split_table.mean_excursion_end_m(0.0)
    edge, beyond = split_table.at_excursion(end, 0.0), split_table.at_excursion(end + 5e-3, 0.0)
    assert (edge.status, beyond.status) == (Status.INSIDE, Status.OUTSIDE)
    assert beyond.planar_motion == edge.planar_motion
    assert not beyond.jacobian.any()
    beside = split_table.at_excursion(1e-3, 5e-3)
    assert beside.status is Status.OUTSIDE
    assert beside.planar_motion == pytest.approx(split_table.at_excursion(1e-3, 2e-3).planar_motion)


def test_bad_indices_are_errors(split_table: MotionTable) -> None:
    """NaN, infinity and a wrong number of axes never become a pose."""
    for index in ((float("nan"), 0.0), (0.001, float("inf"))):
        with pytest.raises(InputError, match="not finite"):
            split_table.at(index)
        with pytest.raises(InputError, match="not finite"):
            split_table.at_load(*index)
    with pytest.raises(InputError, match="this table has 2"):
        split_table.at((0.001, 0.0, 0.0))


def test_samples_are_not_overwritten_by_later_ones(split_table: MotionTable) -> None:
    """A sample that is kept stays what it was."""
    kept = split_table.at_excursion(0.001, 0.0)
    before = all_of(kept)
    split_table.at_excursion(0.004, 0.001)
    assert all_of(kept) == before


def test_file_and_memory_round_trips_are_exact(split_table: MotionTable, tmp_path: Path) -> None:
    """The same numbers from the built table, its file, and the mapped memory file after its descriptor is closed."""
    split_table.save(tmp_path / "table.npz")
    stored = MotionTable.load(tmp_path / "table.npz")
    descriptor = stored.to_memfd()
    mapped = MotionTable.from_memfd(descriptor)
    os.close(descriptor)
    for table in (stored, mapped):
        assert table.header == split_table.header
        for index in ((-1.0, 0.0), (0.0007, 1e-4), (0.0033, -1.1e-3), (0.009, 0.0)):
            assert all_of(table.at(index)) == all_of(split_table.at(index))
        assert all_of(table.at_load(60.0, 1e-4)) == all_of(split_table.at_load(60.0, 1e-4))
    assert not any(array.flags.writeable for array in mapped.arrays.values())


def test_memory_crosses_processes(split_table: MotionTable) -> None:
    """Another process maps the descriptor that it inherits and reads the same pose, without loading scipy."""
    descriptor = split_table.to_memfd()
    code = (
        "import sys; from calibration.motion_table import MotionTable;"
        f"t = MotionTable.from_memfd({descriptor}); print(t.at_excursion(0.002, 1e-4).planar_motion);"
        "print('scipy' in sys.modules)"
    )
    try:
        run = subprocess.run(
            [sys.executable, "-c", code], pass_fds=[descriptor], capture_output=True, text=True, check=True
        )
    finally:
        os.close(descriptor)
    pose, scipy_loaded = run.stdout.splitlines()
    assert pose == str(split_table.at_excursion(0.002, 1e-4).planar_motion)
    assert scipy_loaded == "False"


def test_a_table_for_something_else_is_refused(split_table: MotionTable) -> None:
    """Another hand, object or grasp is named by its first differing parameter."""
    hand, thing, grasp = load_hand("t42pp"), load_object("cylinder40"), GraspSpec(onset_split=0.1, supported=False)
    split_table.refuse_unless(hand=hand, object=thing, grasp=grasp)
    longer = replace(hand, left=replace(hand.left, distal_link_m=0.048))
    with pytest.raises(TableError, match=r"another hand: hand\.left\.distal_link_m is 0\.047 there and 0\.048 here"):
        split_table.refuse_unless(hand=longer)
    with pytest.raises(TableError, match=r"object\.name"):
        split_table.refuse_unless(object=load_object("cylinder30"))
    with pytest.raises(TableError, match=r"grasp\.onset_split"):
        split_table.refuse_unless(grasp=GraspSpec())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda h, a: h.update(format_version=1), "format version 1, expected 2"),
        (lambda h, a: h.pop("contact"), "wrong header"),
        (lambda h, a: h.update(extra=1), "wrong header"),
        (lambda h, a: a.pop("load.mixed"), "lacks the array 'load.mixed'"),
        (lambda h, a: a.update({"excursion.start": np.zeros(3)}), "excursion.start"),
        (lambda h, a: a.update({"excursion.value": a["excursion.value"].astype(np.float32)}), "float32"),
        (lambda h, a: a["load.end"].__setitem__(3, np.nan), "not finite"),
        (lambda h, a: h.update(tendons=["right"]), "12 channels for 1 tendons"),
        (lambda h, a: h["contact"].update(tension_N=[1.0]), r"contact\.tension_N = \[1\.0\], expected 2"),
        (lambda h, a: h["contact"].update(pose=[0.0] * 3), r"contact\.pose"),
        (lambda h, a: h["settings"].pop("frozen_travel_m"), "lacks the setting 'frozen_travel_m'"),
        (lambda h, a: h["column_end"].pop(), "names 40 ends of 41 columns"),
        (lambda h, a: a["load.axis_0"].__setitem__(3, 0.0), "load.axis_0 that does not rise"),
    ],
)
def test_a_well_sealed_but_wrong_file_is_refused(
    split_table: MotionTable, tmp_path: Path, change: Any, said: str
) -> None:
    """Even with a proper integrity mark, version, header and arrays must be right."""
    split_table.save(tmp_path / "good.npz")
    header, arrays = read_file(tmp_path / "good.npz")
    change(header, arrays)
    write_file(tmp_path / "bad.npz", header, arrays)
    with pytest.raises(TableError, match=said):
        MotionTable.load(tmp_path / "bad.npz")


def test_header_is_plain_json(split_table: MotionTable) -> None:
    """Parameters of hand, object and grasp can be read by any program; an infinite stiffness is the text 'inf'."""
    header = msgspec.json.decode(msgspec.json.encode(split_table.header))
    assert header["hand"]["name"] == "T42PP"
    assert header["hand"]["right"]["tendon_stiffness_N_per_m"] == "inf"
    assert header["object"]["shape"] == {"kind": "disc", "diameter_m": 0.04}
    assert header["grasp"]["onset_split"] == 0.1
    assert len(header["inputs_sha256"]) == 64


def test_a_hole_is_marked_and_not_interpolated_over(split_table: MotionTable) -> None:
    """Where a node has no solution the sample says invalid, holds the contact pose and moves nothing."""
    arrays = {name: array.copy() for name, array in split_table.arrays.items()}
    arrays["excursion.value"][10, 20] = np.nan
    table = MotionTable(split_table.header, arrays)
    step = arrays["excursion.axis_0"][1]
    sample = table.at_excursion(10.5 * step, 0.0)
    assert sample.status is Status.INVALID
    assert not sample.motion.any()
    assert not sample.jacobian.any()
    assert table.at_excursion(12.5 * step, 0.0).status is Status.INSIDE
