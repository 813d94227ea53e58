"""The control tables as data, against rows of the reference written out here, and laws that every table obeys."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.dynamixel.control_tables import (
    MODELS,
    MX_28,
    MX_28_2,
    RX_28,
    XL430_W250,
    XM430_W210,
    XM430_W350,
    MotorModel,
    model_by_name,
    model_by_number,
)
from drivers.dynamixel.registers import Register
from drivers.errors import InputError

EVERY = pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)

ROWS = {  # reference 2.2, 2.3: name → address, size, default
    1: {
        "return_delay_time": (5, 1, 250),
        "max_torque": (14, 2, 1023),
        "status_return_level": (16, 1, 2),
        "torque_enable": (24, 1, 0),
        "moving_speed": (32, 2, 0),
        "torque_limit": (34, 2, 1023),
        "present_velocity": (38, 2, 0),
        "present_load": (40, 2, 0),
        "present_input_voltage": (42, 1, 120),
        "present_temperature": (43, 1, 30),
    },
    2: {
        "return_delay_time": (9, 1, 250),
        "operating_mode": (11, 1, 3),
        "homing_offset": (20, 4, 0),
        "pwm_limit": (36, 2, 885),
        "shutdown": (63, 1, 52),
        "torque_enable": (64, 1, 0),
        "status_return_level": (68, 1, 2),
        "hardware_error_status": (70, 1, 0),
        "bus_watchdog": (98, 1, 0),
        "goal_pwm": (100, 2, 885),
        "goal_velocity": (104, 4, 0),
        "goal_position": (116, 4, 0),
        "present_velocity": (128, 4, 0),
        "present_position": (132, 4, 0),
        "present_temperature": (146, 1, 30),
        "indirect_address_1": (168, 2, 224),
        "indirect_address_28": (222, 2, 251),
        "indirect_data_28": (251, 1, 0),
        "indirect_address_29": (578, 2, 634),
        "indirect_data_56": (661, 1, 0),
    },
}


@EVERY
def test_registers_do_not_overlap(model: MotorModel) -> None:
    """A slip in an address or size would let one register's write damage another."""
    end = 0
    for register in sorted(model.registers.values(), key=lambda register: register.address):
        assert register.address >= end, register.name
        end = register.address + register.size


@EVERY
def test_registers_are_where_the_reference_has_them(model: MotorModel) -> None:
    """Address, size and default of what the driver touches."""
    found = {name: model.registers[name] for name in ROWS[model.protocol]}
    assert {name: (r.address, r.size, r.default) for name, r in found.items()} == ROWS[model.protocol]


@EVERY
def test_defaults_and_ends_can_be_written(model: MotorModel) -> None:
    """A default, a minimum or a maximum outside its own range or size would only show on a real motor."""
    for register in model.registers.values():
        for value in (register.default, register.minimum, register.maximum):
            assert register.decode(register.encode(value)) == value, register.name


@EVERY
def test_the_driver_finds_what_it_needs(model: MotorModel) -> None:
    """Effort, ceiling and gain are named by the model; each name must exist, the ceiling be writable and in RAM."""
    assert model.registers[model.effort_register].maximum > 0
    assert model.registers[model.ceiling].writable
    assert model.registers[model.ceiling].address >= model.eeprom_end
    assert model.registers[model.position_gain].default == model.default_position_gain
    assert model.registers["model_number"].default == model.model_number == model.number


@pytest.mark.parametrize(
    ("model", "number", "protocol", "effort", "tick_deg", "stall", "no_load_rpm", "gear"),
    [
        (RX_28, 28, 1, "load", 300 / 1023, (18.5, 3.7), 85, 193),
        (MX_28, 29, 1, "load", 0.087890625, (12.0, 2.5), 55, 193),
        (MX_28_2, 30, 2, "load", 0.087890625, (14.8, 3.1), 55, 193),
        (XM430_W210, 1030, 2, "current", 0.087890625, (12.0, 3.0), 77, 212.6),
        (XM430_W350, 1020, 2, "current", 0.087890625, (12.0, 4.1), 46, 353.5),
        (XL430_W250, 1060, 2, "load", 0.087890625, (11.1, 1.4), 61, 258.5),
    ],
)
def test_facts_are_the_reference_s(
    model: MotorModel,
    number: int,
    protocol: int,
    effort: str,
    tick_deg: float,
    stall: tuple[float, float],
    no_load_rpm: float,
    gear: float,
) -> None:
    """Reference 2.1, row by row."""
    assert (model.number, model.protocol, model.effort, model.gear_ratio) == (number, protocol, effort, gear)
    assert math.degrees(model.tick_rad) == pytest.approx(tick_deg)
    assert model.stall_torque_Nm(stall[0]) == pytest.approx(stall[1])
    assert model.no_load_speed_rad_s == pytest.approx(no_load_rpm * 2 * math.pi / 60)
    assert model_by_number(number) is model
    assert model.has_current_modes is (effort == "current")


