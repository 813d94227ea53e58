"""Inspecting, bringing up and adopting one motor of every model, against literal motors."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from typing import Any

import pytest

from drivers.dynamixel.control_tables import model_by_number
from drivers.dynamixel.discovery import motor_bus
from drivers.dynamixel.load_law import LoadLaw
from drivers.dynamixel.motor import TendonMotor
from drivers.dynamixel.settings import MotorSettings
from drivers.errors import DeviceError, ProtocolError

RigOf = Callable[..., Any]
MODELS = [(28, 1), (29, 1), (30, 2), (1020, 2), (1030, 2), (1060, 2)]
EVERY = pytest.mark.parametrize(("number", "protocol"), MODELS, ids=[str(number) for number, _ in MODELS])
TORQUE = {1: 24, 2: 64}
LOAD_LAW = LoadLaw(torque_per_effort_Nm=2.0, friction_effort=0.05)


def make(rig_of: RigOf, number: int, protocol: int, **settings: Any) -> tuple[TendonMotor, Any, Any]:
    """Driver's motor, literal motor, rig."""
    rig = rig_of((1, number, protocol))
    rig.motors[0]["position"] = 500
    model = model_by_number(number)
    law = LoadLaw() if model.effort == "current" else LOAD_LAW
    motor = TendonMotor(motor_bus(protocol, rig.port), MotorSettings(1, 1, 400, load_law=law, **settings), model)
    return motor, rig.motors[0], rig


def addresses(literal: Any) -> list[int]:
    return [address for address, _ in literal.writes]


@EVERY
def test_inspection_writes_nothing(rig_of: RigOf, number: int, protocol: int) -> None:
    """What is only looked at must not change."""
    motor, literal, _ = make(rig_of, number, protocol)
    found = motor.inspect()
    assert (found.identity.model_number, found.identity.protocol, found.identity.adopted) == (number, protocol, False)
    assert found.position_ticks == 500
    assert literal.writes == []


@EVERY
def test_torque_comes_last_at_the_present_position_and_under_a_small_ceiling(
    rig_of: RigOf, number: int, protocol: int
) -> None:
    """Switched on, a motor neither moves nor pulls: ceiling, then goal (it switches protocol 1.0 on), then torque."""
    motor, literal, _ = make(rig_of, number, protocol)
    goal, ceiling = motor.bring_up(motor.inspect())
    model = motor.model
    assert goal == literal["goal"] == 500
    assert literal["torque"] == 1
    places = [model.registers[name].address for name in (model.ceiling, "goal_position", "torque_enable")]
    assert [address for address in addresses(literal) if address in places] == places
    assert 0 < ceiling * model.ceiling_unit < 0.3
    assert literal["delay"] == 0
    if protocol == 2:
        assert literal["mode"] == (5 if model.has_current_modes else 4)
        assert addresses(literal).index(11) < addresses(literal).index(places[0])  # a mode change resets the ceiling
        assert literal["watchdog"] == 10
        assert addresses(literal)[-1] == 98


@EVERY
def test_a_holding_motor_is_adopted_without_ever_letting_go(rig_of: RigOf, number: int, protocol: int) -> None:
    """No torque off, no mode, no EEPROM, no other goal, no other ceiling: the object stays in the hand."""
    motor, literal, _ = make(rig_of, number, protocol)
    model = motor.model
    literal["torque"], literal["goal"] = 1, 530
    if protocol == 2:
        literal["mode"] = model.position_modes[-1]
    ceiling = model.registers[model.ceiling]
    literal.memory[ceiling.address : ceiling.address + ceiling.size] = (200).to_bytes(2, "little")
    found = motor.inspect()
    assert found.identity.adopted
    assert found.identity.refusal == ""
    assert motor.bring_up(found) == (530, 200)
    forbidden = {TORQUE[protocol], ceiling.address, model.registers["goal_position"].address}
    assert not forbidden & set(addresses(literal))
    assert all(address >= model.eeprom_end for address in addresses(literal))


@pytest.mark.parametrize(
    ("number", "protocol", "spoil", "may_pay_out"),
    [
        (1020, 2, {"mode": 3}, True),
        (1020, 2, {"mode": 4}, True),
        (1020, 2, {"mode": 0}, False),
        (1060, 2, {"mode": 16}, False),
        (29, 1, {"lower": 0, "upper": 0}, False),
    ],
)
def test_a_motor_that_holds_in_another_mode_is_left_alone(
    rig_of: RigOf, number: int, protocol: int, spoil: dict[str, int], may_pay_out: bool
) -> None:
    """Changing the mode would let go: it is refused in words, and not one byte is written."""
    motor, literal, _ = make(rig_of, number, protocol)
    for name, value in {"torque": 1, **spoil}.items():
        literal[name] = value
    found = motor.inspect()
    assert "would let go" in found.identity.refusal
    assert found.may_pay_out is may_pay_out
    motor.bring_up(found)
    assert literal.writes == []


def test_a_wheel_without_torque_becomes_a_joint(rig_of: RigOf) -> None:
    """Protocol 1.0: both angle limits 0 is a wheel, which would wind for ever."""
    motor, literal, _ = make(rig_of, 28, 1)
    literal["lower"] = literal["upper"] = 0
    motor.bring_up(motor.inspect())
    assert (literal["lower"], literal["upper"]) == (0, 1023)


def test_multi_turn_mx_takes_goals_beyond_a_turn(rig_of: RigOf) -> None:
    """Both limits at 4095: the whole tendon may lie across the end of a turn."""
    motor, literal, _ = make(rig_of, 29, 1)
    literal["lower"] = literal["upper"] = 4095
    assert motor.inspect().goal_range == (-28672, 28672)


