"""Each `Reason` in words: a stable code for programs, what happened, and what to do about it."""

from __future__ import annotations

from typing import Final, NamedTuple

from controller.messages import Reason
from drivers.errors import CommandError
from drivers.wam.fault_table import ARM_FAULTS, ArmFault

ARM_REASONS: Final[dict[ArmFault, Reason]] = {
    ArmFault.ESTOP: Reason.ARM_ESTOP,
    ArmFault.ARM_IDLED: Reason.ARM_IDLED,
    ArmFault.VELOCITY: Reason.ARM_VELOCITY,
    ArmFault.TORQUE: Reason.ARM_TORQUE,
    ArmFault.VOLTAGE: Reason.ARM_VOLTAGE,
    ArmFault.HEARTBEAT: Reason.ARM_HEARTBEAT,
    ArmFault.SAFETY_SILENT: Reason.SAFETY_SILENT,
    ArmFault.ARM_SILENT: Reason.ARM_SILENT,
    ArmFault.PUCK_RESET: Reason.PUCK_RESET,
    ArmFault.ZERO_LOST: Reason.ZERO_LOST,
    ArmFault.POSITION_JUMP: Reason.POSITION_JUMP,
    ArmFault.MOTOR_IDLE: Reason.MOTOR_IDLE,
    ArmFault.MODE_RAISED: Reason.MODE_RAISED,
    ArmFault.FOREIGN_TORQUE: Reason.FOREIGN_TORQUE,
    ArmFault.STALE_FLOOD: Reason.STALE_FLOOD,
    ArmFault.MALFORMED_FLOOD: Reason.MALFORMED_FLOOD,
    ArmFault.ERROR_FRAMES: Reason.BUS_ERRORS,
    ArmFault.BUS_OFF: Reason.BUS_OFF,
    ArmFault.QUEUE_FULL: Reason.QUEUE_FULL,
    ArmFault.ADAPTER_GONE: Reason.ADAPTER_GONE,
    ArmFault.BUS_FAILED: Reason.BUS_FAILED,
}
"""What the cycle and its clients call each fault of the arm."""


class Explanation(NamedTuple):
    """Why something was refused, failed or stopped."""

    code: str
    message: str
    help: str


