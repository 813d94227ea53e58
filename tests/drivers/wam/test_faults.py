"""Faults of the arm by name, from simulated pucks and an adapter that a script makes fail."""

from __future__ import annotations

import errno
from collections.abc import Callable
from typing import Any

import can
import numpy as np
import pytest

from drivers.clock import VirtualClock
from drivers.errors import BusError
from drivers.simulated.arm_faults import BrownOut, SetProperty, Silence, Supply
from drivers.simulated.can_fault_actions import BusOff, Corrupt, Duplicate, ErrorFrame, Flood, QueueFull, Unplug
from drivers.simulated.can_faults import CanFaults
from drivers.simulated.can_hub import MemoryCanBus, MemoryCanHub
from drivers.simulated.faults import Fault, FaultScript
from drivers.simulated.simple_arm import SimpleArm
from drivers.simulated.wam import SimulatedWam
from drivers.wam.arm import Arm
from drivers.wam.fault_table import ARM_FAULTS, ArmFault, NamedFault, Reaction, Recovery
from drivers.wam.faults import bus_fault
from drivers.wam.frames import set_property, torque_frame
from drivers.wam.parameters import load_wam_parameters
from drivers.wam.safety_puck import ArmMode

PARAMETERS = load_wam_parameters()
PERIOD_NS = 2_000_000


