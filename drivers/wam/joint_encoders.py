"""Which joint encoders may tell their joints' angles: fitted, wanted and indexed. Asked once, at start-up.

An optical encoder at the joint knows where it is only after its index has passed; ECMIN and ECMAX are not zero then. An
index that passes later is not noticed before the next start. Source: WAM reference 2.5, 3.2, 5.1.
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.wam.dialogue import Dialogue
from drivers.wam.motor_settings import MotorSettings
from drivers.wam.parameters import WamParameters
from drivers.wam.properties import property_id, property_numbers

_ROLE_JOINT_ENCODER = 0x4000
_ENDS = ("ECMIN", "ECMAX")


@dataclass(frozen=True)
class JointEncoders:
    """Encoders at the joints that tell their angles; tuples in joint order."""

    joints: tuple[int, ...] = ()
    """Joints, 0 to 6."""
    counts_per_turn: tuple[float, ...] = ()
    """Of each of `joints`."""
    notes: tuple[str, ...] = ()
    """What the operator should know of the others."""


def read_joint_encoders(dialogue: Dialogue, motors: MotorSettings, parameters: WamParameters) -> JointEncoders:
    """Ask the pucks that have one; none where the parameters do not want them. NoReplyError for a silent puck."""
    if not parameters.use_joint_encoders:
        return JointEncoders()
    used: list[int] = []
    notes: list[str] = []
    counts = parameters.joint_encoder_counts.tolist()
    for joint, (role, firmware) in enumerate(zip(motors.roles, motors.firmware, strict=True)):
        if not (role & _ROLE_JOINT_ENCODER and counts[joint]):
            continue
        known = property_numbers(firmware, "motor")
        ends = [dialogue.ask(joint + 1, property_id(name, firmware, "motor"), name) for name in _ENDS if name in known]
        if any(ends):
            used.append(joint)
        else:
            notes.append(
                f"the encoder of joint {joint + 1} has not passed its index: the motor's encoder stands in for it; "
                "move the joint through its index and start again to use it"
            )
    return JointEncoders(tuple(used), tuple(counts[joint] for joint in used), tuple(notes))
