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
from drivers.wam.bus import CanBus
from drivers.wam.dialogue import ATTEMPTS, REPLY_TIMEOUT_S, STATUS_ID, Dialogue
from drivers.wam.frames import (
    GROUP_LOWER_TORQUE,
    GROUP_POSITION,
    GROUP_UPPER_TORQUE,
    SAFETY_NODE,
    set_property,
    torque_frame,
)
from drivers.wam.properties import (
    IDLE_REQUEST_FIRMWARE,
    SAFETY_ACTIVE,
    SAFETY_ESTOP,
    SAFETY_IDLE,
    property_id,
)

CONFIGURATION_PAUSE_S = 0.011
"""Between two settings: the safety puck loses them when they come within 10 ms (WAM reference 2.2). The rest is for the
frames' different lengths."""
_HEARD_GROUPS = {GROUP_LOWER_TORQUE, GROUP_UPPER_TORQUE, GROUP_POSITION}
_LIMITS = ("VL1", "VL2", "TL1", "TL2")
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
        self._dialogue = Dialogue(bus, clock)
        self.firmware = firmware

    def get(self, name: str, *, attempts: int = ATTEMPTS) -> int:
        """Value of a property; NoReplyError if every attempt stays without answer for 50 ms."""
        value = self._dialogue.ask_or_none(SAFETY_NODE, self._number(name), attempts=attempts)
        if value is None:
            raise NoReplyError(
                "safety puck",
                f"no reply to {name} within {REPLY_TIMEOUT_S * 1e3:.0f} ms"
                f"{f', asked {attempts} times' if attempts > 1 else ''}.",
                help="Check that the arm's power supply is on and the CAN cable connected.",
            )
        return value

    def set(self, name: str, value: int) -> None:
        """Write a property, wait for a sign of life and until the next may follow. NoReplyError if there is none."""
        quiet_ns = self._clock.now_ns() + nanoseconds(CONFIGURATION_PAUSE_S)
        self._dialogue.tell(SAFETY_NODE, self._number(name), value)
        self._dialogue.ask(SAFETY_NODE, STATUS_ID, "STAT")
        self._clock.sleep_until_ns(quiet_ns)

    def write(self, name: str, value: int) -> None:
        """Set a property and read it back, once more if it got lost. ProtocolError if it then still differs."""
        for _ in range(2):
            self.set(name, value)
            found = self.get(name)
            if found == value:
                return
        raise ProtocolError(
            "safety puck",
            f"{name} reads {found} after {value} was written.",
            help="It cannot be relied on: start again, and if it stays so have the puck checked.",
        )

    def mode(self, *, attempts: int = ATTEMPTS) -> ArmMode:
        """The arm's mode now. NoReplyError if the safety puck is silent."""
        return arm_mode(self.get("MODE", attempts=attempts))

    def check_groups(self) -> None:
        """It must hear torques and positions, or it watches over nothing. ProtocolError if it does not."""
        groups = [self.get(name) for name in ("GRPA", "GRPB", "GRPC")]
        if set(groups) != _HEARD_GROUPS:
            raise ProtocolError(
                "safety puck",
                f"it listens to groups {groups}; expected {sorted(_HEARD_GROUPS)}, torques and positions.",
                help="Write its GRPA, GRPB and GRPC with the vendor's btutil: 1, 2 and 3.",
            )

    def request_idle(self) -> None:
        """Ask for idle and return at once; whether it came about, `mode` tells. InputError before firmware 197."""
        if self.firmware < IDLE_REQUEST_FIRMWARE:
            raise InputError(
                f"safety puck firmware {self.firmware} takes no idle request; "
                f"expected {IDLE_REQUEST_FIRMWARE} or later.",
                help="Press Shift-Idle on the pendant.",
            )
        self._bus.send(set_property(SAFETY_NODE, self._number("MODE"), SAFETY_IDLE))

    def set_limits(self, velocity_m_s: float, motor_torque_Nm: float) -> None:
        """Set the fault limits of elbow speed and motor torque (motors 1 to 4), warnings at 0.9 of them.

        They last until power-down. First the factory's are restored, as the vendor's library does. Each is read back,
        and one that differs is a ProtocolError. A zero velocity limit would switch the fault off and is refused
        (InputError). The speed is that of the elbow and of a point 350 mm beyond it; until the arm is zeroed the same
        number means rad/s of a joint.
        """
        for key, value, highest in (("velocity_m_s", velocity_m_s, 7.0), ("motor_torque_Nm", motor_torque_Nm, 3.0)):
            if not (isfinite(value) and 0.0 < value <= highest):
                raise InputError(f"{key} = {value} is out of range; expected above 0 and at most {highest}.")
        for name in _LIMITS:
            self.set("DEF", self._number(name))
            self.set("LOAD", self._number(name))
        velocity, torque = velocity_m_s * _VELOCITY_UNIT, motor_torque_Nm * _TORQUE_UNIT
        # Fault limits before warnings, in the order that the vendor's library keeps.
        limits = {"VL2": int(velocity), "VL1": int(_WARNING_SHARE * velocity)}
        limits |= {"TL2": int(torque), "TL1": int(_WARNING_SHARE * torque)}
        for name, limit in limits.items():
            self.write(name, limit)

    def _number(self, name: str) -> int:
        return property_id(name, self.firmware, "safety")


class Guard:
    """Idles the arm from a second CAN socket when the process that controls it has died.

    Until the pucks are idle they go on applying their last torque, so this acts first and reports afterwards.
    """

    def __init__(self, bus: CanBus, clock: Clock, safety_firmware: int, motor_firmware: int | None = None) -> None:
        """Without `motor_firmware` the motor pucks are taken to be of the safety puck's generation."""
        self._bus = bus
        self._clock = clock
        self._puck = SafetyPuck(bus, clock, safety_firmware)
        generation = safety_firmware if motor_firmware is None else motor_firmware
        self._torque_id = property_id("T", generation, "motor")

    @property
    def safety_firmware(self) -> int:
        """As told to it."""
        return self._puck.firmware

    def idle_arm(self) -> str:
        """Idle the arm and say what was done and whether it is confirmed. Never raises for a dead bus or puck."""
        done: list[str] = []
        listens = self._puck.firmware >= IDLE_REQUEST_FIRMWARE
        for _ in range(3 if listens else 0):
            try:
                self._puck.request_idle()
                mode = self._puck.mode(attempts=1)
            except (BusError, NoReplyError, ProtocolError) as error:
                done.append(f"idle asked for but not confirmed ({error.message})")
                continue
            if mode is not ArmMode.ACTIVE:
                return f"Asked the safety puck for idle; it confirms: the arm is {mode.value}."
            done.append("idle asked for but the arm is still active")
        return self._send_zero_torques(done)

    def _send_zero_torques(self, done: list[str]) -> str:
        try:
            self._bus.send(torque_frame(GROUP_LOWER_TORQUE, (0, 0, 0, 0), self._torque_id))
            self._bus.send(torque_frame(GROUP_UPPER_TORQUE, (0, 0, 0), self._torque_id))
            done.append("zero torques sent to all motors")
            mode = self._puck.mode(attempts=1)
        except (BusError, NoReplyError, ProtocolError) as error:
            done.append(f"the mode could not be read ({error.message})")
        else:
            done.append(f"the safety puck reports {mode.value}")
            if mode is not ArmMode.ACTIVE:
                return f"Idled: {'; '.join(done)}."
        return f"NOT confirmed: {'; '.join(done)}. Press Shift-Idle or E-stop."
