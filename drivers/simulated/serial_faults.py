"""A fault script at work on a simulated serial bus: on packets, on the host's adapter, on the motors.

`SimulatedMotors` asks `SerialFaults` what becomes of each packet and tells it how time passes; actions are in
`serial_fault_actions.py`. Times in ns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from drivers.clock import nanoseconds
from drivers.errors import InputError
from drivers.simulated import dynamixel_packets as packets2
from drivers.simulated import dynamixel_packets1 as packets1
from drivers.simulated.dynamixel_answer import Answer
from drivers.simulated.dynamixel_motor import SimulatedMotor
from drivers.simulated.dynamixel_packets import BROADCAST, Packet
from drivers.simulated.dynamixel_protocol2 import group_requests
from drivers.simulated.faults import START, Fault, FaultScript, Running, Schedule
from drivers.simulated.serial_fault_actions import (
    HARDWARE_ERRORS,
    INSTANTS,
    SERIAL_EVENTS,
    Corrupt,
    CutOff,
    Drop,
    Echo,
    EffortError,
    EffortStuck,
    EncoderJump,
    EncoderNoise,
    EncoderStuck,
    ErrorStatus,
    Garbage,
    HardwareError,
    Late,
    PacketAction,
    Reboot,
    SerialAction,
    SetRegister,
    Silence,
    Supply,
    Temperature,
    Truncate,
    Unplug,
    WrongId,
)

_REQUESTS = {
    0x01: "ping",
    0x02: "read",
    0x03: "write",
    0x04: "reg_write",
    0x05: "action",
    0x08: "reboot",
    0x82: "sync_read",
    0x8A: "sync_read",
    0x83: "sync_write",
    0x92: "bulk_read",
    0x9A: "bulk_read",
}


_ALERT, _FAST_START = 0x80, 8
"""Of protocol 2.0: the top bit of a status' error; where the parts of the one answer of several motors begin."""


@dataclass
class Adapter:
    """The host's end of the line, as it is now."""

    echoes: bool = False
    unplugged: bool = False
    times_unplugged: int = 0
    """A line that was open before the last time stays dead."""


class SerialFaults:
    """One run of a script on one bus. InputError for a script that does not fit its motors.

    `adapter` is kept up to date. `supply_V`: what the motors have without a fault.
    """

    def __init__(
        self, script: FaultScript[SerialAction], motors: Sequence[SimulatedMotor], supply_V: float, start_ns: int
    ) -> None:
        self.adapter = Adapter()
        self.struck = 0
        """Packets that packet actions have changed so far."""
        self._motors = tuple(motors)
        self._supply_V = supply_V
        self._schedule: Schedule[SerialAction] = Schedule(script, (PacketAction,), INSTANTS, SERIAL_EVENTS, start_ns)
        self._schedule.check_actions(self._check)
        self._next_ns: int | None = start_ns

    def add(self, fault: Fault[SerialAction], now_ns: int) -> None:
        """Have one more fault, timed from now. InputError if it does not fit."""
        self._check(fault.action)
        self._schedule.add(fault)
        self._schedule.notice(START, now_ns)
        self._next_ns = self._schedule.next_ns()

    def advance(self, now_ns: int) -> None:
        """Begin and end what is due by `now_ns`."""
        heard = self._hear_events(now_ns)
        if not heard and (self._next_ns is None or now_ns < self._next_ns):
            return
        for time_ns, edge, running in self._schedule.due(now_ns):
            self._change(running.action, edge == "begin", time_ns)
            self._hear_events(time_ns)
        self._next_ns = self._schedule.next_ns()

    def request(self, packet: Packet, now_ns: int) -> Packet | None:
        """What the motors hear of a request: itself, damaged, or None."""
        self._schedule.count_frame(now_ns)
        for running in self._schedule.frame_faults:
            action = running.action
            if not isinstance(action, Drop | Corrupt) or action.sender != "host":
                continue
            named = action.motor is None or packet.packet_id in (action.motor, BROADCAST)
            if named and _answers(action, packet) and running.strikes(now_ns):
                self.struck += 1
                if isinstance(action, Drop):
                    return None
                packet = replace(packet, intact=False)
        return packet

    def answers(self, answers: list[Answer], packet: Packet, now_ns: int) -> list[Answer]:
        """What the host gets of the motors' answers to a request."""
        given: list[Answer] = []
        pause_ns = 0
        for answer in answers:
            outcome: Answer | None = replace(answer, delay_ns=answer.delay_ns + pause_ns)
            self._schedule.count_frame(now_ns)
            for running in self._schedule.frame_faults:
                if outcome is not None and _concerns(running.action, outcome, packet) and running.strikes(now_ns):
                    self.struck += 1
                    outcome = _struck(running, outcome, packet)
            pause_ns = 0
            if outcome is None:
                pause_ns = answer.delay_ns  # the time that it took on the wire stays
            else:
                given.append(outcome)
        return given

    def _hear_events(self, now_ns: int) -> bool:
        heard = False
        for motor in self._motors:
            while motor.events:
                self._schedule.notice(motor.events.pop(0), now_ns)
                heard = True
        return heard

    def _change(self, action: SerialAction, begins: bool, now_ns: int) -> None:
        match action:
            case Echo():
                self.adapter.echoes = begins
            case Unplug():
                self.adapter.unplugged = begins
                self.adapter.times_unplugged += begins
            case Supply():
                for motor in self._motors:
                    _set_supply(motor, action.volts if begins else self._supply_V, now_ns)
            case _:
                for motor in self._named(action):
                    _befall(motor, action, begins, now_ns)

    def _named(self, action: SerialAction) -> list[SimulatedMotor]:
        ids = getattr(action, "motors", None)
        return [motor for motor in self._motors if ids is None or motor.motor_id in ids]

    def _check(self, action: SerialAction) -> None:
        known = [motor.motor_id for motor in self._motors]
        ids = getattr(action, "motors", None) or ()
        named = getattr(action, "motor", None)
        for motor_id in (*ids, *(() if named is None else (named,))):
            if motor_id not in known:
                raise InputError(f"motor {motor_id} is not on the bus; expected one of {', '.join(map(str, known))}.")
        if isinstance(action, SetRegister):
            for motor in self._named(action):
                register = motor.model.registers.get(action.name)
                if register is None or not register.minimum <= action.value <= register.maximum:
                    raise InputError(
                        f"a {motor.model.name} has no register {action.name!r} that can be {action.value}.",
                        help="Names and ranges: see its control table.",
                    )


