"""Zero calibration against the simulated arm, on virtual time, and what later start-ups make of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import count
from math import pi

import can
import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.clock import VirtualClock
from drivers.errors import DeviceError, ProtocolError
from drivers.simulated.can_hub import MemoryCanBus, MemoryCanHub
from drivers.simulated.puck_settings import PuckSettings
from drivers.simulated.safety_watch import SafetySettings
from drivers.simulated.wam import SimulatedWam
from drivers.wam.arm import Arm
from drivers.wam.homing import read_mechanical_counts
from drivers.wam.parameters import WamParameters, load_wam_parameters
from drivers.wam.startup import Operator
from drivers.wam.zero_calibration import ZeroMeasurement

PARAMETERS = load_wam_parameters()
FIELD_HOME = np.array([-0.00102, -1.86447, -0.03521, 3.08424, -0.03819, 0.14122, -0.00688])
"""A real arm's home, reference 4.4."""


class Plant:
    """Joints that the test places, and that may drift a little each time somebody looks."""

    def __init__(self, joint_rad: NDArray[np.float64]) -> None:
        self.joint_rad = joint_rad.copy()
        self.drift_rad = 0.0

    def joint_position_rad(self) -> NDArray[np.float64]:
        self.joint_rad = self.joint_rad + self.drift_rad
        return self.joint_rad

    def set_joint_torque_Nm(self, torque_Nm: NDArray[np.float64], braking: bool, at_ns: int) -> None:
        assert not torque_Nm.any()


class Rig:
    """A strict simulated arm, which loses what is not paced, on one virtual wire."""

    def __init__(
        self, *, firmware: int = 200, booted: bool = True, pucks: dict[int, PuckSettings] | None = None
    ) -> None:
        self.plant = Plant(FIELD_HOME)
        self.wam = SimulatedWam(
            self.plant,
            PARAMETERS,
            booted=booted,
            motor_firmware=firmware,
            pucks=pucks,
            safety=SafetySettings(set_gap_s=0.01),
            set_gap_s=0.0003,
            power_up_s=3.5,
        )
        self.hub = MemoryCanHub([self.wam])
        self.clock = VirtualClock()
        self.bus = MemoryCanBus(self.hub, self.clock)

    def press(self, button: str) -> None:
        self.hub.transmit(self.wam.press(button, self.clock.now_ns()), self.wam)

    def measurement(self, parameters: WamParameters = PARAMETERS) -> ZeroMeasurement:
        return ZeroMeasurement(self.bus, self.clock, parameters)

    def mech(self, node: int) -> int:
        """MECH of firmware 200 by a raw frame (reference 2.1)."""
        self.bus.send(can.Message(arbitration_id=node, is_extended_id=False, data=b"\x42"))
        message = self.bus.receive(self.clock.now_ns() + 10_000_000)
        assert message is not None
        return int.from_bytes(message.data[2:], "little")

    def positions(self, parameters: WamParameters) -> NDArray[np.float64]:
        """Joint angles that a started driver reads."""
        arm = Arm(self.bus, self.clock, parameters)
        arm.start()
        arm.request_positions()
        return arm.collect_positions(self.clock.now_ns() + 1_500_000).joint_rad


@pytest.mark.parametrize("booted", [True, False])
def test_calibrated_angles_are_those_at_zero_joints(booted: bool) -> None:
    """Protects the meaning of zero_angle_rad: what each encoder shows when all joints are at zero, woken or not."""
    rig = Rig(booted=booted)
    measurement = rig.measurement()
    measurement.prepare()
    found = measurement.measure(FIELD_HOME)
    assert found.absolute_encoders == (1, 2, 3, 4, 5, 6, 7)
    assert found.notes == ()
    rig.plant.joint_rad = np.zeros(7)
    shown = np.array([rig.mech(node) for node in range(1, 8)]) * 2 * pi / 4096
    difference = np.mod(found.zero_angle_rad - shown + pi, 2 * pi) - pi
    np.testing.assert_allclose(difference, 0.0, atol=1.01 * 2 * pi / 4096)
    assert rig.wam.heard["torque"] == 0
    assert rig.wam.heard["lost_set"] == 0


