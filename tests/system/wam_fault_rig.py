"""A robot on virtual time that is brought to a phase once, and then split in two for every fault: a fork of the process
lives through it and tells what it saw. So every fault meets the very same robot, to the bit.

Times in ns, angles in rad, torques in N·m. What is so is read from the world, the pucks and the wire; what the daemon
says, from its front, as a client would.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from calibration.motion_table import MotionTable
from controller.config import RobotConfig
from controller.simulation.demo_cases import GraspCase, approach_joints, preposition, table_name
from controller.simulation.virtual_robot import VirtualRobot
from controller.simulation.world import World
from drivers.clock import nanoseconds
from drivers.errors import StillgraspError
from drivers.simulated.can_wire import Frame, TimedFrame
from drivers.simulated.faults import Fault, FaultScript
from drivers.wam.parameters import load_wam_parameters
from drivers.wam.transmission import joint_to_motor_torque
from tests.system.forked import in_a_fork

PERIOD_NS = nanoseconds(0.002)
STILL_RAD_S = 0.05
_TORQUE_IDS = (0x401, 0x402)
_TORQUE_BYTE = 0x80 | 42
"""SET of property T, of all firmware from 61 on (WAM reference 3.1)."""
_MOVE_RAD = 0.5
_LONGEST_START_S = 6.0


@dataclass
class Seen:
    """What a robot went through after its fault, in plain values; times from the fault on."""

    refusal: tuple[str, str, str] | None = None
    """Class, message and help of the error with which start-up ended."""
    started: bool = False
    modes: list[tuple[float, int]] = field(default_factory=list)
    """When the safety puck's MODE changed, and to what; first as the fault found it."""
    still_s: float = 0.0
    """From when on the joints stood."""
    command_still_s: float = 0.0
    """From when on the commanded joints stood."""
    fault_s: float | None = None
    """When the daemon's record first named a fault."""
    status: dict[str, Any] = field(default_factory=dict)
    told: list[dict[str, Any]] = field(default_factory=list)
    """Events that no command caused, with code, message and help."""
    cycles: int = 0
    """Cycles that ended, of those that were due in `duration_s`."""
    duration_s: float = 0.0
    torque_frames: int = 0
    stale_torques: list[str] = field(default_factory=list)
    """Torque frames that were on the wire in another period than the one that computed them."""
    own_torques: int = 0
    position_error_rad: float = 0.0
    """The most by which a position that the cycle took differed from the joints'."""
    moved_rad: float = 0.0
    """The most that a joint moved altogether."""
    virtual_s: float = 0.0

    @property
    def mode(self) -> int:
        """The safety puck's MODE in the end."""
        return self.modes[-1][1]

    @property
    def fault(self) -> str:
        """The fault that `status` names in the end."""
        return str(self.status["state"]["grasp"]["fault"]) if self.status.get("state") else ""

    @property
    def arm(self) -> str:
        """The arm's state that `status` names in the end."""
        return str(self.status["state"]["arm"]["state"]) if self.status.get("state") else ""


class Recorder:
    """Keeps of every cycle what the checks need."""

    def __init__(self) -> None:
        self.cycles: list[tuple[int, dict[str, Any]]] = []

    def record_cycle(self, record: dict[str, Any], time_ns: int) -> None:
        kept = ("cycle", "reason", "joint_rad", "joint_command_rad_s", "joint_torque_Nm", "can_replies")
        self.cycles.append((time_ns, {name: record[name] for name in kept}))

    def event(self, event: dict[str, Any], time_ns: int) -> None:
        """Events are read by the client."""


class WireTap:
    """Notes every torque frame that the pucks hear, with the time at which it ended on the wire."""

    def __init__(self, hear: Callable[[Frame, int], list[TimedFrame]]) -> None:
        self._hear = hear
        self.torques: list[tuple[int, Frame]] = []

    def receive(self, frame: Frame, now_ns: int) -> list[TimedFrame]:
        if frame.identifier in _TORQUE_IDS and len(frame.data) == 8:
            self.torques.append((now_ns, frame))
        return self._hear(frame, now_ns)


