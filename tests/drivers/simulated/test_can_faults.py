"""Faults on the simulated bus: what hosts hear, what the wire carries, and what the arm goes through."""

from __future__ import annotations

import errno
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import pytest

from drivers.clock import VirtualClock
from drivers.errors import BusError, InputError
from drivers.simulated.arm_faults import BrownOut, Press, SetProperty, Silence, Supply
from drivers.simulated.can_fault_actions import (
    BusOff,
    Corrupt,
    Delay,
    Drop,
    Duplicate,
    ErrorFrame,
    Flood,
    QueueFull,
    Reorder,
    Truncate,
    Unplug,
)
from drivers.simulated.can_faults import CanFaults
from drivers.simulated.can_hub import MemoryCanBus, MemoryCanHub
from drivers.simulated.can_wire import Frame, TimedFrame
from drivers.simulated.faults import Fault, FaultScript
from drivers.simulated.seqpacket_can import SeqpacketHub

MS = 1_000_000
REPLIES = ["423#000000", "443#3F701F", "463#008FE0", "483#3F7088", "4A3#000000", "4C3#000000", "4E3#000000"]


class Ear:
    """A device that only listens to the wire."""

    def __init__(self) -> None:
        self.heard: list[str] = []

    def receive(self, frame: Frame, now_ns: int) -> list[TimedFrame]:
        self.heard.append(f"{frame.identifier:03X}#{frame.data.hex().upper()}")
        return []

    def tick(self, now_ns: int) -> list[TimedFrame]:
        return []


class Bench:
    """An arm, a listening device and a host on a bus with faults."""

    def __init__(self, talk: Callable[..., Any], *faults: Fault[Any], seed: int = 0) -> None:
        self.arm = talk()
        self.ear = Ear()
        self.faults = CanFaults(FaultScript(seed=seed, faults=faults), self.arm.wam)
        self.hub = MemoryCanHub([self.arm.wam, self.ear], self.faults)
        self.clock = VirtualClock()
        self.bus = MemoryCanBus(self.hub, self.clock)

    def send(self, text: str) -> None:
        identifier, data = text.split("#")
        message = can.Message(arbitration_id=int(identifier, 16), is_extended_id=False, data=bytes.fromhex(data))
        self.bus.send(message)

    def listen(self, until_ns: int) -> list[str]:
        """All that comes until then; error frames as 'error class'."""
        texts = []
        while (message := self.bus.receive(until_ns)) is not None:
            data = bytes(message.data).hex().upper()
            error = f"error {message.arbitration_id:X}"
            texts.append(error if message.is_error_frame else f"{message.arbitration_id:03X}#{data}")
        return texts

    def ask(self, text: str = "404#30", until_ms: float = 2) -> list[str]:
        self.send(text)
        return self.listen(round(until_ms * MS))


@pytest.mark.parametrize(
    ("action", "expected"),
    [
        (Drop(node=3), [*REPLIES[:2], *REPLIES[3:]]),
        (Drop(id=0x4A3, mask=0x7FF), [*REPLIES[:4], *REPLIES[5:]]),
        (Delay(node=1, by_s=0.001), [*REPLIES[1:], REPLIES[0]]),
        (Duplicate(node=1, times=2, after_s=0.0005), [*REPLIES[:6], REPLIES[0], REPLIES[6], REPLIES[0]]),
        (Corrupt(node=2, data="0102"), [REPLIES[0], "443#0102", *REPLIES[2:]]),
        (Truncate(node=2, length=1), [REPLIES[0], "443#3F", *REPLIES[2:]]),
        (Drop(sender="host"), []),
        (Truncate(sender="host", length=0), []),
        (Corrupt(sender="host", data="05"), [f"{0x426 + 0x20 * node:03X}#85000200" for node in range(7)]),
    ],
)
def test_what_befalls_a_frame(talk: Callable[..., Any], action: object, expected: list[str]) -> None:
    """Protects each action on frames: hosts hear the altered answer, or the arm the altered question; once."""
    bench = Bench(talk, Fault(action=action))
    heard = bench.ask()
    assert sorted(heard) == sorted(expected)
    if not isinstance(action, Duplicate):
        assert heard == expected
    assert bench.faults.struck == 1
    assert bench.ask(until_ms=4) == REPLIES


def test_loss_behind_the_wire_and_before_it(talk: Callable[..., Any]) -> None:
    """Protects the difference between a host that lost a reply and a puck that did not get it out: others hear it."""
    behind, before = Bench(talk, Fault(action=Drop(node=3))), Bench(talk, Fault(action=Drop(node=3, on_wire=True)))
    assert behind.ask() == before.ask() == [*REPLIES[:2], *REPLIES[3:]]
    assert "463#008FE0" in behind.ear.heard
    assert "463#008FE0" not in before.ear.heard