def test_later_starts_find_a_sloppily_placed_arm() -> None:
    """Protects every morning: calibrated once, an arm put 1.5° beside home at each joint is read where it stands."""
    rig = Rig()
    measurement = rig.measurement()
    measurement.prepare()
    found = measurement.measure(FIELD_HOME)
    positions = measurement.zero(found)
    assert positions.plan is not None
    assert rig.wam.mode == 1
    calibrated = replace(PARAMETERS, home_rad=found.home_rad, zero_angle_rad=found.zero_angle_rad)
    np.testing.assert_allclose(rig.positions(calibrated), FIELD_HOME, atol=4e-4)
    rig.press("estop")
    rig.press("release")
    rig.press("idle")
    rig.clock.advance_to_ns(rig.clock.now_ns() + 4_000_000_000)
    rig.plant.joint_rad = FIELD_HOME + np.array([1, -1, 1, -1, 1, -1, 1]) * 0.026
    np.testing.assert_allclose(rig.positions(calibrated), rig.plant.joint_rad, atol=4e-4)
    rig.plant.joint_rad = np.zeros(7)
    np.testing.assert_allclose(rig.positions(calibrated), 0.0, atol=4e-4)  # ZERO is 1: kept, not zeroed again


@pytest.mark.parametrize(("firmware", "encoders"), [(60, ()), (118, tuple(range(1, 8))), (141, tuple(range(1, 8)))])
def test_old_generations_calibrate_what_they_have(firmware: int, encoders: tuple[int, ...]) -> None:
    """Protects arms without absolute encoders: home alone, marked as unused, and zeroed by it."""
    rig = Rig(firmware=firmware)
    measurement = rig.measurement()
    measurement.prepare()
    found = measurement.measure(FIELD_HOME)
    assert found.absolute_encoders == encoders
    assert (found.zero_angle_rad >= 0).all() == bool(encoders)
    measurement.zero(found)
    calibrated = replace(PARAMETERS, home_rad=found.home_rad, zero_angle_rad=found.zero_angle_rad)
    np.testing.assert_allclose(rig.positions(calibrated), FIELD_HOME, atol=4e-4)


def test_a_motor_without_encoder_is_left_out() -> None:
    """Protects mixed arms: ROLE without bit 0x0100 gets no angle, its neighbours do."""
    rig = Rig(pucks={4: PuckSettings(properties={"ROLE": 0x00C0})})
    measurement = rig.measurement()
    measurement.prepare()
    found = measurement.measure(FIELD_HOME)
    assert found.absolute_encoders == (1, 2, 3, 5, 6, 7)
    assert found.zero_angle_rad[3] == -1.0


@pytest.mark.parametrize("frame", [(0x404, "30"), (0x401, "AA00000000000000"), (0x423, "000000")])
def test_another_program_on_the_bus_refuses(frame: tuple[int, str]) -> None:
    """Protects a running arm: a position request, a torque frame or an unasked position each tell of a daemon; and
    until then not a word was said."""
    rig = Rig()
    other = MemoryCanBus(rig.hub, VirtualClock(1_000_000))
    message = can.Message(arbitration_id=frame[0], is_extended_id=False, data=bytes.fromhex(frame[1]))
    measurement = rig.measurement()
    rig.clock.advance_to_ns(900_000)
    _send_while_listening(rig, other, message)
    with pytest.raises(DeviceError, match="another program controls the arm"):
        measurement.prepare()
    assert sum(rig.wam.heard.values()) <= 1  # the other's


def _send_while_listening(rig: Rig, other: MemoryCanBus, message: can.Message) -> None:
    """The other's frame arrives after what was waiting has been drained."""
    receive, calls = rig.bus.receive, 0

    def receive_and_send(deadline_ns: int) -> can.Message | None:
        nonlocal calls
        calls += 1
        if calls == 2:
            other.send(message)
        return receive(deadline_ns)

    rig.bus.receive = receive_and_send  # type: ignore[method-assign]  # a host that speaks at the right moment


