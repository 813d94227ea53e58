"""The vendor's unmodified SDK, its port included, as a client of simulated motors behind a pty, in both protocols."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest
from dynamixel_sdk import GroupBulkRead, GroupBulkWrite, GroupSyncRead, GroupSyncWrite, PacketHandler, PortHandler

from drivers.clock import MonotonicClock
from drivers.dynamixel.byte_line import SerialLine
from drivers.dynamixel.port import WaitingPort
from drivers.dynamixel.tendons import MotorSettings, TendonPair, TendonSetPoint

SERVER = """
import json, select, sys
from drivers.clock import MonotonicClock
from drivers.dynamixel.control_tables import model_by_name
from drivers.simulated.dynamixel import SimulatedMotors, SimulatedMotorSettings
from drivers.simulated.serial_lines import PtyServer
from drivers.simulated.spring_tendons import SpringTendons
clock, springs, model = MonotonicClock(), SpringTendons(), model_by_name(sys.argv[1])
settings = (SimulatedMotorSettings(1, 600, model=model), SimulatedMotorSettings(2, 500, model=model))
sim = SimulatedMotors(springs, settings)
server = PtyServer(sim, clock)
print(json.dumps({"port": server.port}), flush=True)
plant_ns = clock.now_ns()
while True:
    while plant_ns < clock.now_ns():
        sim.control(plant_ns, 0.001)
        springs.step(0.001)
        plant_ns += 1_000_000
    due_ns = min(plant_ns, server.next_due_ns() or plant_ns)
    readable, _, _ = select.select([server, sys.stdin], [], [], max(0.0, (due_ns - clock.now_ns()) * 1e-9))
    if sys.stdin in readable:
        break
    server.step()
server.close()
"""


@pytest.fixture
def serve() -> Iterator[Callable[[str], str]]:
    """Motors 1 and 2 of a model behind a pty, in a process of their own: the SDK's busy loop would starve a thread."""
    with ExitStack() as stack:

        def start(model: str) -> str:
            command = [sys.executable, "-c", SERVER, model]
            process = stack.enter_context(
                subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            )
            assert process.stdin is not None
            assert process.stdout is not None
            stack.callback(lambda: process.wait())
            stack.callback(process.stdin.close)
            return str(json.loads(process.stdout.readline())["port"])

        yield start


def _open(path: str, protocol: float) -> tuple[Any, Any]:
    port, handler = PortHandler(path), PacketHandler(protocol)
    assert port.openPort()
    return port, handler


def _eventually(condition: Callable[[], bool]) -> bool:
    """Within a generous number of transactions, each of which takes its time."""
    return any(condition() for _ in range(500))


def test_another_baud_rate_finds_nobody(serve: Callable[[str], str]) -> None:
    """The SDK closes and opens the port to set a rate: the pty survives it, and the motors only hear their own rate."""
    port, handler = _open(serve("XM430-W350"), 2.0)
    for baud, answered in ((57_600, False), (1_000_000, True), (4_000_000, False), (1_000_000, True)):
        assert port.setBaudRate(baud)
        assert (handler.ping(port, 1)[1] == 0) == answered
    port.closePort()


def test_protocol_2(serve: Callable[[str], str]) -> None:
    """Ping, writes and reads, sync, fast sync and bulk groups, registered writes, refusals, clear, reset, reboot."""
    port, handler = _open(serve("XM430-W350"), 2.0)
    assert handler.ping(port, 1) == (1020, 0, 0)
    assert handler.ping(port, 9)[1] == -3001
    found, result = handler.broadcastPing(port)
    assert (result, sorted(found), found[2][0]) == (0, [1, 2], 1020)
    for motor_id in (1, 2):
        assert handler.write1ByteTxRx(port, motor_id, 9, 0) == (0, 0)
        assert handler.write1ByteTxRx(port, motor_id, 11, 5) == (0, 0)
        assert handler.write2ByteTxRx(port, motor_id, 102, 300) == (0, 0)
        assert handler.write1ByteTxRx(port, motor_id, 64, 1) == (0, 0)
    goals = GroupSyncWrite(port, handler, 116, 4)
    goals.addParam(1, list((700).to_bytes(4, "little")))
    goals.addParam(2, list((650).to_bytes(4, "little")))
    assert goals.txPacket() == 0
    block = GroupSyncRead(port, handler, 126, 10)
    for motor_id in (1, 2):
        block.addParam(motor_id)

    def arrived() -> bool:
        assert block.txRxPacket() == 0
        return bool(block.getData(1, 132, 4) > 685 and block.getData(2, 132, 4) > 635)

    assert _eventually(arrived)
    slow = [block.getData(motor_id, 132, 4) for motor_id in (1, 2)]
    assert block.fastSyncRead() == 0
    assert [block.getData(motor_id, 132, 4) for motor_id in (1, 2)] == pytest.approx(slow, abs=30)

    bulk = GroupBulkRead(port, handler)
    bulk.addParam(1, 70, 1)
    bulk.addParam(2, 144, 3)
    assert bulk.txRxPacket() == 0
    assert (bulk.getData(1, 70, 1), bulk.getData(2, 144, 2)) == (0, 120)
    writes = GroupBulkWrite(port, handler)
    writes.addParam(1, 65, 1, [1])
    writes.addParam(2, 116, 4, list((640).to_bytes(4, "little")))
    assert writes.txPacket() == 0
    assert handler.read1ByteTxRx(port, 1, 65) == (1, 0, 0)
    assert handler.read4ByteTxRx(port, 2, 116) == (640, 0, 0)

    assert handler.regWriteTxRx(port, 1, 65, 1, [0]) == (0, 0)
    assert handler.read1ByteTxRx(port, 1, 69) == (1, 0, 0)
    assert handler.action(port, 0xFE) == 0
    assert handler.read1ByteTxRx(port, 1, 65) == (0, 0, 0)

    assert handler.write1ByteTxRx(port, 1, 11, 3) == (0, 7)  # torque is on
    assert handler.read1ByteTxRx(port, 1, 11) == (5, 0, 0)
    assert handler.factoryReset(port, 1, 0x02) == (0, 1)
    assert handler.reboot(port, 1) == (0, 0)
    assert handler.ping(port, 1)[1] == -3001
    assert _eventually(lambda: bool(handler.ping(port, 1)[1] == 0))
    assert handler.read1ByteTxRx(port, 1, 64) == (0, 0, 0)
    assert handler.clearMultiTurn(port, 1) == (0, 0)
    port.closePort()


