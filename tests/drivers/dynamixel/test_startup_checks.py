"""What is refused at the start, what is only warned of, and what a motor that holds already changes about it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.clock import VirtualClock
from drivers.dynamixel.control_tables import MODELS, MX_28, RX_28, XL430_W250, XM430_W350, MotorModel, model_by_number
from drivers.dynamixel.discovery import motor_bus
from drivers.dynamixel.load_law import LoadLaw
from drivers.dynamixel.motor import Inspection, TendonMotor
from drivers.dynamixel.port import WaitingPort
from drivers.dynamixel.settings import Calibration, MotorSettings
from drivers.dynamixel.startup_checks import check_travel, shuts_down_on
from drivers.dynamixel.tendons import TendonPair
from drivers.errors import DeviceError, InputError
from drivers.simulated.dynamixel import SimulatedMotors, SimulatedMotorSettings
from drivers.simulated.serial_lines import MemoryLine
from drivers.simulated.spring_tendons import SpringTendons

RigOf = Callable[..., Any]
MODELS_AND_PROTOCOLS = [(28, 1), (29, 1), (30, 2), (1020, 2), (1030, 2), (1060, 2)]
EVERY = pytest.mark.parametrize(
    ("number", "protocol"), MODELS_AND_PROTOCOLS, ids=[str(n) for n, _ in MODELS_AND_PROTOCOLS]
)
CALIBRATED = Calibration("XM430-W350", firmware=45, voltage_V=12.0, temperature_C=35.0, scatter_N=0.5)


def make(rig_of: RigOf, number: int = 1020, protocol: int = 2, **settings: Any) -> tuple[TendonMotor, Any]:
    """Driver's motor and the literal motor, which stands at 500 ticks with its zero at 97 (RX-28) or 400."""
    rig = rig_of((1, number, protocol))
    rig.motors[0]["position"] = rig.motors[0]["goal"] = 500
    model = model_by_number(number)
    law = LoadLaw() if model.effort == "current" else LoadLaw(torque_per_effort_Nm=2.0, friction_effort=0.05)
    zero = settings.pop("zero_ticks", 97 if number == 28 else 400)
    return TendonMotor(motor_bus(protocol, rig.port), MotorSettings(1, 1, zero, load_law=law, **settings), model), (
        rig.motors[0]
    )


def holding(literal: Any) -> Any:
    """The literal motor with torque on, as some process left it, in the mode that is wanted."""
    literal["torque"], literal["delay"] = 1, 0
    if literal.protocol == 2:
        literal["mode"] = 5 if literal.model in (1020, 1030) else 4
    return literal


def started(motor: TendonMotor) -> Inspection:
    found = motor.check_mounting(motor.inspect())
    motor.bring_up(found)
    return found


def test_a_reversed_motor_is_not_driven(rig_of: RigOf) -> None:
    """Drive Mode bit 0 turns every sign over: winding would be letting go. Found holding, it is left as it is."""
    motor, literal = make(rig_of)
    literal["drive"] = 1
    with pytest.raises(DeviceError, match=r"motor 1: has Drive Mode 1, reverse.*Write 0 to Drive Mode"):
        motor.inspect()
    assert literal.writes == []
    holding(literal)
    found = started(motor)
    assert "reverse" in found.identity.refusal
    assert not found.may_pay_out
    assert literal.writes == []


def test_other_drive_modes_are_set_to_0_without_torque(rig_of: RigOf) -> None:
    """Time-based profiles and torque by goal: EEPROM, so only of a motor that holds nothing."""
    motor, literal = make(rig_of)
    literal["drive"] = 4 + 8
    assert started(motor).identity.warnings == ()
    assert literal["drive"] == 0
    assert [address for address, _ in literal.writes].index(10) < [a for a, _ in literal.writes].index(64)


