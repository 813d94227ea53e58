"""The command line: what it says of itself, what it takes and what it refuses, without a daemon."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from controller.cli import MOUNTED, arguments_of, build_app, main
from drivers.errors import InputError

PATHS = (
    (),
    ("run",),
    ("status",),
    ("send",),
    ("simulate", "wam"),
    ("simulate", "dynamixel"),
    ("table", "build"),
    ("table", "show"),
    ("table", "check"),
    ("table", "list"),
)
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**9), 10**9) | st.floats(allow_nan=False, allow_infinity=False),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text("ab", min_size=1), inner, max_size=3),
    max_leaves=5,
)


def run_main(arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["stillgrasp", *arguments])
    interrupt = signal.getsignal(signal.SIGINT)
    try:
        with pytest.raises(SystemExit) as ended:
            main()
    finally:
        signal.signal(signal.SIGINT, interrupt)
    code = ended.value.code
    return code if isinstance(code, int) else 0


@pytest.mark.parametrize("path", PATHS, ids=" ".join)
def test_every_command_explains_itself_with_an_example(path: tuple[str, ...]) -> None:
    """--help is the first page of the manual that anybody opens."""
    shown = CliRunner().invoke(build_app(path), [*path, "--help"])
    assert shown.exit_code == 0
    assert "Example" in shown.output


def test_help_lists_all_and_loads_nothing_heavy() -> None:
    """`stillgrasp --help` answers at once: the libraries wait for the command that needs them."""
    program = (
        "import sys; from controller.cli import build_app; build_app([]);"
        "print([name for name in ('numpy', 'zmq', 'pinocchio', 'mujoco', 'msgspec') if name in sys.modules])"
    )
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert loaded.stdout.strip() == "[]"
    output = CliRunner().invoke(build_app([]), ["--help"]).output
    assert all(name in output for name in ("run", "status", "send", "simulate", "table"))


@pytest.mark.parametrize(
    ("arguments", "code", "named"),
    [
        (["run", "--seed", "3"], 2, "--simulate"),
        (["run", "--pendant", "manual"], 2, "--simulate"),
        (["run", "--motor-faults", "x.toml"], 2, "motor_faults: only a simulation has these"),
        (["run", "--simulate", "--motor-faults", "none.toml"], 2, "none.toml: (file) = 'No such file"),
        (["run", "--simulate", "--arm-faults", "none.toml"], 2, "none.toml: (file) = 'No such file"),
        (["run", "--simulate", "--record", "x.mcap", "--no-record"], 2, "--no-record"),
        (["run", "--simulate", "--object", "teapot"], 2, "cylinder40"),
        (["run", "--simulate", "--object-xyz", "nan", "0", "0"], 2, "object_xyz_m[0]"),
        (["run", "--config", "/nowhere/robot.toml"], 2, "/nowhere/robot.toml"),
        (["send", "grasp.squeeze", "load_N=1e9"], 2, "load_N"),
        (["send", "grasp.sqeeze"], 2, "grasp.squeeze"),
        (["send", "stop", "now"], 2, "KEY=VALUE"),
        (["status", "--endpoint", "telnet"], 2, "telnet"),
        (["simulate", "dynamixel", "--model", "AX-12"], 2, "XM430-W350"),
        (["simulate", "dynamixel", "--ids", "1", "1"], 2, "own id"),
        (["simulate", "wam", "--channel", "/nowhere/can"], 1, "/nowhere/can"),
        (["status"], 1, "stillgrasp run"),
        (["send", "stop"], 1, "stillgrasp run"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_what_is_wrong_is_told_in_one_message(
    arguments: list[str],
    code: int,
    named: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    """Exit code 2 for bad input, 1 for failure; what was wrong and what to do, and never a traceback."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert run_main(arguments, monkeypatch) == code
    told = capsys.readouterr()
    assert named in told.err
    assert told.out == ""
    assert len(told.err.splitlines()) == 1
    assert not list(tmp_path.rglob("simulated-*"))


def test_what_is_mounted_is_there() -> None:
    """A command that is listed can be called."""
    listed = CliRunner().invoke(build_app([]), ["--help"]).output
    for name in MOUNTED:
        if f" {name} " in listed:
            assert CliRunner().invoke(build_app([name]), [name, "--help"]).exit_code == 0


@given(st.dictionaries(st.text("abcxyz_", min_size=1), VALUES))
def test_arguments_mean_the_same_as_words_and_as_json(arguments: dict[str, Any]) -> None:
    """KEY=VALUE is JSON a word; both ways give what the wire will carry."""
    assert arguments_of("stop", [f"{key}={json.dumps(value)}" for key, value in arguments.items()]) == arguments
    assert arguments_of("stop", [json.dumps(arguments)]) == arguments


def test_a_value_that_is_no_json_is_text() -> None:
    """Names need no quotes; a key may not come twice."""
    assert arguments_of("table.load", ["table=sym", "path=a=b"]) == {"table": "sym", "path": "a=b"}
    with pytest.raises(InputError, match="twice"):
        arguments_of("table.load", ["table=a", "table=b"])
    with pytest.raises(InputError, match="not JSON"):
        arguments_of("table.load", ["{table}"])