@EVERY
def test_eeprom_is_not_written_when_it_is_right(rig_of: RigOf, number: int, protocol: int) -> None:
    """EEPROM wears; a second start has nothing to write there."""
    motor, literal, _ = make(rig_of, number, protocol)
    motor.bring_up(motor.inspect())
    literal["torque"] = 0
    literal.writes.clear()
    motor.bring_up(motor.inspect())
    assert all(address >= motor.model.eeprom_end for address in addresses(literal))


@pytest.mark.parametrize(
    ("number", "protocol", "spoil", "reason"),
    [
        (1020, 2, {"hardware": 0x20}, "hardware error: overload.*motors --reboot 1"),
        (1060, 2, {"hardware": 0x05}, "hardware error: input voltage, overheating"),
        (1020, 2, {"offset": 7}, "Homing Offset 7"),
        (1020, 2, {"firmware": 37}, "firmware 37; the bus watchdog needs 38"),
        (1020, 2, {"model": 1030}, "is a XM430-W210; expected a XM430-W350"),
    ],
)
def test_unfit_motors_are_refused_before_anything_is_written(
    rig_of: RigOf, number: int, protocol: int, spoil: dict[str, int], reason: str
) -> None:
    """What it has, what is expected, what to do."""
    motor, literal, _ = make(rig_of, number, protocol)
    for name, value in spoil.items():
        literal[name] = value
    with pytest.raises(DeviceError, match=reason):
        motor.inspect()
    assert literal.writes == []


@pytest.mark.parametrize(("limit", "refused"), [(0, True), (1023, False)])
def test_a_protocol_1_motor_has_tripped_when_its_torque_limit_is_gone(rig_of: RigOf, limit: int, refused: bool) -> None:
    """An alarm with Torque Limit 0 is a shutdown; a voltage alarm alone does not let go."""
    motor, literal, _ = make(rig_of, 29, 1)
    literal["limit"], literal["torque"], literal.alarms = limit, 1, 0x20 if refused else 0x01
    if refused:
        with pytest.raises(DeviceError, match="hardware error: overload"):
            motor.inspect()
    else:
        assert motor.inspect().identity.adopted


@EVERY
def test_two_motors_with_one_id_are_noticed(rig_of: RigOf, number: int, protocol: int) -> None:
    """They answer a ping as one; their positions collide on the wire."""
    rig = rig_of((1, number, protocol), (1, number, protocol))
    rig.motors[0]["position"], rig.motors[1]["position"] = 421, 618
    motor = TendonMotor(motor_bus(protocol, rig.port), MotorSettings(1, 1, 400), model_by_number(number))
    with pytest.raises(DeviceError, match=r"does not seem to be alone.*give each its own id"):
        motor.inspect()


def test_an_answer_that_comes_twice_is_two_motors(rig_of: RigOf) -> None:
    """With different return delays they answer one after the other, each perfectly."""
    motor, _, rig = make(rig_of, 1020, 2)
    rig.line.spoil = lambda answer: answer + answer
    with pytest.raises(DeviceError, match="does not seem to be alone"):
        motor.inspect()


@pytest.mark.parametrize("doubled", range(1, 8))
def test_an_answer_that_comes_twice_once_is_no_second_motor(rig_of: RigOf, doubled: int) -> None:
    """A pause of the machine lets an answer to an earlier question be found behind a later one."""
    motor, _, rig = make(rig_of, 1020, 2)
    reads = count(1)
    rig.line.spoil = lambda answer: answer + answer if next(reads) == doubled else answer
    assert motor.inspect().identity.refusal == ""


def test_a_moving_motor_is_not_taken_up(rig_of: RigOf) -> None:
    """Two positions far apart: the goal would be a position it has left."""
    motor, literal, rig = make(rig_of, 1020, 2)

    def drift(answer: bytes) -> bytes:
        literal["position"] += 60
        return answer

    rig.line.spoil = drift
    with pytest.raises(ProtocolError, match="while it should stand still"):
        motor.inspect()


def test_writes_are_acknowledged_from_now_on(rig_of: RigOf) -> None:
    """A status return level below 2 would make every write look lost."""
    motor, literal, rig = make(rig_of, 1020, 2)
    literal["level"] = 1
    motor.bring_up(motor.inspect())
    assert literal["level"] == 2
    assert any(packet[4] == 0xFE and packet[7:10] == b"\x83\x44\x00" for packet in rig.line.sent)


def test_reboot_waits_for_the_motor(rig_of: RigOf) -> None:
    """The motor is silent for some 0.3 s; a hardware error that remains is told."""
    motor, literal, rig = make(rig_of, 1020, 2)
    literal["hardware"] = 0x20
    heard = []

    def restart(answer: bytes) -> bytes:
        heard.append(rig.clock.now_ns())
        return answer if rig.clock.now_ns() > 300_000_000 else b""

    rig.line.spoil = restart
    with pytest.raises(DeviceError, match="overload"):
        motor.reboot(rig.clock)
    assert 300_000_000 < rig.clock.now_ns() < 400_000_000
    literal["hardware"] = 0
    motor.reboot(rig.clock)


def test_reboot_that_never_ends_is_told(rig_of: RigOf) -> None:
    """A motor that does not come back: two seconds, and a reason."""
    motor, literal, rig = make(rig_of, 1020, 2)
    literal.silent = True
    with pytest.raises(DeviceError, match="did not come back"):
        motor.reboot(rig.clock)
    assert rig.clock.now_ns() < 2_200_000_000
