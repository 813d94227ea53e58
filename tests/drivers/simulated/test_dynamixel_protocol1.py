"""Simulated RX-28 and MX-28: the reference's worked packets as literal bytes, refusals, shutdown, modes."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.dynamixel.control_tables import MX_28, RX_28, XM430_W350
from drivers.simulated import dynamixel_packets1 as packets
from tests.drivers.simulated.motor_bench import MILLISECOND, Bench

OK_1, OK_2 = "FF FF 01 02 00 FC", "FF FF 02 02 00 FB"


@pytest.fixture
def bench() -> Bench:
    return Bench(MX_28)


@pytest.mark.parametrize(
    ("request_hex", "answer_hex"),
    [
        ("FF FF 01 02 01 FA", "FF FF 01 02 10 EC"),  # checksum error
        ("FF FF 01 02 40 BC", "FF FF 01 02 40 BC"),  # instruction error
        ("FF FF FE 02 01 FE", ""),  # broadcasts are not answered
    ],
)
def test_odd_packets(bench: Bench, request_hex: str, answer_hex: str) -> None:
    """By the reference's rules, worked out by hand."""
    assert bench.say(request_hex) == bytes.fromhex(answer_hex)


@given(st.integers(0, 253), st.integers(1, 6), st.binary(max_size=30), st.binary(max_size=20), st.integers(1, 9))
def test_reader_finds_a_packet_behind_noise_in_pieces(
    packet_id: int, instruction: int, parameters: bytes, noise: bytes, cut: int
) -> None:
    """A real line brings packets in pieces and after garbage; what was packed is found as it was."""
    wire = packets.pack(packet_id, instruction, parameters)
    stream = noise.replace(b"\xff", b"\x01") + wire
    reader, found = packets.PacketReader(), []
    for start in range(0, len(stream), cut):
        found += reader.feed(stream[start : start + cut])
    assert [(packet.packet_id, packet.instruction, packet.parameters) for packet in found] == [
        (packet_id, instruction, parameters)
    ]


@given(st.lists(st.binary(max_size=40), max_size=10))
def test_noise_leaves_the_motors_as_they_were(pieces: list[bytes]) -> None:
    """Bytes that are no intact packet change nothing, and the next good packet is answered."""
    bench = Bench(MX_28)
    before = [dict(motor._values) for motor in bench.sim.motors]
    for piece in pieces:
        bench.sim.receive(piece.replace(b"\xff\xff", b"\xff\x00"), bench.now_ns)
    assert [motor._values for motor in bench.sim.motors] == before
    bench.now_ns += 20 * MILLISECOND
    assert bench.say("FF FF 01 02 01 FB") == bytes.fromhex(OK_1)


def test_refusals_name_their_bit(bench: Bench) -> None:
    """Error byte of reference 4.1: angle limit, range (value, read-only, beyond the table), action without a write."""
    assert bench.write(1, "ccw_angle_limit", 2000) == 0
    assert bench.write(1, "goal_position", 2001) == 0x02
    assert bench.write(1, "torque_limit", 1024) == 0x08
    assert bench.write(1, "present_load", 5) == 0x08
    assert bench.ask(1, 0x02, bytes((200, 4)))[4] == 0x08
    assert bench.ask(1, 0x05)[4] == 0x40
    assert bench.read(1, "goal_position") == 0


def test_registered_write_waits_for_action(bench: Bench) -> None:
    """Reg write shows in register 44; action, by broadcast too, carries it out once."""
    assert bench.ask(1, 0x04, bytes((25, 1)))[4] == 0
    assert (bench.read(1, "led"), bench.read(1, "registered_instruction")) == (0, 1)
    assert bench.ask(0xFE, 0x05) == b""
    assert (bench.read(1, "led"), bench.read(1, "registered_instruction")) == (1, 0)


def test_an_rx_28_does_not_know_bulk_reads() -> None:
    """Reference 4.1: it is silent, and the driver has to read one after the other."""
    assert Bench(RX_28).say("FF FF FE 09 92 00 08 01 24 08 02 24 0B") == b""


def test_a_goal_switches_torque_on(bench: Bench) -> None:
    """Protocol 1.0 motors hold as soon as they have a goal; it has to be written last."""
    assert bench.write(1, "goal_position", 100) == 0
    assert bench.read(1, "torque_enable") == 1
    bench.control()
    bench.control()
    assert bench.shafts.torque_Nm[0] > 0.0


def test_shutdown_takes_the_torque_limit(bench: Bench) -> None:
    """Reference 6.2: Torque Limit becomes 0, torque is gone; writing it again brings both back, position kept."""
    bench.write(1, "goal_position", 500)
    bench.sim.trip(0, 0x20)
    bench.control()
    assert bench.shafts.torque_Nm[0] == 0.0
    assert bench.read(1, "torque_limit") == 0
    assert bench.write(1, "torque_limit", 409) == 0
    bench.control()
    assert bench.shafts.torque_Nm[0] > 0.0
    assert bench.ask(1, 0x01)[4] == 0


