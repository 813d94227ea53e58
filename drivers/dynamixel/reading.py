"""How both motors are read: which registers at once, which in turn, and what happens when one keeps silent.

Protocol 2.0: eight registers that lie far apart are mapped together by indirect addresses (RAM, lost at a restart), and
one group read of 16 bytes a motor brings all of them. A motor that does not take the map is read as 126…135, the
rest in turn. Protocol 1.0: 36…43 of each motor, and 24…35 (torque) in turn.

In a protocol 2.0 group read the second motor waits for the first one's answer, so that one silent motor silences both.
Hence after a miss each motor is read alone, the healthy one first; one that missed `EXCLUDE_AFTER` times is left out
and asked again every `FIRST_PROBES_NS`, as a short disturbance is no fault, and from `GIVE_UP_NS` of silence on every
`PROBE_NS`; each costs the other one time-out.

Source: dynamixel reference 2.2, 2.3 (blocks, indirect map), 5, 6.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from drivers.dynamixel.bus import MotorBus, Status, persistently
from drivers.dynamixel.control_tables import MotorModel
from drivers.dynamixel.registers import INDIRECT_BLOCKS, signed
from drivers.errors import BusError, DeviceError

EXCLUDE_AFTER = 3
FIRST_PROBES_NS, GIVE_UP_NS = 10_000_000, 100_000_000
PROBE_NS = 250_000_000
SLOW_EVERY = 3
"""Reads between two reads of what is read in turn."""

_FORMATS = {(1, False): "B", (1, True): "b", (2, False): "H", (2, True): "h", (4, False): "I", (4, True): "i"}


@dataclass(frozen=True, slots=True)
class Block:
    """Registers that one read brings."""

    address: int
    names: tuple[str, ...]
    layout: struct.Struct
    sign_magnitude: tuple[str, ...]
    """Those of them whose bit 10 is the sign."""

    def decode(self, data: bytes) -> dict[str, int]:
        """Values by name, of exactly `layout.size` bytes."""
        values = dict(zip(self.names, self.layout.unpack(data), strict=True))
        for name in self.sign_magnitude:
            values[name] = signed(values[name])
        return values


def block_of(model: MotorModel, names: Sequence[str], mapped_to: int | None = None) -> Block:
    """The block from the first register to the last; with `mapped_to`, the same registers without gaps from there."""
    registers = [model.registers[name] for name in names]
    layout, end = "<", registers[0].address
    for register in registers:
        gap = 0 if mapped_to is not None else register.address - end
        twos_complement = register.minimum < 0 and not register.sign_magnitude
        layout += "x" * gap + _FORMATS[register.size, twos_complement]
        end = register.address + register.size
    address = registers[0].address if mapped_to is None else mapped_to
    return Block(address, tuple(names), struct.Struct(layout), tuple(r.name for r in registers if r.sign_magnitude))


@dataclass(frozen=True, slots=True)
class ReadPlan:
    """What is read each time, and what in turn."""

    fast: Block
    slow: tuple[Block, ...] = ()
    mapped: bool = False


def direct_plan(model: MotorModel) -> ReadPlan:
    """Reading where the registers are."""
    if model.protocol == 1:
        fast = ("present_position", "present_velocity", "present_load", "present_input_voltage", "present_temperature")
        return ReadPlan(block_of(model, fast), (block_of(model, ("torque_enable", "torque_limit")),))
    slow = (("hardware_error_status",), ("torque_enable",), ("bus_watchdog",))
    return ReadPlan(
        block_of(model, (model.effort_register, "present_velocity", "present_position")),
        tuple(block_of(model, names) for names in (*slow, ("present_input_voltage", "present_temperature"))),
    )


def mapped_plan(model: MotorModel) -> ReadPlan:
    """Protocol 2.0: everything through the indirect map."""
    names = (
        model.effort_register,
        "present_velocity",
        "present_position",
        "torque_enable",
        "hardware_error_status",
        "bus_watchdog",
        "present_input_voltage",
        "present_temperature",
    )
    return ReadPlan(block_of(model, names, mapped_to=INDIRECT_BLOCKS[0][1]), mapped=True)


def indirect_map(model: MotorModel, plan: ReadPlan) -> bytes:
    """Contents of the indirect address registers for a mapped plan: one address for every byte."""
    content = bytearray()
    for name in plan.fast.names:
        register = model.registers[name]
        for address in range(register.address, register.address + register.size):
            content += address.to_bytes(2, "little")
    return bytes(content)


class PairReader:
    """Reads two motors of one model. `values` are the newest of each, by register name."""

    def __init__(self, bus: MotorBus, motor_ids: tuple[int, int], model: MotorModel) -> None:
        self.values: list[Mapping[str, int]] = [{}, {}]
        self.alert = [False, False]
        self.missed = [0, 0]
        self.plan = direct_plan(model)
        self._bus = bus
        self._ids = motor_ids
        self._model = model
        self._probe_ns = [0, 0]
        self._silent_since_ns = [0, 0]
        self._turn = 0
        self._slow_next = 0
        self._slow_wanted = False

    def prepare(self) -> None:
        """Map the registers of both motors and read everything once. DeviceError if a motor does not answer."""
        if self._model.protocol == 2:
            self._choose_map()
        for index in (0, 1):
            persistently(partial(self._read_all, index))

    def read_anew(self, index: int) -> None:
        """A motor that restarted: give it its map again, and read all of it alone. DeviceError."""
        if self.plan.mapped:
            self._bus.write(self._ids[index], INDIRECT_BLOCKS[0][0], indirect_map(self._model, self.plan))
        self._read_all(index)

    def read_slow_next(self) -> None:
        """All that is read in turn is wanted with the next read."""
        self._slow_wanted = True

    def read(self, now_ns: int) -> tuple[DeviceError | None, ...]:
        """Read both; None for each that answered, with new `values`. Raises BusError only."""
        if self.missed == [0, 0]:
            results = self._bus.read_group(self.plan.fast.address, self.plan.fast.layout.size, self._ids)
            errors = [self._settle(index, result, now_ns) for index, result in enumerate(results)]
        else:
            errors = [None, None]
            for index in sorted((0, 1), key=lambda motor: self.missed[motor]):
                errors[index] = self._read_alone(index, now_ns)
        if self.plan.slow:
            self._read_slow()
        return tuple(errors)

    def miss(self, index: int) -> None:
        """What a motor answered was not believed."""
        self.missed[index] += 1

    def _read_all(self, index: int) -> None:
        for block in (self.plan.fast, *self.plan.slow):
            self._take(index, block, self._bus.read(self._ids[index], block.address, block.layout.size))

    def _read_alone(self, index: int, now_ns: int) -> DeviceError | None:
        excluded = self.missed[index] >= EXCLUDE_AFTER
        if excluded and now_ns < self._probe_ns[index]:
            self.missed[index] += 1
            return DeviceError(f"tendon motor {self._ids[index]}", "has not answered; it is asked again soon.")
        block = self.plan.fast
        (result,) = self._bus.read_group(block.address, block.layout.size, self._ids[index : index + 1])
        self._slow_wanted |= self.missed[index] > 0 and isinstance(result, Status)  # it may have restarted meanwhile
        return self._settle(index, result, now_ns)

    def _settle(self, index: int, result: Status | DeviceError, now_ns: int) -> DeviceError | None:
        if isinstance(result, Status):
            self.missed[index] = 0
            self._take(index, self.plan.fast, result)
            return None
        if self.missed[index] == 0:
            self._silent_since_ns[index] = now_ns
        self.missed[index] += 1
        new = now_ns - self._silent_since_ns[index] < GIVE_UP_NS
        self._probe_ns[index] = now_ns + (FIRST_PROBES_NS if new else PROBE_NS)
        return result

    def _read_slow(self) -> None:
        self._turn = (self._turn + 1) % SLOW_EVERY
        living = [index for index in (0, 1) if self.missed[index] == 0]
        if not living or not (self._slow_wanted or self._turn == 0):
            return
        blocks = self.plan.slow if self._slow_wanted else (self.plan.slow[self._slow_next],)
        self._slow_next = (self._slow_next + 1) % len(self.plan.slow)
        self._slow_wanted = False
        motor_ids = [self._ids[index] for index in living]
        for block in blocks:
            results = self._bus.read_group(block.address, block.layout.size, motor_ids)
            for index, result in zip(living, results, strict=True):
                if isinstance(result, Status):
                    self._take(index, block, result)

    def _take(self, index: int, block: Block, status: Status) -> None:
        values = {**self.values[index], **block.decode(status.parameters)}
        if self._model.protocol == 1:
            values["hardware_error_status"] = status.alarms
        self.values[index] = values
        if status.alert and not self.alert[index]:
            self._slow_wanted = True  # what it complains about, and whether it still holds
        self.alert[index] = status.alert

    def _choose_map(self) -> None:
        plan = mapped_plan(self._model)
        try:
            shown = [persistently(partial(self._map, motor_id, plan)) for motor_id in self._ids]
        except BusError:
            raise
        except DeviceError:
            return
        if not all(values["present_input_voltage"] for values in shown):
            return  # the map was taken, but shows nothing
        self.plan = plan
        fast = plan.fast.address, plan.fast.layout.size, self._ids
        _ = self._bus.try_fast_read(*fast) or self._bus.try_fast_read(*fast)

    def _map(self, motor_id: int, plan: ReadPlan) -> dict[str, int]:
        """Give a motor its map, if it has not got it; what it shows."""
        wanted, block, address = indirect_map(self._model, plan), plan.fast, INDIRECT_BLOCKS[0][0]
        if self._bus.read(motor_id, address, len(wanted)).parameters != wanted:
            self._bus.write(motor_id, address, wanted)
        return block.decode(self._bus.read(motor_id, block.address, block.layout.size).parameters)