def test_a_holding_motor_that_a_goal_switches_on_is_warned_of_and_sent_none_blindly(rig_of: RigOf) -> None:
    """It may have restarted while it was silent; then a goal would clamp the hand shut again."""
    motor, literal = make(rig_of)
    holding(literal)["drive"] = 8
    found = started(motor)
    assert found.goal_switches_on
    assert "a goal would switch its torque on" in found.identity.warnings[0]
    assert literal["drive"] == 8


@EVERY
def test_overheating_has_to_shut_down(rig_of: RigOf, number: int, protocol: int) -> None:
    """Without torque the mask is completed and told; with torque it is locked, and told."""
    motor, literal = make(rig_of, number, protocol)
    literal["shutdown"] = 32
    found = started(motor)
    assert literal["shutdown"] == (0x34 if protocol == 2 else 0x24)
    assert "does not shut down on overheating" in found.identity.warnings[0]
    assert found.identity.shuts_down_on.startswith("overheating")
    motor, literal = make(rig_of, number, protocol)
    holding(literal)["shutdown"] = 32
    found = started(motor)
    assert literal["shutdown"] == 32
    assert "locked while the motor holds" in found.identity.warnings[0]
    assert found.identity.shuts_down_on == "overload"


def test_overload_is_a_choice_that_is_told(rig_of: RigOf) -> None:
    """A gripper may live without bit 5 (reference 6.2): no warning, but the journal says what it lets go for."""
    motor, literal = make(rig_of)
    literal["shutdown"] = 0x14
    found = started(motor)
    assert found.identity.warnings == ()
    assert found.identity.shuts_down_on == "overheating, electrical shock"
    assert literal["shutdown"] == 0x14
    assert shuts_down_on(MX_28, 0) == "nothing"


@EVERY
def test_an_adopted_motor_s_return_delay_is_told(rig_of: RigOf, number: int, protocol: int) -> None:
    """It is EEPROM, locked while torque is on: half a millisecond a read, until the next start without torque."""
    motor, literal = make(rig_of, number, protocol)
    holding(literal)["delay"] = 250
    assert "answers 500 µs later than it could" in started(motor).identity.warnings[0]
    assert literal["delay"] == 250
    literal["torque"] = 0
    assert started(motor).identity.warnings == ()
    assert literal["delay"] == 0


def test_a_secondary_id_is_taken_away(rig_of: RigOf) -> None:
    """With the other motor's id both would wind when one is told to; nobody would see why."""
    motor, literal = make(rig_of)
    literal["second_id"] = 2
    assert started(motor).identity.warnings == ()
    assert literal["second_id"] == 255
    holding(literal)["second_id"] = 2
    assert "also obeys what is written to id 2" in started(motor).identity.warnings[0]
    assert literal["second_id"] == 2


@pytest.mark.parametrize(
    ("limit_C", "told"),
    [
        (100, "only at 100 °C; it is made for 80 °C"),
        (60, "at 60 °C, before its load cap is lowered at 65 °C"),
        (70, ""),
    ],
)
def test_where_a_motor_lets_go_for_heat(rig_of: RigOf, limit_C: int, told: str) -> None:
    """Derating must come first, and the limit must protect."""
    motor, literal = make(rig_of)
    literal["hottest"] = limit_C
    warnings = started(motor).identity.warnings
    assert told in warnings[0] if told else warnings == ()


@pytest.mark.parametrize(
    ("change", "text"),
    [({"firmware": 43}, "has firmware 43; its load law was measured with firmware 45"), ({}, "")],
)
def test_another_firmware_than_the_load_law_s(rig_of: RigOf, change: dict[str, int], text: str) -> None:
    """Refused with what to do; a motor that holds is adopted and the operator told."""
    motor, literal = make(rig_of, calibrated=CALIBRATED)
    for name, value in change.items():
        literal[name] = value
    if not text:
        assert started(motor).identity.warnings == ()
        return
    with pytest.raises(DeviceError, match=f"{text}.*calibrate motor-load"):
        started(motor)
    assert literal["torque"] == 0
    holding(literal)
    assert text in started(motor).identity.warnings[0]


