"""Safety puck, pendant coding and guard against the WAM reference 2.6, 4.1 and 4.3."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.clock import VirtualClock
from drivers.errors import BusError, InputError, NoReplyError, ProtocolError
from drivers.simulated.can_hub import MemoryCanBus, MemoryCanHub
from drivers.simulated.can_wire import Frame
from drivers.simulated.wam import SimulatedWam
from drivers.wam.frames import torque_frame
from drivers.wam.parameters import load_wam_parameters
from drivers.wam.safety_puck import ArmMode, Button, Guard, Light, PendantState, SafetyPuck


class Plant:
    """Joints at rest; keeps the last torque."""

    torque_Nm: NDArray[np.float64]
    braking: bool

    def joint_position_rad(self) -> NDArray[np.float64]:
        return np.zeros(7)

    def set_joint_torque_Nm(self, torque_Nm: NDArray[np.float64], braking: bool, at_ns: int) -> None:
        self.torque_Nm, self.braking = torque_Nm, braking


class Rig:
    """A simulated active arm that a host has left with a torque, and a second socket."""

    def __init__(self, firmware: int = 197) -> None:
        self.plant = Plant()
        self.wam = SimulatedWam(self.plant, load_wam_parameters(), zeroed=True, safety_firmware=firmware)
        self.hub = hub = MemoryCanHub([self.wam])
        self.clock = VirtualClock()
        self.bus = MemoryCanBus(hub, self.clock)
        self.wam.press("activate", 0)
        MemoryCanBus(hub, VirtualClock()).send(torque_frame(1, [500, 500, 500, 500]))
        assert self.plant.torque_Nm.any()


_SAFE = Light.SAFE


@pytest.mark.parametrize(
    ("value", "state"),
    [
        (0x0D3F1249, PendantState(Button.NONE, False, True)),
        (0x0E3F124A, PendantState(Button.NONE, True, False, velocity=Light.WARNING)),
        (0x0D06124C, PendantState(Button.NONE, False, True, 0x06, velocity=Light.FAULT)),
        (0x0D061261, PendantState(Button.NONE, False, True, 0x06, torque=Light.FAULT)),
        (0x00794249, PendantState(Button.ESTOP, False, False, 0x79, other=Light.FAULT)),
        (0x093F1249, PendantState(Button.IDLE, False, True)),
        (0x063F1249, PendantState(Button.ACTIVATE, True, False)),
        (0x0D3F1849, PendantState(Button.NONE, False, True, heartbeat=Light.FAULT)),
        (0x0D3F1311, PendantState(Button.NONE, False, True, torque=Light.WARNING, voltage=Light.FAULT)),
    ],
)
def test_pendant_rows_of_the_reference(value: int, state: PendantState) -> None:
    """Protects the fault lights that the operator is told about, both ways."""
    assert PendantState.from_value(value) == state
    assert state.to_value() == value


@pytest.mark.parametrize("value", [0, 0x0D3F124B, 0x0D3F1248])
def test_light_without_one_colour_is_refused(value: int) -> None:
    """Protects against reading noise as a pendant state."""
    with pytest.raises(ProtocolError, match="one bit"):
        PendantState.from_value(value)


def test_guard_idles_an_abandoned_arm_and_confirms() -> None:
    """Protects the arm when the controlling process dies: torque gone, brakes on, and it says so."""
    rig = Rig()
    said = Guard(rig.bus, rig.clock, 197).idle_arm()
    assert rig.wam.mode == 1
    assert rig.plant.braking
    assert not rig.plant.torque_Nm.any()
    assert "confirms: the arm is idle" in said


def test_guard_sends_zero_torques_where_idle_cannot_be_asked() -> None:
    """Protects arms with older safety firmware: no torque is left, and the operator is called."""
    rig = Rig(firmware=190)
    said = Guard(rig.bus, rig.clock, 190).idle_arm()
    assert rig.wam.mode == 2
    assert not rig.plant.torque_Nm.any()
    assert "zero torques" in said
    assert "NOT confirmed" in said
    assert "E-stop" in said


@pytest.mark.parametrize(
    ("firmware", "motor", "head"), [(60, None, 0x89), (32, None, 0x8A), (190, 60, 0x89), (60, 200, 0xAA)]
)
def test_guard_speaks_the_motors_firmware(firmware: int, motor: int | None, head: int) -> None:
    """Protects old arms: zero torques under the number that T has there (reference 3.1), not under 42."""
    rig = Rig()
    listener = MemoryCanBus(rig.hub, VirtualClock())
    Guard(rig.bus, rig.clock, firmware, motor).idle_arm()
    frames = [frame for _, frame in listener.inbox if frame.identifier in (0x401, 0x402)]
    assert [frame.data[0] for frame in frames] == [head, head]


def test_guard_is_not_fooled_by_old_replies() -> None:
    """Protects the confirmation: a MODE reply that waited on the silent socket does not count."""
    rig = Rig()
    rig.bus.inbox.appendleft((0, Frame(0x546, bytes.fromhex("88000100"))))
    rig.wam.silent_nodes.add(10)
    said = Guard(rig.bus, rig.clock, 197).idle_arm()
    assert "NOT confirmed" in said
    assert not rig.plant.torque_Nm.any()


def test_guard_survives_a_dead_bus() -> None:
    """Protects the reporting process: a bus that is gone is said, not raised."""
    rig = Rig()
    rig.bus.close()
    said = Guard(rig.bus, rig.clock, 197).idle_arm()
    assert "NOT confirmed" in said


def test_mode_and_limits() -> None:
    """Protects units and order of the limits: Q4.12 metres per second, 2700 units per N·m, warnings at 0.9."""
    rig = Rig()
    puck = SafetyPuck(rig.bus, rig.clock)
    assert puck.mode() is ArmMode.ACTIVE
    puck.set_limits(1.5, 3.0)
    assert [puck.get(name) for name in ("VL2", "VL1", "TL2", "TL1")] == [6144, 5529, 8100, 7290]
    puck.request_idle()
    assert puck.mode() is ArmMode.IDLE


@pytest.mark.parametrize(("velocity", "torque"), [(0.0, 1.0), (-1.0, 1.0), (1.0, 3.1), (float("nan"), 1.0)])
def test_limits_that_would_disarm_are_refused(velocity: float, torque: float) -> None:
    """Protects the fault limits: zero velocity or too large a torque would switch them off."""
    rig = Rig()
    with pytest.raises(InputError, match="out of range"):
        SafetyPuck(rig.bus, rig.clock).set_limits(velocity, torque)


def test_silence_and_old_firmware_are_errors() -> None:
    """Protects callers from waiting for ever, and from a request that nobody hears."""
    rig = Rig()
    with pytest.raises(InputError, match="Shift-Idle"):
        SafetyPuck(rig.bus, rig.clock, 190).request_idle()
    rig.wam.silent_nodes.add(10)
    with pytest.raises(NoReplyError, match="50 ms"):
        SafetyPuck(rig.bus, rig.clock).mode()
    rig.bus.close()
    with pytest.raises(BusError):
        SafetyPuck(rig.bus, rig.clock).mode()
