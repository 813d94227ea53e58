"""`stillgrasp simulate wam` with firmware, encoders and faults: refusals in one line, and a run with a script."""

from __future__ import annotations

import json
import select
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from controller.cli import main

COMMAND = [sys.executable, "-P", "-c", "from controller.cli import main; main()", "simulate", "wam"]


@pytest.fixture
def directory() -> Iterator[Path]:
    """A short path: sockets have at most 107 bytes for theirs."""
    with tempfile.TemporaryDirectory(prefix="sg-") as path:
        yield Path(path)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--firmware", "20"], "firmware 20 is not supported; expected version 32 or later"),
        (["--faults", "{file}"], "fault[0].action.kind = 'brake' is not accepted; expected one of"),
        (["--faults", "/does/not/exist"], "No such file"),
        (["--asleep"], "cannot be zeroed while its pucks are in their boot monitor"),
        (["--safety-firmware", "31"], "safety puck firmware 31 is not supported"),
    ],
)
def test_bad_input_is_one_clear_line(
    directory: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    told: str,
) -> None:
    """Protects users: what is wrong is said before anything runs, and nothing is left behind."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(directory))
    (directory / "faults.toml").write_text('[[fault]]\naction = { kind = "brake" }\n')
    words = [word.format(file=directory / "faults.toml") for word in arguments]
    monkeypatch.setattr(sys, "argv", ["stillgrasp", "simulate", "wam", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    error = capsys.readouterr().err
    assert ended.value.code
    assert told in error
    assert len(error.splitlines()) == 1


def test_an_old_arm_with_a_fault_script(directory: Path) -> None:
    """Protects the whole way: firmware 60 answers its P, the error frame comes, a typed fault presses E-stop."""
    script = directory / "faults.jsonl"
    script.write_text('{"on": "first_position", "action": {"kind": "error_frame", "error": 32}}\n')
    process = subprocess.Popen(
        [*COMMAND, "--json", "--channel", str(directory / "can"), "--firmware", "60", "--faults", str(script)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        assert select.select([process.stdout], [], [], 60.0)[0]
        with can.Bus(**json.loads(process.stdout.readline())) as bus:
            bus.send(can.Message(arbitration_id=0x404, data=[26], is_extended_id=False))
            heard = [bus.recv(10.0) for _ in range(5)]
            assert {0x423, 0x443, 0x463, 0x483} == {
                message.arbitration_id for message in heard if message is not None and not message.is_error_frame
            }
            assert [message.arbitration_id for message in heard if message is not None and message.is_error_frame] == [
                32
            ]
            print('{"action": {"kind": "press", "button": "estop"}}', file=process.stdin, flush=True)
            order = bus.recv(10.0)
            assert order is not None
            assert order.arbitration_id == 0x540
    finally:
        process.terminate()
        assert process.wait(60.0) == 0
        process.stdin.close()
        process.stdout.close()
