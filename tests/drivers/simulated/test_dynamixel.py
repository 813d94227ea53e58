"""Simulated motors: worked packets, refusals, the vendor's SDK as a client, and the inner loop against mechanics."""

import math
import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.clock import VirtualClock
from drivers.dynamixel.control_tables import XM430_W350
from drivers.errors import InputError
from drivers.simulated import dynamixel_packets as packets
from drivers.simulated.dynamixel import SimulatedMotors, SimulatedMotorSettings
from drivers.simulated.serial_lines import MemoryLine, PtyServer
from drivers.simulated.spring_tendons import SpringTendons
from tests.drivers.simulated.motor_bench import MILLISECOND, Bench, HeldShafts


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_crc_check_value() -> None:
    """The catalogue's check value of CRC-16/UMTS (reference 4.2)."""
    assert packets.crc16(b"123456789") == 0xFEE8


@given(st.integers(0, 252), st.integers(1, 0x54), st.lists(st.sampled_from([0xFF, 0xFD, 0]), max_size=30))
def test_packed_is_read_back_and_hides_no_header(packet_id: int, instruction: int, parameters: list[int]) -> None:
    """Stuffing law: every packet comes back as it was, and only its beginning looks like a header."""
    wire = packets.pack_instruction(packet_id, instruction, bytes(parameters))
    assert wire[:-2].count(packets.HEADER) == 1
    (packet,) = packets.PacketReader().feed(wire)
    assert (packet.packet_id, packet.instruction, packet.parameters) == (packet_id, instruction, bytes(parameters))


@given(st.binary(max_size=40), st.lists(st.integers(1, 12), max_size=20))
def test_reader_finds_a_packet_behind_noise_in_pieces(noise: bytes, cuts: list[int]) -> None:
    """A real line brings packets in pieces and after garbage; the one good packet is found all the same."""
    good = bytes.fromhex("FF FF FD 00 02 03 00 01 19 72")
    stream = noise.replace(b"\xff", b"\x01") + good
    reader, found = packets.PacketReader(), []
    for length in [*cuts, len(stream)]:
        piece, stream = stream[:length], stream[length:]
        found += reader.feed(piece)
    assert [packet.wire for packet in found] == [good]


def test_refusals_are_the_protocol_s(bench: Bench) -> None:
    """Range, access, length, limit, instruction and CRC errors (A20, A21), and nothing changes by them."""
    assert bench.write(2, "operating_mode", 99) == 4
    assert bench.say(
        "FF FF FD 00 01 07 00 02 00 10 02 00"
        + packets.crc16(bytes.fromhex("FF FF FD 00 01 07 00 02 00 10 02 00")).to_bytes(2, "little").hex()
    ) == bytes.fromhex("FF FF FD 00 01 04 00 55 07 B0 8C")
    assert bench.write(1, "present_position", 5) == 7
    short = packets.pack_instruction(1, 0x03, bytes((116, 0, 1, 2)))
    assert bench.sim.receive(short, 0)[8] == 5
    assert bench.write(1, "current_limit", 100) == 0
    assert bench.write(1, "goal_current", 101) == 6
    assert bench.write(1, "torque_enable", 1) == 0
    assert bench.write(1, "operating_mode", 5) == 7  # EEPROM is locked while torque is on
    assert bench.say(packets.pack_instruction(1, 0x30).hex())[8] == 2
    damaged = bytearray.fromhex("FF FF FD 00 02 03 00 01 19 73")
    assert bench.sim.receive(bytes(damaged), 0)[8] == 3
    assert bench.read(1, "operating_mode") == 3


def test_mode_change_resets_gains_and_goal_current(bench: Bench) -> None:
    """Why Goal Current has to be written after the mode (reference 2.3)."""
    bench.write(1, "goal_current", 100)
    bench.write(1, "position_p_gain", 333)
    bench.write(1, "operating_mode", 5)
    assert (bench.read(1, "goal_current"), bench.read(1, "position_p_gain")) == (1193, 800)


