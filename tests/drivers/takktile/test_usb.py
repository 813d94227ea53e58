"""The bridge on USB: the unmodified pyusb in front of a backend that is a simulated bridge.

Descriptors are the bridge's (reference 3): vendor 59e3, product 74c7, one interface, bulk in 0x81 of 64 bytes.
"""

from __future__ import annotations

import array
import importlib
import sys
from types import SimpleNamespace
from typing import Any

import pytest

from drivers.clock import MonotonicClock, VirtualClock, nanoseconds
from drivers.errors import BusError, InputError, NoReplyError, ProtocolError
from drivers.simulated.takktile import RequestStalled, SimulatedTakktile
from drivers.takktile.bridge import Bridge
from drivers.takktile.usb import UsbTransport

ENODEV, EPIPE, ETIMEDOUT, EACCES, EBUSY = 19, 32, 110, 13, 16


def test_without_pyusb_the_cure_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """The extra is named; nothing else of the driver needs it."""
    monkeypatch.setitem(sys.modules, "usb", None)
    monkeypatch.setitem(sys.modules, "usb.core", None)
    with pytest.raises(InputError, match="tracker-usb"):
        UsbTransport("", VirtualClock())


class Backend:
    """A libusb of simulated bridges, by serial number."""

    def __init__(self, core: Any, bridges: dict[str, SimulatedTakktile]) -> None:
        self.core = core
        self.bridges = bridges
        self.serials = list(bridges)
        self.error: int | None = None
        self.now_ns = 0
        self.closed = 0

    def enumerate_devices(self) -> list[str]:
        return self.serials

    def get_parent(self, device: str) -> None:
        return None

    def get_device_descriptor(self, device: str) -> SimpleNamespace:
        return SimpleNamespace(
            bLength=18,
            bDescriptorType=1,
            bcdUSB=0x200,
            bDeviceClass=0xFF,
            bDeviceSubClass=0,
            bDeviceProtocol=0,
            bMaxPacketSize0=64,
            idVendor=0x59E3,
            idProduct=0x74C7,
            bcdDevice=0x100,
            iManufacturer=1,
            iProduct=2,
            iSerialNumber=3,
            bNumConfigurations=1,
            address=1 + self.serials.index(device),
            bus=1,
            port_number=1,
            port_numbers=(1,),
            speed=2,
        )

    def get_configuration_descriptor(self, device: str, index: int) -> SimpleNamespace:
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=2,
            wTotalLength=25,
            bNumInterfaces=1,
            bConfigurationValue=1,
            iConfiguration=0,
            bmAttributes=0x80,
            bMaxPower=250,
            extra_descriptors=array.array("B"),
        )

    def get_interface_descriptor(self, device: str, index: int, alternate: int, configuration: int) -> SimpleNamespace:
        if index or alternate:
            raise IndexError
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=4,
            bInterfaceNumber=0,
            bAlternateSetting=0,
            bNumEndpoints=1,
            bInterfaceClass=0xFF,
            bInterfaceSubClass=0,
            bInterfaceProtocol=0,
            iInterface=0,
            extra_descriptors=array.array("B"),
        )

    def get_endpoint_descriptor(
        self, device: str, index: int, interface: int, alternate: int, configuration: int
    ) -> SimpleNamespace:
        return SimpleNamespace(
            bLength=7,
            bDescriptorType=5,
            bEndpointAddress=0x81,
            bmAttributes=2,
            wMaxPacketSize=64,
            bInterval=0,
            bRefresh=0,
            bSynchAddress=0,
            extra_descriptors=array.array("B"),
        )

    def open_device(self, device: str) -> str:
        return device

    def close_device(self, handle: str) -> None:
        self.closed += 1

    def set_configuration(self, handle: str, value: int) -> None:
        self._check(handle)

    def get_configuration(self, handle: str) -> int:
        return 1

    def claim_interface(self, handle: str, interface: int) -> None: ...

    def release_interface(self, handle: str, interface: int) -> None: ...

    def ctrl_transfer(
        self, handle: str, kind: int, request: int, value: int, index: int, data: Any, timeout: int
    ) -> int:
        if kind == 0x80 and request == 6:  # a string descriptor: languages, then the serial number
            text = b"\x09\x04" if value & 0xFF == 0 else handle.encode("utf-16-le")
            return _into(data, bytes([2 + len(text), 3]) + text)
        self._check(handle)
        try:
            return _into(data, self.bridges[handle].request(request, value, index, len(data), self.now_ns))
        except RequestStalled as stall:
            raise self.core.USBError("Pipe error", -9, EPIPE) from stall

    def bulk_read(self, handle: str, endpoint: int, interface: int, buffer: Any, timeout: int) -> int:
        self._check(handle)
        bridge = self.bridges[handle]
        self.now_ns += timeout * 1_000_000
        frame = bridge.take_frame(self.now_ns)
        if frame is None:
            raise self.core.USBTimeoutError("Operation timed out", -7, ETIMEDOUT)
        return _into(buffer, frame)

    intr_read = iso_read = bulk_read  # pyusb looks all three up before it calls one

    def _check(self, handle: str) -> None:
        if self.bridges[handle].unplugged:
            raise self.core.USBError("No such device", -4, ENODEV)
        if self.error == ETIMEDOUT:
            raise self.core.USBTimeoutError("Operation timed out", -7, ETIMEDOUT)
        if self.error is not None:
            raise self.core.USBError("refused", -3, self.error)


