"""Simulated tendon motors of any model, byte for byte, in front of a plant that turns their shafts.

`SimulatedMotors` is a device on a line (`drivers.simulated.serial_lines`): bytes in, timed answers out. Its packers
share no code with dynamixel-sdk or the driver. Each motor speaks its model's protocol (`dynamixel_protocol1.py`,
`dynamixel_protocol2.py`); on a bus with both, each hears only its own. A motor does not understand a host at another
baud rate. Motors with one id answer into each other. A fault script makes things go wrong.

What agrees with the protocols' documents here was not seen on a motor. Source: dynamixel reference 4, 6.2, 6.3.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from drivers.dynamixel.control_tables import XM430_W350, MotorModel
from drivers.errors import InputError
from drivers.simulated.dynamixel_answer import Answer, collided
from drivers.simulated.dynamixel_effort import EffortErrors
from drivers.simulated.dynamixel_motor import SimulatedMotor
from drivers.simulated.dynamixel_packets import BROADCAST, Packet
from drivers.simulated.dynamixel_protocol1 import Protocol1
from drivers.simulated.dynamixel_protocol2 import Protocol2
from drivers.simulated.faults import FaultScript
from drivers.simulated.serial_fault_actions import SerialAction
from drivers.simulated.serial_faults import Adapter, SerialFaults

PARTIAL_PACKET_NS = 10_000_000
"""A packet that stops for longer than this in its middle is forgotten."""
_BYTE_NS = 10_000.0
"""At 1 Mbit/s, where nobody says at which rate the bytes came."""


def taut_ticks(model: MotorModel) -> int:
    """Where a simulated spool is clamped: so that a hand's whole travel lies in the one turn that protocol 1.0 has."""
    if model.protocol == 2:
        return 0
    return 97 if model.ticks_per_revolution < 2048 else 600


class TendonPlant(Protocol):
    """What the motors' gears turn; motor 0 is the first of the settings."""

    def shaft_angle_rad(self, motor: int) -> float:
        """Angle of the output shaft, all turns counted."""
        ...

    def shaft_velocity_rad_s(self, motor: int) -> float:
        """Speed of the output shaft."""
        ...

    def set_shaft_torque_Nm(self, motor: int, torque: float) -> None:
        """Torque on the output shaft until it is set anew; the gear's friction is the plant's."""
        ...


@dataclass(frozen=True, slots=True)
class SimulatedMotorSettings:
    """One motor on the simulated bus."""

    motor_id: int
    ticks_at_zero_angle: int = 0
    """Position register at shaft angle 0: a spool is never clamped exactly at 0."""
    direction: int = 1
    """+1: ticks grow with the shaft's angle; −1: mounted the other way round."""
    model: MotorModel = XM430_W350
    firmware: int | None = None
    """Without it, as delivered today."""
    baud: int | None = None
    """Without it, the bus's."""
    effort_offset: float = 0.0
    """Error of what it tells of its effort: A, or part of full output; positive towards growing shaft angles."""
    effort_drift_per_s: float = 0.0
    """How this changes in time."""

    def __post_init__(self) -> None:
        highest = 253 if self.model.protocol == 1 else 252
        if (
            not 0 <= self.motor_id <= highest
            or self.direction not in (1, -1)
            or abs(self.ticks_at_zero_angle) > 1_000_000
        ):
            raise InputError(
                f"{self.model.name} {self.motor_id} at {self.ticks_at_zero_angle} ticks, direction {self.direction}, "
                f"is not possible; expected an id in 0…{highest}, direction 1 or -1, ticks within 1 000 000."
            )