@pytest.mark.parametrize(("model", "number"), [("MX-28", 29), ("RX-28", 28)])
def test_protocol_1(serve: Callable[[str], str], model: str, number: int) -> None:
    """Ping, writes and reads, sync write, bulk read where there is one, registered writes, refusals, no reboot."""
    port, handler = _open(serve(model), 1.0)
    assert handler.ping(port, 1) == (number, 0, 0)
    assert handler.ping(port, 9)[1] == -3001
    for motor_id in (1, 2):
        assert handler.write1ByteTxRx(port, motor_id, 5, 0) == (0, 0)
        assert handler.write2ByteTxRx(port, motor_id, 34, 409) == (0, 0)
    goals = GroupSyncWrite(port, handler, 30, 2)
    goals.addParam(1, list((700).to_bytes(2, "little")))
    goals.addParam(2, list((450).to_bytes(2, "little")))
    assert goals.txPacket() == 0
    assert handler.read1ByteTxRx(port, 1, 24) == (1, 0, 0)

    def arrived() -> bool:
        first, result, error = handler.read2ByteTxRx(port, 1, 36)
        assert (result, error) == (0, 0)
        return bool(first > 620 and handler.read2ByteTxRx(port, 2, 36)[0] < 480)

    assert _eventually(arrived)
    block, result, error = handler.readTxRx(port, 1, 36, 8)
    assert (len(block), result, error, block[6]) == (8, 0, 0, 120)
    assert block[5] & 0x04 == 0  # pulls counter-clockwise
    # the SDK's own GroupBulkRead ends in a TypeError with protocol 1.0
    assert handler.bulkReadTx(port, [8, 1, 36, 8, 2, 36], 6) == 0
    if model == "MX-28":
        assert handler.readRx(port, 1, 8)[1:] == (0, 0)
        assert handler.readRx(port, 2, 8)[1:] == (0, 0)
    else:
        assert handler.readRx(port, 1, 8)[1] == -3001
        port.is_using = False
    assert handler.regWriteTxRx(port, 1, 25, 1, [1]) == (0, 0)
    assert handler.action(port, 0xFE) == 0
    assert handler.read1ByteTxRx(port, 1, 25) == (1, 0, 0)
    refused = handler.write2ByteTxRx(port, 1, 30, 5000)[1]
    assert refused == (0x02 if model == "MX-28" else 0x08)  # beyond its angle limit, or of any position
    assert handler.reboot(port, 1)[0] == -9000
    port.closePort()


@pytest.mark.parametrize("model", ["XM430-W350", "MX-28"])
def test_driver_works_in_real_time(serve: Callable[[str], str], model: str) -> None:
    """The whole real path, serial line, select and monotonic clock; margins wide for a busy machine."""
    clock = MonotonicClock()
    port = WaitingPort(SerialLine(serve(model), 1_000_000), clock, reply_margin_s=0.5)
    settings = (
        MotorSettings(motor_id=1, tightening_sign=1, zero_ticks=600, watchdog_s=0, model=model),
        MotorSettings(motor_id=2, tightening_sign=1, zero_ticks=500, watchdog_s=0, model=model),
    )
    pair = TendonPair(port, clock, settings)
    pair.start()
    for _ in range(3000):
        sample = pair.exchange(TendonSetPoint((0.003, 0.004), (50.0, 50.0)))
        if 0.002 < sample.excursion_m[0] < 0.003 and 0.002 < sample.excursion_m[1] < 0.004:
            break
    else:
        pytest.fail(f"tendons did not come near their set-point: {sample}")
    pair.stop(release=True)
    port.close()