def test_registered_write_waits_for_action(bench: Bench) -> None:
    """Reg write and action make motors move at one moment."""
    bench.sim.receive(packets.pack_instruction(1, 0x04, bytes((65, 0, 1))), 0)
    assert bench.read(1, "led") == 0
    bench.sim.receive(packets.pack_instruction(0xFE, 0x05), 0)
    assert bench.read(1, "led") == 1


def test_silent_motor_silences_those_behind_it(bench: Bench) -> None:
    """In a sync read each waits for its predecessor (reference 4.2, 5.4)."""
    behind = packets.pack_instruction(0xFE, 0x82, bytes((126, 0, 2, 0, 7, 1)))
    before = packets.pack_instruction(0xFE, 0x82, bytes((126, 0, 2, 0, 1, 7)))
    assert bench.sim.receive(behind, 0) == b""
    assert len(bench.sim.receive(before, 0)) == 13


def test_hardware_error_lets_go_until_reboot(bench: Bench) -> None:
    """Reference 6.2: torque off, alert, no enabling; a reboot loses RAM and takes 0.3 s."""
    bench.drive(1, 5, goal_position=100)
    bench.sim.trip(0, 0x20)
    bench.control()
    assert bench.shafts.torque_Nm[0] == 0.0
    assert bench.write(1, "torque_enable", 1) == 0x80 | 7
    assert bench.read(1, "hardware_error_status") == 0x20
    bench.sim.receive(packets.pack_instruction(1, 0x08), bench.now_ns)
    assert bench.say("FF FF FD 00 01 07 00 02 7E 00 02 00 35 49") == b""
    bench.control(301 * MILLISECOND)
    assert bench.read(1, "torque_enable") == 0
    assert bench.write(1, "torque_enable", 1) == 0
    assert bench.read(1, "operating_mode") == 5


def test_watchdog_holds_and_locks_goals(bench: Bench) -> None:
    """Reference 6.3: any instruction feeds it; then it stops, holds, reads −1, refuses goals until it is cleared."""
    bench.drive(1, 5, goal_position=100, bus_watchdog=5)
    for _ in range(4):
        bench.control(60 * MILLISECOND)
        bench.say("FF FF FD 00 02 03 00 01 19 72")
    assert bench.read(1, "bus_watchdog") == 5
    bench.control(101 * MILLISECOND)
    assert bench.read(1, "bus_watchdog") == -1
    assert bench.write(1, "goal_position", 50) == 4
    bench.control()
    assert bench.shafts.torque_Nm[0] == 0.0  # holds where it is
    assert bench.write(1, "bus_watchdog", 0) == 0
    assert bench.write(1, "goal_position", 50) == 0


def test_blocked_shaft_stalls_at_goal_current(bench: Bench) -> None:
    """Mode 5 against a wall: present current is the goal current, torque is K times it (reference 3.3)."""
    bench.drive(1, 5, goal_current=260, goal_position=1000)
    bench.control()
    assert bench.read(1, "present_current") == 260
    assert bench.shafts.torque_Nm[0] == pytest.approx(1.79 * 260 * 2.69e-3)
    bench.drive(2, 5, goal_current=260, goal_position=-1000)
    bench.control()
    assert bench.shafts.torque_Nm[1] == pytest.approx(-1.79 * 260 * 2.69e-3)


def test_stall_and_no_load_are_the_data_sheet_s(bench: Bench) -> None:
    """At full voltage: 2.3 A and 4.1 N·m blocked; at 46 rpm just the current that the gear's friction takes."""
    bench.drive(1, 16, goal_pwm=885)
    bench.control()
    assert bench.read(1, "present_current") * 2.69e-3 == pytest.approx(2.3, abs=2e-3)
    assert bench.shafts.torque_Nm[0] == pytest.approx(4.1, abs=0.03)
    bench.shafts.velocity_rad_s[0] = 46 * 2 * math.pi / 60
    bench.control()
    assert bench.shafts.torque_Nm[0] == pytest.approx(0.13 * 1.79, abs=1e-3)
    assert bench.read(1, "present_velocity") == round(46 / 0.229)


