"""The arm on its bus: started once, and then the bus side of one control cycle.

Joint angles in rad and joint torques in N·m, DH convention; times from the project's clock. The arm's mode is the
operator's: nothing here raises it. Source: WAM reference 4.6 (time-outs), 5.1 (cycle).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import can
import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.errors import InputError, ProtocolError
from drivers.wam.bus import CanBus
from drivers.wam.frames import (
    GROUP_ARM,
    GROUP_LOWER_TORQUE,
    GROUP_UPPER_TORQUE,
    SAFETY_NODE,
    UNASKED_SAFETY_ID,
    get_property,
    is_position,
    is_property,
    parse_position,
    parse_property,
    parse_request,
    position_request,
    torque_frame,
)
from drivers.wam.parameters import JOINTS, WamParameters
from drivers.wam.properties import MOTOR_IDLE, MOTOR_TORQUE, property_id
from drivers.wam.safety_puck import ArmMode, PendantState, SafetyPuck, arm_mode
from drivers.wam.startup import ArmIdentity, Operator, StartUp
from drivers.wam.transmission import joint_to_motor_torque, motor_to_joint

_SAMPLING_DELAY_NS = 75_000
"""From the position request to the moment the encoders are sampled (WAM reference 4.7)."""
_USUAL_READING_NS = 640_000
"""From the request to the last of seven replies, with usual stuff bits. To sleep so long and then read all of them
costs half the processor time of waking for each."""
_UNANSWERED_POLLS = 10


@dataclass(frozen=True, eq=False)
class ArmSample:
    """One reading of the arm."""

    joint_rad: NDArray[np.float64]
    """Joint angles (7); with the last good position of a motor that is missing or was rejected."""
    sample_ns: int
    """When the encoders were sampled."""
    complete: bool
    """All seven positions are of this cycle and plausible."""
    replies: int
    """Good positions of this cycle, 0 to 7."""
    stale: int
    """Positions dropped because they were older than the request or came twice."""
    rejected: int
    """Positions dropped because the motor cannot have turned so far."""


class Arm:
    """Seven motor pucks and a safety puck on one bus. First `start`, then in each cycle `request_positions`,
    `collect_positions`, `write_torques`.

    Anything that the bus refuses to send raises BusError from the call that sent it.
    """

    def __init__(self, bus: CanBus, clock: Clock, parameters: WamParameters) -> None:
        self._bus = bus
        self._clock = clock
        self._parameters = parameters
        self._safety = SafetyPuck(bus, clock)
        self._safety_mode_id = property_id("MODE", self._safety.firmware, "safety")
        self._position_id = 48
        self._torque_id = 42
        self._position_groups: tuple[int, ...] = (GROUP_ARM,)
        self._counts = [0] * JOINTS
        self._missed_cycles = [0] * JOINTS
        self._quarter_turn = [1024] * JOINTS
        self._radian_per_count = np.full(JOINTS, 2.0 * np.pi / 4096.0)
        self._units_per_Nm = parameters.units_per_Nm
        self._torque_limit_units = parameters.motor_torque_limit_units
        self._request_ns = 0
        self._stale = 0
        self._unanswered = 0
        self.mode = ArmMode.OFFLINE
        """Last known mode of the arm; OFFLINE before `start` and when the safety puck no longer answers."""
        self.zeroed: bool | None = None
        """Last seen ZERO of the safety puck; False means that positions are meaningless."""
        self.pendant: PendantState | None = None
        """Last seen pendant state."""
        self.malformed_frames = 0

    def start(self, operator: Operator | None = None) -> ArmIdentity:
        """Find, wake, check and, if positions were lost, zero the arm at `home_rad`, where the operator has put it.

        Takes some 0.3 s, over a second more if pucks have to be woken, and as long as `operator` lets it wait for what
        only they can do; without one the arm must be idle. Raises NoReplyError for missing pucks, ProtocolError for an
        inconsistent arm, DeviceError in E-stop or active.
        """
        found = StartUp(self._bus, self._clock, self._parameters, self._safety, operator).run()
        motors = found.motors
        self.mode = ArmMode.IDLE
        self.zeroed = True
        self._safety_mode_id = property_id("MODE", found.safety_firmware, "safety")
        self._position_id, self._torque_id = motors.position_id, motors.torque_id
        self._position_groups = motors.position_groups
        self._quarter_turn = [counts // 4 for counts in motors.counts_per_turn]
        self._radian_per_count = 2.0 * np.pi / np.array(motors.counts_per_turn, dtype=np.float64)
        self._units_per_Nm = np.array(motors.units_per_Nm, dtype=np.float64)
        self._torque_limit_units = np.minimum(motors.torque_limit_units, self._parameters.motor_torque_limit_units)
        self._counts = list(found.first_counts)
        self._missed_cycles = [0] * JOINTS
        return found

    # --- one cycle

    def request_positions(self) -> None:
        """Ask all pucks for their positions; what still waits on the bus is read first, and its positions dropped."""
        self._stale = 0
        now_ns = self._clock.now_ns()
        while (message := self._bus.receive(now_ns)) is not None:
            if is_position(message):
                self._stale += 1
            else:
                self._notice(message)
        self._request_ns = self._clock.now_ns()
        for group in self._position_groups:
            self._bus.send(position_request(group, self._position_id))

    def collect_positions(self, deadline_ns: int) -> ArmSample:
        """Collect the replies to the last request until all seven are there or `deadline_ns` has come.

        A late reply to an earlier request that comes after this one is recognised by its puck answering twice: the
        later answer counts.
        """
        fresh = [False] * JOINTS
        replies = rejected = 0
        self._clock.sleep_until_ns(min(deadline_ns, self._request_ns + _USUAL_READING_NS))
        while replies < JOINTS and (message := self._bus.receive(deadline_ns)) is not None:
            if not is_position(message):
                self._notice(message)
                continue
            try:
                position = parse_position(message)
            except ProtocolError:
                self.malformed_frames += 1
                continue
            motor = position.node - 1
            if motor >= JOINTS:
                continue
            # A motor that was missing may have turned for longer; more than half a turn is implausible in any case.
            allowed = self._quarter_turn[motor] * min(2, 1 + self._missed_cycles[motor])
            if abs(position.motor_counts - self._counts[motor]) > allowed:
                rejected += 1
                continue
            if fresh[motor]:
                self._stale += 1
            else:
                replies += 1
            fresh[motor] = True
            self._counts[motor] = position.motor_counts
            self._missed_cycles[motor] = 0
        if replies < JOINTS:
            self._missed_cycles = [
                missed if seen else missed + 1 for seen, missed in zip(fresh, self._missed_cycles, strict=True)
            ]
        joint_rad = motor_to_joint(np.array(self._counts, dtype=np.float64) * self._radian_per_count)
        sample_ns = self._request_ns + _SAMPLING_DELAY_NS
        return ArmSample(joint_rad, sample_ns, replies == JOINTS, replies, self._stale, rejected)

    def write_torques(self, joint_torque_Nm: Sequence[float] | NDArray[np.float64]) -> None:
        """Send joint torques (7), N·m: as motor torques, each within its motor's limit, in two frames.

        InputError, and nothing sent, if they are not seven finite numbers.
        """
        torque_Nm = np.asarray(joint_torque_Nm, dtype=np.float64)
        if torque_Nm.shape != (JOINTS,) or not isfinite(torque_Nm.sum()):
            raise InputError(f"joint torques {torque_Nm.tolist()} are not acceptable; expected seven finite numbers.")
        limit = self._torque_limit_units
        units = joint_to_motor_torque(torque_Nm) * self._units_per_Nm
        values = np.minimum(np.maximum(units, -limit), limit).tolist()
        # Both frames are ready before the first goes out.
        lower = torque_frame(GROUP_LOWER_TORQUE, values[:4], self._torque_id)
        upper = torque_frame(GROUP_UPPER_TORQUE, values[4:], self._torque_id)
        self._bus.send(lower)
        self._bus.send(upper)

    def request_idle(self) -> None:
        """Ask for idle and return at once; `mode` tells when it is so. InputError before safety firmware 197."""
        self._safety.request_idle()

    def poll_safety_mode(self) -> None:
        """Ask the safety puck for its mode; a later `collect_positions` or `request_positions` notices the reply."""
        self._unanswered += 1
        if self._unanswered > _UNANSWERED_POLLS:
            self.mode = ArmMode.OFFLINE
        self._bus.send(get_property(SAFETY_NODE, self._safety_mode_id))

    def _notice(self, message: can.Message) -> None:
        """Take what the safety puck says in passing; other properties are not for us."""
        try:
            if message.arbitration_id == UNASKED_SAFETY_ID:
                self._notice_motor_mode(message)
            elif is_property(message):
                reply = parse_property(message)
                if reply.node == SAFETY_NODE:
                    self._notice_safety(reply.property_id, reply.value)
        except ProtocolError:
            self.malformed_frames += 1

    def _notice_safety(self, number: int, value: int) -> None:
        firmware = self._safety.firmware
        if number == self._safety_mode_id:
            self.mode = arm_mode(value)
            self._unanswered = 0
        elif number == property_id("ZERO", firmware, "safety"):
            self.zeroed = value == 1
        elif number == property_id("PEN", firmware, "safety"):
            self.pendant = PendantState.from_value(value)

    def _notice_motor_mode(self, message: can.Message) -> None:
        """The safety puck has told the motor pucks their mode: what the operator did, before the next poll."""
        number, value = parse_request(message)
        if number == self._safety_mode_id and value == MOTOR_TORQUE:
            self.mode = ArmMode.ACTIVE
        elif number == self._safety_mode_id and value == MOTOR_IDLE and self.mode is ArmMode.ACTIVE:
            self.mode = ArmMode.IDLE
