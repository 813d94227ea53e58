"""The safety puck: the arm's mode, its limits, the pendant's lights; and the guard that idles an abandoned arm.

The pendant is the operator's. The host only ever lowers the mode, and only safety firmware from 197 on listens to that.
Source: WAM reference 2.6 (pendant), 4.1 (modes), 4.3 (limits).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import isfinite

from drivers.clock import Clock, nanoseconds
from drivers.errors import BusError, InputError, NoReplyError, ProtocolError
from drivers.wam.bus import CanBus, ask_property
from drivers.wam.frames import GROUP_LOWER_TORQUE, GROUP_UPPER_TORQUE, SAFETY_NODE, set_property, torque_frame
from drivers.wam.properties import (
    IDLE_REQUEST_FIRMWARE,
    SAFETY_ACTIVE,
    SAFETY_ESTOP,
    SAFETY_IDLE,
    property_id,
)

REPLY_TIMEOUT_NS = nanoseconds(0.05)
CONFIGURATION_PAUSE_NS = nanoseconds(0.01)
"""Between two settings: the safety puck loses them when they come faster (WAM reference 2.2)."""
_WARNING_SHARE = 0.9
_VELOCITY_UNIT = 4096  # a metre per second, Q4.12
_TORQUE_UNIT = 2700  # a N·m of motor torque, motors 1 to 4


class ArmMode(Enum):
    """State of the arm as the safety puck reports it; `OFFLINE` when it does not report."""

    OFFLINE = "offline"
    ESTOP = "estop"
    IDLE = "idle"
    ACTIVE = "active"


_MODES = {SAFETY_ESTOP: ArmMode.ESTOP, SAFETY_IDLE: ArmMode.IDLE, SAFETY_ACTIVE: ArmMode.ACTIVE}


def arm_mode(value: int) -> ArmMode:
    """The safety puck's MODE as `ArmMode`; ProtocolError for any other value."""
    try:
        return _MODES[value]
    except KeyError:
        raise ProtocolError("safety puck", f"MODE {value} is unknown; expected 0, 1 or 2.") from None


class Button(Enum):
    """The pendant button that is pressed, by its code."""

    NONE = 3
    IDLE = 2
    ACTIVATE = 1
    ESTOP = 0


class Light(Enum):
    """A pendant warning light, by its code."""

    SAFE = 1
    WARNING = 2
    FAULT = 4


@dataclass(frozen=True)
class PendantState:
    """What the pendant shows (property PEN)."""

    button: Button = Button.NONE
    activate_lit: bool = False
    idle_lit: bool = False
    segments: int = 0x3F
    """Seven-segment pattern, bits mid TL BL bottom BR TR top; 0x3F shows 0."""
    velocity: Light = Light.SAFE
    torque: Light = Light.SAFE
    voltage: Light = Light.SAFE
    heartbeat: Light = Light.SAFE
    other: Light = Light.SAFE

    def to_value(self) -> int:
        """The 32-bit value of PEN."""
        lights = (self.velocity, self.torque, self.voltage, self.heartbeat, self.other)
        value = self.button.value << 26 | self.activate_lit << 25 | self.idle_lit << 24 | self.segments << 16
        return value | sum(light.value << 3 * place for place, light in enumerate(lights))

    @classmethod
    def from_value(cls, value: int) -> PendantState:
        """Read PEN; ProtocolError if a light has more or fewer than one bit set."""
        try:
            velocity, torque, voltage, heartbeat, other = (Light(value >> 3 * place & 7) for place in range(5))
        except ValueError:
            expected = "one bit set in each three-bit field"
            raise ProtocolError("safety puck", f"PEN {value:#010x} is not valid; expected {expected}.") from None
        lit = bool(value >> 25 & 1), bool(value >> 24 & 1)
        return cls(Button(value >> 26 & 3), *lit, value >> 16 & 0xFF, velocity, torque, voltage, heartbeat, other)