def test_chance_disorder_and_bits_are_the_same_twice(talk: Callable[..., Any]) -> None:
    """Protects repetition: seeded loss, corruption and disorder give the same frames at the same times."""
    faults: list[Fault[Any]] = [
        Fault(action=Drop(), for_s=1.0, chance=0.2),
        Fault(action=Corrupt(bits=3), for_s=1.0, chance=0.5),
        Fault(action=Reorder(within_s=0.0005), for_s=1.0),
    ]
    runs = []
    for seed in (1, 1, 2):
        bench = Bench(talk, *faults, seed=seed)
        runs.append([bench.ask(until_ms=2 * cycle) for cycle in range(1, 20)])
    assert runs[0] == runs[1] != runs[2]
    assert any(sorted(cycle) != cycle for cycle in runs[0])


def test_host_frames_that_come_late_are_late_on_the_wire(talk: Callable[..., Any]) -> None:
    """Protects against old torques: a delayed torque frame reaches the motors later, as an adapter's queue would."""
    bench = Bench(talk, Fault(action=Delay(sender="host", id=0x401, mask=0x7FF, by_s=0.003)))
    bench.arm.press("activate")
    bench.send("401#AA04B00000000000")
    bench.listen(2 * MS)
    assert not bench.arm.plant.torque_Nm.any()
    bench.listen(4 * MS)
    assert bench.arm.plant.torque_Nm[0] == pytest.approx(-42 * 300 / 2700)
    assert 3 * MS < bench.arm.plant.at_ns < 3.2 * MS


def test_flood_takes_what_the_wire_has(talk: Callable[..., Any]) -> None:
    """Protects arbitration under load: an unimportant flood delays by one frame, an urgent one stops everything."""
    lazy = Bench(talk, Fault(action=Flood(id=0x7FF), for_s=0.01))
    heard = lazy.ask(until_ms=2)
    assert [text for text in heard if text in REPLIES] == REPLIES
    assert heard.count("7FF#0000000000000000") > 5
    urgent = Bench(talk, Fault(action=Flood(id=0x000), for_s=0.01))
    assert not set(urgent.ask(until_ms=9)) & set(REPLIES)
    assert [text for text in urgent.listen(12 * MS) if text in REPLIES] == REPLIES
    slow = Bench(talk, Fault(action=Flood(id=0x7FF, data="AB", period_s=0.001), at_s=0.001, for_s=0.0095))
    assert slow.listen(20 * MS) == ["7FF#AB"] * 10


def test_endless_flood_does_not_hang_the_simulation(talk: Callable[..., Any]) -> None:
    """Protects tests: frames behind an endless flood wait, and the full queue is refused."""
    bench = Bench(talk, Fault(action=Flood(id=0x000)))
    for _ in range(10):
        bench.send("404#30")
    with pytest.raises(BusError, match="No buffer space"):
        bench.send("404#30")


def test_bus_off_loses_all_both_ways_and_says_so(talk: Callable[..., Any]) -> None:
    """Protects against a bus that is lost: error frames 0x40 and 0x100 of SocketCAN around a time without anything."""
    bench = Bench(talk, Fault(action=BusOff(), at_s=0.003, for_s=0.004))
    assert bench.ask(until_ms=2.9) == REPLIES
    assert bench.listen(4 * MS) == ["error 40"]
    assert bench.ask(until_ms=6) == []
    assert bench.arm.wam.heard["get"] == 1
    assert bench.listen(8 * MS) == ["error 100"]
    assert bench.ask(until_ms=10) == REPLIES


@pytest.mark.parametrize(
    ("action", "number"), [(QueueFull(), errno.ENOBUFS), (BusOff(refuse=True), errno.ENOBUFS), (Unplug(), errno.ENODEV)]
)
def test_adapter_refuses_and_recovers(talk: Callable[..., Any], action: object, number: int) -> None:
    """Protects the errors of a real adapter: full queue, bus-off that refuses, unplugged; afterwards it works again."""
    bench = Bench(talk, Fault(action=action, at_s=0.001, for_s=0.002))
    bench.clock.advance_to_ns(2 * MS)
    with pytest.raises(BusError) as refused:
        bench.send("404#30")
    cause = refused.value.__cause__
    if isinstance(action, Unplug):
        with pytest.raises(BusError, match="gone"):
            bench.bus.receive(0)
        with pytest.raises(BusError, match="no adapter"):
            MemoryCanBus(bench.hub, VirtualClock())
    assert cause is None or isinstance(cause, can.CanOperationError)
    assert cause is None or cause.error_code == number
    bench.clock.advance_to_ns(4 * MS)
    bench.hub.step(4 * MS)
    if isinstance(action, Unplug):
        with pytest.raises(BusError, match="open the bus again"):
            bench.send("404#30")
        bench.bus = MemoryCanBus(bench.hub, bench.clock)
    bench.listen(5 * MS)
    assert bench.ask(until_ms=7) == REPLIES


