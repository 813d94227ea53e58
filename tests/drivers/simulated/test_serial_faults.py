"""Scripted faults of simulated motors: each does what it says, when it says, to whom it says."""

from pathlib import Path
from typing import Any

import msgspec
import pytest

from controller.simulation.fault_file import read_motor_faults
from drivers.clock import VirtualClock
from drivers.dynamixel.control_tables import MX_28, XM430_W350
from drivers.errors import BusError, ConfigurationError, InputError
from drivers.simulated import dynamixel_packets as packets
from drivers.simulated import dynamixel_packets1 as packets1
from drivers.simulated.faults import FaultScript
from drivers.simulated.serial_fault_actions import SerialAction
from drivers.simulated.serial_lines import MemoryLine
from tests.drivers.simulated.motor_bench import MILLISECOND, Bench

PING_1 = "FF FF FD 00 01 03 00 01 19 4E"
SYNC_READ = "FF FF FD 00 FE 09 00 82 7E 00 0A 00 01 02 38 92"


def script(*faults: dict[str, Any], seed: int = 1) -> FaultScript[SerialAction]:
    """As a file would give it."""
    return msgspec.convert({"seed": seed, "fault": list(faults)}, FaultScript[SerialAction])


def _intact(status: bytes) -> bool:
    return packets.crc16(status[:-2]) == int.from_bytes(status[-2:], "little")


def _answer(bench: Bench, request: str = PING_1) -> bytes:
    return bench.say(request)


def test_drop_loses_one_motor_s_answer_in_a_group() -> None:
    """The other one, behind it, was not waiting in vain: it heard the lost answer on the wire."""
    bench = Bench(faults=script({"action": {"kind": "drop", "motor": 1, "request": "sync_read"}}))
    assert _answer(bench) != b""
    reply = _answer(bench, SYNC_READ)
    assert (len(reply), reply[4]) == (21, 2)
    assert len(_answer(bench, SYNC_READ)) == 42


def test_drop_of_a_request() -> None:
    """The motor never hears it, and its registers stay."""
    bench = Bench(faults=script({"action": {"kind": "drop", "sender": "host", "request": "write"}}))
    bench.ask(1, 0x03, bytes((65, 0, 1)))
    assert bench.read(1, "led") == 0
    assert bench.write(1, "led", 1) == 0


def test_a_corrupt_request_is_answered_with_a_crc_error() -> None:
    """Reference 4.2."""
    bench = Bench(faults=script({"action": {"kind": "corrupt", "sender": "host"}}))
    assert _answer(bench)[8] == 3
    assert _answer(bench)[8] == 0


@pytest.mark.parametrize("where", ["anywhere", "check"])
def test_corrupt_answers(where: str) -> None:
    """Bits turn behind the header, or in the CRC alone, where the data stay what they were."""
    bench = Bench(faults=script({"action": {"kind": "corrupt", "where": where}, "for_frames": 20}))
    sound = Bench().say(PING_1)
    for _ in range(20):
        reply = _answer(bench)
        assert reply[:4] == sound[:4]
        assert not _intact(reply)
        assert where == "anywhere" or reply[:-2] == sound[:-2]
    assert _answer(bench) == sound


def test_corrupt_checksum_of_protocol_1() -> None:
    """One byte of check."""
    bench = Bench(MX_28, faults=script({"action": {"kind": "corrupt", "where": "check"}}))
    reply = bench.say("FF FF 01 02 01 FB")
    assert reply[:-1] == bytes.fromhex("FF FF 01 02 00")
    assert reply[-1] != 0xFC


@pytest.mark.parametrize("model", [XM430_W350, MX_28])
def test_wrong_id_is_an_intact_answer_of_another(model: Any) -> None:
    """What a late or foreign answer looks like."""
    bench = Bench(model, faults=script({"action": {"kind": "wrong_id", "id": 2}}))
    reply = bench.ask(1, 0x01)
    if model.protocol == 2:
        assert reply[4] == 2
        assert _intact(reply)
    else:
        assert reply == packets1.pack(2, 0)


