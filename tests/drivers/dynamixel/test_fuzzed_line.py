"""Arbitrary bytes on the motors' line, at both ends of it: nothing crashes, hangs, or is taken for a value."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.clock import VirtualClock
from drivers.dynamixel.control_tables import MODELS, MX_28, XM430_W350, MotorModel, model_by_number
from drivers.dynamixel.load_law import published_law
from drivers.dynamixel.port import WaitingPort
from drivers.dynamixel.settings import MotorSettings
from drivers.dynamixel.tendons import TendonPair, TendonSetPoint
from drivers.simulated import dynamixel_packets as packets2
from drivers.simulated import dynamixel_packets1 as packets1
from drivers.simulated.serial_lines import MemoryLine
from tests.drivers.simulated.motor_bench import Bench

SET_POINT = TendonSetPoint((0.0, 0.0), (20.0, 20.0))
NOISE = st.lists(st.binary(max_size=60), min_size=1, max_size=12)
HEADERS = [b"\xff\xff\xfd\x00", b"\xff\xff\xfd\x00\x01\x0e\x00\x55", b"\xff\xff", b"\xff\xff\x01\x0a\x00", b""]
QUICK = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


class PairRig:
    """Two literal motors at rest at their zeros and the driver, started."""

    def __init__(self, rig: Any, number: int) -> None:
        self.rig = rig
        model = model_by_number(number)
        for motor in rig.motors:
            motor["position"] = motor["goal"] = 600
        law = published_law(model, 0.0105)
        right, left = (MotorSettings(n, 1, 600, 0.0105, law, model.name) for n in (1, 2))
        self.pair = TendonPair(rig.port, rig.clock, (right, left))
        self.pair.start()


@pytest.fixture(params=[(1020, 2), (29, 1)], ids=["XM430-W350", "MX-28"])
def pair_rig(request: Any, rig_of: Any) -> PairRig:
    number, protocol = request.param
    return PairRig(rig_of((1, number, protocol), (2, number, protocol)), number)


@QUICK
@given(NOISE, st.sampled_from(HEADERS))
def test_noise_for_answers_leaves_the_sample_as_it_was(pair_rig: PairRig, noise: list[bytes], header: bytes) -> None:
    """Whatever comes, exchanges go on in time, keep the last values, and count up; good answers end it."""
    rig, pair = pair_rig.rig, pair_rig.pair
    good = pair.exchange(SET_POINT)
    chunks = [header + chunk for chunk in noise]
    rig.line.spoil = lambda answer: chunks[len(rig.line.sent) % len(chunks)]
    for count in range(1, 6):
        start_ns = rig.clock.now_ns()
        sample = pair.exchange(SET_POINT)
        assert rig.clock.now_ns() - start_ns < 40_000_000
        assert max(sample.missed) >= 1 + (count > 1)
        assert (sample.excursion_m, sample.effort, sample.rate_m_s) == (good.excursion_m, good.effort, good.rate_m_s)
        assert sample.torque_on == (True, True)
    rig.line.spoil = lambda answer: answer
    for _ in range(60):
        rig.clock.advance_to_ns(rig.clock.now_ns() + 10_000_000)
        sample = pair.exchange(SET_POINT)
    assert sample.missed == (0, 0)


@QUICK
@given(st.sampled_from(list(MODELS.values())), NOISE, st.sampled_from(HEADERS))
def test_noise_for_requests_is_survived_by_simulated_motors(
    model: MotorModel, noise: list[bytes], header: bytes
) -> None:
    """They find no packet, or one by chance; afterwards they answer as before."""
    bench = Bench(model)
    for chunk in noise:
        bench.sim.receive(header + chunk, bench.now_ns)
    bench.now_ns += 400_000_000  # a packet that never became whole is forgotten; a reboot is over
    assert answers_to_ping(bench)


@QUICK
@given(
    st.sampled_from([MX_28, XM430_W350]),
    st.lists(st.tuples(st.integers(0, 254), st.integers(0, 255), st.binary(max_size=24)), min_size=1, max_size=8),
)
def test_any_well_made_request_is_survived(model: MotorModel, requests: list[tuple[int, int, bytes]]) -> None:
    """Every instruction with every content, its checksum right: resets, reboots, writes anywhere, absurd groups."""
    bench = Bench(model)
    pack = packets2.pack_instruction if model.protocol == 2 else packets1.pack
    for motor_id, instruction, parameters in requests:
        bench.sim.receive(pack(motor_id, instruction, parameters), bench.now_ns)
        bench.control(400_000_000)
        for motor in bench.sim.motors:
            for register in model.registers.values():
                assert register.minimum <= motor.value(register.name) <= register.maximum, register.name


def answers_to_ping(bench: Bench) -> bool:
    """Whether somebody answers; noise may have changed an id, a level or the protocol by chance, but not of both."""
    clock = VirtualClock(bench.now_ns)
    line = MemoryLine(bench.sim, clock)
    port = WaitingPort(line, clock)
    asked = [packets1.pack(motor_id, 1) for motor_id in range(4)]
    asked += [packets2.pack_instruction(motor_id, 1) for motor_id in range(4)]
    for request in asked:
        line.write(request)
        clock.advance_to_ns(clock.now_ns() + 5_000_000)
        if line.read(100):
            port.close()
            return True
    return False
