"""Faults of the arm through the daemon as its processes: named to clients, with an arm that is where it should be, and
cleared without a restart.

One daemon goes through all of them; faults and buttons are typed at its pendant. Real time, so nothing here asserts how
long something took, every wait has a generous end, and a machine that stalls may give the cycle other faults before.
"""

from __future__ import annotations

import json
import signal
import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from controller.client import Client
from controller.reasons import EXPLANATIONS
from drivers.clock import nanoseconds
from drivers.errors import CommandError
from tests.system.daemon_rig import TIMEOUT_S, Daemon, Installation, ThirdClient, heard
from tests.system.wam_fault_cases import ADVICE

pytestmark = pytest.mark.slow
ATTEMPTS = 5
_TEXTS = {explanation.code: explanation for explanation in EXPLANATIONS.values()}
_MOTOR_TORQUE_MODE = "88000200"
_NO_TORQUE = "AA00000000000000"


class Operator:
    """At the pendant of a running daemon, with a client's screen beside it."""

    def __init__(self, daemon: Daemon, client: Client) -> None:
        self.daemon, self.client = daemon, client

    def type(self, line: str) -> None:
        """A line at the pendant."""
        assert self.daemon.process.stdin is not None
        print(line, file=self.daemon.process.stdin, flush=True)

    def cause(self, action: dict[str, Any], for_s: float | None = None) -> None:
        """Let something go wrong."""
        self.type(json.dumps({"action": action} | ({} if for_s is None else {"for_s": for_s})))

    def wait(self, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The first state for which `condition` holds."""
        end_ns = self.client.clock.now_ns() + nanoseconds(TIMEOUT_S)
        while self.client.clock.now_ns() < end_ns:
            state: dict[str, Any] = self.client.status()["state"]
            if condition(state):
                return state
            self.pause(0.02)
        raise AssertionError(
            f"it never came to that: {state['arm']['state']}, {state['grasp']}\n{self.daemon.messages()}"
        )

    def make_ready(self) -> None:
        """Clear what there is and activate the arm, as often as the machine's stalls make it necessary."""
        for _ in range(ATTEMPTS):
            self.type("idle")
            self.pause(0.3)
            try:
                self.client.fault_clear()
            except CommandError:  # not yet: an adapter that is still away
                continue
            self.wait(lambda state: state["arm"]["state"] == "idle")
            self.type("activate")
            state = self.wait(lambda state: state["arm"]["state"] == "active" or bool(state["grasp"]["fault"]))
            if not state["grasp"]["fault"]:
                return
        raise AssertionError(f"the arm does not become active\n{self.daemon.messages()}")

    def pause(self, duration_s: float) -> None:
        """Let time pass, listening."""
        end_ns = self.client.clock.now_ns() + nanoseconds(duration_s)
        while self.client.receive_until(end_ns):
            pass

    def mode(self) -> int:
        """The safety puck's own word: 0 E-stop, 1 idle, 2 active."""
        third = ThirdClient(self.daemon)
        try:
            return third.safety("MODE")
        finally:
            third.bus.shutdown()


@dataclass(frozen=True)
class Step:
    """A fault, the names that it may have, and the modes in which the arm may then be."""

    action: dict[str, Any]
    codes: tuple[str, ...]
    for_s: float | None = None
    modes: tuple[int, ...] = (1,)
    undo: dict[str, Any] | None = None
    """What makes the arm sound again before the fault is cleared."""


STEPS = {
    "undervoltage": Step({"kind": "supply", "volts": 20}, ("arm_voltage",), undo={"kind": "supply", "volts": 48}),
    "too much torque": Step(
        {"kind": "set_property", "node": 10, "name": "TL2", "value": 1},
        ("arm_torque",),
        undo={"kind": "set_property", "node": 10, "name": "TL2", "value": 8100},
    ),
    "a silent puck": Step({"kind": "silence", "nodes": [4]}, ("arm_silent",), 1.5),
    "all pucks silent": Step({"kind": "silence", "nodes": [1, 2, 3, 4, 5, 6, 7]}, ("arm_silent", "arm_heartbeat"), 1.5),
    "torques of another host": Step(
        {"kind": "flood", "id": 0x401, "data": _NO_TORQUE, "period_s": 0.02}, ("foreign_torque",), 0.1
    ),
    "a mode of another host": Step(
        {"kind": "flood", "id": 0x404, "data": _MOTOR_TORQUE_MODE, "period_s": 0.02}, ("mode_raised",), 0.03
    ),
    "malformed frames": Step({"kind": "flood", "id": 0x540, "period_s": 0.0004}, ("malformed_flood",), 0.5, (1, 2)),
    "bus-off": Step({"kind": "bus_off"}, ("bus_off",), 1.0, (1, 2)),
    "a full queue": Step({"kind": "enobufs"}, ("can_queue_full",), 1.0, (1, 2)),
    "an unplugged adapter": Step({"kind": "unplug"}, ("can_adapter_gone", "bus_failed"), 1.0, (1, 2)),
}


@pytest.fixture(scope="module")
def operator() -> Iterator[Operator]:
    with tempfile.TemporaryDirectory(prefix="sg-") as directory, closing(Installation(Path(directory))) as place:
        daemon = place.start("--pendant", "manual").wait_ready()
        with daemon.client() as client:
            client.hello()
            yield Operator(daemon, client)


@pytest.mark.parametrize("name", STEPS)
def test_a_fault_is_named_and_can_be_cleared(name: str, operator: Operator) -> None:
    """Protects the operator: cause and cure reach every client, the arm is where the words say, and work goes on."""
    step = STEPS[name]
    operator.make_ready()
    operator.client.events.clear()
    operator.cause(step.action, step.for_s)
    state = operator.wait(lambda state: bool(state["grasp"]["fault"]))
    assert state["grasp"]["fault"] in step.codes, operator.daemon.messages()
    operator.client.poll()
    told = [event.fields for event in operator.client.events if event.event == "fault"]
    text = _TEXTS[str(told[0]["code"])]
    assert (told[0]["message"], told[0]["help"]) == (text.message, text.help)
    assert ADVICE[text.code][1] in str(told[0]["help"])
    if step.undo is not None:
        operator.cause(step.undo)
    operator.pause(step.for_s or 0.0)
    operator.wait(lambda state: step.modes == (1, 2) or state["arm"]["state"] == "idle")
    assert operator.mode() in step.modes
    operator.make_ready()


def test_lost_replies_and_frames_are_no_fault(operator: Operator) -> None:
    """Protects work from alarms: single losses are made good within a few cycles."""
    for _ in range(ATTEMPTS):
        operator.make_ready()
        for action in ({"kind": "drop", "node": 3}, {"kind": "drop", "sender": "host"}, {"kind": "error_frame"}):
            operator.cause(action)
        number = operator.client.status()["state"]["cycle"]["number"]
        state = operator.wait(lambda state, after=number + 200: state["cycle"]["number"] > after)  # type: ignore[misc]
        if not state["grasp"]["fault"]:
            return
    raise AssertionError(operator.daemon.messages())


def test_the_guard_still_guards_in_the_end(operator: Operator) -> None:
    """Protects what comes last: after all that was opened again, the front still idles the arm of a dead cycle."""
    operator.make_ready()
    operator.daemon.send_signal("cycle", signal.SIGKILL)
    heard(operator.client, operator.daemon, "fault", "cycle_lost")
    assert operator.mode() == 1
    assert "the arm is idle" in operator.client.status()["cycle_lost"]
    assert operator.daemon.exit_code() == 1