class SimulatedMotors:
    """All motors of one bus. `heard` keeps the newest intact requests, as they were on the wire.

    `baud`: the rate they are set to. `noise_counts`: standard deviation of the effort that is read, drawn from `seed`.
    `fast_reads` False: firmware without fast sync and bulk reads. `shared_ids`: let several have one id. InputError for
    settings or faults that cannot be.
    """

    def __init__(
        self,
        plant: TendonPlant,
        settings: Sequence[SimulatedMotorSettings],
        *,
        baud: int = 1_000_000,
        supply_V: float = 12.0,
        noise_counts: float = 0.0,
        seed: int = 0,
        fast_reads: bool = True,
        shared_ids: bool = False,
        faults: FaultScript[SerialAction] | None = None,
        start_ns: int = 0,
    ) -> None:
        if not settings or (len({s.motor_id for s in settings}) != len(settings) and not shared_ids):
            raise InputError("simulated motors need at least one motor, each with its own id.")
        if not (math.isfinite(supply_V) and 0.0 <= supply_V <= 30.0):
            raise InputError(f"supply {supply_V} V; expected 0 to 30 V.")
        self.heard: deque[bytes] = deque(maxlen=256)
        self.motors = [
            SimulatedMotor(
                one.motor_id,
                one.model,
                baud=one.baud or baud,
                firmware=one.firmware,
                effort=EffortErrors(
                    noise_counts, one.direction * one.effort_offset, one.direction * one.effort_drift_per_s
                ),
                seed=seed,
            )
            for one in settings
        ]
        self._settings = tuple(settings)
        self._plant = plant
        self._protocols: dict[int, Protocol1 | Protocol2] = {1: Protocol1(), 2: Protocol2(fast_reads)}
        self._last_byte_ns = 0
        self._answers_to_drop = 0
        for index, motor in enumerate(self.motors):
            motor.supply_V = supply_V
            motor.measure(self._angle_rad(index))
        self.faults = SerialFaults(faults or FaultScript(), self.motors, supply_V, start_ns)

    @property
    def adapter(self) -> Adapter:
        """The host's end of the line, for the line."""
        return self.faults.adapter

    def drop_answers(self, count: int) -> None:
        """Swallow the answers to the next `count` requests that would be answered."""
        self._answers_to_drop = count

    def trip(self, motor: int, error_bits: int) -> None:
        """Let a motor (by index) have a hardware error, such as 0x20 overload."""
        self.motors[motor].trip(error_bits)

    # the plant's side

    def control(self, now_ns: int, period_s: float) -> None:
        """One step of every motor's inner loop; the world calls it before each physics step of `period_s`."""
        self.faults.advance(now_ns)
        plant = self._plant
        for index, motor in enumerate(self.motors):
            watchdog_ns = motor.watchdog_ns
            if watchdog_ns and now_ns - motor.last_instruction_ns > watchdog_ns:
                motor.trip_watchdog()
            sign = self._settings[index].direction
            torque_Nm = motor.control(now_ns, self._angle_rad(index), sign * plant.shaft_velocity_rad_s(index))
            plant.set_shaft_torque_Nm(index, sign * torque_Nm)

    def _angle_rad(self, index: int) -> float:
        settings, motor = self._settings[index], self.motors[index]
        shaft_rad = self._plant.shaft_angle_rad(index)
        return settings.direction * shaft_rad + settings.ticks_at_zero_angle * motor.model.tick_rad

    # the host's side

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """All bytes that these bytes are answered with."""
        return b"".join(answer.data for answer in self.answers(data, now_ns))

    def answers(self, data: bytes, now_ns: int, baud: int | None = None) -> list[Answer]:
        """The packets that these bytes are answered with, and their delays. `baud`: the rate they come at, if known."""
        self.faults.advance(now_ns)
        if now_ns - self._last_byte_ns > PARTIAL_PACKET_NS:
            for protocol in self._protocols.values():
                protocol.reader.clear()
        self._last_byte_ns = now_ns
        answers: list[Answer] = []
        for number in sorted({motor.protocol for motor in self.motors}):
            for packet in self._protocols[number].reader.feed(data):
                answers += self._answers_to(packet, number, now_ns, baud)
        return answers

    def _answers_to(self, packet: Packet, protocol: int, now_ns: int, baud: int | None) -> list[Answer]:
        hearing = [motor for motor in self.motors if motor.protocol == protocol and motor.hears(now_ns, baud)]
        heard = self.faults.request(packet, now_ns)
        if not hearing or heard is None:
            return []
        if heard.intact:
            self.heard.append(heard.wire)
            for motor in hearing:
                motor.last_instruction_ns = now_ns
        answers = self._protocols[protocol].execute(heard, hearing, now_ns)
        if len(answers) > 1 and heard.packet_id != BROADCAST:
            answers = collided(answers, _BYTE_NS if baud is None else 1e10 / baud)
        if answers and self._answers_to_drop > 0:
            self._answers_to_drop -= 1
            return []
        return self.faults.answers(answers, heard, now_ns)
