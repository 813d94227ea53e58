"""The arm on its bus: start-up, and the bus side of one control cycle.

Joint angles in rad and joint torques in N·m, DH convention; times from the project's clock. The arm's mode is the
operator's: nothing here raises it. Source: WAM reference 4.2 and 4.4 (start-up), 4.6 (time-outs), 5.1 (cycle).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import can
import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock, nanoseconds
from drivers.errors import DeviceError, InputError, NoReplyError, ProtocolError
from drivers.wam.bus import CanBus, ask_property
from drivers.wam.frames import (
    GROUP_ARM,
    GROUP_BIT,
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
    set_property,
    torque_frame,
)
from drivers.wam.parameters import JOINTS, WamParameters
from drivers.wam.properties import (
    MOTOR_IDLE,
    MOTOR_TORQUE,
    STATUS_MONITOR,
    STATUS_READY,
    property_id,
)
from drivers.wam.safety_puck import ArmMode, PendantState, SafetyPuck, arm_mode
from drivers.wam.transmission import joint_to_motor, joint_to_motor_torque, motor_to_joint

NODES = range(1, JOINTS + 1)
_WAKE_PAUSE_NS = nanoseconds(0.01)
_WAKE_SILENCE_NS = nanoseconds(1.0)
_REPLY_TIMEOUT_NS = nanoseconds(0.05)
_FIRST_READ_NS = nanoseconds(0.05)
_SAMPLING_DELAY_NS = 75_000
"""From the position request to the moment the encoders are sampled (WAM reference 4.7)."""
_USUAL_READING_NS = 640_000
"""From the request to the last of seven replies, with usual stuff bits. To sleep so long and then read all of them
costs half the processor time of waking for each."""
_VELOCITY_SAMPLES_IGNORED = 5
_UNANSWERED_POLLS = 10
_ROLE_KIND = 0x1F


@dataclass(frozen=True)
class ArmIdentity:
    """What start-up found; tuples in motor order 1 to 7."""

    motor_firmware: tuple[int, ...]
    safety_firmware: int
    counts_per_turn: tuple[int, ...]
    units_per_Nm: tuple[int, ...]
    woken: tuple[int, ...]
    """Nodes that were in their boot monitor."""
    zeroed_at_home: bool
    """True if this start-up declared the present pose to be home; False if the pucks remembered their positions."""


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
        self._motor_firmware: tuple[int, ...] = ()
        self._safety_mode_id = property_id("MODE", self._safety.firmware, "safety")
        self._position_id = 48
        self._torque_id = 42
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

    # --- start-up

    def start(self) -> ArmIdentity:
        """Find, wake, check and, if positions were lost, zero the arm at `home_rad`, where the operator has put it.

        Takes some 20 ms, and over a second if pucks have to be woken. Needs the arm in idle. Raises NoReplyError for
        missing pucks, ProtocolError for an inconsistent arm, DeviceError in E-stop or active.
        """
        self.mode = self._safety.mode()
        self._safety.firmware = self._safety.get("VERS")
        self._safety_mode_id = property_id("MODE", self._safety.firmware, "safety")
        self._require_idle()
        woken = self._wake(self._enumerate())
        self._motor_firmware = tuple(self._ask(node, 0, "VERS") for node in NODES)
        self._check_pucks()
        counts_per_turn = self._ask_all("CTS")
        units_per_Nm = self._ask_all("IPNM")
        for name, values in (("CTS", counts_per_turn), ("IPNM", units_per_Nm)):
            if min(values) <= 0:
                raise ProtocolError(
                    "WAM", f"{name} is {values}; expected positive numbers.", help="Repair the puck's settings."
                )
        self._quarter_turn = [counts // 4 for counts in counts_per_turn]
        self._radian_per_count = 2.0 * np.pi / np.array(counts_per_turn, dtype=np.float64)
        self._units_per_Nm = np.array(units_per_Nm, dtype=np.float64)
        self._bus.send(set_property(GROUP_BIT | GROUP_ARM, self._motor_id("MODE"), MOTOR_IDLE))
        self.zeroed = self._safety.get("ZERO") == 1
        zero_now = not self.zeroed
        # Without this the safety puck takes movement before start-up, or the jump of zeroing, for a velocity fault.
        self._safety.set("IFAULT", _VELOCITY_SAMPLES_IGNORED)
        if zero_now:
            self._zero_at_home(np.array(counts_per_turn, dtype=np.float64))
        self._read_first_positions()
        return ArmIdentity(
            self._motor_firmware, self._safety.firmware, counts_per_turn, units_per_Nm, woken, zeroed_at_home=zero_now
        )

    def _require_idle(self) -> None:
        if self.mode is ArmMode.ESTOP:
            help_text = "Release E-stop, press Shift-Idle, wait four seconds and start again."
            raise DeviceError("WAM", "the arm is in E-stop; expected idle.", help=help_text)
        if self.mode is ArmMode.ACTIVE:
            raise DeviceError("WAM", "the arm is active; expected idle.", help="Press Shift-Idle and start again.")

    def _enumerate(self) -> dict[int, int]:
        """STAT of each motor puck. NoReplyError, naming all that are silent."""
        statuses = {node: self._ask_or_none(node, property_id("STAT", 0, "monitor")) for node in NODES}
        silent = [node for node, status in statuses.items() if status is None]
        if silent:
            raise NoReplyError(
                "WAM",
                f"pucks {silent} of 1 to 7 do not answer.",
                help="Check power and the cables of the arm; after an E-stop wait four seconds.",
            )
        return {node: status for node, status in statuses.items() if status is not None}

    def _wake(self, statuses: dict[int, int]) -> tuple[int, ...]:
        """Start the main firmware of pucks in their boot monitor, with the silences that keep the bus alive."""
        status_id = property_id("STAT", 0, "monitor")
        asleep = tuple(node for node, status in statuses.items() if status == STATUS_MONITOR)
        for node in asleep:
            self._bus.send(set_property(node, status_id, STATUS_READY))
            self._pause(_WAKE_PAUSE_NS)
        if asleep:
            self._pause(_WAKE_SILENCE_NS)
        for node in NODES:
            status = self._ask(node, status_id, "STAT")
            if status != STATUS_READY:
                help_text = "Switch the arm off and on again."
                raise DeviceError(
                    f"puck {node}", f"STAT is {status} after waking; expected {STATUS_READY}.", help=help_text
                )
        return asleep

    def _check_pucks(self) -> None:
        """Refuse pucks that would take another's torque, or would not hear the position request."""
        for name in ("P", "T"):
            numbers = {property_id(name, firmware, "motor") for firmware in self._motor_firmware}
            if len(numbers) > 1:
                message = (
                    f"firmware {self._motor_firmware} numbers property {name} in {len(numbers)} ways; expected one."
                )
                raise ProtocolError("WAM", message, help="Have the pucks updated to the same firmware.")
        self._position_id, self._torque_id = self._motor_id("P"), self._motor_id("T")
        for node, role in zip(NODES, self._ask_all("ROLE"), strict=True):
            if role & _ROLE_KIND:
                raise ProtocolError(
                    f"puck {node}", f"ROLE {role:#06x} is not an arm motor's.", help="Check the puck's place."
                )
        expected_place = (1, 2, 3, 4, 1, 2, 3)
        places = self._ask_all("PIDX")
        if places != expected_place:
            help_text = "A puck was exchanged: write its PIDX with the vendor's btutil."
            raise ProtocolError("WAM", f"PIDX of pucks 1 to 7 is {places}; expected {expected_place}.", help=help_text)
        for name, wanted in (("GRPB", (1, 1, 1, 1, 2, 2, 2)), ("GRPC", (GROUP_ARM,) * JOINTS)):
            groups = self._ask_all(name)
            if groups != wanted:
                help_text = f"Write {name} of the pucks that differ with the vendor's btutil."
                raise ProtocolError("WAM", f"{name} of pucks 1 to 7 is {groups}; expected {wanted}.", help=help_text)

    def _zero_at_home(self, counts_per_turn: NDArray[np.float64]) -> None:
        home_counts = np.floor(counts_per_turn / (2.0 * np.pi) * joint_to_motor(self._parameters.home_rad))
        for node, counts in zip(NODES, home_counts, strict=True):
            self._bus.send(set_property(node, self._position_id, int(counts)))
            self._ask(node, property_id("STAT", 0, "monitor"), "STAT")  # not to overflow the puck's receive buffer
        # One reading in between lets the safety puck see the new positions while it ignores the jump.
        self._read_first_positions()
        self._safety.set("ZERO", 1)
        self.zeroed = True

    def _read_first_positions(self) -> None:
        """Take positions as they come, whatever was known before. NoReplyError if not all seven answer."""
        counts: dict[int, int] = {}
        self.request_positions()
        deadline_ns = self._clock.now_ns() + _FIRST_READ_NS
        while len(counts) < JOINTS:
            message = self._bus.receive(deadline_ns)
            if message is None:
                silent = [node for node in NODES if node not in counts]
                raise NoReplyError("WAM", f"pucks {silent} report no position.", help="Check the arm's cables.")
            try:
                position = parse_position(message)
            except ProtocolError:
                continue
            if position.node in NODES:
                counts[position.node] = position.motor_counts
        self._counts = [counts[node] for node in NODES]
        self._missed_cycles = [0] * JOINTS

    def _motor_id(self, name: str) -> int:
        return property_id(name, self._motor_firmware[0], "motor")

    def _ask_all(self, name: str) -> tuple[int, ...]:
        firmware = zip(NODES, self._motor_firmware, strict=True)
        return tuple(self._ask(node, property_id(name, version, "motor"), name) for node, version in firmware)

    def _ask(self, node: int, number: int, name: str) -> int:
        value = self._ask_or_none(node, number)
        if value is None:
            raise NoReplyError(f"puck {node}", f"no reply to {name} within 50 ms.", help="Check the arm's cables.")
        return value

    def _ask_or_none(self, node: int, number: int) -> int | None:
        return ask_property(self._bus, node, number, self._clock.now_ns() + _REPLY_TIMEOUT_NS)

    def _pause(self, duration_ns: int) -> None:
        self._clock.sleep_until_ns(self._clock.now_ns() + duration_ns)

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
        self._bus.send(position_request(GROUP_ARM, self._position_id))

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
