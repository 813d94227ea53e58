"""The fault matrix of the tendon motors: what goes wrong with them or their bus, in which phase, and what is expected.

    python -m tests.system.motor_fault_cases            print the matrix
    python -m tests.system.motor_fault_cases --write    write it into docs/faults.md

`test_motor_faults*.py` hold the robot to it. Times in s from the fault on; motor 1 is the right finger's, 2 the left's.
"Lasting" is longer than anybody watches (`WATCH_S`). What has to happen follows from the dynamixel reference 6 and
design 5 ("A fault keeps the object"); what the operator is told, from `ADVICE`, which is written by hand.
"""

from __future__ import annotations

from typing import Any

from drivers.simulated.faults import Fault
from drivers.simulated.serial_fault_actions import (
    Corrupt,
    CutOff,
    Drop,
    Echo,
    EffortError,
    EffortStuck,
    EncoderJump,
    EncoderNoise,
    EncoderStuck,
    ErrorStatus,
    Garbage,
    HardwareError,
    Late,
    Reboot,
    SetRegister,
    Silence,
    Supply,
    Temperature,
    Truncate,
    Unplug,
    WrongId,
)
from tests.system.fault_page import tell
from tests.system.motor_fault_matrix import (
    BEGIN,
    END,
    GOES_ON,
    STARTS,
    WATCH_S,
    XM,
    After,
    Case,
    Cell,
    holds,
    lets_go,
    matrix,
    refuses,
    slackens,
    stops,
    warns,
)
from tests.system.motor_fault_rig import HandStall

_LASTING = WATCH_S
_MX, _XL = "MX-28", "XL430-W250"


def _fault(action: Any, at_s: float = 0.0, for_s: float | None = None, **more: Any) -> Fault[Any]:
    return Fault(action=action, at_s=at_s, for_s=for_s, **more)


def _set(name: str, value: int, motors: tuple[int, ...] | None = None, at_s: float = 0.0) -> Fault[Any]:
    return _fault(SetRegister(name=name, value=value, motors=motors), at_s)


def _row(
    name: str,
    *faults: Fault[Any] | HandStall,
    running: Cell | None = GOES_ON,
    start: Cell | None = STARTS,
    after: After = "",
    let_go: tuple[int, ...] = (),
    mend: tuple[Fault[Any], ...] = (),
    model: str = XM,
    watch_s: float = WATCH_S,
    opens: bool = True,
    **cells: Cell | None,
) -> Case:
    """`running`: squeezing and, where something happens with the first model, holding. Other phases as `cells` names
    them, else not looked at."""
    squeezing = cells.get("squeezing", running)
    holding = cells.get("holding", running if model == XM and running is not GOES_ON else None)
    row = (start, cells.get("open"), cells.get("closing"), squeezing, holding, cells.get("adoption"))
    return Case(name, faults, row, after, let_go, mend, model, watch_s, opens)


_SILENT, _ONE = holds("hand_silent"), holds("hand_motor_silent")
_NOBODY = refuses("NoReplyError", "no reply at 1000000 bit/s")
_ALONE: dict[str, Any] = {"start": refuses("NoReplyError", "the other motor answers")}
_DAMAGED = refuses("ProtocolError", "damaged reply")

