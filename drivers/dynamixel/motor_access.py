"""One motor's registers by name: asked again where an answer was lost or damaged, values as numbers with their sign.

Source: dynamixel reference 2.2, 2.3, 4, 6.1.
"""

from __future__ import annotations

from drivers.dynamixel.bus import MotorBus, Status, motor_name, persistently
from drivers.dynamixel.control_tables import MotorModel
from drivers.errors import DeviceError, ProtocolError

STILL_RAD = 0.08
"""Two position reads one after the other may differ by this much (0.8 mm of tendon) while a motor is brought up."""


class MotorAccess:
    """Motor `motor_id` of a model on a bus."""

    def __init__(self, bus: MotorBus, motor_id: int, model: MotorModel) -> None:
        self.model = model
        self.motor_id = motor_id
        self.bus = bus

    def read(self, name: str) -> int:
        """A register's value. DeviceError."""
        return self.model.registers[name].decode(self.status(name).parameters)

    def status(self, name: str) -> Status:
        """The whole answer to a read of a register, with its alarms. DeviceError."""
        register = self.model.registers[name]
        return persistently(lambda: self.bus.read(self.motor_id, register.address, register.size))

    def write(self, name: str, value: int) -> None:
        """Write a register and see it acknowledged. DeviceError."""
        register = self.model.registers[name]
        persistently(lambda: self.bus.write(self.motor_id, register.address, register.encode(value)))

    def write_if_different(self, name: str, value: int) -> None:
        """Write what is not so already: EEPROM wears."""
        if self.read(name) != value:
            self.write(name, value)

    def steady_position(self) -> int:
        """Where it stands, ticks. ProtocolError if two reads disagree."""
        first, second = self.read("present_position"), self.read("present_position")
        allowed = round(STILL_RAD / self.model.tick_rad)
        if abs(second - first) > allowed:
            raise ProtocolError(
                motor_name(self.motor_id),
                f"read {first} and then {second} ticks while it should stand still (within {allowed}).",
                help="Let the hand come to rest; if it was at rest, check the wiring.",
            )
        return second

    def error(self, message: str, help: str) -> DeviceError:
        """Something is wrong with this motor."""
        return DeviceError(motor_name(self.motor_id), message, help=help)
