"""Simulated motors of protocol 2.0: indirect addresses, groups, shadow id, resets, baud rates, several with one id."""

from typing import Any

import pytest

from drivers.dynamixel.control_tables import MX_28, MX_28_2, XL430_W250, XM430_W210, XM430_W350, MotorModel
from drivers.errors import InputError
from drivers.simulated import dynamixel_packets as packets
from drivers.simulated.dynamixel import SimulatedMotors, SimulatedMotorSettings
from tests.drivers.simulated.motor_bench import MILLISECOND, Bench, HeldShafts

PING_1 = bytes.fromhex("FF FF FD 00 01 03 00 01 19 4E")


@pytest.fixture
def bench() -> Bench:
    return Bench()


def _status(reply: bytes) -> tuple[int, int, bytes]:
    """Id, error and data of one status packet, its CRC checked."""
    assert packets.crc16(reply[:-2]) == int.from_bytes(reply[-2:], "little")
    return reply[4], reply[8], packets.unstuff(reply[7:-2])[2:]


def _little(*numbers: int) -> bytes:
    return b"".join(number.to_bytes(2, "little") for number in numbers)


@pytest.mark.parametrize(
    ("model", "number"), [(MX_28_2, 30), (XM430_W350, 1020), (XM430_W210, 1030), (XL430_W250, 1060)]
)
def test_every_model_says_who_it_is(model: MotorModel, number: int) -> None:
    """Model numbers of reference 2.1, in a ping's answer."""
    assert _status(Bench(model).ask(1, 0x01))[2][:2] == number.to_bytes(2, "little")


@pytest.mark.parametrize("model", [MX_28_2, XL430_W250])
def test_models_without_current_measurement(model: MotorModel) -> None:
    """Reference 2.3: no modes 0 and 5, no current limit, and at 126 stands the load."""
    bench = Bench(model)
    assert bench.write(1, "operating_mode", 5) == 4
    assert bench.write(1, "operating_mode", 0) == 4
    assert _status(bench.ask(1, 0x02, _little(102, 2)))[1] == 7
    bench.drive(1, 16, goal_pwm=-443)
    bench.control()
    assert bench.read(1, "present_load") == -501  # 443 / 885


def test_reading_through_indirect_addresses(bench: Bench) -> None:
    """Reference 2.3's map: every byte its own entry; then one read of 10 bytes shows registers that lie far apart."""
    targets = [126, 127, 132, 133, 134, 135, 70, 144, 145, 146]
    assert _status(bench.ask(1, 0x03, _little(168, *targets)))[1] == 0
    motor = bench.sim.motors[0]
    for name, value in {"present_current": -37, "present_position": 2048, "present_temperature": 41}.items():
        motor.put(name, value)
    data = _status(bench.ask(1, 0x02, _little(224, 10)))[2]
    assert data == bytes.fromhex("DB FF 00 08 00 00 00 78 00 29")
    motor.reboot(0)
    bench.now_ns += 400 * MILLISECOND
    assert _status(bench.ask(1, 0x02, _little(168, 20)))[2] == _little(*range(224, 234))  # lost


def test_writing_through_indirect_addresses(bench: Bench) -> None:
    """Writes go through too, whole registers only, and with their own limits."""
    bench.ask(1, 0x03, _little(578, 65, 116, 117, 118, 119))
    data = bytes((1,)) + (1234).to_bytes(4, "little")
    assert _status(bench.ask(1, 0x03, _little(634) + data))[1] == 0
    assert (bench.read(1, "led"), bench.read(1, "goal_position")) == (1, 1234)
    assert _status(bench.ask(1, 0x03, _little(635) + b"\x01"))[1] == 5
    assert bench.write(1, "indirect_address_1", 63) == 4  # RAM only


def test_unmapped_indirect_data_are_plain_storage(bench: Bench) -> None:
    """As delivered each byte names itself."""
    assert bench.write(1, "indirect_data_3", 77) == 0
    assert bench.read(1, "indirect_data_3") == 77


