"""What the driver hears beside positions: the safety puck, single motor pucks, other hosts, the adapter's error frames.

Only what it was told last, and counts; what follows from it says `faults.py`. Asks nothing by itself: `question` names
what should be asked next. Source: WAM reference 1.4, 2.3, 2.6, 4.1; linux/can/error.h.
"""

from __future__ import annotations

from drivers.errors import ProtocolError
from drivers.wam.frames import (
    ERROR_FRAME,
    GROUP_BIT,
    GROUP_LOWER_TORQUE,
    GROUP_UPPER_TORQUE,
    SAFETY_NODE,
    UNASKED_SAFETY_ID,
    RawFrame,
    property_and_value,
)
from drivers.wam.parameters import JOINTS
from drivers.wam.properties import (
    MOTOR_IDLE,
    MOTOR_TORQUE,
    PENDANT_FIRMWARE,
    STATUS_MONITOR,
    property_id,
)
from drivers.wam.safety_puck import ArmMode, Light, PendantState, arm_mode

_STATUS_ID = property_id("STAT", 0, "monitor")
_PROPERTY_NODES = {GROUP_BIT | 6 | node << 5: node for node in (*range(1, JOINTS + 1), SAFETY_NODE)}
_TORQUE_IDS = (GROUP_BIT | GROUP_LOWER_TORQUE, GROUP_BIT | GROUP_UPPER_TORQUE)
_UNANSWERED_POLLS = 10
_BUS_OFF, _RESTARTED = 0x40, 0x100


class ArmWatch:
    """The last word of everybody on the bus. Counters only grow; `forget` begins anew."""

    def __init__(self) -> None:
        self.mode = ArmMode.OFFLINE
        """Last known mode of the arm; OFFLINE before start-up and when the safety puck no longer answers."""
        self.zeroed: bool | None = None
        """Last seen ZERO of the safety puck; False means that positions are meaningless."""
        self.pendant: PendantState | None = None
        """Last seen pendant state."""
        self.pendants_seen = 0
        self.motor_modes: dict[int, int] = {}
        """MODE of motor pucks by node, as far as the safety puck has said since that the arm's mode is the same."""
        self._motor_modes: dict[int, int] = {}
        self.reset_nodes: set[int] = set()
        """Motor pucks that were seen in their boot monitor: their positions are lost."""
        self.bus_off = False
        """The adapter has said that it left the bus, and not yet that it is back."""
        self.error_frames = self.malformed = self.foreign_torques = self.raised_modes = self.unknown = 0
        self._unanswered = 0
        self._turn = 0
        self._learn(197, 200)

    def _learn(self, safety_firmware: int, motor_firmware: int) -> None:
        self._tells_pendant = safety_firmware >= PENDANT_FIRMWARE
        self._motor_mode_id = property_id("MODE", motor_firmware, "motor")
        self.safety_mode_id = property_id("MODE", safety_firmware, "safety")
        self._zero_id = property_id("ZERO", safety_firmware, "safety")
        self._pendant_id = property_id("PEN", safety_firmware, "safety")

    def forget(self, safety_firmware: int, motor_firmware: int) -> None:
        """Start-up has found an idle arm whose positions are right."""
        self._learn(safety_firmware, motor_firmware)
        self._change_mode(ArmMode.IDLE)
        self.zeroed, self.pendant = True, None
        self.reset_nodes.clear()
        self.bus_off = False
        self._unanswered = 0

    # --- asking

    def question(self, missing: tuple[int, ...]) -> RawFrame:
        """What to ask next, one at a time: of an arm with `missing` nodes its mode and in turn their state, otherwise
        the pendant, ZERO and the motors' modes in turn."""
        self._turn += 1
        if missing:
            if self._turn % 2:
                return self.mode_question()
            return missing[self._turn // 2 % len(missing)], bytes((_STATUS_ID,))
        if self._turn % 2 and self._tells_pendant:
            return SAFETY_NODE, bytes((self._pendant_id,))
        place = self._turn // 2 % (JOINTS + 1)
        return (place, bytes((self._motor_mode_id,))) if place else (SAFETY_NODE, bytes((self._zero_id,)))

    def mode_question(self) -> RawFrame:
        """Ask for the arm's mode; ten without answer make it OFFLINE."""
        self._unanswered += 1
        if self._unanswered > _UNANSWERED_POLLS:
            self.mode = ArmMode.OFFLINE
        return SAFETY_NODE, bytes((self.safety_mode_id,))

    def pendant_question(self) -> RawFrame | None:
        """Ask what the pendant shows; None if this safety puck does not tell."""
        return (SAFETY_NODE, bytes((self._pendant_id,))) if self._tells_pendant else None

    # --- hearing

    def notice(self, identifier: int, data: bytes) -> None:
        """Take a frame that is no position. Never raises."""
        node = _PROPERTY_NODES.get(identifier)
        try:
            if node is not None:
                number, value = property_and_value(identifier, data)
                (self._hear_safety if node == SAFETY_NODE else self._hear_motor)(node, number, value)
            elif identifier == UNASKED_SAFETY_ID:
                self._hear_order(*property_and_value(identifier, data))
            elif identifier & ERROR_FRAME:
                self._hear_adapter(identifier)
            elif identifier & GROUP_BIT and identifier < GROUP_BIT | 0x20:
                self._hear_host(identifier, data)
            else:
                self.unknown += 1
        except ProtocolError:
            self.malformed += 1

    def _hear_safety(self, node: int, number: int, value: int) -> None:
        if number == self.safety_mode_id:
            self._unanswered = 0
            if self.mode is arm_mode(value):
                self.motor_modes.update(self._motor_modes)
            self._change_mode(arm_mode(value))
        elif number == self._zero_id:
            if value in (0, 1):  # anything else is a damaged answer
                self.zeroed = value == 1
        elif number == self._pendant_id:
            self.pendant = PendantState.from_value(value)
            self.pendants_seen += 1
            if self.pendant.other is Light.FAULT:  # only E-stop lights it
                self._change_mode(ArmMode.ESTOP)

    def _hear_motor(self, node: int, number: int, value: int) -> None:
        if number == _STATUS_ID:
            if value == STATUS_MONITOR:
                self.reset_nodes.add(node)
        elif number == self._motor_mode_id:
            self._motor_modes[node] = value

    def _hear_order(self, number: int, value: int) -> None:
        """The safety puck has told the motor pucks their mode: what the operator did, before the next poll."""
        if number == self.safety_mode_id and value == MOTOR_TORQUE:
            self._change_mode(ArmMode.ACTIVE)
        elif number == self.safety_mode_id and value == MOTOR_IDLE and self.mode is not ArmMode.ESTOP:
            self._change_mode(ArmMode.IDLE)

    def _change_mode(self, mode: ArmMode) -> None:
        if mode is not self.mode:
            self.mode = mode
            self.motor_modes.clear()
            self._motor_modes.clear()

    def _hear_host(self, identifier: int, data: bytes) -> None:
        """Another host speaks to all pucks of a group: its torques, and modes that are the operator's to raise."""
        if identifier in _TORQUE_IDS and len(data) == 8:
            self.foreign_torques += 1
        elif len(data) in (4, 6) and data[0] == 0x80 | self._motor_mode_id and int.from_bytes(data[2:], "little"):
            self.raised_modes += 1

    def _hear_adapter(self, identifier: int) -> None:
        self.error_frames += 1
        if identifier & _BUS_OFF:
            self.bus_off = True
        elif identifier & _RESTARTED:
            self.bus_off = False
