"""What a command does to the cycle's state: each kind one method, each answer a `Reason`.

Commands were validated in the front; here only what depends on the present state can refuse them. Nothing here waits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from controller.cycle.arm_motion import ArmMotion
from controller.cycle.arm_supervision import tells_more
from controller.cycle.grasp_state import ArmState, GraspEvent, GraspPhase
from controller.cycle.grasping import Grasping
from controller.cycle.outcome import Outcome
from controller.cycle.safety import HAND_REASONS
from controller.messages import CommandKind, CompensationIndex, CycleCommand, EventKind, HandState, Reason
from controller.pose import Pose

REACHED_M = 1e-3
"""A wrist that is commanded nearer than this to where it was wanted has got there; well followed it is micrometres."""


class Orders:
    """Carries out commands on the arm's motion and the grasp."""

    def __init__(self, motion: ArmMotion, grasping: Grasping) -> None:
        self._motion = motion
        self._grasping = grasping
        self._arm_token = 0
        self._arm_event: GraspEvent | None = None
        self.stopping = False
        self.shutting_down = False
        self.compensation = True
        self.fault = Reason.NONE
        self.arm_state = ArmState.OFFLINE
        self.hand: HandState | None = None
        self.hand_fault = Reason.NONE
        """What is wrong with the tendon motors now."""
        self._carry_out = {
            CommandKind.STOP: self._stop,
            CommandKind.FAULT_CLEAR: self._clear_fault,
            CommandKind.SHUTDOWN: self._shut_down,
            CommandKind.ARM_HOLD: self._hold_arm,
            CommandKind.MOVE_JOINTS: self._move_joints,
            CommandKind.MOVE_WRIST: self._move_wrist,
            CommandKind.PREPOSITION: self._preposition,
            CommandKind.CLOSE: self._close,
            CommandKind.SQUEEZE: self._squeeze,
            CommandKind.HOLD: self._hold,
            CommandKind.RELEASE: self._release,
            CommandKind.OPEN: self._open,
            CommandKind.SET_COMPENSATION: self._set_compensation,
        }

    def take(self, command: CycleCommand) -> Reason:
        """Carry out or refuse; a refused command changes nothing."""
        return self._carry_out[command.kind](command)

    def finish_arm_path(self) -> None:
        """To be called when a path has come to its end or to rest: completes or fails the command behind it."""
        token, event = self._arm_token, self._arm_event
        self._arm_token, self._arm_event = 0, None
        reason = self._path_outcome()
        self.stopping = False
        if event is GraspEvent.CARRIED or (event is GraspEvent.PREPOSITIONED and reason is Reason.NONE):
            self._grasping.enter(event)
        if token:
            kind = EventKind.COMPLETED if reason is Reason.NONE else EventKind.FAILED
            self._grasping.outcomes.append(Outcome(kind, token, reason))

    def _path_outcome(self) -> Reason:
        if self.stopping:
            return self.fault or Reason.STOPPED_BY_COMMAND
        return Reason.UNREACHABLE if self._motion.wrist_error_m > REACHED_M else Reason.NONE

    def fail(self, reason: Reason, values: tuple[float, ...] = ()) -> None:
        """A fault: the arm stops along its path, the hand keeps the object. Told if it tells more than what stands."""
        if not tells_more(reason, self.fault):
            return
        self._fail(reason, values)

    def fail_hand(self, reason: Reason) -> None:
        """A fault of the hand that was not told yet: the same. A fault of the arm keeps its name beside it, as it needs
        more to recover from."""
        if self.fault in HAND_REASONS:
            self._fail(reason, ())
        else:
            self._grasping.outcomes.append(Outcome(EventKind.FAULT, 0, reason))

    def _fail(self, reason: Reason, values: tuple[float, ...]) -> None:
        first = self.fault is Reason.NONE
        self.fault = reason
        self._grasping.outcomes.append(Outcome(EventKind.FAULT, 0, reason, values))
        if first:  # later the operator may be letting trapped fingers go
            self.stopping = self._motion.moving
            self._grasping.fail(reason)

    def drop_arm_path(self, reason: Reason) -> None:
        """The arm is no longer ours to move: whatever was under way has failed."""
        if self._arm_token:
            self._grasping.outcomes.append(Outcome(EventKind.FAILED, self._arm_token, reason))
        self._arm_token, self._arm_event, self.stopping = 0, None, False

    def _stop(self, command: CycleCommand) -> Reason:
        self.stopping = self._motion.moving
        self._grasping.stop()
        return self._done(command)

    def _clear_fault(self, command: CycleCommand) -> Reason:
        self.fault = Reason.NONE
        self._grasping.clear_fault()
        return self._done(command)

    def _shut_down(self, command: CycleCommand) -> Reason:
        self.shutting_down = True
        self.stopping = self._motion.moving
        return self._done(command)

    def _hold_arm(self, command: CycleCommand) -> Reason:
        self.stopping = self._motion.moving
        return self._done(command)

    def _move_joints(self, command: CycleCommand) -> Reason:
        if self._grasping.compensated:
            return Reason.WRONG_PHASE
        if (reason := self._ready_to_move()) is not Reason.NONE:
            return reason
        self._grasping.enter(GraspEvent.WITHDRAWN)
        self._motion.move_joints(np.array(command.values[:7]), command.values[7])
        self._arm_token = command.token
        return Reason.NONE

    def _move_wrist(self, command: CycleCommand) -> Reason:
        phase = self._grasping.phase
        if self._grasping.compensated and phase is not GraspPhase.HOLDING:
            return Reason.WRONG_PHASE
        if (reason := self._ready_to_move()) is not Reason.NONE:
            return reason
        if phase is GraspPhase.HOLDING:
            self._grasping.enter(GraspEvent.CARRY)
            self._arm_event = GraspEvent.CARRIED
        else:
            self._grasping.enter(GraspEvent.WITHDRAWN)
        self._motion.move_wrist(_pose(command), command.values[7])
        self._arm_token = command.token
        return Reason.NONE

    def _preposition(self, command: CycleCommand) -> Reason:
        if self._grasping.table is None:
            return Reason.NO_TABLE
        if self._grasping.compensated:
            return Reason.WRONG_PHASE
        if (reason := self._ready_to_move()) is not Reason.NONE:
            return reason
        self._motion.move_wrist(_pose(command), command.values[7])
        arrives = command.values[8] != 0.0
        self._grasping.enter(GraspEvent.WITHDRAWN)
        self._arm_token, self._arm_event = command.token, GraspEvent.PREPOSITIONED if arrives else None
        return Reason.NONE

    def _close(self, command: CycleCommand) -> Reason:
        if (reason := self._ready_to_move()) is not Reason.NONE:
            return reason
        if self.hand is None:
            return Reason.HAND_SILENT
        if self.hand_fault is not Reason.NONE:
            return self.hand_fault
        rate_m_s = command.values[0] if command.values else None
        return self._grasping.close(command.token, self.hand, rate_m_s)

    def _squeeze(self, command: CycleCommand) -> Reason:
        if self.fault is not Reason.NONE:
            return self.fault
        excursion_m, load_N, duration_s = command.values[:3]
        return self._grasping.squeeze(command.token, excursion_m, load_N, duration_s)

    def _hold(self, command: CycleCommand) -> Reason:
        reason = self._grasping.hold()
        return reason if reason is not Reason.NONE else self._done(command)

    def _release(self, command: CycleCommand) -> Reason:
        return self._grasping.release(command.token)

    def _open(self, command: CycleCommand) -> Reason:
        """As release where something is gripped; else the hand process pays out what it holds."""
        if self._grasping.compensated:
            return self._grasping.release(command.token)
        self._grasping.open(command.token)
        return Reason.NONE

    def _set_compensation(self, command: CycleCommand) -> Reason:
        """Only while nothing is gripped: a change under load would move the object."""
        if self._grasping.compensated:
            return Reason.WRONG_PHASE
        self.compensation = command.values[0] != 0.0
        self._grasping.index_kind = CompensationIndex(int(command.values[1]))
        return self._done(command)

    def _ready_to_move(self) -> Reason:
        if self.fault is not Reason.NONE:
            return self.fault
        if self.arm_state is not ArmState.ACTIVE:
            return Reason.ARM_NOT_ACTIVE
        return Reason.BUSY if self._motion.moving or self.shutting_down else Reason.NONE

    def _done(self, command: CycleCommand) -> Reason:
        self._grasping.outcomes.append(Outcome(EventKind.COMPLETED, command.token))
        return Reason.NONE


def _pose(command: CycleCommand) -> NDArray[np.float64]:
    x, y, z, *quaternion = command.values[:7]
    return Pose((x, y, z), (quaternion[0], quaternion[1], quaternion[2], quaternion[3])).matrix()
