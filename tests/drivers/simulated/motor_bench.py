"""Simulated motors on shafts that the test turns, spoken to in registers and in hex."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from drivers.dynamixel.control_tables import XM430_W350, MotorModel
from drivers.simulated import dynamixel_packets as packets2
from drivers.simulated import dynamixel_packets1 as packets1
from drivers.simulated.dynamixel import SimulatedMotors, SimulatedMotorSettings

MILLISECOND = 1_000_000


@dataclass
class HeldShafts:
    """Two shafts that something holds at given angles and speeds; keeps the torque put on them."""

    angle_rad: list[float] = field(default_factory=lambda: [0.0, 0.0])
    velocity_rad_s: list[float] = field(default_factory=lambda: [0.0, 0.0])
    torque_Nm: list[float] = field(default_factory=lambda: [0.0, 0.0])

    def shaft_angle_rad(self, motor: int) -> float:
        return self.angle_rad[motor]

    def shaft_velocity_rad_s(self, motor: int) -> float:
        return self.velocity_rad_s[motor]

    def set_shaft_torque_Nm(self, motor: int, torque: float) -> None:
        self.torque_Nm[motor] = torque


class Bench:
    """Motors 1 and 2 of one model on held shafts."""

    def __init__(self, model: MotorModel = XM430_W350, *, zero_ticks: int = 0, **options: Any) -> None:
        self.model = model
        self.shafts = HeldShafts()
        settings = [SimulatedMotorSettings(motor_id, zero_ticks, model=model) for motor_id in (1, 2)]
        self.sim = SimulatedMotors(self.shafts, settings, **options)
        self.now_ns = 0

    def say(self, request: str) -> bytes:
        """The answer to a request given in hex."""
        return self.sim.receive(bytes.fromhex(request), self.now_ns)

    def ask(self, motor_id: int, instruction: int, parameters: bytes = b"") -> bytes:
        """The answer to an instruction packet of the model's protocol."""
        pack = packets2.pack_instruction if self.model.protocol == 2 else packets1.pack
        return self.sim.receive(pack(motor_id, instruction, parameters), self.now_ns)

    def write(self, motor_id: int, name: str, value: int) -> int:
        """Write a register by a packet; the status's error byte."""
        register = self.model.registers[name]
        data = (value & ((1 << 8 * register.size) - 1)).to_bytes(register.size, "little")
        return self._error(self.ask(motor_id, 0x03, self._address(register.address) + data))

    def read(self, motor_id: int, name: str) -> int:
        """Read a register by a packet."""
        register = self.model.registers[name]
        length = register.size.to_bytes(2 if self.model.protocol == 2 else 1, "little")
        reply = self.ask(motor_id, 0x02, self._address(register.address) + length)
        data = packets2.unstuff(reply[7:-2])[2:] if self.model.protocol == 2 else reply[5:-1]
        return register.decode(data)

    def drive(self, motor_id: int, mode: int, **registers: int) -> None:
        """Switch on in a mode with some registers set after it (protocol 2.0)."""
        for name, value in {"operating_mode": mode, **registers, "torque_enable": 1}.items():
            assert self.write(motor_id, name, value) == 0

    def control(self, duration_ns: int = MILLISECOND) -> None:
        """One step of the inner loops at the end of this time."""
        self.now_ns += duration_ns
        self.sim.control(self.now_ns, duration_ns * 1e-9)

    def control_for(self, duration_s: float, step_ns: int = MILLISECOND) -> None:
        """Many steps."""
        for _ in range(round(duration_s * 1e9 / step_ns)):
            self.control(step_ns)

    def _address(self, address: int) -> bytes:
        return address.to_bytes(2 if self.model.protocol == 2 else 1, "little")

    def _error(self, reply: bytes) -> int:
        return reply[8] if self.model.protocol == 2 else reply[4]
