"""The arm's driver against the simulated pucks, on virtual time and on real bytes."""

from __future__ import annotations

from dataclasses import dataclass, field

import can
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from drivers.clock import VirtualClock
from drivers.errors import BusError, DeviceError, InputError, NoReplyError, ProtocolError
from drivers.simulated import puck_frames
from drivers.simulated.can_hub import MemoryCanBus, MemoryCanHub
from drivers.simulated.wam import SimulatedWam
from drivers.wam.arm import Arm, ArmSample
from drivers.wam.frames import set_property
from drivers.wam.parameters import load_wam_parameters
from drivers.wam.safety_puck import ArmMode, Light

_PERIOD_NS = 2_000_000
_PARAMETERS = load_wam_parameters()


class Plant:
    """Joints that the test places; records torques."""

    def __init__(self, joint_rad: NDArray[np.float64]) -> None:
        self.joint_rad = joint_rad.copy()
        self.torque_Nm = np.zeros(7)
        self.braking = True
        self.calls = 0

    def joint_position_rad(self) -> NDArray[np.float64]:
        return self.joint_rad

    def set_joint_torque_Nm(self, torque_Nm: NDArray[np.float64], braking: bool, at_ns: int) -> None:
        self.torque_Nm, self.braking = torque_Nm, braking
        self.calls += 1


@dataclass
class Rig:
    """A driver and a simulated arm on one virtual wire."""

    booted: bool = True
    zeroed: bool = True
    joint_rad: NDArray[np.float64] = field(default_factory=lambda: _PARAMETERS.home_rad)

    def __post_init__(self) -> None:
        self.plant = Plant(self.joint_rad)
        self.wam = SimulatedWam(self.plant, _PARAMETERS, booted=self.booted, zeroed=self.zeroed)
        self.hub = MemoryCanHub([self.wam])
        self.clock = VirtualClock()
        self.bus = MemoryCanBus(self.hub, self.clock)
        self.arm = Arm(self.bus, self.clock, _PARAMETERS)

    def press(self, button: str) -> None:
        self.hub.transmit(self.wam.press(button, self.clock.now_ns()), self.wam)

    def cycle(self) -> ArmSample:
        """One reading, in the middle of its period when it ends early."""
        start_ns = self.clock.now_ns() // _PERIOD_NS * _PERIOD_NS + _PERIOD_NS
        self.clock.advance_to_ns(start_ns)
        self.hub.step(start_ns)
        self.arm.request_positions()
        return self.arm.collect_positions(start_ns + 1_500_000)


def _other_host(rig: Rig) -> MemoryCanBus:
    return MemoryCanBus(rig.hub, VirtualClock(rig.clock.now_ns()))


def test_start_keeps_the_positions_of_a_zeroed_arm() -> None:
    """Protects restarts: an arm that knows its position anywhere is read as it is, and not zeroed again."""
    rig = Rig(joint_rad=np.array([0.3, -0.6, 0.9, 1.2, -1.5, 0.7, -0.4]))
    identity = rig.arm.start()
    assert not identity.zeroed_at_home
    assert identity.motors.firmware == (200,) * 7
    assert identity.safety_firmware == 197
    assert identity.motors.units_per_Nm == (2700, 2700, 2700, 2700, 6500, 6500, 17474)
    assert rig.arm.mode is ArmMode.IDLE
    # A motor count is at most 1.03e-4 rad of joint 7, and 1.6e-4 where two motors share a joint (reference 5.4).
    np.testing.assert_allclose(rig.cycle().joint_rad, rig.joint_rad, atol=2e-4)


def test_start_wakes_and_zeroes_an_arm_that_lost_its_positions() -> None:
    """Protects the sequence after E-stop: all pucks woken, positions set for home, ZERO set, later angles right."""
    rig = Rig(booted=False, zeroed=False)
    identity = rig.arm.start()
    assert identity.woken == (1, 2, 3, 4, 5, 6, 7)
    assert identity.zeroed_at_home
    assert rig.arm.zeroed
    rig.plant.joint_rad = rig.joint_rad + 0.005
    np.testing.assert_allclose(rig.cycle().joint_rad, rig.joint_rad + 0.005, atol=2e-4)


