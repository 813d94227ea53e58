"""The fault matrix: what goes wrong with the arm, in which phase, and what is then expected of the robot.

    python -m tests.system.wam_fault_cases            print the matrix
    python -m tests.system.wam_fault_cases --write    write it into docs/faults.md

`test_wam_faults.py` holds the robot to it. Times in s from the fault on. What the arm has to do follows from the WAM
reference 4.5, 4.6, 7 and design 5; what the operator is told, from `ADVICE`, which is written by hand.
"""

from __future__ import annotations

from typing import Any

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
from drivers.simulated.faults import Fault
from tests.system.fault_page import tell
from tests.system.wam_fault_matrix import (
    BEGIN,
    END,
    GOES_ON,
    STARTS,
    Case,
    Cell,
    holds,
    idles,
    lost,
    matrix,
    refuses,
)

MID_CYCLE_S = 0.0003
"""Faults begin while the replies to a position request travel."""
_FOREVER = float("inf")
_ALL = (1, 2, 3, 4, 5, 6, 7)
_REPLIES: dict[str, Any] = {"id": 0x403, "mask": 0x41F}
_REQUESTS: dict[str, Any] = {"sender": "host", "id": 0x404, "mask": 0x7FF}
_TORQUES: dict[str, Any] = {"sender": "host", "id": 0x400, "mask": 0x7FC}


def _fault(action: object, at_s: float = MID_CYCLE_S, for_s: float | None = None, chance: float = 1.0) -> Fault[Any]:
    return Fault(action=action, at_s=at_s, for_s=for_s, chance=chance)


def _row(
    name: str, *faults: Fault[Any], start: Cell | None = STARTS, running: Cell | None = GOES_ON, **cells: Any
) -> Case:
    """`running`: the cell of idle, moving and squeezing, where `cells` names no other."""
    three = {"idle": running, "moving": running, "squeezing": running}
    return Case(name, faults, start, **(three | cells))


_SILENT = idles("arm_silent", 0.02)
_NO_REPLY = refuses("NoReplyError", "report no position")
_NOBODY = refuses("NoReplyError", "no reply")
_NO_BUS = refuses("BusError", "could not be sent")
_UNPLUGGED = refuses("BusError", "the adapter is gone")

