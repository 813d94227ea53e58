"""A TakkTile bridge on USB, through pyusb and libusb.

pyusb is asked for only here, and only when a bridge is opened. Several bridges are told apart by their serial numbers.
Source: TakkTile reference 3.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable
from typing import Any, Protocol

from drivers.clock import Clock
from drivers.errors import BusError, DeviceError, InputError, NoReplyError, ProtocolError
from drivers.takktile.frames import BULK_ENDPOINT, DEVICE, LONGEST_FRAME_BYTES, PRODUCT_ID, REQUEST_TYPE, VENDOR_ID

REQUEST_TIMEOUT_MS = 500
_PIPE_ERROR = 32
"""EPIPE: the bridge stalled, that is, refused a request (pyusb gives libusb's errors as errno)."""
_BUSY = 16
_NO_ACCESS = 13
_UDEV = "Install deploy/udev/99-stillgrasp.rules, which lets your group open 59e3:74c7, and plug it in again."


class UsbDevice(Protocol):
    """What is used of `usb.core.Device`."""

    @property
    def serial_number(self) -> str | None: ...

    def set_configuration(self) -> None: ...

    def ctrl_transfer(
        self, bmRequestType: int, bRequest: int, wValue: int, wIndex: int, data_or_wLength: int, timeout: int
    ) -> Iterable[int]: ...

    def read(self, endpoint: int, size_or_buffer: int, timeout: int) -> Iterable[int]: ...


class UsbTransport:
    """The bridge with this serial number; without one, the only one there is. Raises BusError and InputError."""

    def __init__(self, serial: str, clock: Clock) -> None:
        core = _pyusb("usb.core")
        self._clock = clock
        self._error: type[OSError] = core.USBError
        self._timeout: type[OSError] = core.USBTimeoutError
        self._dispose: Callable[[UsbDevice], None] = _pyusb("usb.util").dispose_resources
        self._device = self._find(core, serial)
        try:
            self._call(self._device.set_configuration)
        except DeviceError:
            self.close()
            raise

    def request(self, request: int, value: int, index: int, length: int) -> bytes:
        device = self._device
        return bytes(
            self._call(
                lambda: device.ctrl_transfer(REQUEST_TYPE, request, value, index, length, REQUEST_TIMEOUT_MS), request
            )
        )

    def read_frame(self, deadline_ns: int) -> bytes | None:
        # libusb takes a timeout of 0 for none at all
        timeout_ms = max(1, (deadline_ns - self._clock.now_ns()) // 1_000_000)
        try:
            return bytes(self._call(lambda: self._device.read(BULK_ENDPOINT, LONGEST_FRAME_BYTES, timeout_ms)))
        except NoReplyError:
            return None

    def close(self) -> None:
        self._dispose(self._device)

    def _find(self, core: Any, serial: str) -> UsbDevice:
        try:
            found: list[UsbDevice] = list(core.find(find_all=True, idVendor=VENDOR_ID, idProduct=PRODUCT_ID))
        except core.NoBackendError as error:
            raise BusError(DEVICE, "libusb is not installed.", help="Install the package libusb-1.0-0.") from error
        serials = [self._serial_number(device) for device in found]
        matching = [device for device, number in zip(found, serials, strict=True) if serial in ("", number)]
        if not matching:
            seen = f"; there are {', '.join(serials)}" if serials else ""
            wanted = f" with serial number {serial!r}" if serial else ""
            raise BusError(DEVICE, f"none{wanted} is on USB{seen}.", help="Check its plug, and tactile.channel.")
        if len(matching) > 1:
            raise InputError(
                f"{len(matching)} TakkTile bridges are on USB: {', '.join(serials)}.",
                help="Name one of these serial numbers as tactile.channel.",
            )
        return matching[0]

    def _serial_number(self, device: UsbDevice) -> str:
        try:
            return self._call(lambda: device.serial_number) or ""
        except ValueError as error:  # pyusb's word for strings that it may not read
            raise BusError(DEVICE, "this user may not open it.", help=_UDEV) from error

    def _call(self, act: Callable[[], Any], request: int | None = None) -> Any:
        """Do it; what pyusb raises becomes an error of ours."""
        try:
            return act()
        except self._timeout as error:
            raise NoReplyError(DEVICE, "kept silent on USB.", help="Unplug it and plug it in again.") from error
        except self._error as error:
            raise _explained(error, request) from error


def _explained(error: OSError, request: int | None) -> DeviceError:
    if error.errno == _PIPE_ERROR and request is not None:
        return ProtocolError(DEVICE, f"refused request 0x{request:02X}.", help="Check its firmware.")
    if error.errno == _NO_ACCESS:
        return BusError(DEVICE, "this user may not open it.", help=_UDEV)
    if error.errno == _BUSY:
        return BusError(DEVICE, "another program uses it.", help="Stop that program.")
    return BusError(DEVICE, f"USB failed: {error}.", help="Check its plug.")


def _pyusb(module: str) -> Any:
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise InputError(
            "TakkTile bridges on USB need pyusb, which is not installed.", help="pip install stillgrasp[tracker-usb]"
        ) from error