def test_resolution_and_speed_of_the_tendon_are_the_reference_s() -> None:
    """Reference 1.4: one tick is 16.1 µm of tendon, 53.7 µm with an RX-28, on the spool of 10.5 mm."""
    assert 0.0105 * XM430_W350.tick_rad == pytest.approx(16.1e-6, rel=2e-3)
    assert 0.0105 * RX_28.tick_rad == pytest.approx(53.7e-6, rel=2e-3)
    assert 0.0105 * XM430_W350.no_load_speed_rad_s == pytest.approx(0.051, abs=5e-4)


@EVERY
def test_stall_torque_grows_with_the_supply(model: MotorModel) -> None:
    """Between, below and above the manual's points; a voltage that is none is refused."""
    torques = [model.stall_torque_Nm(voltage_V) for voltage_V in (6.0, 9.0, 11.1, 11.5, 12.0, 14.0, 15.0, 18.5)]
    assert torques == sorted(torques)
    assert min(torques) > 0
    with pytest.raises(InputError, match="supply voltage nan"):
        model.stall_torque_Nm(math.nan)


@EVERY
def test_baud_codes_are_the_protocol_s(model: MotorModel) -> None:
    """Protocol 1.0: 2 000 000/(v+1), to the 2.1 % that the reference names; 57 600 and 1 000 000 everywhere."""
    assert {57_600, 1_000_000} <= set(model.bauds.values())
    if model.protocol == 1:
        for code, baud in model.bauds.items():
            assert code >= 250 or baud == pytest.approx(2e6 / (code + 1), rel=0.022)
    else:
        assert model.bauds[3] == 1_000_000


@pytest.mark.parametrize(
    ("model", "name", "data", "value"),
    [
        (XM430_W350, "present_current", "dbff", -37),
        (XM430_W350, "goal_position", "00080000", 2048),
        (XL430_W250, "present_load", "18fc", -1000),
        (RX_28, "present_load", "c804", -200),  # B4
        (RX_28, "present_load", "0004", 0),  # the second zero
        (MX_28, "present_velocity", "c800", 200),
        (MX_28, "present_position", "00f0", -4096),
    ],
)
def test_numbers_are_little_endian_and_signed(model: MotorModel, name: str, data: str, value: int) -> None:
    """Unsigned reading of signed registers is the most frequent fault of users (reference 2.4)."""
    assert model.registers[name].decode(bytes.fromhex(data)) == value


@given(st.sampled_from([register for model in MODELS.values() for register in model.registers.values()]), st.data())
def test_every_value_comes_back(register: Register, data: st.DataObject) -> None:
    """Writing and reading are inverse, whichever way the register keeps its sign."""
    value = data.draw(st.integers(register.minimum, register.maximum))
    encoded = register.encode(value)
    assert len(encoded) == register.size
    assert register.decode(encoded) == value


def test_register_refuses_what_it_cannot_hold() -> None:
    """A value outside the range, or the neighbour's bytes, must never reach a motor or a goal."""
    register = XM430_W350.registers["goal_current"]
    with pytest.raises(InputError, match=r"goal_current = 1194 .*-1193…1193"):
        register.encode(1194)
    with pytest.raises(InputError, match="has 2 bytes, got 4"):
        register.decode(b"\0\0\0\0")


def test_current_and_load_are_never_mixed_up() -> None:
    """Pitfall 7.7: load times 2.69 mA, for models that have no current sensor."""
    with pytest.raises(InputError, match="does not measure its current"):
        _ = XL430_W250.current_unit_A
    assert XM430_W350.current_unit_A == 2.69e-3


@pytest.mark.parametrize("name", ["XM430-W350", "xm430w350", "MX-28(2.0)", "rx-28"])
def test_models_are_found_by_name(name: str) -> None:
    """Hyphens and capitals are no reason to refuse an installation."""
    assert model_by_name(name).name.replace("-", "").lower().startswith(name.replace("-", "").lower()[:4])


def test_unknown_models_are_refused() -> None:
    """An MX-64 answers at the same addresses with other units: not a motor for this driver."""
    with pytest.raises(InputError, match=r"310 is not known; expected RX-28 \(28\)"):
        model_by_number(310)
    with pytest.raises(InputError, match="'MX-64' is not known"):
        model_by_name("MX-64")