CASES: tuple[Case, ...] = (
    # --- frames that are lost
    _row("one position reply lost", _fault(Drop(node=3, **_REPLIES))),
    _row("a puck's replies lost for three cycles", _fault(Drop(node=3, **_REPLIES), for_s=0.006)),
    _row("all replies lost for three cycles", _fault(Drop(**_REPLIES), for_s=0.006)),
    _row("one in twenty replies lost", _fault(Drop(**_REPLIES), for_s=_FOREVER, chance=0.05)),
    _row(
        "one in three replies lost",
        _fault(Drop(**_REPLIES), for_s=_FOREVER, chance=0.33),
        start=_NO_REPLY,
        running=idles("arm_silent", 0.05),
    ),
    _row("one position request lost", _fault(Drop(**_REQUESTS))),
    _row("position requests lost", _fault(Drop(**_REQUESTS), for_s=_FOREVER), start=_NO_REPLY, running=_SILENT),
    _row("one torque frame lost", _fault(Drop(**_TORQUES))),
    _row(
        "torque frames lost",
        _fault(Drop(**_TORQUES), for_s=_FOREVER),
        moving=idles("collision", 0.6),
        squeezing=idles("collision", 1.0),
        duration_s=1.1,
    ),
    _row(
        "all frames of the host lost",
        _fault(Drop(sender="host"), for_s=_FOREVER),
        start=_NOBODY,
        idle=idles("safety_puck_silent", 0.02),
        running=idles("safety_puck_silent", 0.12),
    ),
    # --- frames that come late, twice, or out of order
    _row("replies 0.4 ms late, as through a USB adapter", _fault(Delay(by_s=0.0004, **_REPLIES), for_s=_FOREVER)),
    _row("a puck's replies a cycle late for 20 ms", _fault(Delay(node=2, by_s=0.002, **_REPLIES), for_s=0.02)),
    _row("a reply twice", _fault(Duplicate(node=2, **_REPLIES))),
    _row(
        "all replies twice",
        _fault(Duplicate(**_REPLIES), for_s=_FOREVER),
        start=idles("stale_flood", 1.0),
        idle=idles("stale_flood", 0.05),
        running=holds("stale_flood"),
    ),
    _row("replies in any order", _fault(Reorder(within_s=0.0002, **_REPLIES), for_s=_FOREVER)),
    # --- frames with other content
    _row("one wrong position", _fault(Corrupt(node=3, data="1F0000", **_REPLIES))),
    _row(
        "wrong positions",
        _fault(Corrupt(node=6, data="1F0000", **_REPLIES), for_s=_FOREVER),
        start=refuses("DeviceError", "outside its range"),
        running=idles("position_jump", 0.02),
    ),
    _row("a short reply", _fault(Truncate(length=1, **_REPLIES))),
    _row(
        "short replies",
        _fault(Truncate(node=5, length=2, **_REPLIES), for_s=_FOREVER),
        start=_NO_REPLY,
        running=_SILENT,
    ),
    _row("empty replies", _fault(Truncate(length=0, **_REPLIES), for_s=_FOREVER), start=_NO_REPLY, running=_SILENT),
    _row("garbled properties", _fault(Corrupt(bits=8, id=0x406, mask=0x41F), for_s=_FOREVER), start=_NOBODY),
    # --- the adapter
    _row("an error frame", _fault(ErrorFrame())),
    _row("an error frame a cycle for 50 ms", *(_fault(ErrorFrame(error=8), 0.002 * n) for n in range(25))),
    _row(
        "four error frames a cycle",
        *(_fault(ErrorFrame(error=8), 0.0005 * n) for n in range(800)),
        start=idles("bus_errors", 1.0),
        idle=idles("bus_errors", 0.05),
        running=holds("bus_errors"),
    ),
    _row("bus-off for 50 ms", _fault(BusOff(), for_s=0.05), idle=idles("bus_off", 0.005), running=holds("bus_off")),
    _row("bus-off", _fault(BusOff(), for_s=_FOREVER), start=_NOBODY, running=lost("bus_off")),
    _row(
        "bus-off, frames refused",
        _fault(BusOff(refuse=True), for_s=_FOREVER),
        start=_NO_BUS,
        running=lost("can_queue_full"),
    ),
    _row(
        "transmit queue full for 1 ms",
        _fault(QueueFull(), for_s=0.001),
        start=_NO_BUS,
        idle=idles("can_queue_full", 0.005),
        running=holds("can_queue_full"),
    ),
    _row("transmit queue full", _fault(QueueFull(), for_s=_FOREVER), start=_NO_BUS, running=lost("can_queue_full")),
    _row("adapter unplugged", _fault(Unplug(), for_s=_FOREVER), start=_UNPLUGGED, running=lost("can_adapter_gone")),
    _row(
        "adapter unplugged for 0.2 s", _fault(Unplug(), for_s=0.2), start=_UNPLUGGED, running=lost("can_adapter_gone")
    ),
    # --- somebody else on the bus
    _row("a full bus of low priority for 50 ms", _fault(Flood(id=0x7FF), for_s=0.05)),
    _row(
        "a full bus of high priority for 50 ms",
        _fault(Flood(id=0x000), for_s=0.05),
        idle=idles("can_queue_full", 0.02),
        running=holds("can_queue_full"),
    ),
    _row(
        "a full bus of high priority",
        _fault(Flood(id=0x000), for_s=_FOREVER),
        start=_NOBODY,
        running=lost("can_queue_full", 0.02),
    ),
    _row(
        "malformed positions at full rate for 50 ms",
        _fault(Flood(id=0x423, data="00"), for_s=0.05),
        idle=idles("malformed_flood", 0.02),
        running=idles("malformed_flood", 0.02),
    ),
    _row(
        "positions of puck 3 from elsewhere, which the safety puck believes",
        _fault(Flood(id=0x463, data="012345", period_s=0.002), for_s=_FOREVER),
        idle=GOES_ON,
        running=idles("arm_velocity", 0.01),
    ),
    _row(
        "malformed frames of the safety puck for 50 ms",
        _fault(Flood(id=0x540, period_s=0.0002), for_s=0.05),
        idle=idles("malformed_flood", 0.05),
        running=holds("malformed_flood"),
    ),
    _row(
        "torques of another host",
        _fault(Flood(id=0x401, data="AA00000000000000", period_s=0.002), for_s=_FOREVER),
        start=idles("foreign_torque", 1.0),
        running=idles("foreign_torque", 0.01),
        foreign_torques=True,
    ),
    _row(
        "another host puts pucks into torque mode",
        _fault(Flood(id=0x404, data="88000200", period_s=0.01), for_s=0.001),
        running=idles("mode_raised", 0.01),
    ),
    # --- the pendant and the safety puck
    _row("Shift+Idle", _fault(Press(button="idle")), moving=idles("", 0.005), squeezing=idles("arm_idled", 0.005)),
    _row(
        "E-stop",
        _fault(Press(button="estop")),
        start=refuses("DeviceError", "in E-stop"),
        running=Cell("unpowered", "estop", 0.005),
    ),
    _row(
        "E-stop, released, Shift+Idle",
        _fault(Press(button="estop")),
        _fault(Press(button="release"), 0.1),
        _fault(Press(button="idle"), 0.15),
        start=refuses("DeviceError", "in E-stop"),
        running=idles("estop", 0.16),
    ),
    _row(
        "too fast for the safety puck",
        _fault(SetProperty(node=10, name="VL2", value=1)),
        running=idles("arm_velocity", 0.01),
        idle=GOES_ON,
    ),
    _row(
        "an encoder's glitch, seen by the safety puck too",
        _fault(Corrupt(node=2, on_wire=True, data="1F0000", **_REPLIES)),
        running=idles("arm_velocity", 0.01),
        idle=GOES_ON,
    ),
    _row(
        "too much torque for the safety puck",
        _fault(SetProperty(node=10, name="TL2", value=1)),
        running=idles("arm_torque", 0.01),
        idle=GOES_ON,
    ),
    _row("undervoltage", _fault(Supply(volts=20)), running=idles("arm_voltage", 0.01), idle=GOES_ON),
    _row("overvoltage", _fault(Supply(volts=90)), running=idles("arm_voltage", 0.01), idle=GOES_ON),
    _row(
        "the safety puck hears no positions",
        _fault(SetProperty(node=10, name="GRPC", value=5)),
        start=refuses("ProtocolError", "listens to groups"),
        running=idles("arm_heartbeat", 0.12),
        idle=GOES_ON,
    ),
    _row(
        "the safety puck falls silent",
        _fault(Silence(nodes=(10,)), for_s=_FOREVER),
        start=_NOBODY,
        idle=idles("safety_puck_silent", 0.7),
        running=holds("safety_puck_silent", 1.0),
        duration_s=1.1,
    ),
    _row(
        "ZERO cleared",
        _fault(SetProperty(node=10, name="ZERO", value=0)),
        running=idles("zero_lost", 1.0),
        start=None,
        duration_s=1.1,
    ),
    # --- motor pucks and their power
    _row(
        "a puck falls silent",
        _fault(Silence(nodes=(4,)), for_s=_FOREVER),
        start=refuses("NoReplyError", "pucks [4] of 1 to 7 do not answer"),
        running=_SILENT,
    ),
    _row(
        "all pucks fall silent",
        _fault(Silence(nodes=_ALL), for_s=_FOREVER),
        start=refuses("NoReplyError", "no motor puck answers"),
        running=_SILENT,
    ),
    _row(
        "a puck's replies are lost on the wire",
        _fault(Drop(node=5, on_wire=True, **_REPLIES), for_s=_FOREVER),
        start=_NO_REPLY,
        running=_SILENT,
    ),
    _row(
        "brown-out of all pucks",
        _fault(BrownOut()),
        running=idles("puck_reset", 0.02),
    ),
    _row("brown-out of a puck", _fault(BrownOut(nodes=(3,))), running=idles("puck_reset", 0.02)),
    _row(
        "a puck resets",
        _fault(SetProperty(node=5, name="STAT", value=0)),
        running=idles("puck_reset", 0.02),
    ),
    _row(
        "a puck's position is written anew",
        _fault(SetProperty(node=4, name="P", value=100_000)),
        start=refuses("DeviceError", "outside its range"),
        running=idles("position_jump", 0.01),
    ),
    _row(
        "a puck idles by itself",
        _fault(SetProperty(node=3, name="MODE", value=0)),
        idle=GOES_ON,
        running=idles("collision", 0.3),
        duration_s=0.5,
    ),
    _row(
        "wrist pucks change their group",
        *(_fault(SetProperty(node=node, name="GRPC", value=5)) for node in (5, 6, 7)),
        running=_SILENT,
    ),
    _row(
        "a puck takes another's torque",
        _fault(SetProperty(node=4, name="PIDX", value=1), 0.0),
        start=refuses("ProtocolError", "PIDX"),
        idle=GOES_ON,
        running=idles("collision", 0.3),
        duration_s=0.5,
    ),
    # --- an arm that is not what it should be
    _row(
        "a puck of another role",
        _fault(SetProperty(node=4, name="ROLE", value=3), 0.0),
        start=refuses("ProtocolError", "not an arm motor's"),
        running=None,
    ),
    _row(
        "the arm is active before it is under control",
        _fault(Press(button="activate"), 0.0),
        start=refuses("DeviceError", "is active; expected idle"),
        running=None,
    ),
    _row(
        "the safety puck hears no torques",
        _fault(SetProperty(node=10, name="GRPA", value=5), 0.0),
        start=refuses("ProtocolError", "listens to groups"),
        running=None,
    ),
)

