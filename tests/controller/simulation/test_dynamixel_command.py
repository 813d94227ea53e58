"""`stillgrasp simulate dynamixel`: bad input in one line, and motors of protocol 1.0 with a fault script."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import tempfile
import termios
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from dynamixel_sdk import PacketHandler, PortHandler

from controller.cli import main

COMMAND = [sys.executable, "-P", "-c", "from controller.cli import main; main()", "simulate", "dynamixel"]


@pytest.fixture
def directory() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="sg-") as path:
        yield Path(path)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--model", "AX-12"], "motor model 'AX-12' is not known; expected one of RX-28, MX-28"),
        (["--ids", "1", "1"], "each with its own id"),
        (["--ids", "1", "254"], "expected an id in 0…252"),
        (["--model", "MX-28", "--baud", "4000000"], "has no baud rate 4000000; expected one of"),
        (["--faults", "{file}"], "fault[0].action.kind = 'brake' is not accepted; expected one of"),
        (["--faults", "{other}"], "motor 9 is not on the bus; expected one of 1, 2"),
        (["--faults", "/does/not/exist"], "No such file"),
        (["--supply", "99"], "supply 99.0 V; expected 0 to 30 V"),
    ],
)
def test_bad_input_is_one_clear_line(
    directory: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    told: str,
) -> None:
    """Protects users: what is wrong is said before anything runs."""
    (directory / "faults.toml").write_text('[[fault]]\naction = { kind = "brake" }\n')
    (directory / "other.toml").write_text('[[fault]]\naction = { kind = "silence", motors = [9] }\n')
    names = {"file": directory / "faults.toml", "other": directory / "other.toml"}
    words = [word.format(**names) for word in arguments]
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(directory))
    monkeypatch.setattr(sys, "argv", ["stillgrasp", "simulate", "dynamixel", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    error = capsys.readouterr().err
    assert ended.value.code
    assert told in error
    assert len(error.splitlines()) == 1


def test_an_old_hand_whose_adapter_is_unplugged(directory: Path) -> None:
    """Protects the whole way: MX-28 answers the SDK in protocol 1.0; the adapter goes, and comes back on its path."""
    script = directory / "faults.jsonl"
    script.write_text('{"action": {"kind": "unplug"}, "on": "torque_on", "at_s": 0.2, "for_s": 0.3}\n')
    arguments = ["--model", "mx-28", "--ids", "3", "1", "--baud", "57600", "--faults", str(script), "--json"]
    environment = {"PATH": "/usr/bin:/bin", "XDG_RUNTIME_DIR": str(directory)}
    with subprocess.Popen([*COMMAND, *arguments], stdout=subprocess.PIPE, env=environment, text=True) as process:
        assert process.stdout is not None
        try:
            path = json.loads(process.stdout.readline())["port"]
            port, handler = PortHandler(path), PacketHandler(1.0)
            assert port.setBaudRate(57_600)
            assert handler.ping(port, 3) == (29, 0, 0)
            assert handler.ping(port, 2)[1] == -3001
            assert handler.write2ByteTxRx(port, 1, 30, 150) == (0, 0)
            end_s = time.monotonic() + 20.0
            with pytest.raises((OSError, termios.error), match=r"Input/output error|device reports readiness"):
                _read_until(end_s, port, handler)
            assert _comes_back(path, end_s)
        finally:
            process.send_signal(signal.SIGINT)
    assert process.returncode == 0
    assert list(directory.rglob("tendons")) == []


def _read_until(end_s: float, port: Any, handler: Any) -> None:
    while time.monotonic() < end_s:
        handler.read2ByteTxRx(port, 1, 36)


def _comes_back(path: str, end_s: float) -> bool:
    while time.monotonic() < end_s:
        try:
            port = PortHandler(path)
            port.setBaudRate(57_600)
            if PacketHandler(1.0).ping(port, 3)[1] == 0:
                port.closePort()
                return True
        except (OSError, termios.error):
            pass  # the link's end is gone, or not there yet
    return False