class Rig:
    """A driver that cycles as the controller's does, in front of an arm that turns freely."""

    def __init__(self, motor_firmware: int = 200) -> None:
        self.clock = VirtualClock()
        self.plant = SimpleArm(PARAMETERS, np.zeros(7))
        self.wam = SimulatedWam(self.plant, PARAMETERS, zeroed=True, motor_firmware=motor_firmware)
        self.faults = CanFaults(FaultScript(), self.wam)
        self.hub = MemoryCanHub([self.wam], self.faults)
        self.arm = Arm(MemoryCanBus(self.hub, self.clock), self.clock, PARAMETERS)
        self.arm.start()
        self._missing = 0
        self._cycles = 0

    def press(self, button: str) -> None:
        self.hub.transmit(self.wam.press(button, self.clock.now_ns()), self.wam)

    def has(self, action: Any, for_s: float | None = None) -> None:
        self.faults.add(Fault(action=action, for_s=for_s), self.clock.now_ns())

    def run(self, cycles: int) -> list[NamedFault]:
        """Faults in the order in which they first appear."""
        seen: list[NamedFault] = []
        for _ in range(cycles):
            try:
                fault = self._cycle()
            except BusError as error:
                fault = bus_fault(error)
            if fault is not None and fault.code not in [known.code for known in seen]:
                seen.append(fault)
        return seen

    def _cycle(self) -> NamedFault | None:
        self._cycles += 1
        self.clock.advance_to_ns(self.clock.now_ns() // PERIOD_NS * PERIOD_NS + PERIOD_NS)
        now_ns = self.clock.now_ns()
        self.plant.advance_to(now_ns)
        self.hub.step(now_ns)
        self.arm.request_positions()
        sample = self.arm.collect_positions(now_ns + 1_400_000)
        self._missing = 0 if sample.complete else self._missing + 1
        if self._cycles % 25 == 0:
            self.arm.poll_safety_mode()
        elif self._missing >= 2:
            self.arm.poll_state(sample.missing)
        elif self._cycles % 25 == 12:
            self.arm.poll_state()
        fault = self.arm.fault(sample, silent=self._missing >= 5)
        self.arm.write_torques(np.zeros(7))
        return fault


def other_host(rig: Rig, message: can.Message) -> None:
    MemoryCanBus(rig.hub, VirtualClock(rig.clock.now_ns())).send(message)


@pytest.mark.parametrize(
    ("happens", "code", "values"),
    [
        (lambda rig: rig.press("estop"), ArmFault.ESTOP, ()),
        (lambda rig: rig.press("idle"), ArmFault.ARM_IDLED, ()),
        (lambda rig: rig.has(Supply(volts=20.0)), ArmFault.VOLTAGE, ()),
        (lambda rig: other_host(rig, torque_frame(1, [8000, 0, 0, 0])), ArmFault.FOREIGN_TORQUE, (1.0,)),
        (lambda rig: rig.has(Silence(nodes=(10,))), ArmFault.SAFETY_SILENT, ()),
        (lambda rig: rig.has(Silence(nodes=(1, 3, 5)), 0.05), ArmFault.ARM_SILENT, (135.0,)),
        (lambda rig: rig.has(BrownOut(nodes=(6,), down_s=0.0)), ArmFault.PUCK_RESET, (6.0,)),
        (lambda rig: rig.has(SetProperty(node=4, name="P", value=50_000)), ArmFault.POSITION_JUMP, (4.0,)),
        (lambda rig: rig.has(SetProperty(node=10, name="ZERO", value=0)), ArmFault.ZERO_LOST, ()),
        (lambda rig: rig.has(SetProperty(node=2, name="MODE", value=0)), ArmFault.MOTOR_IDLE, (2.0,)),
        (lambda rig: other_host(rig, set_property(0x400, 8, 2)), ArmFault.MODE_RAISED, (0.0,)),
        (lambda rig: rig.has(Duplicate(), 1.0), ArmFault.STALE_FLOOD, ()),
        (lambda rig: rig.has(Flood(id=0x4A3, data="01", period_s=0.0005), 1.0), ArmFault.MALFORMED_FLOOD, ()),
        (lambda rig: rig.has(BusOff(), 0.05), ArmFault.BUS_OFF, ()),
        (lambda rig: rig.has(QueueFull(), 0.05), ArmFault.QUEUE_FULL, ()),
        (lambda rig: rig.has(Unplug()), ArmFault.ADAPTER_GONE, ()),
    ],
    ids=lambda value: value.value if isinstance(value, ArmFault) else "",
)
def test_each_fault_of_an_active_arm_has_its_name(
    happens: Callable[[Rig], None], code: ArmFault, values: tuple[float, ...]
) -> None:
    """Protects the operator: what happened is named, with the nodes concerned, before anything vaguer."""
    rig = Rig()
    rig.press("activate")
    assert rig.run(100) == []
    happens(rig)
    seen = rig.run(600)
    assert seen[0].code is code
    if values or code is ArmFault.ESTOP:
        assert seen[0].values[: len(values)] == values


def test_a_few_bad_frames_are_no_fault() -> None:
    """Protects availability: single corrupt replies and error frames are dropped, counted and forgotten."""
    rig = Rig()
    rig.press("activate")
    rig.run(50)
    for _ in range(20):
        rig.has(Corrupt(node=3, data="1F0000"))
        rig.has(ErrorFrame())
        assert rig.run(10) == []
    assert rig.arm.watch.error_frames == 20
    assert rig.arm.repeated_requests >= 10


def test_old_safety_firmware_tells_no_cause() -> None:
    """Protects against claiming what is not known: before firmware 197 a voltage fault is an arm that went idle."""
    rig = Rig(motor_firmware=141)
    rig.press("activate")
    rig.run(50)
    rig.has(Supply(volts=20.0))
    assert [fault.code for fault in rig.run(50)] == [ArmFault.ARM_IDLED]


def test_motors_in_torque_mode_in_an_idle_arm_are_noticed() -> None:
    """Protects whoever reaches into an idle arm: a single puck that another host has raised is found by asking it."""
    rig = Rig()
    rig.run(50)
    rig.has(SetProperty(node=5, name="MODE", value=2))
    assert rig.run(900)[0] == NamedFault(ArmFault.MODE_RAISED, (5.0,))


def test_forgetting_ends_a_fault_that_is_over() -> None:
    """Protects recovery: what was counted is past; what still is comes back at once."""
    rig = Rig()
    rig.press("activate")
    rig.run(30)
    other_host(rig, torque_frame(2, [1, 0, 0]))
    assert rig.run(5)
    rig.arm.forget_faults()
    assert rig.run(20) == []
    rig.press("estop")
    rig.run(60)
    rig.arm.forget_faults()
    assert rig.run(1)[0].code is ArmFault.ESTOP
    assert rig.arm.mode is ArmMode.ESTOP


@pytest.mark.parametrize(
    ("cause", "code"),
    [
        (OSError(errno.ENOBUFS, "no buffer space"), ArmFault.QUEUE_FULL),
        (can.CanOperationError("Transmit buffer full", errno.ENOBUFS), ArmFault.QUEUE_FULL),
        (OSError(errno.ENODEV, "no such device"), ArmFault.ADAPTER_GONE),
        (can.CanOperationError("failed", errno.ENETDOWN), ArmFault.ADAPTER_GONE),
        (can.CanOperationError("failed"), ArmFault.BUS_FAILED),
        (None, ArmFault.BUS_FAILED),
    ],
)
def test_an_error_of_the_bus_has_a_name(cause: Exception | None, code: ArmFault) -> None:
    """Protects the advice: a full queue, a vanished adapter and anything else are told apart, by errno."""
    error = BusError("can0", "it failed.")
    error.__cause__ = cause
    assert bus_fault(error).code is code


@pytest.mark.parametrize("fault", ArmFault)
def test_every_fault_says_cause_reaction_and_cure(fault: ArmFault) -> None:
    """Protects the reader: each is a sentence; where the bus is lost nothing claims a stop."""
    text = ARM_FAULTS[fault]
    assert all(part.endswith(".") for part in (text.cause, text.arm_does, text.operator))
    if text.recovery is Recovery.REOPEN:
        assert text.reaction is Reaction.NONE
        assert "last torque until the safety puck's heartbeat" in text.arm_does