def test_truncate_and_garbage() -> None:
    """The first bytes only; then others before the answer."""
    faults: list[dict[str, Any]] = [
        {"action": {"kind": "truncate", "length": 6}},
        {"action": {"kind": "garbage", "data": "00FF13"}, "at_frame": 2},
    ]
    bench = Bench(faults=script(*faults))
    sound = Bench().say(PING_1)
    assert _answer(bench) == sound[:6]
    assert _answer(bench) == bytes.fromhex("00FF13") + sound
    assert _answer(bench) == sound


def test_late_answer_is_read_behind_the_next_request() -> None:
    """Reference 6.1: the adapter holds it back; the next one overtakes it."""
    clock = VirtualClock()
    bench = Bench(faults=script({"action": {"kind": "late", "by_s": 0.02}}))
    line = MemoryLine(bench.sim, clock)
    line.write(bytes.fromhex(PING_1))
    clock.advance_to_ns(5 * MILLISECOND)
    assert line.read(100) == b""
    line.write(bytes.fromhex("FF FF FD 00 02 03 00 01 19 72"))
    clock.advance_to_ns(10 * MILLISECOND)
    assert line.read(100)[4] == 2
    clock.advance_to_ns(22 * MILLISECOND)
    assert line.read(100)[4] == 1


def test_echo_gives_the_request_back_before_the_answer() -> None:
    """As an adapter without echo suppression does; it lasts as long as the fault."""
    clock = VirtualClock()
    bench = Bench(faults=script({"action": {"kind": "echo"}, "for_s": 0.1}))
    line = MemoryLine(bench.sim, clock)
    line.write(bytes.fromhex(PING_1))
    assert line.next_arrival_ns() == len(bytes.fromhex(PING_1)) * 10_000
    clock.advance_to_ns(5 * MILLISECOND)
    assert line.read(100) == bytes.fromhex(PING_1) + Bench().say(PING_1)
    clock.advance_to_ns(200 * MILLISECOND)
    line.write(bytes.fromhex(PING_1))
    clock.advance_to_ns(300 * MILLISECOND)
    assert line.read(100) == Bench().say(PING_1)


def test_unplugged_lines_stay_dead() -> None:
    """Everything is a BusError while the adapter is out; afterwards a new line works, the old one does not."""
    clock = VirtualClock()
    bench = Bench(faults=script({"action": {"kind": "unplug"}, "at_s": 0.01, "for_s": 0.1}))
    line = MemoryLine(bench.sim, clock)
    line.write(bytes.fromhex(PING_1))
    bench.control(20 * MILLISECOND)
    clock.advance_to_ns(bench.now_ns)
    assert line.next_arrival_ns() == 0  # readable: the error is what there is to read
    for use in (lambda: line.read(10), lambda: line.write(b"x"), line.discard_input):
        with pytest.raises(BusError, match="unplugged"):
            use()
    with pytest.raises(BusError, match="unplugged"):
        MemoryLine(bench.sim, clock)
    bench.control(200 * MILLISECOND)
    with pytest.raises(BusError, match="unplugged"):
        line.read(10)
    MemoryLine(bench.sim, clock).write(b"x")


def test_silence_obeys_and_does_not_answer() -> None:
    """In a sync read it silences the motor behind it too."""
    bench = Bench(faults=script({"action": {"kind": "silence", "motors": [1]}, "for_s": 0.1}))
    bench.control()
    bench.ask(1, 0x03, bytes((65, 0, 1)))
    assert bench.sim.motors[0].value("led") == 1
    assert _answer(bench, SYNC_READ) == b""
    bench.control(200 * MILLISECOND)
    assert len(_answer(bench, SYNC_READ)) == 42


@pytest.mark.parametrize("action", [{"kind": "cut_off", "motors": [1]}, {"kind": "supply", "volts": 3.0}])
def test_without_supply_a_motor_is_off_and_starts_anew(action: dict[str, Any]) -> None:
    """No torque, no answer; then torque off, RAM as delivered, after 0.3 s."""
    bench = Bench(faults=script({"action": action, "on": "torque_on", "at_s": 0.1, "for_s": 0.1}))
    bench.drive(1, 5, goal_position=1000)
    bench.control_for(0.05)
    assert bench.shafts.torque_Nm[0] > 0.0
    bench.control_for(0.1)
    assert bench.shafts.torque_Nm[0] == 0.0
    assert _answer(bench) == b""
    bench.control_for(0.1)
    assert _answer(bench) == b""  # starting
    bench.control_for(0.35)
    assert bench.read(1, "torque_enable") == 0
    assert bench.read(1, "operating_mode") == 5