CASES: tuple[Case, ...] = (
    # --- packets that are lost
    _row("one answer lost", _fault(Drop()), closing=GOES_ON, holding=GOES_ON, adoption=STARTS),
    _row("three answers lost", _fault(Drop(), for_frames=3), start=None),
    _row("answers lost for 50 ms", _fault(Drop(), for_s=0.05), start=_NOBODY, closing=GOES_ON, holding=GOES_ON),
    _row("one motor silent for 30 ms", _fault(Silence(motors=(2,)), for_s=0.03), start=None),
    _row(
        "answers lost",
        _fault(Drop(), for_s=_LASTING),
        start=_NOBODY,
        open=warns("hand_silent"),
        closing=_SILENT,
        running=_SILENT,
        adoption=_NOBODY,
        after="clear",
    ),
    _row(
        "one motor silent",
        _fault(Silence(motors=(1,)), for_s=_LASTING),
        start=refuses("NoReplyError", "the other motor answers"),
        open=warns("hand_motor_silent"),
        closing=_ONE,
        running=_ONE,
        after="clear",
    ),
    _row(
        "requests lost",
        _fault(Drop(sender="host"), for_s=_LASTING),
        start=_NOBODY,
        running=slackens("hand_silent"),
        after="clear",
        opens=False,
    ),
    # --- packets with other content
    _row("one answer damaged", _fault(Corrupt()), adoption=STARTS),
    _row(
        "one answer in twenty damaged",
        _fault(Corrupt(), for_s=_LASTING, chance=0.05),
        closing=GOES_ON,
        holding=GOES_ON,
        adoption=STARTS,
    ),
    _row("answers damaged", _fault(Corrupt(), for_s=_LASTING), start=_DAMAGED, running=_SILENT, after="clear"),
    _row(
        "requests damaged",
        _fault(Corrupt(sender="host"), for_s=_LASTING),
        start=None,
        running=slackens("hand_silent"),
        after="clear",
        opens=False,
    ),
    _row("an answer of another motor", _fault(WrongId(id=7))),
    _row(
        "answers of one motor name the other",
        _fault(WrongId(motor=1, id=2), for_s=_LASTING),
        start=refuses("ProtocolError", "reply to ping"),
        running=_SILENT,
        after="clear",
    ),
    _row("half an answer", _fault(Truncate(length=9))),
    _row("half answers", _fault(Truncate(length=9), for_s=_LASTING), start=None, running=_SILENT, after="clear"),
    _row("other bytes before answers", _fault(Garbage(data="00FF13"), for_s=_LASTING)),
    _row("a header before answers", _fault(Garbage(data="FFFFFD00"), for_s=_LASTING)),
    _row(
        "a flood of other bytes",
        _fault(Garbage(data="A5" * 3000), for_s=_LASTING),
        start=None,
        running=_SILENT,
        after="clear",
    ),
    *(
        _row(f"an answer says: {error}", _fault(ErrorStatus(error=number)), start=None, holding=None)
        for number, error in enumerate(
            (
                "result fail",
                "instruction error",
                "CRC error",
                "data range error",
                "data length error",
                "data limit error",
                "access error",
            ),
            start=1,
        )
    ),
    _row(
        "all answers say: access error",
        _fault(ErrorStatus(error=7), for_s=_LASTING),
        start=refuses("ProtocolError", "access error"),
        running=_SILENT,
        after="clear",
    ),
    # --- the adapter
    _row("answers 1 ms late", _fault(Late(by_s=0.001), for_s=_LASTING), closing=GOES_ON),
    _row("one answer later than anybody waits", _fault(Late(by_s=0.006))),
    _row(
        "answers 16 ms late: a latency timer that was not set",
        _fault(Late(by_s=0.016), for_s=_LASTING),
        start=refuses("ProtocolError", "reply to ping"),
        running=_SILENT,
        after="clear",
    ),
    _row("an adapter that echoes", _fault(Echo(), for_s=_LASTING)),
    _row(
        "adapter unplugged",
        _fault(Unplug(), for_s=_LASTING),
        start=refuses("BusError", "unplugged"),
        open=warns("hand_bus_lost"),
        running=slackens("hand_bus_lost", 0.02),
        after="clear",
        opens=False,
    ),
    _row(
        "the hand process stands still for 0.3 s",
        HandStall(0.3),
        start=None,
        running=slackens("hand_silent"),
        after="clear",
        opens=False,
    ),
    # --- hardware errors
    _row(
        "overload",
        _fault(HardwareError(motors=(1,))),
        start=refuses("DeviceError", "hardware error: overload"),
        open=warns("hand_overloaded"),
        running=lets_go("hand_overloaded", 0.02),
        let_go=(0,),
        after="restart",
    ),
    _row(
        "overheating",
        _fault(HardwareError(motors=(2,), error="overheating")),
        start=refuses("DeviceError", "hardware error: overheating"),
        running=lets_go("hand_overheated", 0.02),
        let_go=(1,),
        after="restart",
    ),
    _row(
        "electrical shock, both",
        _fault(HardwareError(error="shock")),
        start=refuses("DeviceError", "hardware error"),
        running=lets_go("hand_torque_lost", 0.02),
        let_go=(0, 1),
        after="restart",
    ),
    _row(
        "voltage error",
        _fault(HardwareError(motors=(1,), error="voltage")),
        start=None,
        open=warns("hand_voltage"),
        running=holds("hand_voltage", 0.02),
        after="clear",
    ),
    _row(
        "encoder error",
        _fault(HardwareError(motors=(1,), error="encoder")),
        start=None,
        running=holds("hand_hardware", 0.02),
        after="clear",
    ),
    # --- heat and supply
    _row(
        "getting hot",
        *(_fault(Temperature(celsius=66.0 + 2.0 * n), 0.02 * n) for n in range(7)),
        start=None,
        squeezing=stops("hand_hot"),
        holding=warns("hand_hot"),
    ),
    _row(
        "above the temperature limit",
        _fault(Temperature(motors=(2,), celsius=85.0)),
        start=None,
        running=lets_go("hand_overheated", 0.03),
        let_go=(1,),
        after="restart",
    ),
    _row(
        "supply sags to 9 V",
        _fault(Supply(volts=9.0), for_s=_LASTING),
        start=None,
        running=holds("hand_voltage", 0.03),
        after="clear",
    ),
    _row(
        "supply gone for 20 ms",
        _fault(Supply(volts=4.0), for_s=0.02),
        start=None,
        running=lets_go("hand_silent", then="hand_restarted"),
        let_go=(0, 1),
        after="open",
    ),
    _row(
        "supply gone",
        _fault(Supply(volts=0.0), for_s=_LASTING),
        start=_NOBODY,
        running=lets_go("hand_silent"),
        let_go=(0, 1),
        after="open",
    ),
    _row(
        "one motor restarts",
        _fault(Reboot(motors=(1,))),
        start=refuses("NoReplyError", "the other motor answers"),
        closing=lets_go("hand_motor_silent", then="hand_restarted"),
        running=lets_go("hand_motor_silent", then="hand_restarted"),
        let_go=(0,),
        after="open",
    ),
    _row(
        "one motor's plug is out",
        _fault(CutOff(motors=(2,)), for_s=_LASTING),
        start=refuses("NoReplyError", "the other motor answers"),
        running=lets_go("hand_motor_silent"),
        let_go=(1,),
        after="open",
    ),
    # --- another program on the bus
    _row(
        "torque switched off by another program",
        _set("torque_enable", 0, (1,)),
        start=None,
        running=lets_go("hand_torque_lost", 0.02),
        let_go=(0,),
        after="open",
    ),
    _row(
        "a goal of another program",
        _set("goal_position", 600, (1,)),
        start=None,
        holding=lets_go("hand_not_following"),
        let_go=(0,),
        after="open",
    ),
    _row(
        "a position gain of another program",
        _set("position_p_gain", 0, (1,)),
        start=None,
        running=lets_go("hand_not_following", known_s=0.15),
        let_go=(0,),
        after="restart",
    ),
    _row("a ceiling of another program", _set("goal_current", 20, (1,)), start=None, holding=GOES_ON),
    _row("the watchdog switched off", _set("bus_watchdog", 0), start=None),
    _row("the indirect map overwritten", _set("indirect_address_1", 224, (1,)), start=None),
    _row(
        "one motor at another baud rate",
        _set("baud_rate", 1, (2,)),
        start=refuses("NoReplyError", "the other motor answers"),
        running=holds("hand_motor_silent"),
        mend=(_set("baud_rate", 3, (2,)),),
        after="clear",
        opens=False,
    ),
    _row(
        "both motors with one id",
        _set("id", 1, (2,)),
        start=refuses("NoReplyError", "the other motor answers"),
        running=holds("hand_motor_silent"),
        mend=(_set("id", 2, (1,)), _set("id", 1, (1,))),
        opens=False,
    ),
    _row("return delay back at 500 µs", _set("return_delay_time", 250)),
    # --- sensors
    _row(
        "a position that jumps by a millimetre",
        _fault(EncoderJump(motors=(1,), ticks=62)),
        start=None,
        open=warns("hand_position_jump"),
        running=lets_go("hand_position_jump", 0.02),
        let_go=(0,),
        after="restart",
    ),
    _row(
        "a stuck encoder",
        _fault(EncoderStuck(motors=(1,)), for_s=0.8),
        start=None,
        squeezing=lets_go("hand_not_following", known_s=0.4),
        let_go=(0,),
        after="restart",
        watch_s=0.6,
    ),
    _row("positions that tremble by 3 ticks", _fault(EncoderNoise(ticks=3.0), for_s=_LASTING), start=None),
    _row("a false peak of current", _fault(EffortError(motors=(1,), counts=1000), for_s=0.004), start=None),
    _row(
        "false current above the cap",
        _fault(EffortError(motors=(1,), counts=1000), for_s=_LASTING),
        start=None,
        squeezing=stops(""),
    ),
    _row("a current sensor that is stuck", _fault(EffortStuck(motors=(1,)), for_s=_LASTING), start=None),
    # --- protocol 1.0: no watchdog, alarms in the error byte, one read a motor
    _row("one answer lost", _fault(Drop()), model=_MX),
    _row("answers lost", _fault(Drop(), for_s=_LASTING), start=_NOBODY, running=_SILENT, after="clear", model=_MX),
    _row(
        "one motor silent",
        _fault(Silence(motors=(1,)), for_s=_LASTING),
        running=_ONE,
        after="clear",
        model=_MX,
        **_ALONE,
    ),
    _row(
        "requests lost",
        _fault(Drop(sender="host"), for_s=_LASTING),
        start=_NOBODY,
        running=_SILENT,
        after="clear",
        opens=False,
        model=_MX,
    ),
    _row("one checksum wrong", _fault(Corrupt(where="check")), model=_MX),
    _row(
        "checksums wrong",
        _fault(Corrupt(where="check"), for_s=_LASTING),
        start=_DAMAGED,
        running=_SILENT,
        after="clear",
        model=_MX,
    ),
    *(
        _row(f"an answer says: {error}", _fault(ErrorStatus(error=bit)), start=None, model=_MX)
        for bit, error in ((0x02, "angle limit"), (0x08, "range"), (0x10, "checksum"), (0x40, "instruction"))
    ),
    _row("an adapter that echoes", _fault(Echo(), for_s=_LASTING), model=_MX),
    _row(
        "adapter unplugged",
        _fault(Unplug(), for_s=_LASTING),
        start=refuses("BusError", "unplugged"),
        running=holds("hand_bus_lost", 0.02),
        after="clear",
        opens=False,
        model=_MX,
    ),
    _row(
        "the hand process stands still for 0.3 s",
        HandStall(0.3),
        start=None,
        running=_SILENT,
        after="clear",
        opens=False,
        model=_MX,
    ),
    _row(
        "overload",
        _fault(HardwareError(motors=(1,))),
        start=refuses("DeviceError", "hardware error: overload"),
        running=lets_go("hand_overloaded", 0.03),
        let_go=(0,),
        after="restart",
        model=_MX,
    ),
    _row(
        "above the temperature limit",
        _fault(Temperature(motors=(2,), celsius=85.0)),
        start=None,
        running=lets_go("hand_overheated", 0.03),
        let_go=(1,),
        after="restart",
        model=_MX,
    ),
    _row(
        "one motor restarts",
        _fault(Reboot(motors=(1,))),
        running=lets_go("hand_motor_silent", then="hand_restarted"),
        let_go=(0,),
        after="open",
        model=_MX,
        **_ALONE,
    ),
    _row(
        "torque switched off by another program",
        _set("torque_enable", 0, (1,)),
        start=None,
        squeezing=GOES_ON,
        holding=lets_go("hand_restarted", 0.03),
        let_go=(0,),
        after="open",
        model=_MX,
    ),
    _row(
        "a position that jumps by a millimetre",
        _fault(EncoderJump(motors=(1,), ticks=62)),
        start=None,
        running=lets_go("hand_position_jump", 0.03),
        let_go=(0,),
        after="restart",
        model=_MX,
    ),
    # --- protocol 2.0 of motors that tell their load
    _row("answers lost", _fault(Drop(), for_s=_LASTING), start=_NOBODY, running=_SILENT, after="clear", model=_XL),
    _row(
        "requests lost",
        _fault(Drop(sender="host"), for_s=_LASTING),
        start=_NOBODY,
        running=slackens("hand_silent"),
        after="clear",
        opens=False,
        model=_XL,
    ),
    _row(
        "overload",
        _fault(HardwareError(motors=(1,))),
        start=refuses("DeviceError", "hardware error: overload"),
        running=lets_go("hand_overloaded", 0.02),
        let_go=(0,),
        after="restart",
        model=_XL,
    ),
    _row(
        "one motor restarts",
        _fault(Reboot(motors=(1,))),
        running=lets_go("hand_motor_silent", then="hand_restarted"),
        let_go=(0,),
        after="open",
        model=_XL,
        **_ALONE,
    ),
    _row("a false peak of load", _fault(EffortError(motors=(1,), counts=900), for_s=0.004), start=None, model=_XL),
)

ADVICE = {
    "hand_silent": ("No fresh sample", "serial line"),
    "hand_motor_silent": ("One tendon motor does not answer", "plug"),
    "hand_bus_lost": ("serial line of the tendon motors is gone", "plug"),
    "hand_overloaded": ("may have been dropped", "--reboot"),
    "hand_overheated": ("may have been dropped", "cool"),
    "hand_torque_lost": ("may have been dropped", "Secure the object"),
    "hand_restarted": ("may have been dropped", "`hand.open`"),
    "hand_position_jump": ("may have been dropped", "`hand.open`"),
    "hand_voltage": ("supply voltage", "supply and its cable"),
    "hand_hardware": ("hardware error", "error bits"),
    "hand_not_following": ("not where it was wound to", "`hand.open`"),
    "hand_hot": ("load cap is lowered", "rest"),
}
"""Words that the message and the help of each fault must hold."""


if __name__ == "__main__":
    tell(BEGIN, END, matrix(CASES))