@pytest.mark.parametrize(
    ("prepare", "error", "words"),
    [
        (lambda rig: rig.press("estop"), DeviceError, "E-stop"),
        (lambda rig: rig.press("activate"), DeviceError, "Shift-Idle"),
        (lambda rig: rig.wam.silent_nodes.update({3, 5}), NoReplyError, r"\[3, 5\]"),
        (lambda rig: rig.wam.silent_nodes.add(10), NoReplyError, "safety puck"),
        (lambda rig: rig.bus.send(set_property(6, 28, 3)), ProtocolError, "GRPC"),
        (lambda rig: rig.bus.send(set_property(2, 70, 3)), ProtocolError, "PIDX"),
        (lambda rig: rig.bus.send(set_property(2, 86, 0)), ProtocolError, "IPNM"),
    ],
)
def test_start_refuses_what_is_not_a_sound_idle_arm(prepare: object, error: type[DeviceError], words: str) -> None:
    """Protects the operator: each unfit state is named, and no torque or zeroing happens."""
    rig = Rig()
    assert callable(prepare)
    prepare(rig)
    with pytest.raises(error, match=words):
        rig.arm.start()
    assert rig.wam.heard["torque"] == 0


def test_cycle_on_virtual_time_takes_what_the_wire_takes() -> None:
    """Protects the timing that the control rests on: seven replies 0.6 to 0.7 ms after the request."""
    rig = Rig()
    rig.arm.start()
    sample = rig.cycle()
    assert (sample.complete, sample.replies, sample.stale, sample.rejected) == (True, 7, 0, 0)
    elapsed_ns = rig.clock.now_ns() % _PERIOD_NS
    assert 600_000 <= elapsed_ns <= 700_000
    assert 0 < sample.sample_ns % _PERIOD_NS < 100_000


def test_torques_arrive_as_asked_within_a_unit() -> None:
    """Protects signs and units end to end, by the reference's motor formulas and not by the driver's matrices."""
    rig = Rig()
    rig.arm.start()
    rig.press("activate")
    rig.cycle()
    tau = np.array([2.0, -3.0, 4.0, 5.0, 0.5, -0.6, 0.1])
    rig.arm.write_torques(tau)
    N, n3 = np.array([42.0, 28.25, 28.25, 18.0, 9.7, 9.7, 14.93]), 1.68
    t1, t2, t3, t4, t5, t6, t7 = tau
    motor_Nm = [-t1, (t2 - n3 * t3) / 2, (-t2 - n3 * t3) / 2, -t4, (t5 - t6) / 2, (t5 + t6) / 2, -t7] / N
    units = np.floor(np.array([2700, 2700, 2700, 2700, 6500, 6500, 17474]) * motor_Nm)
    assert units.tolist() == [-129, -465, -178, -750, 368, -34, -118]
    T1, T2, T3, T4, T5, T6, T7 = units / [2700, 2700, 2700, 2700, 6500, 6500, 17474] * N
    applied = [-T1, T2 - T3, -(T2 + T3) / n3, -T4, T5 + T6, T6 - T5, -T7]
    np.testing.assert_allclose(rig.plant.torque_Nm, applied, rtol=3e-6)
    assert not rig.plant.braking


def test_torques_are_limited_per_motor() -> None:
    """Protects the shared motors 2 and 3: the limit is on motors, not on joints."""
    rig = Rig()
    rig.arm.start()
    rig.press("activate")
    rig.cycle()
    rig.arm.write_torques([0, 90, 50, 0, 0, 0, 0])
    # Motor 3 alone is beyond MT = 4860 units; motor 2 carries the small difference.
    motor_2_Nm = np.floor((90 - 1.68 * 50) / 56.5 * 2700) / 2700
    assert rig.plant.torque_Nm[1] == pytest.approx(28.25 * (motor_2_Nm + 4860 / 2700), rel=1e-6)


@pytest.mark.parametrize("bad", [[0.0] * 6, [float("nan")] * 7, [float("inf"), *[0.0] * 6], [[0.0] * 7]])
def test_bad_torques_send_nothing(bad: list[float]) -> None:
    """Protects the arm from a command that is no torque: neither of the two frames goes out."""
    rig = Rig()
    rig.arm.start()
    with pytest.raises(InputError):
        rig.arm.write_torques(bad)
    assert rig.wam.heard["torque"] == 0


def _position(node: int, counts: int) -> can.Message:
    frame = puck_frames.position(node, counts)
    return can.Message(arbitration_id=frame.identifier, is_extended_id=False, data=frame.data)