def test_bulk_and_fast_bulk_differ_only_in_wrapping(bench: Bench) -> None:
    """Different registers of different motors: one status each, or one packet whose last CRC covers it all."""
    bench.sim.motors[1].put("present_temperature", 55)
    wanted = bytes((1,)) + _little(64, 1) + bytes((2,)) + _little(146, 1)
    assert bench.ask(0xFE, 0x92, wanted).endswith(packets.pack_status(2, 0, bytes((55,))))
    fast = bench.ask(0xFE, 0x9A, wanted)
    assert fast[:8] == bytes.fromhex("FF FF FD 00 FE 0B 00 55")
    assert (fast[8:11], fast[13:16]) == (bytes((0, 1, 0)), bytes((0, 2, 55)))
    assert packets.crc16(fast[:-2]) == int.from_bytes(fast[-2:], "little")


def test_bulk_write_gives_each_its_own(bench: Bench) -> None:
    """Instruction 93: other addresses and lengths for each motor, no answer."""
    body = bytes((1,)) + _little(65, 1) + bytes((1, 2)) + _little(116, 4) + (700).to_bytes(4, "little")
    assert bench.ask(0xFE, 0x93, body) == b""
    assert (bench.read(1, "led"), bench.read(2, "led"), bench.read(2, "goal_position")) == (1, 0, 700)


def test_firmware_without_fast_reads_is_silent() -> None:
    """So the driver has to try, and fall back (reference 4.2)."""
    bench = Bench(fast_reads=False)
    assert bench.ask(0xFE, 0x8A, _little(126, 2) + bytes((1, 2))) == b""
    assert bench.ask(0xFE, 0x82, _little(126, 2) + bytes((1, 2))) != b""


def test_shadow_id_obeys_and_never_answers(bench: Bench) -> None:
    """Register 12 below 253: both motors do what the shadow id is told, neither says so."""
    for motor_id in (1, 2):
        assert bench.write(motor_id, "secondary_id", 9) == 0
    assert bench.ask(9, 0x03, _little(65) + b"\x01") == b""
    assert (bench.read(1, "led"), bench.read(2, "led")) == (1, 1)


def test_status_return_level(bench: Bench) -> None:
    """0 answers pings only, 1 reads too; what is asked is done at any level."""
    assert bench.ask(1, 0x03, _little(68) + b"\x00") == b""
    assert bench.ask(1, 0x02, _little(65, 1)) == b""
    assert bench.ask(1, 0x03, _little(65) + b"\x01") == b""
    assert bench.sim.motors[0].value("led") == 1
    assert bench.ask(1, 0x01) != b""
    bench.ask(1, 0x08)
    assert bench.ask(1, 0x01) == b""  # it reboots, though it did not say so


def test_factory_reset(bench: Bench) -> None:
    """Refused with torque on and by broadcast; done with what is to be kept; an unknown choice is a range error."""
    bench.write(2, "return_delay_time", 3)
    bench.drive(2, 3)
    assert _status(bench.ask(2, 0x06, b"\x01"))[1] == 1
    bench.write(2, "torque_enable", 0)
    assert _status(bench.ask(2, 0x06, b"\x07"))[1] == 4
    bench.ask(0xFE, 0x06, b"\xff")
    assert bench.read(2, "return_delay_time") == 3
    assert _status(bench.ask(2, 0x06, b"\x02"))[1] == 0
    bench.now_ns += 400 * MILLISECOND
    assert bench.read(2, "return_delay_time") == 250
    assert bench.sim.motors[1].value("baud_rate") == 3  # kept: 1 Mbit/s


