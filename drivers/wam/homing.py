"""Makes the positions of an idle, woken arm right: those that the pucks remember, or zeroing in the home pose.

Positions survive idle and restarts of the program; they are lost with the pucks' power, and then also where the safety
puck's ZERO should still be 1. Writing P looks like a jump to the safety puck, so IFAULT comes first, and one reading
lets it see the new positions before ZERO = 1. Joint angles in rad (DH), motor positions in counts.
Source: WAM reference 0.7, 4.2, 4.4; 8.4 on ZERO.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drivers.clock import nanoseconds
from drivers.errors import DeviceError, NoReplyError, ProtocolError
from drivers.wam.dialogue import STATUS_ID, Dialogue
from drivers.wam.discovery import MOTOR_NODES
from drivers.wam.frames import is_position, parse_position, position_request
from drivers.wam.motor_settings import MotorSettings
from drivers.wam.parameters import JOINTS, WamParameters
from drivers.wam.properties import property_id
from drivers.wam.safety_puck import SafetyPuck
from drivers.wam.transmission import joint_to_motor, motor_to_joint
from drivers.wam.zeroing import ZeroingPlan, plan_zeroing

VELOCITY_SAMPLES_IGNORED = 5
_READING_S = 0.05
_READINGS = 3
_BEYOND_LIMIT_RAD = 0.3
"""How far a remembered joint angle may lie outside its range: home does, and joints give way."""
_AT_HOME_RAD = 0.1
"""How far a joint may be from home for an arm that lost some of its positions to be zeroed there."""
_MOVED_TURN = 1 / 128
"""Share of a motor turn that an arm which stands by itself may move while it is zeroed."""
_DOUBTFUL_TURN = 0.45
"""Share of a motor turn from which its correction might as well be one in the other direction."""


@dataclass(frozen=True)
class Positions:
    """What the motors report once their positions are right, and how they came to be."""

    counts: tuple[int, ...]
    """P of motors 1 to 7."""
    plan: ZeroingPlan | None
    """The zeroing that was done; None where positions were remembered."""


class Homing:
    """Positions of one arm whose settings are known."""

    def __init__(
        self, dialogue: Dialogue, parameters: WamParameters, safety: SafetyPuck, motors: MotorSettings
    ) -> None:
        self._dialogue, self._parameters, self._safety, self._motors = dialogue, parameters, safety, motors

    def restore(self, woken: tuple[int, ...], announce: Callable[[str], None]) -> Positions:
        """Keep the positions, or zero the arm where it stands, which `announce` says beforehand.

        `woken`: nodes that had to be woken, and so lost theirs. Raises NoReplyError for silent pucks, DeviceError
        for an arm that is not at home though it should be, or does not take its positions.
        """
        remembered = self._safety.get("ZERO") == 1
        self._ignore_velocity()
        if remembered and not woken:
            counts = self.read_agreeing_positions()
            self._require_possible(counts)
            return Positions(counts, None)
        if remembered and len(woken) < JOINTS:
            self._require_home(woken)
        plan = self.plan()
        announce(self._announcement(plan))
        return self.zero(plan)

    def zero(self, plan: ZeroingPlan) -> Positions:
        """Carry out `plan`, whatever the pucks remember. Errors as of `restore`."""
        self._ignore_velocity()
        counts = self._write(plan)
        self._ignore_velocity()
        return Positions(counts, plan)

    def _ignore_velocity(self) -> None:
        """Keep the safety puck from taking motion before start-up, or the jump of zeroing, for a velocity fault."""
        for _ in range(2):
            self._safety.set("IFAULT", VELOCITY_SAMPLES_IGNORED)
            if self._safety.get("IFAULT") > 0:  # it counts down with every reading of positions, whoever asks
                return

    def plan(self) -> ZeroingPlan:
        """How the arm would be zeroed where it stands. DeviceError if an absolute encoder doubts that it is home."""
        parameters, motors = self._parameters, self._motors
        mechanical = read_mechanical_counts(self._dialogue, motors)
        plan = plan_zeroing(parameters.home_rad, motors.counts_per_turn, parameters.zero_angle_rad, mechanical)
        turns = np.abs(plan.motor_error_rad) / (2.0 * np.pi)
        doubtful = [motor for motor in plan.corrected if turns[motor - 1] > _DOUBTFUL_TURN]
        if doubtful:
            raise DeviceError(
                "WAM",
                f"motors {doubtful} stand almost half a turn from their calibrated place in home; expected less than "
                f"{_DOUBTFUL_TURN} of a turn.",
                help="Place the arm closer to home and start again; after a repair run 'stillgrasp calibrate zero'.",
            )
        return plan

    def _announcement(self, plan: ZeroingPlan) -> str:
        angles = " ".join(f"{angle:.3f}" for angle in self._parameters.home_rad)
        how = f", corrected by the absolute encoders of motors {list(plan.corrected)}" if plan.corrected else ""
        return (
            f"The arm's positions are lost: the pose in which it stands is taken for home ({angles} rad){how}. If it "
            "is not there, do not activate it: press E-stop, place it in home, release, press Shift+Idle, start again."
        )

    def _write(self, plan: ZeroingPlan) -> tuple[int, ...]:
        self._safety.write("ZERO", 0)  # the tip's speed means nothing while positions are exchanged
        motors, wrong = self._motors, list(MOTOR_NODES)
        counts: tuple[int, ...] = ()
        # A counter that differs at all may have missed its order; one that differs again has moved with the arm.
        for tolerated_turn in (0.0, _MOVED_TURN):
            for node in wrong:
                self._dialogue.tell(node, motors.position_id, plan.motor_counts[node - 1])
                self._dialogue.ask(node, STATUS_ID, "STAT")  # not to overflow the puck's receive buffer
            # This reading lets the safety puck see the new positions while it ignores the jump.
            counts = self.read_positions()
            wrong = [
                node
                for node, found, wanted, turn in zip(
                    MOTOR_NODES, counts, plan.motor_counts, motors.counts_per_turn, strict=True
                )
                if abs(found - wanted) > tolerated_turn * turn
            ]
            if not wrong:
                break
        else:
            raise DeviceError(
                "WAM",
                f"pucks {wrong} do not take the positions of home, or the arm is moving.",
                help="Hold the arm still and start again.",
            )
        self._safety.write("ZERO", 1)
        return counts

    def _require_home(self, woken: tuple[int, ...]) -> None:
        """An arm that lost some positions is zeroed only if the others say that it stands at home."""
        counts = self.read_agreeing_positions()
        home_motor_rad = joint_to_motor(self._parameters.home_rad)
        reach = np.abs(joint_to_motor(np.eye(JOINTS))).sum(axis=1) * _AT_HOME_RAD
        for node in set(MOTOR_NODES) - set(woken):
            angle_rad = counts[node - 1] * 2.0 * np.pi / self._motors.counts_per_turn[node - 1]
            if abs(angle_rad - home_motor_rad[node - 1]) > reach[node - 1]:
                raise DeviceError(
                    "WAM",
                    f"pucks {list(woken)} lost their positions, and motor {node}, which did not, is not at home.",
                    help="Place the arm in its home pose by hand and start again.",
                )

    def _require_possible(self, counts: tuple[int, ...]) -> None:
        """What the pucks remember is a pose that the arm can have."""
        parameters = self._parameters
        joint_rad = motor_to_joint(np.array(counts) * 2.0 * np.pi / np.array(self._motors.counts_per_turn))
        beyond = np.maximum(parameters.joint_lower_rad - joint_rad, joint_rad - parameters.joint_upper_rad)
        if beyond.max() > _BEYOND_LIMIT_RAD:
            joint = int(beyond.argmax())
            raise DeviceError(
                "WAM",
                f"by what its pucks remember, joint {joint + 1} stands at {joint_rad[joint]:.2f} rad; that is outside "
                f"its range of {parameters.joint_lower_rad[joint]:.2f} to {parameters.joint_upper_rad[joint]:.2f} rad.",
                help="Somebody wrote P. Press E-stop and release it, place the arm in its home pose and start again.",
            )

    def read_agreeing_positions(self) -> tuple[int, ...]:
        """P of all seven, confirmed by a second reading: all later ones are judged by it. DeviceError if none agree."""
        counts = self.read_positions()
        for _ in range(_READINGS):
            before, counts = counts, self.read_positions()
            apart = [abs(one - other) * 4 for one, other in zip(before, counts, strict=True)]
            if all(far <= turn for far, turn in zip(apart, self._motors.counts_per_turn, strict=True)):
                return counts
        wrong = [
            node for node, far, turn in zip(MOTOR_NODES, apart, self._motors.counts_per_turn, strict=True) if far > turn
        ]
        raise DeviceError(
            "WAM",
            f"the positions of pucks {wrong} jump by more than a quarter motor turn while the arm stands.",
            help="Hold the arm still and start again; if it stays so, have the encoders checked.",
        )

    def read_positions(self) -> tuple[int, ...]:
        """P of all seven, whatever it was before; asked twice. NoReplyError naming those that report none."""
        bus, clock, motors = self._dialogue.bus, self._dialogue.clock, self._motors
        counts: dict[int, int] = {}
        for _ in range(2):
            for group in motors.position_groups:
                bus.send(position_request(group, motors.position_id))
            deadline_ns = clock.now_ns() + nanoseconds(_READING_S)
            while len(counts) < JOINTS and (message := bus.receive(deadline_ns)) is not None:
                if is_position(message):
                    try:
                        position = parse_position(message)
                    except ProtocolError:
                        continue
                    if position.node in MOTOR_NODES:
                        counts[position.node] = position.motor_counts
            if len(counts) == JOINTS:
                return tuple(counts[node] for node in MOTOR_NODES)
        silent = [node for node in MOTOR_NODES if node not in counts]
        raise NoReplyError("WAM", f"pucks {silent} report no position.", help="Check the arm's cables.")


def read_mechanical_counts(dialogue: Dialogue, motors: MotorSettings) -> tuple[int | None, ...]:
    """MECH of each motor with an absolute encoder, None for the others. ProtocolError if one is beyond its turn."""
    counts: list[int | None] = []
    for node, absolute, turn in zip(MOTOR_NODES, motors.absolute_encoder, motors.counts_per_turn, strict=True):
        if not absolute:
            counts.append(None)
            continue
        count = dialogue.ask(node, property_id("MECH", motors.firmware[node - 1], "motor"), "MECH")
        if not 0 <= count < turn:
            raise ProtocolError(
                f"puck {node}", f"MECH is {count}; expected 0 to {turn - 1}.", help="Check the puck and its encoder."
            )
        counts.append(count)
    return tuple(counts)
