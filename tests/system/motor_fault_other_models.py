"""The fault matrix's rows of other models than the XM430: where protocol or load make a difference.

Times and phases as in `motor_fault_cases.py`.
"""

from __future__ import annotations

from drivers.simulated.serial_fault_actions import (
    Corrupt,
    Drop,
    Echo,
    EffortError,
    EncoderJump,
    ErrorStatus,
    HardwareError,
    Reboot,
    Silence,
    Temperature,
    Unplug,
)
from tests.system.motor_fault_matrix import (
    GOES_ON,
    Case,
    holds,
    lets_go,
    refuses,
    slackens,
)
from tests.system.motor_fault_rig import HandStall
from tests.system.motor_fault_rows import (
    ALONE,
    DAMAGED,
    LASTING,
    MX,
    NOBODY,
    ONE_SILENT,
    SILENT,
    XL,
    fault,
    row,
    setting,
)

OTHER_MODELS: tuple[Case, ...] = (
    # --- protocol 1.0: no watchdog, alarms in the error byte, one read a motor
    row("one answer lost", fault(Drop()), model=MX),
    row("answers lost", fault(Drop(), for_s=LASTING), start=NOBODY, running=SILENT, after="clear", model=MX),
    row(
        "one motor silent",
        fault(Silence(motors=(1,)), for_s=LASTING),
        running=ONE_SILENT,
        after="clear",
        model=MX,
        **ALONE,
    ),
    row(
        "requests lost",
        fault(Drop(sender="host"), for_s=LASTING),
        start=NOBODY,
        running=SILENT,
        after="clear",
        opens=False,
        model=MX,
    ),
    row("one checksum wrong", fault(Corrupt(where="check")), model=MX),
    row(
        "checksums wrong",
        fault(Corrupt(where="check"), for_s=LASTING),
        start=DAMAGED,
        running=SILENT,
        after="clear",
        model=MX,
    ),
    *(
        row(f"an answer says: {error}", fault(ErrorStatus(error=bit)), start=None, model=MX)
        for bit, error in ((0x02, "angle limit"), (0x08, "range"), (0x10, "checksum"), (0x40, "instruction"))
    ),
    row("an adapter that echoes", fault(Echo(), for_s=LASTING), model=MX),
    row(
        "adapter unplugged",
        fault(Unplug(), for_s=LASTING),
        start=refuses("BusError", "unplugged"),
        running=holds("hand_bus_lost", 0.02),
        after="clear",
        opens=False,
        model=MX,
    ),
    row(
        "the hand process stands still for 0.3 s",
        HandStall(0.3),
        start=None,
        running=SILENT,
        after="clear",
        opens=False,
        model=MX,
    ),
    row(
        "overload",
        fault(HardwareError(motors=(1,))),
        start=refuses("DeviceError", "hardware error: overload"),
        running=lets_go("hand_overloaded", 0.03),
        let_go=(0,),
        after="restart",
        model=MX,
    ),
    row(
        "above the temperature limit",
        fault(Temperature(motors=(2,), celsius=85.0)),
        start=None,
        running=lets_go("hand_overheated", 0.03),
        let_go=(1,),
        after="restart",
        model=MX,
    ),
    row(
        "one motor restarts",
        fault(Reboot(motors=(1,))),
        running=lets_go("hand_motor_silent", then="hand_restarted"),
        let_go=(0,),
        after="open",
        model=MX,
        **ALONE,
    ),
    row(
        "torque switched off by another program",
        setting("torque_enable", 0, (1,)),
        start=None,
        squeezing=GOES_ON,
        holding=lets_go("hand_restarted", 0.03),
        let_go=(0,),
        after="open",
        model=MX,
    ),
    row(
        "a position that jumps by a millimetre",
        fault(EncoderJump(motors=(1,), ticks=62)),
        start=None,
        running=lets_go("hand_position_jump", 0.03),
        let_go=(0,),
        after="restart",
        model=MX,
    ),
    # --- protocol 2.0 of motors that tell their load
    row("answers lost", fault(Drop(), for_s=LASTING), start=NOBODY, running=SILENT, after="clear", model=XL),
    row(
        "requests lost",
        fault(Drop(sender="host"), for_s=LASTING),
        start=NOBODY,
        running=slackens("hand_silent"),
        after="clear",
        opens=False,
        model=XL,
    ),
    row(
        "overload",
        fault(HardwareError(motors=(1,))),
        start=refuses("DeviceError", "hardware error: overload"),
        running=lets_go("hand_overloaded", 0.02),
        let_go=(0,),
        after="restart",
        model=XL,
    ),
    row(
        "one motor restarts",
        fault(Reboot(motors=(1,))),
        running=lets_go("hand_motor_silent", then="hand_restarted"),
        let_go=(0,),
        after="open",
        model=XL,
        **ALONE,
    ),
    row("a false peak of load", fault(EffortError(motors=(1,), counts=900), for_s=0.004), start=None, model=XL),
)