def test_error_frame_is_one_word_of_the_adapter(talk: Callable[..., Any]) -> None:
    """Protects the counting of bus errors: one error frame of the class asked for."""
    bench = Bench(talk, Fault(action=ErrorFrame(error=0x8, data="0000000000000001"), at_s=0.001))
    assert bench.listen(3 * MS) == ["error 8"]


def test_what_the_arm_and_its_operator_do(talk: Callable[..., Any]) -> None:
    """Protects device faults on a script, timed by events: buttons, dips, silence, properties, supply."""
    bench = Bench(
        talk,
        Fault(action=Press(button="shift-activate"), at_s=0.001),
        Fault(action=Silence(nodes=(2,)), on="active", at_s=0.001, for_s=0.002),
        Fault(action=SetProperty(node=5, name="P", value=1000), on="active", at_s=0.005),
        Fault(action=BrownOut(nodes=(7,), down_s=0.0), on="active", at_s=0.007),
        Fault(action=Supply(volts=28), on="active", at_s=0.009),
    )
    assert bench.listen(round(1.5 * MS)) == ["540#88000200"]
    bench.listen(round(2.5 * MS))
    assert bench.ask(until_ms=4) == [REPLIES[0], *REPLIES[2:]]
    assert bench.ask(until_ms=7) == REPLIES
    assert bench.ask(until_ms=8.5) == [*REPLIES[:4], "4A3#0003E8", *REPLIES[5:]]
    assert bench.listen(round(9.5 * MS)) == []
    assert bench.ask(until_ms=11) == [*REPLIES[:4], "4A3#0003E8", REPLIES[5], "540#88000000"]
    assert bench.arm.wam.mode == 1


def test_script_that_does_not_fit_the_arm_is_refused(talk: Callable[..., Any]) -> None:
    """Protects authors of scripts: nodes and properties that this arm does not have."""
    with pytest.raises(InputError, match="fault 1: node 9 does not exist"):
        Bench(talk, Fault(action=SetProperty(node=9, name="P", value=0)))
    with pytest.raises(InputError, match=r"fault 1: a motor puck .* has no property 'ZERO'"):
        Bench(talk, Fault(action=SetProperty(node=1, name="ZERO", value=0)))


def test_faults_over_the_socket(talk: Callable[..., Any], tmp_path: Path) -> None:
    """Protects real-time users: python-can sees the error frame, the full queue and the unplugged adapter as real."""
    arm, clock = talk(), VirtualClock()
    script: FaultScript[Any] = FaultScript(
        faults=(
            Fault(action=ErrorFrame(), at_s=0.001),
            Fault(action=QueueFull(), at_s=0.002, for_s=0.002),
            Fault(action=Unplug(), at_s=0.006, for_s=0.002),
        )
    )
    hub = SeqpacketHub(tmp_path / "can", [arm.wam], clock, CanFaults(script, arm.wam))
    ask = can.Message(arbitration_id=0x00A, data=[8], is_extended_id=False)
    try:
        bus = can.Bus(interface="seqpacket", channel=str(tmp_path / "can"))
        hub.step(0)
        hub.step(1 * MS)
        error = bus.recv(0)
        assert error is not None
        assert (error.is_error_frame, error.arbitration_id) == (True, 0x80)
        hub.step(3 * MS)
        assert bus.recv(0) is None
        with pytest.raises(can.CanOperationError, match="No buffer space"):
            bus.send(ask)
        hub.step(5 * MS)
        assert bus.recv(0) is None
        bus.send(ask)
        hub.step(5 * MS)
        hub.step(round(5.5 * MS))
        assert bus.recv(0) is not None
        hub.step(7 * MS)
        with pytest.raises(can.CanOperationError):
            bus.recv(0)
        bus.shutdown()
        with pytest.raises(can.CanInitializationError):
            can.Bus(interface="seqpacket", channel=str(tmp_path / "can"))
        hub.step(9 * MS)
        can.Bus(interface="seqpacket", channel=str(tmp_path / "can")).shutdown()
    finally:
        hub.close()
