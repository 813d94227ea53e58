"""Whole grasps on virtual time with calibrated pads on the fingertips, against the world's own truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from mcap.reader import make_reader
from numpy.typing import NDArray

from calibration.motion_table import MotionTable
from controller.config import RobotConfig, Tactile
from controller.service.assembly import configured_hand
from controller.service.recorder import Recorder
from controller.service.tactile_assembly import configured_pads
from controller.simulation.demo_cases import GraspCase, approach_joints, preposition, table_name
from controller.simulation.scene import build_devices
from controller.simulation.truth import WorldObserver
from controller.simulation.virtual_robot import VirtualRobot
from controller.simulation.world import World
from drivers.simulated.faults import Fault
from drivers.simulated.takktile_fault_actions import Unplug
from drivers.takktile.compensation import unpack_coefficients
from drivers.takktile.frames import Cell
from tests.system.pad_calibration import calibrated

pytestmark = pytest.mark.slow
CELLS = tuple((row, column) for row, columns in ((0, 5), (1, 3)) for column in range(columns))
TACTILE = Tactile(
    interface="socket",
    channel="memory",
    right_cells=CELLS,
    left_cells=tuple((row + 2, column) for row, column in CELLS),
)
TOLERANCE_N, TOLERANCE = 0.1, 0.03
"""Of the sum of contact forces: noise of 16 cells, and the calibration's own error."""


class Robot:
    """A robot with pads, near the object; it notes the true excursions at which each fingertip first touches, and the
    true contact forces over time."""

    def __init__(self, config: RobotConfig, case: GraspCase, recording: Path) -> None:
        table = MotionTable.load(Path(config.tables.directory) / f"{table_name(case)}.npz")
        joints = tuple(approach_joints(config, table, case))
        self.case, self.config = case, config
        self.touched: dict[int, float] = {}
        self.true_N: list[tuple[int, float]] = []
        self.recorder = Recorder(recording)
        self.virtual = VirtualRobot(
            config,
            replace(case.scene, joint_rad=joints),
            observe=self._note,
            record_pads=self.recorder.record_pads,
        )
        self.observer = WorldObserver(self.virtual.world, configured_hand(config))
        self.virtual.activate()
        self.client = self.virtual.client()

    def close(self, rate_m_s: float) -> NDArray[np.float64]:
        """Preposition and close; the excursions that were found, (2,)."""
        preposition(self.client, self.case, approach_m=0.02)
        self.touched.clear()
        return np.array(self.client.grasp_close(rate_m_s=rate_m_s).wait()["contact_excursion_m"])

    def state(self) -> Any:
        return self.client.status()["state"]

    def codes(self) -> list[str]:
        """Codes of the events that no request caused."""
        self.client.poll()
        return [event.fields["code"] for event in self.client.events if "code" in event.fields]

    def _note(self, world: World) -> None:
        force_N = world.fingertip_force_N()
        self.true_N.append((self.virtual.time.now_ns, sum(force_N)))
        for finger, one_N in enumerate(force_N):
            if one_N > 0.0 and finger not in self.touched:
                self.touched[finger] = float(self.observer.truth().tendon_excursion_m[finger])


