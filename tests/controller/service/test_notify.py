"""sd_notify: the datagram that systemd would read."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from controller.service.notify import notify


@pytest.mark.parametrize("abstract", [False, True])
def test_the_service_manager_hears_the_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, abstract: bool) -> None:
    """Both kinds of address that systemd gives work."""
    address = f"@stillgrasp-test-{os.getpid()}" if abstract else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind("\0" + address[1:] if abstract else address)
        manager.settimeout(5.0)
        monkeypatch.setenv("NOTIFY_SOCKET", address)
        assert notify("READY=1\nSTATUS=idle")
        assert manager.recv(100) == b"READY=1\nSTATUS=idle"


@pytest.mark.parametrize("address", ["", "/nowhere/notify"])
def test_without_a_service_manager_nothing_happens(monkeypatch: pytest.MonkeyPatch, address: str) -> None:
    """The daemon runs from a terminal as it does under systemd."""
    monkeypatch.setenv("NOTIFY_SOCKET", address)
    assert notify("READY=1") is False