def test_clear_reduces_to_one_turn(bench: Bench) -> None:
    """Instruction 10 with its password, standing still; turning, it fails; other words are refused."""
    bench.shafts.angle_rad[0] = 20.0
    bench.control()
    before = bench.read(1, "present_position")
    assert _status(bench.ask(1, 0x10, bytes.fromhex("01 44 58 4C 23")))[1] == 4
    assert _status(bench.ask(1, 0x10, bytes.fromhex("01 44 58 4C 22")))[1] == 0
    assert bench.read(1, "present_position") == before % 4096
    bench.shafts.velocity_rad_s[0] = 2.0
    bench.control()
    assert _status(bench.ask(1, 0x10, bytes.fromhex("01 44 58 4C 22")))[1] == 1


def test_another_baud_rate_is_not_understood() -> None:
    """Silence at the wrong rate, answers within the tolerance of a serial line, the new rate after it was written."""
    bench = Bench(baud=57_600)
    assert bench.sim.answers(PING_1, 0, 1_000_000) == []
    assert len(bench.sim.answers(PING_1, 0, 57_142)) == 1
    assert not bench.sim.answers(PING_1, 0, 115_200)
    assert bench.write(1, "baud_rate", 3) == 0
    assert bench.sim.answers(PING_1, 0, 57_600) == []
    assert len(bench.sim.answers(PING_1, 0, 1_000_000)) == 1


def test_a_rate_that_the_model_does_not_have_is_refused() -> None:
    """Said with what there is."""
    with pytest.raises(InputError, match="MX-28 has no baud rate 4000000; expected one of 9600, 19200"):
        Bench(MX_28, baud=4_000_000)


def test_two_motors_with_one_id_talk_into_each_other() -> None:
    """The wire carries a 0 where either sends one: different answers come out damaged; a slower one comes behind."""
    shafts = HeldShafts([0.3, 0.5])
    settings = [SimulatedMotorSettings(1), SimulatedMotorSettings(1)]
    with pytest.raises(InputError, match="its own id"):
        SimulatedMotors(shafts, settings)
    sim = SimulatedMotors(shafts, settings, shared_ids=True)
    read = packets.pack_instruction(1, 0x02, _little(132, 4))
    (reply,) = sim.answers(read, 0, 1_000_000)
    assert packets.crc16(reply.data[:-2]) != int.from_bytes(reply.data[-2:], "little")
    sim.motors[0].put("return_delay_time", 0)
    first, second = sim.answers(read, 0, 1_000_000)
    assert (_status(first.data)[0], _status(second.data)[0]) == (1, 1)
    assert first.delay_ns == 50_000
    assert second.delay_ns == 500_000 - 10_000 * len(first.data)  # both count from the request


def test_both_protocols_on_one_bus_do_not_disturb_each_other() -> None:
    """A bus with an MX-28 at 1 and an XM430 at 2: each answers in its own protocol only."""
    settings = [SimulatedMotorSettings(1, model=MX_28), SimulatedMotorSettings(2)]
    sim = SimulatedMotors(HeldShafts(), settings)
    assert sim.receive(bytes.fromhex("FF FF 01 02 01 FB"), 0) == bytes.fromhex("FF FF 01 02 00 FC")
    assert sim.receive(bytes.fromhex("FF FF FD 00 02 03 00 01 19 72"), 0)[7:9] == b"\x55\x00"
    assert sim.receive(PING_1, 0) == b""


@pytest.mark.parametrize("motor_id", [253, -1])
def test_ids_are_the_protocol_s(motor_id: int) -> None:
    """253 is an id of protocol 1.0 only."""
    with pytest.raises(InputError, match="id in 0…252"):
        SimulatedMotorSettings(motor_id)
    SimulatedMotorSettings(253, model=MX_28)


@pytest.mark.parametrize("options", [{"supply_V": float("nan")}, {"supply_V": 31.0}])
def test_impossible_buses_are_refused(options: dict[str, Any]) -> None:
    """NaN and absurd values never reach the physics."""
    with pytest.raises(InputError, match="expected 0 to 30 V"):
        Bench(**options)