@pytest.fixture(scope="module")
def robot(config: RobotConfig, symmetric_case: GraspCase, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """With the calibration that the same pads got before, by weights."""
    directory = tmp_path_factory.mktemp("pads")
    tactile = msgspec.structs.replace(TACTILE, own_file=str(directory / "tactile.toml"))
    config = msgspec.structs.replace(config, tactile=tactile)
    twin = build_devices(config, configured_hand(config), symmetric_case.scene).pads
    assert twin is not None
    fits = calibrated(tactile, twin, directory / "tactile.toml")
    assert all(found.accepted() for found in fits)
    return Robot(config, symmetric_case, directory / "pads.mcap")


@pytest.mark.parametrize("rate_m_s", [0.010, 0.020])
def test_contact_is_where_the_fingertips_touched(robot: Robot, rate_m_s: float) -> None:
    """At two closing speeds: within 0.1 mm of excursion of the world's first contact of each finger, and the state
    tells both forces as the world has them."""
    if robot.state()["grasp"]["phase"] != "none":
        robot.client.grasp_release().wait()
    found_m = robot.close(rate_m_s)
    true_m = np.array([robot.touched[0], robot.touched[1]])
    assert found_m == pytest.approx(true_m, abs=1e-4)
    robot.virtual.run_for(0.2)
    assert robot.state()["tactile"]["force_N"] == pytest.approx(robot.observer.truth().contact_force_N, abs=0.1)


def test_the_sum_of_contact_forces_is_the_worlds(robot: Robot) -> None:
    """Through the squeeze after contact, frame by frame of the recording: within 0.1 N and 3 % of the world's sum."""
    start_ns = robot.virtual.time.now_ns
    done: list[float] = []
    robot.client.grasp_squeeze(load_N=60.0, duration_s=1.0).wait(on_progress=lambda told: done.append(told["done"]))
    assert len(done) >= 5
    assert done == sorted(done)
    robot.virtual.run_for(0.3)
    assert robot.state()["tactile"]["touching"] == [True, True]
    robot.recorder.close()
    times_ns, told_N = [], []
    for frame, time_ns in frames(robot.recorder.path):
        if time_ns >= start_ns:
            times_ns.append(time_ns)
            told_N.append(sum(frame["force_N"]))
    world_ns, world_N = np.array(robot.true_N).T
    true_N = np.interp(times_ns, world_ns, world_N)
    assert len(told_N) > 100
    assert true_N.max() > 5.0
    assert np.abs(np.array(told_N) - true_N).max() < TOLERANCE_N + TOLERANCE * true_N.max()


def test_a_recorded_grasp_can_be_evaluated_again(robot: Robot) -> None:
    """From raw words, coefficients, zeros and temperatures of the file alone, with the calibration at hand: the forces
    that were told."""
    pads = configured_pads(robot.config.tactile or TACTILE)
    gain = {cell: g for pad in pads for cell, g in zip(pad.cells, pad.gain_N_per_count, strict=True)}
    seen = 0
    for frame, _ in frames(robot.recorder.path):
        force_N = [0.0, 0.0]
        for i, place in enumerate(frame["place"]):
            cell, chip = Cell(*place), bytes.fromhex(frame["coefficients"][i])
            c, t, p = unpack_coefficients(chip, cell), frame["temperature"][i], frame["pressure"][i]
            counts = c.a0 + (c.b1 + c.c12 * t) * p + c.b2 * t - frame["zero_counts"][i]
            if frame["quality"][i] == 0:
                force_N[frame["finger"][i]] += gain[cell] * counts
                seen += 1
        assert force_N == pytest.approx(frame["force_N"], abs=1e-4)
    assert seen > 1000


def test_pads_unplugged_while_holding_are_no_fault(robot: Robot) -> None:
    """Told as lost and as found; in between nothing is known of them, and the grasp goes on holding."""
    assert robot.virtual.devices.pads is not None
    before = robot.state()["grasp"]["phase"]
    robot.virtual.devices.pads.add_fault(Fault(action=Unplug(), for_s=0.8), robot.virtual.time.now_ns)
    robot.virtual.run_for(0.4)
    status = robot.client.status()
    assert "motors' load finds contact" in status["tactile_lost"]
    assert not status["state"]["tactile"]["present"]
    robot.virtual.run_for(1.0)
    status = robot.client.status()
    assert status["tactile_lost"] == ""
    assert status["state"]["tactile"]["valid_cells"] == [8, 8]
    assert status["state"]["tactile"]["force_N"] == pytest.approx(robot.observer.truth().contact_force_N, rel=0.03)
    assert status["state"]["grasp"]["phase"] == before
    assert robot.codes()[-2:] == ["tactile_lost", "tactile_found"]
    robot.client.grasp_release().wait()


def test_pads_that_are_lost_leave_contact_to_the_motors(robot: Robot) -> None:
    """Unplugged before the grasp: it closes all the same, and finds contact by load."""
    assert robot.virtual.devices.pads is not None
    robot.virtual.devices.pads.unplugged = True
    found_m = robot.close(0.020)
    true_m = np.array([robot.touched[0], robot.touched[1]])
    assert found_m == pytest.approx(true_m, abs=1e-4)
    assert robot.state()["grasp"]["phase"] == "contact"


def frames(path: Path) -> list[tuple[Any, int]]:
    """The pads' frames of a recording, with their times."""
    with path.open("rb") as stream:
        found = make_reader(stream).iter_messages(topics=["/tactile"])
        return [(msgspec.json.decode(message.data), message.log_time) for _, _, message in found]