def test_lock_keeps_eeprom_until_power_is_off(bench: Bench) -> None:
    """Register 47: nothing below 24 changes, nor the lock itself, until a restart."""
    assert bench.write(1, "lock", 1) == 0
    assert bench.write(1, "return_delay_time", 0) != 0
    assert bench.write(1, "lock", 0) != 0
    bench.sim.motors[0].power_up()
    assert bench.write(1, "return_delay_time", 0) == 0


def test_load_is_its_own_output(bench: Bench) -> None:
    """Reference 2.4: standing still, P gain × error in counts, with the sign in bit 10, clipped by Torque Limit."""
    bench.shafts.angle_rad = [math.radians(180.0)] * 2
    bench.control()
    position = bench.read(1, "present_position")
    bench.write(1, "goal_position", position - 50)
    bench.control()
    assert bench.read(1, "present_load") == -50 * 32 // 8
    assert bench.ask(1, 0x02, bytes((40, 2)))[5:7] == (1024 + 200).to_bytes(2, "little")
    bench.write(1, "torque_limit", 100)
    bench.control()
    assert bench.read(1, "present_load") == -100


def test_compliance_of_an_rx_28() -> None:
    """Margin: no torque; then at least the punch, then the slope over 32 ticks to full output."""
    bench = Bench(RX_28, zero_ticks=500)
    bench.control()
    loads = []
    for error in (1, 2, 17, 40):
        bench.write(1, "goal_position", 500 + error)
        bench.control()
        loads.append(bench.read(1, "present_load"))
    assert loads == [0, 32, round(1023 * 16 / 32), 1023]


@pytest.mark.parametrize(("angle_deg", "seen"), [(-1.0, 0), (150.0, 511), (299.9, 1022), (310.0, 1023)])
def test_an_rx_28_sees_300_degrees(angle_deg: float, seen: int) -> None:
    """Reference 2.1: 1023 counts over 300 degrees, and nothing beyond."""
    bench = Bench(RX_28)
    bench.shafts.angle_rad[0] = math.radians(angle_deg)
    bench.control()
    assert bench.read(1, "present_position") == seen


def test_joint_mode_wraps_and_multi_turn_counts(bench: Bench) -> None:
    """An MX-28 in joint mode knows its place in one turn; with both limits at 4095 it counts turns, or parts of one."""
    bench.shafts.angle_rad[0] = 5000.5 * 2 * math.pi / 4096
    bench.control()
    assert bench.read(1, "present_position") == 5000 - 4096
    bench.write(1, "cw_angle_limit", 4095)
    bench.control()
    assert bench.read(1, "present_position") == 5000
    bench.write(1, "resolution_divider", 4)
    bench.write(1, "multi_turn_offset", -10)
    bench.control()
    assert bench.read(1, "present_position") == 5000 // 4 - 10
    bench.write(1, "goal_position", 5000 // 4 - 10)
    bench.control()
    assert abs(bench.shafts.torque_Nm[0]) < 0.01


def test_wheel_mode_turns_at_moving_speed(bench: Bench) -> None:
    """Both angle limits 0: Moving Speed is a speed with a direction in bit 10."""
    bench.write(1, "ccw_angle_limit", 0)
    bench.write(1, "moving_speed", 1024 + 100)
    bench.write(1, "torque_enable", 1)
    bench.control()
    assert bench.shafts.torque_Nm[0] < 0.0


def test_factory_reset_gives_the_delivered_values(bench: Bench) -> None:
    """Instruction 06: id 1, 57 600 bit/s, everything as delivered."""
    bench.write(2, "return_delay_time", 3)
    assert bench.ask(2, 0x06)[4] == 0
    bench.now_ns += 400 * MILLISECOND
    motor = bench.sim.motors[1]
    assert (motor.motor_id, motor.value("baud_rate"), motor.value("return_delay_time")) == (1, 34, 250)


def test_status_return_level(bench: Bench) -> None:
    """Level 1: reads are answered, writes not; level 0: pings only."""
    bench.ask(1, 0x03, bytes((16, 1)))
    assert bench.ask(1, 0x03, bytes((25, 1))) == b""
    assert bench.read(1, "led") == 1
    bench.ask(1, 0x03, bytes((16, 0)))
    assert bench.ask(1, 0x02, bytes((25, 1))) == b""
    assert bench.ask(1, 0x01) == bytes.fromhex(OK_1)


def test_a_motor_of_protocol_2_can_be_switched() -> None:
    """Register 13 of an XM430: it then answers protocol 1.0, and no other."""
    bench = Bench(XM430_W350)
    assert bench.write(1, "protocol_type", 1) == 0
    assert bench.say("FF FF 01 02 01 FB") == bytes.fromhex(OK_1)
    assert bench.ask(1, 0x01) == b""
    assert bench.ask(2, 0x01) != b""