def test_a_load_law_of_another_model_is_never_used(rig_of: RigOf) -> None:
    """Its caps would be another motor's."""
    motor, literal = make(rig_of, 1030, calibrated=CALIBRATED)
    with pytest.raises(DeviceError, match="is a XM430-W210; its load law was measured on a XM430-W350"):
        started(motor)
    holding(literal)
    assert "measured on a XM430-W350" in started(motor).identity.refusal


@pytest.mark.parametrize(
    ("number", "supply", "warned"),
    [(1020, 109, False), (1020, 107, True), (1020, 133, True), (1060, 98, False), (1060, 95, True)],
)
def test_a_supply_far_from_the_load_law_s_is_warned_of(rig_of: RigOf, number: int, supply: int, warned: bool) -> None:
    """10 % for a current, 20 % for a load, which is scaled by the supply."""
    model = model_by_number(number)
    motor, literal = make(rig_of, number, calibrated=replace(CALIBRATED, model=model.name))
    literal["voltage"] = supply
    warnings = started(motor).identity.warnings
    assert any("its load law was measured at 12.0 V" in warning for warning in warnings) is warned


def test_a_supply_outside_the_model_s_is_warned_of(rig_of: RigOf) -> None:
    """An XL430 at 14.8 V does not live long."""
    motor, literal = make(rig_of, 1060)
    literal["voltage"] = 148
    assert "has 14.8 V; a XL430-W250 is made for 6.5 to 12 V" in started(motor).identity.warnings[0]


@pytest.mark.parametrize(("number", "zero"), [(28, 60), (28, 130), (29, 300), (29, 1100)])
def test_travel_has_to_lie_in_the_motor_s_one_turn(rig_of: RigOf, number: int, zero: int) -> None:
    """An MX-28 let out below 0 would show 4095, and its goal lie a turn away: refused with where to clamp the spool."""
    motor, literal = make(rig_of, number, 1, zero_ticks=zero)
    with pytest.raises(
        DeviceError, match=r"has its travel of -5\.0…49\.5 mm at the positions .*; it takes 0…"
    ) as caught:
        started(motor)
    assert literal["torque"] == 0
    first, last = map(int, re.findall(r"stands at (\d+)…(\d+)", caught.value.help)[0])
    for good in (first, last):
        motor, literal = make(rig_of, number, 1, zero_ticks=good)
        started(motor)
        assert literal["torque"] == 1
    for bad in (first - 1, last + 1):
        with pytest.raises(DeviceError, match="has its travel"):
            started(make(rig_of, number, 1, zero_ticks=bad)[0])


def test_a_travel_longer_than_the_turn_cannot_be_clamped_right(rig_of: RigOf) -> None:
    """Then there is only one advice."""
    motor, _ = make(rig_of, 28, 1, travel_m=(-0.005, 0.06))
    with pytest.raises(DeviceError, match=r"Narrow travel_m: there are 55\.0 mm in all"):
        started(motor)


def test_a_holding_motor_with_travel_beyond_its_turn_is_adopted(rig_of: RigOf) -> None:
    """What it holds stays; set-points beyond the turn are refused one by one."""
    motor, literal = make(rig_of, 29, 1, zero_ticks=300)
    holding(literal)
    found = started(motor)
    assert "has its travel" in found.identity.warnings[0]
    assert found.identity.refusal == ""


def test_a_holding_motor_that_lost_its_zero_is_left_as_it_is(rig_of: RigOf) -> None:
    """Driven to an excursion of 0 it would turn away by tens of millimetres, with an object in the hand."""
    motor, literal = make(rig_of, zero_ticks=500 + 5000)
    holding(literal)
    found = started(motor)
    assert re.search("stands at -80.5 mm of excursion", found.identity.refusal)
    assert literal.writes == []


