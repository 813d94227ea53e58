"""The seqpacket bus with unmodified python-can clients, raw sockets, and time that the test moves."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from pathlib import Path

import can
import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.clock import VirtualClock
from drivers.errors import BusError
from drivers.simulated.seqpacket_can import SeqpacketBus, SeqpacketHub
from drivers.simulated.wam import SimulatedWam
from drivers.wam.parameters import load_wam_parameters


class HomePlant:
    """An arm that rests at home."""

    def joint_position_rad(self) -> NDArray[np.float64]:
        return np.array([0.0, -2.0, 0.0, 3.13, 0.0, 0.0, 0.0])

    def set_joint_torque_Nm(self, torque_Nm: NDArray[np.float64], braking: bool, at_ns: int) -> None:
        pass


@pytest.fixture
def hub(tmp_path: Path) -> Iterator[SeqpacketHub]:
    wam = SimulatedWam(HomePlant(), load_wam_parameters(), zeroed=True)
    hub = SeqpacketHub(tmp_path / "can", [wam], VirtualClock())
    yield hub
    hub.close()


def _open(hub_path: Path, **options: object) -> can.BusABC:
    return can.Bus(interface="seqpacket", channel=str(hub_path), **options)  # type: ignore[arg-type]  # kwargs of the interface


def _frame(identifier: int, data: str = "") -> can.Message:
    return can.Message(arbitration_id=identifier, is_extended_id=False, data=bytes.fromhex(data))


def _drain(bus: can.BusABC) -> list[str]:
    texts = []
    while (message := bus.recv(0)) is not None:
        texts.append(f"{message.arbitration_id:03X}#{bytes(message.data).hex().upper()}")
    return texts


def test_any_python_can_client_reads_the_arm(hub: SeqpacketHub, tmp_path: Path) -> None:
    """Protects other programs: by the interface's name alone they get the replies when the wire has carried them."""
    with _open(tmp_path / "can") as bus:
        assert isinstance(bus, SeqpacketBus)
        bus.send(_frame(0x404, "30"))
        hub.step(0)
        assert hub.next_due_ns() == 58_000
        assert _drain(bus) == []
        due_ns = 0
        while (next_ns := hub.next_due_ns()) is not None:
            due_ns = next_ns
            hub.step(due_ns)
        assert 600_000 < due_ns < 700_000
        expected = ["423#000000", "443#3F701F", "463#008FE0", "483#3F7088", "4A3#000000", "4C3#000000", "4E3#000000"]
        assert _drain(bus) == expected


def test_clients_hear_each_other_in_arbitration_order(hub: SeqpacketHub, tmp_path: Path) -> None:
    """Protects the broadcast: everybody but the sender hears a frame; among waiting frames priority counts."""
    path = tmp_path / "can"
    with _open(path) as first, _open(path) as second, _open(path) as third:
        first.send(_frame(0x7F0))
        first.send(_frame(0x7F1))
        second.send(_frame(0x123))
        hub.step(0)
        hub.step(10**6)
        assert _drain(third) == ["123#", "7F0#", "7F1#"]
        assert _drain(first) == ["123#"]
        assert _drain(second) == ["7F0#", "7F1#"]


def test_filter_does_not_end_a_poll_early(hub: SeqpacketHub, tmp_path: Path) -> None:
    """Protects polling readers: a frame that the filter drops does not hide the ones behind it."""
    path = tmp_path / "can"
    filters = [{"can_id": 0x423, "can_mask": 0x7FF}]
    with _open(path, can_filters=filters) as bus, _open(path) as other:
        for identifier in (0x100, 0x101, 0x423):
            other.send(_frame(identifier))
        hub.step(0)
        hub.step(10**6)
        assert _drain(bus) == ["423#"]


def test_malformed_packets_are_counted_and_dropped(hub: SeqpacketHub, tmp_path: Path) -> None:
    """Protects the hub from raw clients: wrong length, empty packet, flags, oversized length field."""
    with (
        socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as raw,
        _open(tmp_path / "can") as bus,
    ):
        raw.connect(str(tmp_path / "can"))
        for packet in (b"x", b"", bytes(15), bytes(1000), struct.pack("=IB3x8s", 1, 9, b""), b"\xff" * 16):
            raw.send(packet)
        raw.send(struct.pack("=IB3x8s", 0x00A, 1, b"\x08"))
        hub.step(0)
        assert hub.malformed_packets == 6
        for now_ns in range(0, 10**6, 50_000):
            hub.step(now_ns)
        assert _drain(bus) == ["00A#08", "546#88000100"]


def test_slow_reader_loses_frames_and_harms_nobody(hub: SeqpacketHub, tmp_path: Path) -> None:
    """Protects the others from a client that does not read: its frames are dropped and counted."""
    with _open(tmp_path / "can") as slow, _open(tmp_path / "can") as sender:
        now_ns = 0
        for _ in range(3000):
            sender.send(_frame(0x123))
            hub.step(now_ns)
            now_ns += 200_000
            hub.step(now_ns)
        received = len(_drain(slow))
        assert received > 0
        assert received + hub.dropped_frames == 3000


def test_full_transmit_queue_refuses_at_once(hub: SeqpacketHub, tmp_path: Path) -> None:
    """Protects against torques that pile up: when the hub takes no more, send raises as SocketCAN does."""

    def flood(bus: can.BusABC) -> None:
        for _ in range(100_000):
            bus.send(_frame(0x401))

    with _open(tmp_path / "can") as bus, pytest.raises(can.CanOperationError, match="Transmit buffer full"):
        flood(bus)


def test_client_may_leave_and_hub_may_close(hub: SeqpacketHub, tmp_path: Path) -> None:
    """Protects the ends: a client that left is forgotten; a closed hub is an error to clients and leaves no file."""
    path = tmp_path / "can"
    leaving, staying = _open(path), _open(path)
    hub.step(0)
    assert len(hub.filenos()) == 3
    leaving.shutdown()
    hub.step(1)
    assert len(hub.filenos()) == 2
    hub.close()
    hub.close()
    assert not path.exists()
    with pytest.raises(can.CanOperationError, match="closed"):
        staying.recv(0)
    staying.shutdown()
    with pytest.raises(can.CanInitializationError):
        _open(path)


def test_stale_socket_is_replaced_and_a_living_one_refused(tmp_path: Path) -> None:
    """Protects restart after a crash, and a running simulation from a second one."""
    path = tmp_path / "can"
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as dead:
        dead.bind(str(path))
    first = SeqpacketHub(path, [], VirtualClock())
    with pytest.raises(BusError, match="cannot be made"):
        SeqpacketHub(path, [], VirtualClock())
    first.close()
    (tmp_path / "file").write_text("kept")
    with pytest.raises(BusError):
        SeqpacketHub(tmp_path / "file", [], VirtualClock())
    assert (tmp_path / "file").read_text() == "kept"


def test_unsupported_frames_and_options_are_refused(hub: SeqpacketHub, tmp_path: Path) -> None:
    """Protects against a client that believes that an extended frame was sent."""
    with _open(tmp_path / "can") as bus, pytest.raises(can.CanOperationError, match="standard data frames"):
        bus.send(can.Message(arbitration_id=0x123456, is_extended_id=True))
    with pytest.raises(can.CanInitializationError, match="own messages"):
        _open(tmp_path / "can", receive_own_messages=True)
