"""The fault matrix of the tendon motors: what goes wrong with them or their bus, in which phase, and what is expected.

    python -m tests.system.motor_fault_cases            print the matrix
    python -m tests.system.motor_fault_cases --write    write it into docs/faults.md

`test_motor_faults*.py` hold the robot to it. Times in s from the fault on; motor 1 is the right finger's, 2 the left's.
"Lasting" is longer than anybody watches (`WATCH_S`). What has to happen follows from the dynamixel reference 6 and
design 5 ("A fault keeps the object"); what the operator is told, from `ADVICE`, which is written by hand.
"""

from __future__ import annotations

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
    WAITS,
    Case,
    holds,
    lets_go,
    matrix,
    refuses,
    slackens,
    stops,
    warns,
)
from tests.system.motor_fault_other_models import OTHER_MODELS
from tests.system.motor_fault_rig import HandStall
from tests.system.motor_fault_rows import (
    DAMAGED,
    LASTING,
    NOBODY,
    ONE_SILENT,
    SILENT,
    fault,
    row,
    setting,
)

_XM430: tuple[Case, ...] = (
    # --- packets that are lost
    row("one answer lost", fault(Drop()), closing=GOES_ON, holding=GOES_ON, adoption=STARTS),
    row("three answers lost", fault(Drop(), for_frames=3), start=None),
    row("answers lost for 50 ms", fault(Drop(), for_s=0.05), start=NOBODY, closing=WAITS, holding=GOES_ON),
    row("one motor silent for 30 ms", fault(Silence(motors=(2,)), for_s=0.03), start=None),
    row(
        "answers lost",
        fault(Drop(), for_s=LASTING),
        start=NOBODY,
        open=warns("hand_silent"),
        closing=SILENT,
        running=SILENT,
        adoption=NOBODY,
        after="clear",
    ),
    row(
        "one motor silent",
        fault(Silence(motors=(1,)), for_s=LASTING),
        start=refuses("NoReplyError", "the other motor answers"),
        open=warns("hand_motor_silent"),
        closing=ONE_SILENT,
        running=ONE_SILENT,
        after="clear",
    ),
    row(
        "requests lost",
        fault(Drop(sender="host"), for_s=LASTING),
        start=NOBODY,
        running=slackens("hand_silent"),
        after="clear",
        opens=False,
    ),
    # --- packets with other content
    row("one answer damaged", fault(Corrupt()), adoption=STARTS),
    row(
        "one answer in twenty damaged",
        fault(Corrupt(), for_s=LASTING, chance=0.05),
        closing=GOES_ON,
        holding=GOES_ON,
        adoption=STARTS,
    ),
    row("answers damaged", fault(Corrupt(), for_s=LASTING), start=DAMAGED, running=SILENT, after="clear"),
    row(
        "requests damaged",
        fault(Corrupt(sender="host"), for_s=LASTING),
        start=None,
        running=slackens("hand_silent"),
        after="clear",
        opens=False,
    ),
    row("an answer of another motor", fault(WrongId(id=7))),
    row(
        "answers of one motor name the other",
        fault(WrongId(motor=1, id=2), for_s=LASTING),
        start=refuses("ProtocolError", "reply to ping"),
        running=SILENT,
        after="clear",
    ),
    row("half an answer", fault(Truncate(length=9))),
    row("half answers", fault(Truncate(length=9), for_s=LASTING), start=None, running=SILENT, after="clear"),
    row("other bytes before answers", fault(Garbage(data="00FF13"), for_s=LASTING)),
    row("a header before answers", fault(Garbage(data="FFFFFD00"), for_s=LASTING)),
    row(
        "a flood of other bytes",
        fault(Garbage(data="A5" * 3000), for_s=LASTING),
        start=None,
        running=SILENT,
        after="clear",
    ),
    *(
        row(f"an answer says: {error}", fault(ErrorStatus(error=number)), start=None, holding=None)
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
    row(
        "all answers say: access error",
        fault(ErrorStatus(error=7), for_s=LASTING),
        start=refuses("ProtocolError", "access error"),
        running=SILENT,
        after="clear",
    ),
    # --- the adapter
    row("answers 1 ms late", fault(Late(by_s=0.001), for_s=LASTING), closing=GOES_ON),
    row("one answer later than anybody waits", fault(Late(by_s=0.006))),
    row(
        "answers 16 ms late: a latency timer that was not set",
        fault(Late(by_s=0.016), for_s=LASTING),
        start=refuses("NoReplyError", "no reply to read"),
        running=SILENT,
        after="clear",
    ),
    row("an adapter that echoes", fault(Echo(), for_s=LASTING)),
    row(
        "adapter unplugged",
        fault(Unplug(), for_s=LASTING),
        start=refuses("BusError", "unplugged"),
        open=warns("hand_bus_lost"),
        running=slackens("hand_bus_lost", 0.02),
        after="clear",
        opens=False,
    ),
    row(
        "the hand process stands still for 0.3 s",
        HandStall(0.3),
        start=None,
        running=slackens("hand_silent"),
        after="clear",
        opens=False,
    ),
    # --- hardware errors
    row(
        "overload",
        fault(HardwareError(motors=(1,))),
        start=refuses("DeviceError", "hardware error: overload"),
        open=warns("hand_overloaded"),
        running=lets_go("hand_overloaded", 0.02),
        let_go=(0,),
        after="restart",
    ),
    row(
        "overheating",
        fault(HardwareError(motors=(2,), error="overheating")),
        start=refuses("DeviceError", "hardware error: overheating"),
        running=lets_go("hand_overheated", 0.02),
        let_go=(1,),
        after="restart",
    ),
    row(
        "electrical shock, both",
        fault(HardwareError(error="shock")),
        start=refuses("DeviceError", "hardware error"),
        running=lets_go("hand_torque_lost", 0.02),
        let_go=(0, 1),
        after="restart",
    ),
    row(
        "voltage error",
        fault(HardwareError(motors=(1,), error="voltage")),
        start=None,
        open=warns("hand_voltage"),
        running=holds("hand_voltage", 0.02),
        after="clear",
    ),
    row(
        "encoder error",
        fault(HardwareError(motors=(1,), error="encoder")),
        start=None,
        running=holds("hand_hardware", 0.02),
        after="clear",
    ),
    # --- heat and supply
    row(
        "getting hot",
        *(fault(Temperature(celsius=66.0 + 2.0 * n), 0.02 * n) for n in range(7)),
        start=None,
        squeezing=stops("hand_hot"),
        holding=warns("hand_hot"),
    ),
    row(
        "above the temperature limit",
        fault(Temperature(motors=(2,), celsius=85.0)),
        start=None,
        running=lets_go("hand_overheated", 0.03),
        let_go=(1,),
        after="restart",
    ),
    row(
        "supply sags to 9 V",
        fault(Supply(volts=9.0), for_s=LASTING),
        start=None,
        running=holds("hand_voltage", 0.03),
        after="clear",
    ),
    row(
        "supply gone for 20 ms",
        fault(Supply(volts=4.0), for_s=0.02),
        start=None,
        running=lets_go("hand_silent", then="hand_restarted"),
        let_go=(0, 1),
        after="open",
    ),
    row(
        "supply gone",
        fault(Supply(volts=0.0), for_s=LASTING),
        start=NOBODY,
        running=lets_go("hand_silent"),
        let_go=(0, 1),
        after="open",
    ),
    row(
        "one motor restarts",
        fault(Reboot(motors=(1,))),
        start=refuses("NoReplyError", "the other motor answers"),
        closing=lets_go("hand_motor_silent", then="hand_restarted"),
        running=lets_go("hand_motor_silent", then="hand_restarted"),
        let_go=(0,),
        after="open",
    ),
    row(
        "one motor's plug is out",
        fault(CutOff(motors=(2,)), for_s=LASTING),
        start=refuses("NoReplyError", "the other motor answers"),
        running=lets_go("hand_motor_silent"),
        let_go=(1,),
        after="open",
    ),
    # --- another program on the bus
    row(
        "torque switched off by another program",
        setting("torque_enable", 0, (1,)),
        start=None,
        running=lets_go("hand_torque_lost", 0.02),
        let_go=(0,),
        after="open",
    ),
    row(
        "a goal of another program",
        setting("goal_position", 600, (1,)),
        start=None,
        holding=lets_go("hand_not_following"),
        let_go=(0,),
        after="open",
    ),
    row(
        "a position gain of another program",
        setting("position_p_gain", 0, (1,)),
        start=None,
        running=lets_go("hand_not_following", known_s=0.15),
        let_go=(0,),
        after="restart",
    ),
    row("a ceiling of another program", setting("goal_current", 20, (1,)), start=None, holding=GOES_ON),
    row("the watchdog switched off", setting("bus_watchdog", 0), start=None),
    row("the indirect map overwritten", setting("indirect_address_1", 224, (1,)), start=None),
    row(
        "one motor at another baud rate",
        setting("baud_rate", 1, (2,)),
        start=refuses("NoReplyError", "the other motor answers"),
        running=holds("hand_motor_silent"),
        mend=(setting("baud_rate", 3, (2,)),),
        after="clear",
        opens=False,
    ),
    row(
        "both motors with one id",
        setting("id", 1, (2,)),
        start=refuses("NoReplyError", "the other motor answers"),
        running=holds("hand_motor_silent"),
        mend=(setting("id", 2, (1,)), setting("id", 1, (1,))),
        opens=False,
    ),
    row("return delay back at 500 µs", setting("return_delay_time", 250)),
    # --- sensors
    row(
        "a position that jumps by a millimetre",
        fault(EncoderJump(motors=(1,), ticks=62)),
        start=None,
        open=warns("hand_position_jump"),
        running=lets_go("hand_position_jump", 0.02),
        let_go=(0,),
        after="restart",
    ),
    row(
        "a stuck encoder",
        fault(EncoderStuck(motors=(1,)), for_s=0.8),
        start=None,
        squeezing=lets_go("hand_not_following", known_s=0.4),
        let_go=(0,),
        after="restart",
        watch_s=0.6,
    ),
    row("positions that tremble by 3 ticks", fault(EncoderNoise(ticks=3.0), for_s=LASTING), start=None),
    row("a false peak of current", fault(EffortError(motors=(1,), counts=1000), for_s=0.004), start=None),
    row(
        "false current above the cap",
        fault(EffortError(motors=(1,), counts=1000), for_s=LASTING),
        start=None,
        squeezing=stops(""),
    ),
    row("a current sensor that is stuck", fault(EffortStuck(motors=(1,)), for_s=LASTING), start=None),
)

CASES = (*_XM430, *OTHER_MODELS)

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