def test_a_program_that_starts_meanwhile_refuses_too() -> None:
    """Protects the minutes in which the operator places the arm."""
    rig = Rig()
    measurement = rig.measurement()
    measurement.prepare()
    other = MemoryCanBus(rig.hub, VirtualClock(rig.clock.now_ns()))
    _send_while_listening(rig, other, can.Message(arbitration_id=0x404, is_extended_id=False, data=b"\x30"))
    with pytest.raises(DeviceError, match="another program"):
        measurement.measure(FIELD_HOME)


@pytest.mark.parametrize(("button", "words"), [("activate", "active"), ("estop", "E-stop")])
def test_an_arm_that_is_not_idle_refuses(button: str, words: str) -> None:
    """Protects the operator's hands: at first, and again when it matters."""
    rig = Rig()
    rig.press(button)
    with pytest.raises(DeviceError, match=words):
        rig.measurement().prepare()
    rig = Rig()
    measurement = rig.measurement()
    measurement.prepare()
    rig.press(button)
    with pytest.raises(DeviceError, match=words):
        measurement.measure(FIELD_HOME)


def test_a_moving_arm_refuses() -> None:
    """Protects the file from an arm that is still being placed."""
    rig = Rig()
    measurement = rig.measurement()
    measurement.prepare()
    rig.plant.drift_rad = 2e-5
    with pytest.raises(DeviceError, match=r"motor 1 moved \d+ counts"):
        measurement.measure(FIELD_HOME)


def test_an_encoder_that_jumps_refuses(monkeypatch: pytest.MonkeyPatch) -> None:
    """Protects against a loose magnet: the motor rests, its absolute encoder does not."""
    rig = Rig()
    measurement = rig.measurement()
    measurement.prepare()
    reads = count()
    monkeypatch.setattr(
        "drivers.wam.zero_calibration.read_mechanical_counts",
        lambda dialogue, motors: (*read_mechanical_counts(dialogue, motors)[:6], 400 * (next(reads) % 2)),
    )
    with pytest.raises(ProtocolError, match="puck 7: its absolute encoder reads"):
        measurement.measure(FIELD_HOME)


@pytest.mark.parametrize("firmware", [60, 118, 141, 200])
@pytest.mark.parametrize("joint_encoders", [False, True])
def test_every_simulated_generation_starts_and_runs_active(firmware: int, joint_encoders: bool) -> None:
    """Protects the promise of start-up: from E-stop through waking and zeroing to an active arm whose safety puck sees
    no fault in the first cycles, whichever firmware."""
    plant = Plant(PARAMETERS.home_rad)
    wam = SimulatedWam(
        plant,
        PARAMETERS,
        booted=False,
        motor_firmware=firmware,
        joint_encoders=joint_encoders,
        safety=SafetySettings(set_gap_s=0.01),
        set_gap_s=0.0003,
        power_up_s=3.5,
    )
    hub, clock = MemoryCanHub([wam]), VirtualClock()
    arm = Arm(MemoryCanBus(hub, clock), clock, PARAMETERS)
    hub.transmit(wam.press("estop", 0), wam)
    presses: list[Callable[[], object]] = [
        lambda: None,
        lambda: hub.transmit(wam.press("release", clock.now_ns()), wam),
        lambda: hub.transmit(wam.press("idle", clock.now_ns()), wam),
    ]

    def operator_acts() -> bool:
        if presses:
            presses.pop(0)()
        return True

    found = arm.start(Operator(wait_s=10.0, still_wanted=operator_acts))
    assert found.zeroed_at_home
    assert found.motors.position_groups == ((4, 5) if firmware == 60 else (4,))
    hub.transmit(wam.press("activate", clock.now_ns()), wam)
    for _ in range(100):
        clock.advance_to_ns(clock.now_ns() // 2_000_000 * 2_000_000 + 2_000_000)
        hub.step(clock.now_ns())
        arm.request_positions()
        sample = arm.collect_positions(clock.now_ns() + 1_700_000)
        assert sample.complete
        arm.write_torques(np.zeros(7))
    np.testing.assert_allclose(sample.joint_rad, PARAMETERS.home_rad, atol=2e-4)
    assert wam.mode == 2
    assert wam.heard["lost_set"] == 0