class SafetyPuck:
    """Node 10, asked and answered one property at a time; not for use within a cycle."""

    def __init__(self, bus: CanBus, clock: Clock, firmware: int = IDLE_REQUEST_FIRMWARE) -> None:
        self._bus = bus
        self._clock = clock
        self.firmware = firmware

    def get(self, name: str) -> int:
        """Value of a property; NoReplyError after 50 ms."""
        number = property_id(name, self.firmware, "safety")
        value = ask_property(self._bus, SAFETY_NODE, number, self._clock.now_ns() + REPLY_TIMEOUT_NS)
        if value is None:
            raise NoReplyError(
                "safety puck",
                f"no reply to {name} within 50 ms.",
                help="Check that the arm's power supply is on and the CAN cable connected.",
            )
        return value

    def set(self, name: str, value: int) -> None:
        """Write a property and keep quiet for 10 ms."""
        self._bus.send(set_property(SAFETY_NODE, property_id(name, self.firmware, "safety"), value))
        self._clock.sleep_until_ns(self._clock.now_ns() + CONFIGURATION_PAUSE_NS)

    def mode(self) -> ArmMode:
        """The arm's mode now. NoReplyError if the safety puck is silent."""
        return arm_mode(self.get("MODE"))

    def request_idle(self) -> None:
        """Ask for idle and return at once; whether it came about, `mode` tells. InputError before firmware 197."""
        if self.firmware < IDLE_REQUEST_FIRMWARE:
            raise InputError(
                f"safety puck firmware {self.firmware} takes no idle request; "
                f"expected {IDLE_REQUEST_FIRMWARE} or later.",
                help="Press Shift-Idle on the pendant.",
            )
        self._bus.send(set_property(SAFETY_NODE, property_id("MODE", self.firmware, "safety"), SAFETY_IDLE))

    def set_limits(self, velocity_m_s: float, motor_torque_Nm: float) -> None:
        """Set the fault limits of elbow speed and motor torque (motors 1 to 4), warnings at 0.9 of them.

        They last until power-down. A zero velocity limit would switch the fault off and is refused.
        """
        for key, value, highest in (("velocity_m_s", velocity_m_s, 7.0), ("motor_torque_Nm", motor_torque_Nm, 3.0)):
            if not (isfinite(value) and 0.0 < value <= highest):
                raise InputError(f"{key} = {value} is out of range; expected above 0 and at most {highest}.")
        velocity, torque = velocity_m_s * _VELOCITY_UNIT, motor_torque_Nm * _TORQUE_UNIT
        # Fault limits before warnings, in the order that the vendor's library keeps.
        for name, limit in (("VL2", velocity), ("VL1", _WARNING_SHARE * velocity)):
            self.set(name, int(limit))
        for name, limit in (("TL2", torque), ("TL1", _WARNING_SHARE * torque)):
            self.set(name, int(limit))


class Guard:
    """Idles the arm from a second CAN socket when the process that controls it has died.

    Until the pucks are idle they go on applying their last torque, so this acts first and reports afterwards.
    """

    def __init__(self, bus: CanBus, clock: Clock, safety_firmware: int) -> None:
        self._bus = bus
        self._clock = clock
        self._puck = SafetyPuck(bus, clock, safety_firmware)

    def idle_arm(self) -> str:
        """Idle the arm and say what was done and whether it is confirmed. Never raises for a dead bus or puck."""
        done: list[str] = []
        listens = self._puck.firmware >= IDLE_REQUEST_FIRMWARE
        for _ in range(3 if listens else 0):
            try:
                self._puck.request_idle()
                mode = self._puck.mode()
            except (BusError, NoReplyError, ProtocolError) as error:
                done.append(f"idle asked for but not confirmed ({error.message})")
                continue
            if mode is not ArmMode.ACTIVE:
                return f"Asked the safety puck for idle; it confirms: the arm is {mode.value}."
            done.append("idle asked for but the arm is still active")
        return self._send_zero_torques(done)

    def _send_zero_torques(self, done: list[str]) -> str:
        try:
            self._bus.send(torque_frame(GROUP_LOWER_TORQUE, (0, 0, 0, 0)))
            self._bus.send(torque_frame(GROUP_UPPER_TORQUE, (0, 0, 0)))
            done.append("zero torques sent to all motors")
            mode = self._puck.mode()
        except (BusError, NoReplyError, ProtocolError) as error:
            done.append(f"the mode could not be read ({error.message})")
        else:
            done.append(f"the safety puck reports {mode.value}")
            if mode is not ArmMode.ACTIVE:
                return f"Idled: {'; '.join(done)}."
        return f"NOT confirmed: {'; '.join(done)}. Press Shift-Idle or E-stop."