def test_stale_replies_are_dropped() -> None:
    """Protects against last cycle's late replies: before the request, or behind it but before the true one."""
    rig = Rig()
    rig.arm.start()
    other = _other_host(rig)
    other.send(_position(4, -36_000))
    assert rig.cycle().stale == 1
    rig.clock.advance_to_ns(rig.clock.now_ns() // _PERIOD_NS * _PERIOD_NS + _PERIOD_NS)
    rig.arm.request_positions()
    late = VirtualClock(rig.clock.now_ns())
    MemoryCanBus(rig.hub, late).send(_position(1, 500))  # overtakes the replies: ends 58 + 78 µs after the request
    sample = rig.arm.collect_positions(rig.clock.now_ns() + 1_500_000)
    assert (sample.replies, sample.stale) == (7, 1)
    np.testing.assert_allclose(sample.joint_rad, _PARAMETERS.home_rad, atol=2e-4)


def test_missing_puck_keeps_the_last_whole_reading() -> None:
    """Protects the cycle from a lost frame: it asks once more, ends at the deadline, says so, and mixes no times."""
    rig = Rig(joint_rad=np.zeros(7))
    rig.arm.start()
    rig.cycle()
    rig.wam.silent_nodes.add(4)
    rig.plant.joint_rad = np.full(7, 0.004)
    sample = rig.cycle()
    assert (sample.complete, sample.replies, sample.missing) == (False, 6, (4,))
    assert (sample.repeated, sample.extrapolated) == (True, True)
    assert rig.clock.now_ns() % _PERIOD_NS == 1_500_000
    np.testing.assert_allclose(sample.joint_rad, 0.0, atol=2e-4)
    rig.wam.silent_nodes.clear()
    sample = rig.cycle()
    assert sample.complete
    np.testing.assert_allclose(sample.joint_rad, 0.004, atol=2e-4)


def test_implausible_jump_is_rejected() -> None:
    """Protects against a corrupt position: more than a quarter motor turn in a cycle is not believed."""
    rig = Rig(joint_rad=np.zeros(7))
    rig.arm.start()
    rig.cycle()
    quarter_turn_rad = 2 * np.pi / 4
    rig.plant.joint_rad[0] = 0.9 * quarter_turn_rad / 42
    assert rig.cycle().complete
    rig.plant.joint_rad[0] += 1.2 * quarter_turn_rad / 42
    sample = rig.cycle()
    # It was asked once more, and again the answer was not believed: the joint is carried on with its filtered speed.
    assert (sample.complete, sample.rejected, sample.replies) == (False, 2, 6)
    speed_rad_s = 180 * (0.9 * quarter_turn_rad / 42) / (1 + 180 * 0.002)
    assert sample.joint_rad[0] == pytest.approx(0.9 * quarter_turn_rad / 42 + speed_rad_s * 2.72e-3, abs=3e-4)


def test_mode_follows_the_operator_in_passing() -> None:
    """Protects the cycle's view of the mode: unasked frames, polled replies, and silence as offline."""
    rig = Rig()
    rig.arm.start()
    rig.cycle()
    rig.press("activate")
    rig.cycle()
    modes = [rig.arm.mode]
    rig.wam.press("idle", rig.clock.now_ns())  # its unasked frame is lost
    rig.arm.poll_safety_mode()
    rig.cycle()
    modes.append(rig.arm.mode)
    rig.press("estop")
    rig.arm.poll_safety_mode()
    rig.cycle()
    modes.append(rig.arm.mode)
    rig.wam.silent_nodes.add(10)
    for _ in range(12):
        rig.arm.poll_safety_mode()
    modes.append(rig.arm.mode)
    assert modes == [ArmMode.ACTIVE, ArmMode.IDLE, ArmMode.ESTOP, ArmMode.OFFLINE]


def test_zero_and_pendant_are_noticed_when_another_host_asks() -> None:
    """Protects positions after a power loss: ZERO = 0 and the pendant's lights are seen when they pass by."""
    rig = Rig()
    rig.arm.start()
    rig.wam.press("estop", 0)
    other = _other_host(rig)
    for number in (42, 43):
        other.send(can.Message(arbitration_id=0x00A, is_extended_id=False, data=[number]))
    rig.cycle()
    assert rig.arm.zeroed is False
    assert rig.arm.pendant is not None
    assert rig.arm.pendant.other is Light.FAULT


def test_bus_failure_is_raised_and_nothing_is_kept() -> None:
    """Protects against old torques: a frame that was refused is not sent by a later call."""
    rig = Rig()
    rig.arm.start()
    rig.bus.close()
    with pytest.raises(BusError):
        rig.arm.write_torques(np.ones(7))
    assert rig.wam.heard["torque"] == 0


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(0x400, 0x7FF), st.binary(max_size=8)), max_size=40))
def test_noise_on_the_bus_never_stops_the_cycle(noise: list[tuple[int, bytes]]) -> None:
    """Law: whatever others send, a reading returns seven finite angles within its deadline."""
    rig = Rig()
    rig.arm.start()
    other = _other_host(rig)
    for identifier, data in noise:
        other.send(can.Message(arbitration_id=identifier, is_extended_id=False, data=data))
    rig.clock.advance_to_ns(rig.clock.now_ns() + 10 * _PERIOD_NS)
    sample = rig.cycle()
    assert np.isfinite(sample.joint_rad).all()
    assert rig.clock.now_ns() % _PERIOD_NS <= 1_500_000
