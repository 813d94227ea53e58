"""What can go wrong on a serial bus of motors and with the motors themselves: the actions of its fault scripts.

Packet actions select answers by motor and by the request that they answer; `drop` and `corrupt` may instead strike the
host's requests (`sender = "host"`). Echo and unplug concern the host's adapter. The rest befalls motors, named by their
ids on the bus; without a selection it befalls all. Source: dynamixel reference 6, 7.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

_Id = Annotated[int, Meta(ge=0, le=253)]
_Ids = Annotated[tuple[_Id, ...], Meta(min_length=1)]
_Bytes = Annotated[str, Meta(pattern="^([0-9A-Fa-f]{2}){1,4096}$")]
Request = Literal["ping", "read", "write", "reg_write", "action", "reboot", "sync_read", "sync_write", "bulk_read"]
HARDWARE_ERRORS = {"voltage": 0x01, "overheating": 0x04, "encoder": 0x08, "shock": 0x10, "overload": 0x20}
HardwareErrorName = Literal["voltage", "overheating", "encoder", "shock", "overload"]


class _Action(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind"):
    """An action; its kind is its name in the script."""


class PacketAction(_Action, frozen=True, kw_only=True):
    """What befalls single packets; without a selection, all answers of motors."""

    motor: _Id | None = None
    """Who answers, or whom a request of the host names; the one answer of several motors counts for each of them."""
    request: Request | None = None
    """Requests, or answers to them; fast reads count as the plain ones."""


class Drop(PacketAction, frozen=True, kw_only=True, tag="drop"):
    """The packet is lost."""

    sender: Literal["host", "motor"] = "motor"


class Corrupt(PacketAction, frozen=True, kw_only=True, tag="corrupt"):
    """Bits of the packet turn over: anywhere behind the header, or in CRC or checksum alone."""

    sender: Literal["host", "motor"] = "motor"
    bits: Annotated[int, Meta(ge=1, le=64)] = 1
    where: Literal["anywhere", "check"] = "anywhere"


class Late(PacketAction, frozen=True, kw_only=True, tag="late"):
    """The adapter hands the answer over later."""

    by_s: Annotated[float, Meta(gt=0, le=10)]


class WrongId(PacketAction, frozen=True, kw_only=True, tag="wrong_id"):
    """The answer names another motor, and is intact."""

    id: _Id


class Truncate(PacketAction, frozen=True, kw_only=True, tag="truncate"):
    """Only the first bytes of the answer come."""

    length: Annotated[int, Meta(ge=0, le=100)]


class ErrorStatus(PacketAction, frozen=True, kw_only=True, tag="error_status"):
    """The answer is an error without data: a number of protocol 2.0 (reference 4.2), bits of protocol 1.0 (4.1)."""

    error: Annotated[int, Meta(ge=1, le=0x7F)]


class Garbage(PacketAction, frozen=True, kw_only=True, tag="garbage"):
    """Other bytes come before the answer."""

    data: _Bytes


class Echo(_Action, frozen=True, kw_only=True, tag="echo"):
    """The adapter gives the host its own bytes back."""


class Unplug(_Action, frozen=True, kw_only=True, tag="unplug"):
    """The host's adapter is gone; a line that was open stays dead."""


class Silence(_Action, frozen=True, kw_only=True, tag="silence"):
    """Motors hear and obey, but do not answer, as long as it lasts."""

    motors: _Ids | None = None


class CutOff(_Action, frozen=True, kw_only=True, tag="cut_off"):
    """The plugs of motors are out: no torque, no answer; afterwards they start anew."""

    motors: _Ids | None = None


class HardwareError(_Action, frozen=True, kw_only=True, tag="hardware_error"):
    """Motors have a hardware error; what follows is up to their Shutdown."""

    motors: _Ids | None = None
    error: HardwareErrorName = "overload"


class Reboot(_Action, frozen=True, kw_only=True, tag="reboot"):
    """Motors start anew by themselves: RAM and turns are lost, and for 0.3 s they are silent."""

    motors: _Ids | None = None


class Supply(_Action, frozen=True, kw_only=True, tag="supply"):
    """The motors' supply has another voltage; below 5.5 V they are off."""

    volts: Annotated[float, Meta(ge=0, le=30)]


class Temperature(_Action, frozen=True, kw_only=True, tag="temperature"):
    """Motors are this hot, as long as it lasts."""

    motors: _Ids | None = None
    celsius: Annotated[float, Meta(ge=-20, le=200)]


class EncoderJump(_Action, frozen=True, kw_only=True, tag="encoder_jump"):
    """The position that motors measure is off by this from now on."""

    motors: _Ids | None = None
    ticks: Annotated[int, Meta(ge=-1_000_000, le=1_000_000)]


class EncoderStuck(_Action, frozen=True, kw_only=True, tag="encoder_stuck"):
    """Motors' encoders go on telling what they told."""

    motors: _Ids | None = None


class EncoderNoise(_Action, frozen=True, kw_only=True, tag="encoder_noise"):
    """The position that motors measure trembles, with this standard deviation."""

    motors: _Ids | None = None
    ticks: Annotated[float, Meta(gt=0, le=1000)]


class EffortStuck(_Action, frozen=True, kw_only=True, tag="effort_stuck"):
    """Motors go on telling the current or load that they told."""

    motors: _Ids | None = None


class EffortError(_Action, frozen=True, kw_only=True, tag="effort_error"):
    """Motors tell so much more current or load than there is, counts."""

    motors: _Ids | None = None
    counts: Annotated[int, Meta(ge=-3000, le=3000)]


class SetRegister(_Action, frozen=True, kw_only=True, tag="set_register"):
    """A register has another value all at once, read-only ones too; its name as in the control tables."""

    motors: _Ids | None = None
    name: str
    value: int


AdapterAction = Echo | Unplug
SensorAction = Temperature | EncoderJump | EncoderStuck | EncoderNoise | EffortStuck | EffortError
MotorAction = Silence | CutOff | HardwareError | Reboot | Supply | SensorAction | SetRegister
SerialAction = Drop | Corrupt | Late | WrongId | Truncate | ErrorStatus | Garbage | AdapterAction | MotorAction
INSTANTS = (HardwareError, Reboot, EncoderJump, SetRegister)
"""Actions that have no duration."""
SERIAL_EVENTS = ("torque_on", "torque_off", "goal", "shutdown", "watchdog", "rebooted")
"""What faults can wait for, of any motor: torque on and off, a goal position, a shutdown, a tripped watchdog, a
restart."""