def _befall(motor: SimulatedMotor, action: SerialAction, begins: bool, now_ns: int) -> None:
    match action:
        case Silence():
            motor.mute = begins
        case CutOff():
            motor.cut_off = begins
            if not begins:
                motor.reboot(now_ns)
        case HardwareError():
            motor.trip(HARDWARE_ERRORS[action.error])
        case Reboot():
            motor.reboot(now_ns)
        case Temperature():
            motor.stress.held_at_C = action.celsius if begins else None
        case EncoderJump():
            motor.encoder.jump_ticks += action.ticks
        case EncoderStuck():
            motor.encoder.stuck = begins
        case EncoderNoise():
            motor.encoder.noise_ticks = action.ticks if begins else 0.0
        case EffortStuck():
            motor.effort.stuck = begins
        case EffortError():
            motor.effort.extra_counts = action.counts if begins else 0
        case SetRegister():
            motor.put(action.name, action.value)


def _set_supply(motor: SimulatedMotor, volts: float, now_ns: int) -> None:
    was_on = motor.powered
    motor.supply_V = volts
    if motor.powered and not was_on:
        motor.reboot(now_ns)


def _answers(action: PacketAction, packet: Packet) -> bool:
    return action.request is None or _REQUESTS.get(packet.instruction) == action.request


def _concerns(action: SerialAction, answer: Answer, packet: Packet) -> bool:
    if not isinstance(action, PacketAction) or getattr(action, "sender", "motor") != "motor":
        return False
    named = action.motor is None or answer.motor_id in (action.motor, BROADCAST)
    return named and _answers(action, packet)


def _struck(running: Running[SerialAction], answer: Answer, packet: Packet) -> Answer | None:
    """What a packet action makes of one answer to a request."""
    match running.action:
        case Drop():
            return None
        case Late(by_s=by_s):
            return replace(answer, held_ns=answer.held_ns + nanoseconds(by_s))
        case Truncate(length=length):
            return replace(answer, data=answer.data[:length])
        case Garbage(data=data):
            return replace(answer, data=bytes.fromhex(data) + answer.data)
        case ErrorStatus(error=error):
            return replace(answer, data=_refused(answer, packet, error, running.action.motor))
        case WrongId(id=motor_id):
            return replace(answer, data=_renamed(answer.data, motor_id))
        case Corrupt(bits=bits, where=where):
            return replace(answer, data=_corrupted(running, answer.data, bits, where == "check"))
    return answer


def _is_protocol_2(data: bytes) -> bool:
    return data.startswith(packets2.HEADER)


def _renamed(data: bytes, motor_id: int) -> bytes:
    """The same status from another id, its check right."""
    if _is_protocol_2(data):
        body = data[:4] + bytes((motor_id,)) + data[5:-2]
        return body + packets2.crc16(body).to_bytes(2, "little")
    body = bytes((motor_id,)) + data[3:-1]
    return packets1.HEADER + body + bytes((packets1.checksum(body),))


def _refused(answer: Answer, packet: Packet, error: int, motor_id: int | None) -> bytes:
    """A status with this error instead of data; in the one answer of several motors, zeros behind the error of the one
    that is named, or of all."""
    data = answer.data
    if not _is_protocol_2(data):
        return packets1.pack(data[2], error)
    if answer.motor_id != BROADCAST:
        return packets2.pack_status(data[4], error | data[8] & _ALERT)
    parts, start = [], _FAST_START
    for part_id, _, length in group_requests(packet):
        alert, content = data[start], data[start + 2 : start + 2 + length]
        struck = motor_id in (None, part_id)
        parts.append((error | alert if struck else alert, part_id, bytes(length) if struck else content))
        start += length + 4
    return packets2.pack_fast_status(parts)


def _corrupted(running: Running[SerialAction], data: bytes, bits: int, check_only: bool) -> bytes:
    header, check = (4, 2) if _is_protocol_2(data) else (2, 1)
    first = 8 * (len(data) - check if check_only else header)
    content = bytearray(data)
    places = range(first, 8 * len(content))
    for place in running.random.sample(places, min(bits, len(places))):
        content[place // 8] ^= 1 << place % 8
    return bytes(content)