@given(st.sampled_from(list(MODELS.values())), st.sampled_from([1, -1]), st.integers(-500, 4600))
def test_a_travel_that_passes_gives_no_position_outside(model: MotorModel, sign: int, zero: int) -> None:
    """The check and what is later refused of set-points are one law."""
    settings = MotorSettings(1, sign, zero)
    lowest, highest = 0, model.registers["ccw_angle_limit"].maximum if model.protocol == 1 else 4095
    inside = [lowest <= settings.ticks(end_m, model) <= highest for end_m in settings.travel_m]
    assert (check_travel(settings, model, (lowest, highest)) == []) is all(inside)


class WrapRig:
    """MX-28s whose zero stands so near the end of the turn that tendon let out crosses it; found holding."""

    def __init__(self) -> None:
        self.springs = SpringTendons()
        self.motors = SimulatedMotors(self.springs, [SimulatedMotorSettings(number, 60, 1, MX_28) for number in (1, 2)])
        self.clock, self.plant_ns = VirtualClock(), 0
        law = LoadLaw(torque_per_effort_Nm=2.5, friction_effort=0.0565)
        wanted = [MotorSettings(number, 1, 60, load_law=law, model="MX-28") for number in (1, 2)]
        for motor in self.motors.motors:
            goal, on = MX_28.registers["goal_position"], MX_28.registers["torque_enable"]
            motor.write(goal.address, goal.encode(60))
            motor.write(on.address, on.encode(1))
        line = MemoryLine(self.motors, self.clock)
        self.pair = TendonPair(WaitingPort(line, self.clock), self.clock, (wanted[0], wanted[1]))

    def run(self, duration_s: float) -> None:
        end_ns = self.clock.now_ns() + round(duration_s * 1e9)
        while self.clock.now_ns() < end_ns:
            self.sample = self.pair.exchange()
            self.clock.advance_to_ns(self.clock.now_ns() + 10_000_000)
            while self.plant_ns < self.clock.now_ns():
                self.motors.control(self.plant_ns, 1e-3)
                self.springs.step(1e-3)
                self.plant_ns += 1_000_000

    def true_m(self, motor: int) -> float:
        return 0.0105 * self.springs.shaft_angle_rad(motor)


def test_a_spool_that_leaves_its_turn_does_no_harm_and_is_told() -> None:
    """Somebody pulls the slack tendon past position 0: no jump of 66 mm, no way round; it comes back by itself."""
    rig = WrapRig()
    assert all("has its travel" in identity.warnings[-1] for identity in rig.pair.start())
    rig.run(0.2)
    rig.springs._angle_rad[0] -= 80 * MX_28.tick_rad
    rig.run(0.02)
    assert rig.sample.outside_turn == (True, False)
    assert rig.sample.excursion_m[0] == pytest.approx(rig.true_m(0), abs=5e-4)  # which moves on for one exchange
    lowest_m = rig.true_m(0)
    rig.run(1.0)
    assert rig.true_m(0) > lowest_m - 1e-4
    assert rig.sample.missed == (0, 0)
    assert abs(rig.true_m(0)) < 2e-3


@pytest.mark.parametrize("model", [XM430_W350, RX_28, XL430_W250], ids=lambda model: model.name)
def test_other_models_have_no_turn_to_leave(model: MotorModel) -> None:
    """Their positions go on, or stop at the end; a jump stays a jump."""
    springs = SpringTendons()
    sim = SimulatedMotors(springs, [SimulatedMotorSettings(number, 500, 1, model) for number in (1, 2)])
    clock = VirtualClock()
    motor = TendonMotor(
        motor_bus(model.protocol, WaitingPort(MemoryLine(sim, clock), clock)), MotorSettings(1, 1, 500), model
    )
    assert motor.inspect().wraps_ticks == 0


def test_impossible_calibrations_are_no_settings() -> None:
    """They come from a file."""
    with pytest.raises(InputError, match="calibration of a load law"):
        replace(CALIBRATED, voltage_V=0.0)
