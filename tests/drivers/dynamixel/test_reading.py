"""What is read at once, and that a silent motor costs the other no more than its time-out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.dynamixel.control_tables import MODELS, XM430_W350, MotorModel, model_by_number
from drivers.dynamixel.discovery import motor_bus
from drivers.dynamixel.reading import (
    EXCLUDE_AFTER,
    FIRST_PROBES_NS,
    GIVE_UP_NS,
    PROBE_NS,
    PairReader,
    direct_plan,
    indirect_map,
    mapped_plan,
)

RigOf = Callable[..., Any]
MODELS_OF_BOTH = [(28, 1), (29, 1), (30, 2), (1020, 2), (1060, 2)]
EVERY = pytest.mark.parametrize(
    ("number", "protocol"), MODELS_OF_BOTH, ids=[str(number) for number, _ in MODELS_OF_BOTH]
)
SAID = {"position": 700, "velocity": 12, "effort": 210, "voltage": 118, "temperature": 41, "torque": 1}
MILLISECOND = 1_000_000


def reader_of(rig_of: RigOf, number: int, protocol: int, **manners: Any) -> tuple[PairReader, Any]:
    """A prepared reader of motors 1 and 2, and their rig."""
    rig = rig_of((1, number, protocol), (2, number, protocol))
    for motor in rig.motors:
        for name, value in SAID.items():
            motor[name] = value
        for name, value in manners.items():
            setattr(motor, name, value)
    reader = PairReader(motor_bus(protocol, rig.port), (1, 2), model_by_number(number))
    reader.prepare()
    return reader, rig


def test_the_direct_blocks_are_the_reference_s() -> None:
    """126, length 10 (reference 2.3) and 36, length 8 (reference 2.2)."""
    fast = {model.name: direct_plan(model).fast for model in MODELS.values()}
    assert {(block.address, block.layout.size) for block in fast.values()} == {(126, 10), (36, 8)}
    (torque,) = direct_plan(MODELS[28]).slow
    assert (torque.address, torque.layout.size) == (24, 12)
    assert torque.decode(bytes((1, *range(9), 0x99, 0x01))) == {"torque_enable": 1, "torque_limit": 409}


def test_the_map_names_every_byte() -> None:
    """Each byte of a multi-byte item needs an entry of its own (reference 2.3)."""
    plan = mapped_plan(XM430_W350)
    addresses = indirect_map(XM430_W350, plan)
    wanted = [126, 127, 128, 129, 130, 131, 132, 133, 134, 135, 64, 70, 98, 144, 145, 146]
    assert [int.from_bytes(addresses[at : at + 2], "little") for at in range(0, len(addresses), 2)] == wanted
    assert (plan.fast.address, plan.fast.layout.size) == (224, 16)


@given(st.sampled_from(list(MODELS.values())), st.binary(min_size=21, max_size=21))
def test_blocks_decode_as_their_registers_do(model: MotorModel, data: bytes) -> None:
    """One struct for the whole block gives what each register alone gives, signs and all."""
    for block in (direct_plan(model).fast, *direct_plan(model).slow):
        content = data[: block.layout.size]
        for name, value in block.decode(content).items():
            register = model.registers[name]
            start = register.address - block.address
            assert value == register.decode(content[start : start + register.size])


@EVERY
def test_everything_is_known_from_the_start(rig_of: RigOf, number: int, protocol: int) -> None:
    """Values of every kind after `prepare`, and again after a motor said something else."""
    reader, rig = reader_of(rig_of, number, protocol)
    effort = model_by_number(number).effort_register
    expected = {"present_position": 700, "present_velocity": 12, effort: 210, "present_temperature": 41}
    expected |= {"present_input_voltage": 118, "torque_enable": 1, "hardware_error_status": 0}
    for values in reader.values:
        assert {name: values[name] for name in expected} == expected
    rig.motors[1]["position"], rig.motors[1]["effort"] = 650, 180
    assert reader.read(rig.clock.now_ns()) == (None, None)
    assert [values["present_position"] for values in reader.values] == [700, 650]
    assert [values[effort] for values in reader.values] == [210, 180]


def test_protocol_2_takes_one_request_a_round(rig_of: RigOf) -> None:
    """All of it in one fast sync read of 16 bytes a motor: nothing is read in turn any more."""
    reader, rig = reader_of(rig_of, 1020, 2)
    rig.line.sent.clear()
    for _ in range(12):
        reader.read(rig.clock.now_ns())
    assert {packet[7:12] for packet in rig.line.sent} == {b"\x8a\xe0\x00\x10\x00"}
    assert len(rig.line.sent) == 12


@pytest.mark.parametrize(("maps", "instruction"), [(True, 0x82), (False, 0x82)])
def test_what_a_firmware_does_not_know_is_done_without(rig_of: RigOf, maps: bool, instruction: int) -> None:
    """No fast sync read, no indirect map: found out by trying, and everything is read all the same."""
    reader, rig = reader_of(rig_of, 1020, 2, maps=maps, fast=False)
    assert reader.plan.mapped is maps
    for motor in rig.motors:
        motor["temperature"], motor["hardware"] = 77, 0x20
    rig.line.sent.clear()
    for _ in range(15):
        assert reader.read(rig.clock.now_ns()) == (None, None)
    assert {packet[7] for packet in rig.line.sent} == {instruction}
    assert [values["present_temperature"] for values in reader.values] == [77, 77]
    assert [values["hardware_error_status"] for values in reader.values] == [0x20, 0x20]


@EVERY
def test_a_dead_motor_does_not_silence_the_other(rig_of: RigOf, number: int, protocol: int) -> None:
    """From the second round on the living one is heard in every round; the dead one is asked every 10 ms for a moment,
    as it may be back, and then only now and then."""
    reader, rig = reader_of(rig_of, number, protocol)
    rig.motors[0].silent = True  # the first of a sync read, for whose answer the other waits
    reader.read(rig.clock.now_ns())
    durations_ns = []
    for _ in range(200):
        start_ns = rig.clock.now_ns()
        errors = reader.read(start_ns)
        assert errors[0] is not None
        assert errors[1] is None
        durations_ns.append(rig.clock.now_ns() - start_ns)
    assert reader.missed[0] == 201
    assert max(durations_ns) < 14 * MILLISECOND  # once: two silences, a time-out, an answer
    slow = [at for at, duration_ns in enumerate(durations_ns) if duration_ns > 3 * MILLISECOND]
    elapsed_ns = sum(durations_ns)
    assert len(slow) <= 1 + EXCLUDE_AFTER + 2 * GIVE_UP_NS // FIRST_PROBES_NS + elapsed_ns // PROBE_NS


@EVERY
def test_a_motor_that_comes_back_is_heard_again(rig_of: RigOf, number: int, protocol: int) -> None:
    """Within one probe; and what is read in turn is read at once, as it may have restarted."""
    reader, rig = reader_of(rig_of, number, protocol)
    rig.motors[1].silent = True
    for _ in range(10):
        reader.read(rig.clock.now_ns())
    rig.motors[1].silent = False
    rig.motors[1]["torque"] = 0
    back_ns = rig.clock.now_ns()
    while reader.missed != [0, 0]:
        reader.read(rig.clock.now_ns())
        rig.clock.advance_to_ns(rig.clock.now_ns() + MILLISECOND)
    assert rig.clock.now_ns() - back_ns < PROBE_NS + 20 * MILLISECOND
    assert reader.values[1]["torque_enable"] == 0


def test_an_alarm_of_protocol_1_is_followed_at_once(rig_of: RigOf) -> None:
    """The error byte says overload: whether the motor still holds is read in the same round."""
    reader, rig = reader_of(rig_of, 28, 1)
    rig.motors[0].alarms, rig.motors[0]["limit"] = 0x20, 0
    reader.read(rig.clock.now_ns())
    assert (reader.values[0]["hardware_error_status"], reader.values[0]["torque_limit"]) == (0x20, 0)
    assert reader.alert == [True, False]


def test_a_lost_map_is_given_back(rig_of: RigOf) -> None:
    """A restart empties the map; `read_anew` writes it again and reads all of the motor."""
    reader, rig = reader_of(rig_of, 1020, 2)
    rig.motors[0].forget_map()
    assert reader.read(rig.clock.now_ns()) == (None, None)
    assert reader.values[0]["present_input_voltage"] == 0  # nothing is mapped: all zero, which no supply can be
    reader.read_anew(0)
    assert reader.values[0]["present_input_voltage"] == 118
    assert reader.read(rig.clock.now_ns()) == (None, None)
    assert reader.values[0]["present_position"] == 700