@pytest.mark.parametrize(("error", "bit"), [("overload", 0x20), ("encoder", 0x08), ("shock", 0x10)])
def test_hardware_errors(error: str, bit: int) -> None:
    """The bit shows; torque goes if Shutdown says so (overload and shock by default)."""
    bench = Bench(faults=script({"action": {"kind": "hardware_error", "motors": [2], "error": error}, "at_s": 0.01}))
    bench.drive(2, 5)
    bench.control(20 * MILLISECOND)
    assert bench.read(2, "hardware_error_status") == bit
    assert bench.read(2, "torque_enable") == (0 if bit & 52 else 1)
    assert bench.read(1, "hardware_error_status") == 0


def test_voltage_outside_its_limits_is_told() -> None:
    """Bit 0; not masked as delivered, so it holds."""
    bench = Bench(faults=script({"action": {"kind": "supply", "volts": 9.0}, "at_s": 0.01}))
    bench.drive(1, 5)
    bench.control_for(0.05)
    assert bench.read(1, "hardware_error_status") == 0x01
    assert (bench.read(1, "present_input_voltage"), bench.read(1, "torque_enable")) == (90, 1)


def test_alarms_of_protocol_1_end_with_their_cause() -> None:
    """Reference 6.2: the voltage bit comes and goes with the voltage."""
    bench = Bench(MX_28, faults=script({"action": {"kind": "supply", "volts": 5.8}, "at_s": 0.01, "for_s": 0.1}))
    bench.control_for(0.05)
    assert bench.ask(1, 0x01)[4] == 0x01
    bench.control_for(0.2)
    assert bench.ask(1, 0x01)[4] == 0


def test_overheating_trips_and_shows() -> None:
    """A scripted temperature above the limit shuts the motor down."""
    bench = Bench(faults=script({"action": {"kind": "temperature", "motors": [1], "celsius": 85}, "at_s": 0.01}))
    bench.drive(1, 5)
    bench.control_for(0.05)
    assert bench.read(1, "present_temperature") == 85
    assert (bench.read(1, "hardware_error_status"), bench.read(1, "torque_enable")) == (0x04, 0)


def test_reboot_jump_and_register_are_moments() -> None:
    """A restart by itself, an encoder that jumps, a register that changes; other faults can wait for the restart."""
    faults: list[dict[str, Any]] = [
        {"action": {"kind": "reboot", "motors": [1]}, "at_s": 0.01},
        {"action": {"kind": "encoder_jump", "motors": [2], "ticks": 300}, "on": "rebooted"},
        {"action": {"kind": "set_register", "motors": [2], "name": "homing_offset", "value": 7}, "on": "rebooted"},
    ]
    bench = Bench(faults=script(*faults))
    bench.drive(1, 5)
    bench.control(20 * MILLISECOND)
    bench.control(500 * MILLISECOND)
    assert bench.read(1, "torque_enable") == 0
    assert bench.read(2, "present_position") == 307


def test_same_script_same_faults() -> None:
    """Chance comes from the script's seed alone."""

    def outcome(seed: int) -> list[bool]:
        faults = {"action": {"kind": "drop"}, "chance": 0.5, "for_frames": 100}
        bench = Bench(faults=script(faults, seed=seed))
        return [bool(_answer(bench)) for _ in range(60)]

    assert outcome(3) == outcome(3)
    assert outcome(3) != outcome(4)
    assert 15 < sum(outcome(3)) < 45


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ({"action": {"kind": "silence", "motors": [7]}}, "motor 7 is not on the bus; expected one of 1, 2"),
        ({"action": {"kind": "drop", "motor": 7}}, "motor 7 is not on the bus"),
        ({"action": {"kind": "set_register", "name": "nonsense", "value": 1}}, "no register 'nonsense'"),
        ({"action": {"kind": "reboot"}, "for_s": 1.0}, "for_s = 1.0 means nothing"),
        ({"action": {"kind": "echo"}, "on": "breakfast"}, "expected one of start, torque_on"),
    ],
)
def test_scripts_that_do_not_fit_are_refused(fault: dict[str, Any], told: str) -> None:
    """Said which fault, and what is accepted, before anything runs."""
    with pytest.raises(InputError, match=f"fault 1.*{told}"):
        Bench(faults=script(fault))