class Robot:
    """A whole robot in front of a world, with an empty fault script."""

    def __init__(self, config: RobotConfig, case: GraspCase, *, at_home: bool = False) -> None:
        """Before its start-up, near the object or `at_home`; there the operator holds the arm: nothing has weight."""
        table = MotionTable.load(Path(config.tables.directory) / f"{table_name(case)}.npz")
        self._case = case
        home_rad = load_wam_parameters().home_rad.tolist()
        joints = tuple(home_rad if at_home else approach_joints(config, table, case))
        self.recorder = Recorder()
        self.world_seen: list[tuple[int, int, NDArray[np.float64], float]] = []
        """Time, MODE, joint angles and the greatest joint speed."""
        self.virtual = VirtualRobot(
            config,
            replace(case.scene, joint_rad=joints),
            recorder=self.recorder,
            observe=self._observe,
            observe_period_s=0.001,
            faults=FaultScript(),
        )
        self.wam = self.virtual.devices.wam
        self.tap = WireTap(self.wam.receive)
        self.wam.receive = self.tap.receive  # type: ignore[method-assign]  # the tap stands before the pucks
        self.client = self.virtual.client()
        if at_home:
            self.virtual.world.parts.model.opt.gravity[:] = 0.0

    def _observe(self, world: World) -> None:
        speed = float(np.abs(world.joint_velocity_rad_s()).max())
        self.world_seen.append((self.virtual.time.now_ns, self.wam.mode, world.joint_position_rad(), speed))

    def to_idle(self) -> None:
        """Started up, under control, waiting for the operator."""
        self._start_up()
        self.client.hello()
        self.virtual.run_for(0.05)

    def _start_up(self) -> None:
        """Until cycles are recorded."""
        end_ns = self.virtual.time.now_ns + nanoseconds(_LONGEST_START_S)
        while not self.recorder.cycles and self.virtual.time.now_ns < end_ns:
            self.virtual.run_for(0.01)

    def to_moving(self) -> None:
        """In the midst of a motion of the first joint."""
        self.to_idle()
        self.virtual.press("activate")
        self.virtual.run_for(0.1)
        target = self.virtual.world.joint_position_rad()
        target[0] += _MOVE_RAD
        self.client.arm_move_joints(target.tolist(), speed=0.5)
        self.virtual.run_for(0.3)

    def to_squeezing(self) -> None:
        """In the midst of a squeeze."""
        self.to_idle()
        self.virtual.press("activate")
        self.virtual.run_for(0.1)
        case = self._case
        preposition(self.client, case, approach_m=0.02)
        self.client.grasp_close().wait()
        self.client.grasp_squeeze(load_N=66.0, duration_s=1.6)
        self.virtual.run_for(0.4)

    def suffer(self, faults: Sequence[Fault[Any]], duration_s: float) -> Seen:
        """Have faults, timed from now, and tell what came of it after `duration_s`."""
        seen = Seen(duration_s=duration_s)
        started_before = bool(self.recorder.cycles)
        # In step with the cycle: when in a period a fault comes is the fault's to say.
        begin_ns = self.virtual.cycle.pacer.deadline_ns if started_before else 0
        if started_before:
            self.client.poll()  # which lets time begin
        events_before = len(self.client.events)
        self.recorder.cycles = self.recorder.cycles[-3:]
        self.tap.torques.clear()
        self.world_seen = self.world_seen[-3:]
        modes = [(0.0, self.wam.mode)]
        offset_s = (begin_ns - self.virtual.time.now_ns) * 1e-9
        for fault in faults:
            self.virtual.add_fault(msgspec.structs.replace(fault, at_s=fault.at_s + offset_s))
        try:
            if not started_before:
                self._start_up()
                seen.started = bool(self.recorder.cycles)
            self.virtual.run_for(duration_s)
            seen.status = self.client.status()
        except StillgraspError as error:
            seen.refusal = type(error).__name__, error.message, error.help
        self.client.poll()
        seen.told = [
            {"event": event.event, **event.fields}
            for event in list(self.client.events)[events_before:]
            if event.seq is None
        ]
        end_ns = self.virtual.time.now_ns
        seen.virtual_s = (end_ns - begin_ns) * 1e-9
        for time_ns, mode, _, _ in self.world_seen:
            if mode != modes[-1][1]:
                modes.append(((time_ns - begin_ns) * 1e-9, mode))
        seen.modes = modes
        self._judge_motion(seen, begin_ns)
        self._judge_torques(seen)
        return seen

    def _judge_motion(self, seen: Seen, begin_ns: int) -> None:
        after = [entry for entry in self.world_seen if entry[0] >= begin_ns]
        moving = [time_ns for time_ns, _, _, speed in after if speed > STILL_RAD_S]
        seen.still_s = (moving[-1] - begin_ns) * 1e-9 if moving else 0.0
        if after:
            seen.moved_rad = float(np.abs(np.array([q for _, _, q, _ in after]) - after[0][2]).max())
        cycles = [(time_ns, record) for time_ns, record in self.recorder.cycles if time_ns >= begin_ns]
        seen.cycles = len(cycles)
        commanded = [time_ns for time_ns, record in cycles if max(map(abs, record["joint_command_rad_s"])) > 1e-3]
        seen.command_still_s = (commanded[-1] - begin_ns) * 1e-9 if commanded else 0.0
        named = [time_ns for time_ns, record in cycles if record["reason"]]
        seen.fault_s = (named[0] - begin_ns) * 1e-9 if named else None
        if cycles and after:
            times = np.array([entry[0] for entry in after])
            angles = np.array([entry[2] for entry in after])
            for time_ns, record in cycles:
                if record["can_replies"] < 7:
                    continue
                truth = [np.interp(time_ns, times, angles[:, joint]) for joint in range(7)]
                error = float(np.abs(np.array(record["joint_rad"]) - truth).max())
                seen.position_error_rad = max(seen.position_error_rad, error)

    def _judge_torques(self, seen: Seen) -> None:
        """Every torque frame on the wire is the one that the cycle of that very period has computed."""
        parameters = load_wam_parameters()
        times = np.array([time_ns for time_ns, _ in self.recorder.cycles])
        seen.torque_frames = len(self.tap.torques)
        for end_ns, frame in self.tap.torques:
            place = int(np.searchsorted(times, end_ns, side="right")) - 1
            if place < 0 or place == len(times) - 1:
                continue  # before the first record that was kept, or of a cycle whose record is on its way
            torque_Nm = np.array(self.recorder.cycles[place][1]["joint_torque_Nm"])
            units = joint_to_motor_torque(torque_Nm) * parameters.units_per_Nm
            limit = parameters.motor_torque_limit_units
            values = [*np.clip(units, -limit, limit).tolist(), 0.0]
            four = values[:4] if frame.identifier == _TORQUE_IDS[0] else values[4:]
            if not _carries(frame.data, four):
                seen.stale_torques.append(f"{(end_ns - times[0]) * 1e-6:.3f} ms: {frame.data.hex()}")
            elif end_ns - times[place] >= PERIOD_NS:
                seen.stale_torques.append(f"{(end_ns - times[0]) * 1e-6:.3f} ms: late")
            else:
                seen.own_torques += 1


def _carries(data: bytes, units: Sequence[float]) -> bool:
    """Whether these are the torques of a frame: floored puck units, four times 14 bits behind the property's byte; a
    millionth may decide between two of them."""
    bits = int.from_bytes(data, "big")
    for place, wanted in enumerate((*units, 0.0)[:4]):
        value = bits >> 14 * (3 - place) & 0x3FFF
        signed = value - 0x4000 if value & 0x2000 else value
        if not -1e-6 <= wanted - signed < 1.0 + 1e-6:
            return False
    return len(data) == 8 and data[0] == _TORQUE_BYTE


def split(robot: Robot, faults: Sequence[Fault[Any]], duration_s: float) -> Seen:
    """Let a fork of this process have the faults; the robot here stays as it is."""
    return in_a_fork(lambda: robot.suffer(faults, duration_s))