def test_present_values_are_quantised(bench: Bench) -> None:
    """Ticks by floor, also below zero; the host sees no more than a real motor tells."""
    tick_rad = 2 * math.pi / 4096
    for angle_ticks, seen in ((10.99, 10), (-0.01, -1), (5000.5, 5000)):
        bench.shafts.angle_rad[0] = angle_ticks * tick_rad
        bench.control()
        assert bench.read(1, "present_position") == seen


def test_spring_and_motor_reach_force_balance() -> None:
    """At rest, motor torque and spring balance within the gear's friction; the error of position is what drives it."""
    springs = SpringTendons((3000.0,), (0.0,))
    sim = SimulatedMotors(springs, (SimulatedMotorSettings(1),))
    motor = sim.motors[0]
    for name, value in {"operating_mode": 5, "goal_current": 400, "goal_position": 500, "torque_enable": 1}.items():
        register = XM430_W350.registers[name]
        assert motor.write(register.address, register.encode(value)) == 0
    for step in range(4000):
        sim.control(step * 500_000, 0.0005)
        springs.step(0.0005)
    assert springs.shaft_velocity_rad_s(0) == 0.0
    current_A = 800 / 128 / 885 * 2.3 * (500 - motor.value("present_position"))
    assert motor.current_A == pytest.approx(current_A)
    assert abs(1.79 * current_A - springs.tension_N(0) * 0.0105) <= 0.13 * 1.79 + 1e-9
    assert springs.tension_N(0) > 10.0


def test_memory_line_takes_the_wire_s_time() -> None:
    """Reference 5.1: a sync read of 10 bytes from two motors is 0.58 ms of wire at 1 Mbaud, and 0.5 ms delay each."""
    clock = VirtualClock()
    sim = SimulatedMotors(HeldShafts(), (SimulatedMotorSettings(1), SimulatedMotorSettings(2)))
    line = MemoryLine(sim, clock, 1_000_000)
    line.write(bytes.fromhex("FF FF FD 00 FE 09 00 82 7E 00 0A 00 01 02 38 92"))
    received = b""
    while (arrival_ns := line.next_arrival_ns()) is not None:
        assert line.read(100) == b""
        clock.advance_to_ns(arrival_ns)
        received += line.read(100)
    assert len(received) == 42
    assert clock.now_ns() == 580_000 + 2 * (500_000 + 50_000)


@given(st.lists(st.binary(max_size=40), max_size=10))
def test_noise_leaves_the_motors_as_they_were(pieces: list[bytes]) -> None:
    """Bytes that are no packet change nothing, and the next good packet is answered."""
    bench = Bench()
    before = [dict(motor._values) for motor in bench.sim.motors]
    for piece in pieces:
        bench.sim.receive(piece, bench.now_ns)
    assert [motor._values for motor in bench.sim.motors] == before
    bench.now_ns += 20 * MILLISECOND  # what is left of a packet is forgotten
    assert bench.say("FF FF FD 00 02 03 00 01 19 72").hex() == "fffffd0002070055" + "00fc032d1d73"


def test_impossible_settings_are_refused() -> None:
    """Two motors with one id would both answer."""
    with pytest.raises(InputError, match="its own id"):
        SimulatedMotors(HeldShafts(), (SimulatedMotorSettings(1), SimulatedMotorSettings(1)))
    with pytest.raises(InputError, match="direction"):
        SimulatedMotorSettings(1, direction=0)


def test_pty_leaves_nothing() -> None:
    """Closing gives the pseudo terminal back; closing twice is harmless."""
    open_before = len(os.listdir("/proc/self/fd"))
    server = PtyServer(SimulatedMotors(HeldShafts(), (SimulatedMotorSettings(1),)), VirtualClock())
    server.step()
    server.close()
    server.close()
    assert len(os.listdir("/proc/self/fd")) == open_before