def _into(buffer: Any, data: bytes) -> int:
    buffer[: len(data)] = array.array("B", data)
    return len(data)


@pytest.fixture
def backend(monkeypatch: pytest.MonkeyPatch) -> Backend:
    core = pytest.importorskip("usb.core", reason="needs the extra tracker-usb")
    backend = Backend(core, {"right-hand": SimulatedTakktile(lambda: (0.0, 0.0))})
    real = core.find
    monkeypatch.setattr(core, "find", lambda **wanted: real(backend=backend, **wanted))
    importlib.import_module("usb.util")
    return backend


def test_a_bridge_samples_over_pyusb(backend: Backend) -> None:
    """Found by its ids, scanned, read and stopped; a read without a frame ends at its time."""
    clock = VirtualClock()
    bridge = Bridge(UsbTransport("", clock), clock)
    assert len(bridge.cells) == 16
    bridge.start(0.008)
    assert bridge.read(clock.now_ns() + nanoseconds(0.1)) is not None
    bridge.stop()
    assert bridge.read(clock.now_ns() + nanoseconds(0.1)) is None
    bridge.close()
    assert backend.closed == 1


def test_of_two_bridges_one_is_named(backend: Backend) -> None:
    """Two on the bus: without a name refused with both serial numbers, with one the right one is taken."""
    backend.bridges["other"] = SimulatedTakktile(lambda: (0.0, 0.0))
    backend.serials.append("other")
    with pytest.raises(InputError, match="right-hand, other"):
        UsbTransport("", VirtualClock())
    UsbTransport("other", VirtualClock()).request(0x5C, 0, 0, 40)
    assert backend.bridges["other"].requests
    assert not backend.bridges["right-hand"].requests
    with pytest.raises(BusError, match=r"'third'.*there are right-hand, other"):
        UsbTransport("third", VirtualClock())


def test_none_on_the_bus_is_told(backend: Backend) -> None:
    """With the cure."""
    backend.serials.clear()
    with pytest.raises(BusError, match=r"none is on USB\. Check its plug"):
        UsbTransport("", VirtualClock())


@pytest.mark.parametrize(
    ("code", "kind", "words"),
    [(EACCES, BusError, "udev"), (EBUSY, BusError, "another program"), (ETIMEDOUT, NoReplyError, "silent")],
)
def test_usb_errors_become_ours(backend: Backend, code: int, kind: type[Exception], words: str) -> None:
    """Each says what to do."""
    backend.error = code
    with pytest.raises(kind, match=words):
        UsbTransport("", MonotonicClock())


def test_unplugging_and_refusals_are_told(backend: Backend) -> None:
    """A stall is the bridge's refusal, a device that is gone a bus error."""
    transport = UsbTransport("", VirtualClock())
    with pytest.raises(ProtocolError, match="0x77"):
        transport.request(0x77, 0, 0, 8)
    backend.bridges["right-hand"].unplugged = True
    with pytest.raises(BusError, match="No such device"):
        transport.read_frame(nanoseconds(0.01))


def test_a_bridge_that_is_plugged_in_again_is_opened_anew(backend: Backend) -> None:
    """The part that lost it finds it by the same name; what was half opened meanwhile was let go of each time."""
    clock = VirtualClock()
    simulated = backend.bridges["right-hand"]
    bridge = Bridge(UsbTransport("right-hand", clock), clock)
    bridge.start(0.008)
    simulated.unplugged = True
    with pytest.raises(BusError):
        bridge.read(clock.now_ns() + nanoseconds(0.1))
    bridge.close()
    for _ in range(3):
        with pytest.raises(BusError):
            UsbTransport("right-hand", clock)
    simulated.unplugged = False
    again = Bridge(UsbTransport("right-hand", clock), clock)
    again.start(0.008)
    assert again.read(clock.now_ns() + nanoseconds(0.1)) is not None
    again.close()
    assert backend.closed == 5