ADVICE = {
    "arm_idled": ("went idle", "Activate the arm again"),
    "arm_silent": ("Position replies of the arm are missing", "Check power, E-stop and the CAN bus"),
    "arm_velocity": ("too fast", "Shift+Idle"),
    "arm_torque": ("torque above its limit", "Shift+Idle"),
    "arm_voltage": ("supply out of its range", "Check the power supply"),
    "arm_heartbeat": ("missed position replies", "Shift+Idle"),
    "estop": ("E-stop was pressed", "release E-stop"),
    "safety_puck_silent": ("safety puck does not answer", "Press E-stop"),
    "puck_reset": ("positions are lost", "home pose"),
    "zero_lost": ("not zeroed", "home pose"),
    "position_jump": ("its zero is lost", "home pose"),
    "mode_raised": ("torque mode", "stop that program"),
    "foreign_torque": ("Another host sends torques", "Stop that program"),
    "stale_flood": ("late or twice", "another program that asks for positions"),
    "malformed_flood": ("no puck sends", "wrong bit rate"),
    "bus_errors": ("reports errors", "termination"),
    "bus_off": ("left the bus", "press E-stop"),
    "can_queue_full": ("queue is full", "press E-stop"),
    "can_adapter_gone": ("adapter is gone", "press E-stop"),
    "bus_failed": ("takes no frames", "press E-stop"),
    "collision": ("beyond what the model explains", "Free the arm"),
    "tracking_error": ("too far from where it was commanded", "Something blocks the arm"),
}
"""Words that the message and the help of each fault must hold."""


if __name__ == "__main__":
    tell(BEGIN, END, matrix(CASES))