EXPLANATIONS: Final[dict[Reason, Explanation]] = {
    Reason.NONE: Explanation("none", "Nothing is wrong.", ""),
    Reason.ARM_NOT_ACTIVE: Explanation(
        "arm_not_active", "The arm is not active.", "Press Shift-Idle, then Shift-Activate on the pendant."
    ),
    Reason.WRONG_PHASE: Explanation(
        "wrong_phase", "The grasp's present phase does not allow this.", "See grasp.phase in `status`."
    ),
    Reason.BUSY: Explanation("busy", "A motion is under way.", "Wait for its completion, or send `stop` first."),
    Reason.NO_TABLE: Explanation("no_table", "No motion table is loaded.", "Send `table.load` first."),
    Reason.OUTSIDE_TABLE: Explanation(
        "outside_table",
        "The motion table does not reach that far.",
        "Ask for less load, or build the table further; nothing is extrapolated.",
    ),
    Reason.LOAD_ABOVE_CAP: Explanation(
        "load_above_cap", "The load is above the load cap.", "Stay below squeeze.load_cap_N of robot.toml."
    ),
    Reason.UNREACHABLE: Explanation(
        "unreachable",
        "The wrist did not get to that pose: a joint's range or a singularity is in the way.",
        "The arm holds where it got to. Choose another pose, or move the joints first.",
    ),
    Reason.SUPERSEDED: Explanation("superseded", "A later command took its place.", ""),
    Reason.STOPPED_BY_COMMAND: Explanation("stopped", "It was stopped by a command.", ""),
    Reason.NO_CONTACT: Explanation(
        "no_contact",
        "The fingers closed without touching anything.",
        "Check where the object is; the hand opened again.",
    ),
    Reason.ONE_SIDED_CONTACT: Explanation(
        "one_sided_contact", "Only one finger touched.", "The object stands off the hand's axis; the hand opened again."
    ),
    Reason.CONTACT_UNEXPECTED: Explanation(
        "contact_unexpected",
        "A finger touched long before the motion table expects it.",
        "Another object, or another place, than the table is for; the hand opened again.",
    ),
    Reason.LOAD_CAP_REACHED: Explanation(
        "load_cap_reached", "A tendon came to its load cap first; both stopped.", "The excursion reached is reported."
    ),
    Reason.TABLE_END_REACHED: Explanation(
        "table_end_reached", "The motion table's end came first; both tendons stopped.", "The excursion is reported."
    ),
    Reason.WOUND_SHORT: Explanation(
        "wound_short",
        "The motors have wound less than they were told to.",
        "The excursion reached is reported. A low supply, or a position loop weaker than tendons.right/left say.",
    ),
    Reason.OFF_CENTRE: Explanation(
        "off_centre",
        "One finger touched well before the other and pushed the object.",
        "The object stood object_offset_m off the hand's axis: the motion before its grip was not compensated.",
    ),
    Reason.HAND_NOT_OPEN: Explanation(
        "hand_not_open",
        "The hand was told to open and got no nearer to it.",
        "A finger is stuck, or a tendon motor let go: see hand in `status`.",
    ),
    Reason.TRACKING_ERROR: Explanation(
        "tracking_error",
        "A joint is too far from where it was commanded.",
        "Something blocks the arm, or the gains are low.",
    ),
    Reason.COLLISION: Explanation(
        "collision",
        "Joint torques are beyond what the model explains: a collision.",
        "Free the arm, then `fault.clear`.",
    ),
    Reason.OFFSET_LIMIT: Explanation(
        "offset_limit", "The compensating offset would exceed its limit.", "Check table and hand against each other."
    ),
    Reason.OFFSET_LAG: Explanation(
        "offset_lag", "The compensating offset cannot keep up.", "Squeeze more slowly, or raise compensation limits."
    ),
    Reason.HAND_SILENT: Explanation(
        "hand_silent",
        "No fresh sample of the tendon motors: what they hold is not known.",
        "Check the hand's power and serial line.",
    ),
    Reason.HAND_HARDWARE: Explanation(
        "hand_hardware", "A tendon motor reports a hardware error.", "Read its error bits."
    ),
    Reason.HAND_TORQUE_LOST: Explanation(
        "hand_torque_lost",
        "A tendon motor let go: the object may have been dropped.",
        "Secure the object before rebooting the motor.",
    ),
    Reason.HAND_REFUSED: Explanation(
        "hand_refused",
        "A set-point is beyond a tendon motor's travel or current limit.",
        "Check zero, travel and load cap of the tendon motors.",
    ),
    Reason.HAND_BUS_LOST: Explanation(
        "hand_bus_lost",
        "The serial line of the tendon motors is gone. They hold what they hold.",
        "Check the adapter's plug (a path in /dev/serial/by-id stays the same); the motors are then taken up again.",
    ),
    Reason.HAND_OVERHEATED: Explanation(
        "hand_overheated",
        "A tendon motor was too hot and let go: the object may have been dropped.",
        "Secure the object and let the motor cool; then `stillgrasp calibrate motors --reboot ID`.",
    ),
    Reason.HAND_OVERLOADED: Explanation(
        "hand_overloaded",
        "A tendon motor was overloaded and let go: the object may have been dropped.",
        "Secure the object, lower the load cap or the holding cap; then `stillgrasp calibrate motors --reboot ID`.",
    ),
    Reason.HAND_VOLTAGE: Explanation(
        "hand_voltage",
        "The supply voltage of a tendon motor is out of its range.",
        "Check the hand's supply and its cable.",
    ),
    Reason.HAND_RESTARTED: Explanation(
        "hand_restarted",
        "A tendon motor lost its supply for a moment and let go: the object may have been dropped.",
        "Check plug and supply; secure the object, then `hand.open`: it brings the motor up again.",
    ),
    Reason.HAND_OTHER_MODE: Explanation(
        "hand_other_mode",
        "A tendon motor was found holding in a mode, or with a direction or zero, in which it cannot be driven; it is "
        "left holding and takes no set-points.",
        "`status` says what it is. `hand.open`, or secure the object; then switch the motors off and restart the "
        "daemon.",
    ),
    Reason.HAND_OUTSIDE_TURN: Explanation(
        "hand_outside_turn",
        "A tendon was let out or pulled in beyond the one turn in which its motor knows its place; it is led back.",
        "Bring the spool back by hand if it stays there; clamp it so that all of its travel lies within the turn.",
    ),
    Reason.HAND_MOTOR_SILENT: Explanation(
        "hand_motor_silent",
        "One tendon motor does not answer. Without supply it has let go: the object may have been dropped.",
        "Secure the object; check that motor's plug and cable.",
    ),
    Reason.HAND_POSITION_JUMP: Explanation(
        "hand_position_jump",
        "The position of a tendon motor is all at once somewhere else, and stays there: its encoder failed, or its "
        "spool slipped. Its loop has pulled or let out tendon by as much: the object may have been dropped.",
        "Secure the object, then `hand.open`; restart the daemon, and calibrate zero_ticks again or replace the motor.",
    ),
    Reason.HAND_NOT_FOLLOWING: Explanation(
        "hand_not_following",
        "A spool is not where it was wound to: its encoder is stuck, its motor has no gain, or another program drives "
        "it. Where the object is in the hand is not known.",
        "Secure the object, then `hand.open`; stop other programs on the motors' bus, and restart the daemon.",
    ),
    Reason.HAND_HOT: Explanation(
        "hand_hot",
        "A tendon motor is hot: its load cap is lowered, so that it does not let go.",
        "Put the object down soon and let the hand rest; see hand.temperature_C and hand.derating in `status`.",
    ),
    Reason.ARM_NOT_READY: Explanation(
        "arm_not_ready",
        "The arm could not be started again; the operator was told why.",
        "Do what the message says, then send `fault.clear` again.",
    ),
} | {
    reason: Explanation(
        fault.value, f"{ARM_FAULTS[fault].cause} {ARM_FAULTS[fault].arm_does}", ARM_FAULTS[fault].operator
    )
    for fault, reason in ARM_REASONS.items()
}


def as_error(reason: Reason) -> CommandError:
    """The reason as the error of a refused or failed command."""
    explanation = EXPLANATIONS[reason]
    return CommandError(explanation.code, explanation.message, help=explanation.help)


def named_values(reason: Reason, values: tuple[float, ...]) -> dict[str, float]:
    """The values of a fault by name; nodes are written as the digits of a number."""
    fault = _FAULTS.get(reason)
    return dict(zip(ARM_FAULTS[fault].value_names, values, strict=False)) if fault is not None else {}


_FAULTS: Final = {reason: fault for fault, reason in ARM_REASONS.items()}