def test_script_files(tmp_path: Path) -> None:
    """The same file format as for the arm, with this bus's actions; other actions are refused with the file's name."""
    good = tmp_path / "faults.toml"
    good.write_text('[[fault]]\nat_s = 1\naction = { kind = "late", by_s = 0.01, motor = 1 }\n')
    (fault,) = read_motor_faults(good).faults
    assert fault.action.by_s == 0.01  # type: ignore[union-attr]  # a `Late`, by its kind
    bad = tmp_path / "bad.jsonl"
    bad.write_text('{"action": {"kind": "press", "button": "idle"}}\n')
    with pytest.raises(ConfigurationError, match=r"bad.jsonl: line 1.*press"):
        read_motor_faults(bad)


FAST_SYNC_READ = "FF FF FD 00 FE 09 00 8A 7E 00 0A 00 01 02 BB 1A"


def test_an_error_comes_without_data() -> None:
    """Reference 4.2, A21: access error, no data; the other motor's answer stays."""
    bench = Bench(faults=script({"action": {"kind": "error_status", "motor": 1, "error": 7}, "for_s": 1.0}))
    assert _answer(bench) == bytes.fromhex("FF FF FD 00 01 04 00 55 07 B0 8C")
    reply = _answer(bench, SYNC_READ)
    assert (reply[8], len(reply)) == (7, 11 + 21)
    fast = _answer(bench, FAST_SYNC_READ)
    assert (len(fast), fast[8], fast[10:20], fast[22], fast[23]) == (36, 7, bytes(10), 0, 2)
    assert packets.crc16(fast[:-2]) == int.from_bytes(fast[-2:], "little")


def test_an_error_of_protocol_1() -> None:
    """Reference 4.1, B8: the error byte, and no data."""
    bench = Bench(MX_28, faults=script({"action": {"kind": "error_status", "error": 32}}))
    assert bench.say("FF FF 01 04 02 24 08 CC") == bytes.fromhex("FF FF 01 02 20 DC")


def test_an_encoder_that_is_stuck_or_trembles() -> None:
    """The host and the motor's own loop see the same wrong position; afterwards the right one."""
    faults: list[dict[str, Any]] = [
        {"action": {"kind": "encoder_stuck", "motors": [1]}, "at_s": 0.1, "for_s": 0.1},
        {"action": {"kind": "encoder_noise", "motors": [1], "ticks": 20}, "at_s": 0.3, "for_s": 0.1},
    ]
    bench = Bench(faults=script(*faults))
    motor = bench.sim.motors[0]
    told = {}
    for step in range(1000):
        now_ns = step * MILLISECOND // 2
        bench.sim.faults.advance(now_ns)
        motor.control(now_ns, 1.0 + step * 0.01, 0.0)
        told[step] = motor.value("present_position")
    true = {step: int((1.0 + step * 0.01) / motor.model.tick_rad) for step in told}
    assert len({told[step] for step in range(201, 399)}) == 1
    errors = [told[step] - true[step] for step in range(601, 799)]
    assert 10 < max(errors) < 100
    assert -100 < min(errors) < -10
    assert [told[step] for step in (100, 500, 900)] == [true[step] for step in (100, 500, 900)]


def test_a_current_sensor_that_is_stuck_or_lies() -> None:
    """What is told is not what flows."""
    faults: list[dict[str, Any]] = [
        {"action": {"kind": "effort_error", "counts": 500}, "at_s": 0.1, "for_s": 0.01},
        {"action": {"kind": "effort_stuck"}, "at_s": 0.2, "for_s": 0.1},
    ]
    bench = Bench(faults=script(*faults))
    motor = bench.sim.motors[0]
    for now_ns, counts in ((0, 0), (105, 500), (150, 0), (205, 0)):
        bench.sim.faults.advance(now_ns * MILLISECOND)
        motor.control(now_ns * MILLISECOND, 0.0, 0.0)
        assert motor.value("present_current") == counts
