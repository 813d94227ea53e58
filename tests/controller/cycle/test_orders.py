"""What each command does to the cycle's state, and what refuses it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio
import pytest

from calibration.build import build_table
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.objects import load_object
from controller.cycle.arm_model import ArmModel
from controller.cycle.arm_motion import ArmMotion, ArmMotionLimits
from controller.cycle.compensation import STILL, WristOffset
from controller.cycle.grasp_state import ArmState, GraspEvent, GraspPhase
from controller.cycle.grasping import Grasping, GraspSettings
from controller.cycle.inverse_kinematics import DifferentialInverseKinematics
from controller.cycle.joint_bounds import JointLimits
from controller.cycle.orders import Orders
from controller.messages import CommandKind, CompensationIndex, CycleCommand, EventKind, HandState, Reason
from drivers.wam.parameters import load_wam_parameters

PERIOD_S = 0.002
TABLE = build_table(load_hand("t42pp"), load_object("cylinder40"), GraspSpec(onset_split=0.1), nodes=9)
MODEL = ArmModel()
PARAMETERS = load_wam_parameters()
LIMITS = JointLimits.from_parameters(PARAMETERS)
START = np.array([0.1, 0.4, -0.2, 2.0, 0.3, -0.7, 0.2])
OPEN_HAND = HandState((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
WAY = {
    GraspPhase.NONE: (),
    GraspPhase.PREPOSITIONED: (GraspEvent.PREPOSITIONED,),
    GraspPhase.CONTACT: (GraspEvent.CONTACT_FOUND,),
    GraspPhase.SQUEEZING: (GraspEvent.CONTACT_FOUND, GraspEvent.SQUEEZE),
    GraspPhase.HOLDING: (GraspEvent.CONTACT_FOUND, GraspEvent.HOLD),
}


class Robot:
    """The part of the cycle that orders touch: arm motion and grasp, active and without hardware."""

    def __init__(self, phase: GraspPhase = GraspPhase.NONE, *, table: bool = True) -> None:
        kinematics = DifferentialInverseKinematics(MODEL, LIMITS, PERIOD_S, PARAMETERS.home_rad)
        self.motion = ArmMotion(MODEL, kinematics, WristOffset(np.eye(4)), PERIOD_S, ArmMotionLimits())
        self.motion.place(START)
        self.grasping = Grasping(PERIOD_S, GraspSettings())
        self.orders = Orders(self.motion, self.grasping)
        self.orders.arm_state = ArmState.ACTIVE
        self.orders.hand = OPEN_HAND
        if table:
            self.grasping.use_table(TABLE)
        if phase in (GraspPhase.CONTACT, GraspPhase.SQUEEZING, GraspPhase.HOLDING, GraspPhase.CLOSING):
            self.grasping.enter(GraspEvent.PREPOSITIONED)
            self.take(CommandKind.CLOSE, token=0)
        for event in WAY.get(phase, ()):
            self.grasping.enter(event)
        if phase is GraspPhase.HOLDING:
            self.grasping.hold()
            for step in range(1, 50):
                self.grasping.step(OPEN_HAND, step * 2_000_000, step * 2_000_000, 1.0)
        assert self.grasping.phase is phase
        self.grasping.outcomes.clear()

    def take(self, kind: CommandKind, *values: float, token: int = 1) -> Reason:
        return self.orders.take(CycleCommand(kind, token, values))

    def move_wrist(self, x_m: float = 0.05, token: int = 1) -> Reason:
        return self.take(CommandKind.MOVE_WRIST, *self.near(x_m), token=token)

    def near(self, x_m: float) -> tuple[float, ...]:
        """A wrist pose `x_m` from here, and a speed."""
        x, y, z = MODEL.wrist_pose(START)[:3, 3].tolist()
        quaternion = pinocchio.Quaternion(MODEL.wrist_pose(START)[:3, :3])
        turn = (float(quaternion.w), float(quaternion.x), float(quaternion.y), float(quaternion.z))
        return (x + x_m, y, z, *turn, 1.0)

    def run(self, most: int = 3000) -> None:
        """Move along the path as the cycle does, until it is done or stopped."""
        for _ in range(most):
            was_moving = self.motion.moving
            self.motion.step(STILL, 0.0 if self.orders.stopping else 1.0)
            if was_moving and (not self.motion.moving or self.motion.stop()):
                self.orders.finish_arm_path()
            if not self.motion.moving:
                return

    def phase(self) -> GraspPhase:
        return self.grasping.phase

    def fault(self) -> Reason:
        return self.orders.fault

    def told(self) -> list[tuple[EventKind, int, Reason]]:
        told = [(outcome.kind, outcome.token, outcome.reason) for outcome in self.grasping.outcomes]
        self.grasping.outcomes.clear()
        return told

    def state(self) -> tuple[object, ...]:
        return (
            self.grasping.phase,
            self.grasping.index_kind,
            self.grasping.table,
            self.orders.fault,
            self.orders.stopping,
            self.orders.shutting_down,
            self.orders.compensation,
            self.motion.moving,
            self.motion.joint_rad.tolist(),
        )


def idle(robot: Robot) -> None:
    robot.orders.arm_state = ArmState.IDLE


def moving(robot: Robot) -> None:
    robot.motion.move_joints(START + 0.1, 1.0)


def failed(robot: Robot) -> None:
    robot.orders.fault = Reason.COLLISION


def no_hand(robot: Robot) -> None:
    robot.orders.hand = None


def let_go(robot: Robot) -> None:
    robot.orders.hand_fault = Reason.HAND_TORQUE_LOST


def nothing(robot: Robot) -> None:
    pass


P, K = GraspPhase, CommandKind
REFUSED: list[tuple[GraspPhase, Callable[[Robot], None], CommandKind, Reason]] = [
    (P.NONE, idle, K.MOVE_JOINTS, Reason.ARM_NOT_ACTIVE),
    (P.NONE, moving, K.MOVE_JOINTS, Reason.BUSY),
    (P.NONE, failed, K.MOVE_JOINTS, Reason.COLLISION),
    (P.HOLDING, nothing, K.MOVE_JOINTS, Reason.WRONG_PHASE),
    (P.NONE, idle, K.MOVE_WRIST, Reason.ARM_NOT_ACTIVE),
    (P.SQUEEZING, nothing, K.MOVE_WRIST, Reason.WRONG_PHASE),
    (P.HOLDING, idle, K.MOVE_WRIST, Reason.ARM_NOT_ACTIVE),
    (P.HOLDING, nothing, K.PREPOSITION, Reason.WRONG_PHASE),
    (P.NONE, moving, K.PREPOSITION, Reason.BUSY),
    (P.NONE, nothing, K.CLOSE, Reason.WRONG_PHASE),
    (P.PREPOSITIONED, no_hand, K.CLOSE, Reason.HAND_SILENT),
    (P.PREPOSITIONED, let_go, K.CLOSE, Reason.HAND_TORQUE_LOST),
    (P.PREPOSITIONED, idle, K.CLOSE, Reason.ARM_NOT_ACTIVE),
    (P.HOLDING, nothing, K.CLOSE, Reason.WRONG_PHASE),
    (P.PREPOSITIONED, nothing, K.SQUEEZE, Reason.NO_TABLE),
    (P.HOLDING, failed, K.SQUEEZE, Reason.COLLISION),
    (P.NONE, nothing, K.HOLD, Reason.WRONG_PHASE),
    (P.NONE, nothing, K.RELEASE, Reason.WRONG_PHASE),
    (P.HOLDING, nothing, K.SET_COMPENSATION, Reason.WRONG_PHASE),
]


@pytest.mark.parametrize(("phase", "make", "kind", "reason"), REFUSED)
def test_a_refused_command_changes_nothing(
    phase: GraspPhase, make: Callable[[Robot], None], kind: CommandKind, reason: Reason
) -> None:
    """Each command that does not fit the moment says why, and everything stays as it was."""
    robot = Robot(phase)
    make(robot)
    values = {
        CommandKind.MOVE_JOINTS: (*(START + 0.2), 0.5),
        CommandKind.MOVE_WRIST: robot.near(0.02),
        CommandKind.PREPOSITION: (*robot.near(0.02), 1.0),
        CommandKind.SQUEEZE: (0.002, 50.0, 1.0),
        CommandKind.SET_COMPENSATION: (0.0, 1.0),
    }
    before = robot.state()
    assert robot.take(kind, *(float(value) for value in values.get(kind, ()))) is reason
    assert robot.state() == before
    assert robot.told() == []


@pytest.mark.parametrize("kind", [CommandKind.PREPOSITION, CommandKind.RELEASE])
def test_without_a_table_there_is_no_grasp(kind: CommandKind) -> None:
    """What needs the table says so."""
    robot = Robot(table=False)
    assert robot.take(kind, *robot.near(0.01)) is Reason.NO_TABLE


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ((0.002, 300.0, 1.0), Reason.LOAD_ABOVE_CAP),
        ((0.050, 50.0, 1.0), Reason.OUTSIDE_TABLE),
    ],
)
def test_a_squeeze_stays_within_cap_and_table(values: tuple[float, ...], reason: Reason) -> None:
    """The cycle checks again what the front has checked: nothing is extrapolated, no cap exceeded."""
    robot = Robot(GraspPhase.HOLDING)
    before = robot.state()
    assert robot.take(CommandKind.SQUEEZE, *values) is reason
    assert robot.state() == before


def test_a_preposition_is_one_only_when_it_has_arrived() -> None:
    """The hand closes only where the table's grasp begins; a stopped approach is no preposition."""
    robot = Robot()
    assert robot.take(CommandKind.PREPOSITION, *robot.near(0.02), 1.0, token=5) is Reason.NONE
    assert robot.take(CommandKind.CLOSE) is Reason.BUSY
    robot.run()
    assert robot.told() == [(EventKind.COMPLETED, 5, Reason.NONE)]
    assert robot.phase() is GraspPhase.PREPOSITIONED

    robot = Robot()
    robot.take(CommandKind.PREPOSITION, *robot.near(0.05), 1.0, token=6)
    robot.run(most=100)
    assert robot.take(CommandKind.STOP, token=7) is Reason.NONE
    assert robot.told() == [(EventKind.COMPLETED, 7, Reason.NONE)]
    robot.run()
    assert robot.told() == [(EventKind.FAILED, 6, Reason.STOPPED_BY_COMMAND)]
    assert robot.phase() is GraspPhase.NONE
    assert robot.move_wrist(token=8) is Reason.NONE
    robot.run()
    assert robot.told() == [(EventKind.COMPLETED, 8, Reason.NONE)]


def test_moving_away_gives_the_preposition_up() -> None:
    """After any other motion the hand is not around the object any more."""
    robot = Robot(GraspPhase.PREPOSITIONED)
    assert robot.move_wrist() is Reason.NONE
    assert robot.phase() is GraspPhase.NONE


@pytest.mark.parametrize("stopped", [False, True])
def test_carrying_ends_in_holding(stopped: bool) -> None:
    """Arrived or stopped on the way, the object is held."""
    robot = Robot(GraspPhase.HOLDING)
    assert robot.move_wrist(token=3) is Reason.NONE
    assert robot.phase() is GraspPhase.CARRYING
    robot.run(most=100)
    if stopped:
        robot.take(CommandKind.ARM_HOLD, token=4)
        robot.told()
    robot.run()
    expected = (EventKind.FAILED, 3, Reason.STOPPED_BY_COMMAND) if stopped else (EventKind.COMPLETED, 3, Reason.NONE)
    assert robot.told() == [expected]
    assert robot.phase() is GraspPhase.HOLDING


def test_a_hand_that_lets_go_is_told_behind_a_fault_of_the_arm() -> None:
    """The object may have been dropped: that is told, while the arm's fault, which needs more, keeps its name."""
    robot = Robot(GraspPhase.HOLDING)
    robot.orders.fail(Reason.ARM_ESTOP)
    robot.orders.fail_hand(Reason.HAND_TORQUE_LOST)
    assert robot.told() == [
        (EventKind.FAULT, 0, Reason.ARM_ESTOP),
        (EventKind.FAULT, 0, Reason.HAND_TORQUE_LOST),
    ]
    assert robot.fault() is Reason.ARM_ESTOP


def test_a_fault_is_told_once_and_ends_all_that_is_under_way() -> None:
    """The first reason stands, the arm stops along its path, the object stays held, and only release opens."""
    robot = Robot(GraspPhase.HOLDING)
    robot.move_wrist(token=3)
    robot.run(most=100)
    robot.orders.fail(Reason.COLLISION)
    robot.orders.fail(Reason.HAND_SILENT)
    assert robot.told() == [(EventKind.FAULT, 0, Reason.COLLISION)]
    assert robot.fault() is Reason.COLLISION
    assert robot.phase() is GraspPhase.FAULT
    robot.run()
    assert robot.told() == [(EventKind.FAILED, 3, Reason.COLLISION)]
    assert robot.phase() is GraspPhase.FAULT
    assert robot.take(CommandKind.FAULT_CLEAR, token=4) is Reason.NONE
    assert robot.fault() is Reason.NONE
    assert robot.phase() is GraspPhase.HOLDING


@pytest.mark.parametrize("kind", [CommandKind.RELEASE, CommandKind.OPEN])
def test_trapped_fingers_come_free_in_a_fault(kind: CommandKind) -> None:
    """Release and open are accepted while the fault stands."""
    robot = Robot(GraspPhase.HOLDING)
    robot.orders.fail(Reason.HAND_SILENT)
    assert robot.take(kind) is Reason.NONE
    assert robot.phase() is GraspPhase.RELEASING
    assert robot.fault() is Reason.HAND_SILENT


def test_an_arm_that_went_idle_fails_its_path() -> None:
    """The client that waits for a motion hears that it will not arrive, and a later motion is not stopped by it."""
    robot = Robot()
    robot.move_wrist(token=3)
    robot.take(CommandKind.STOP, token=4)
    robot.told()
    robot.orders.drop_arm_path(Reason.ARM_IDLED)
    assert robot.told() == [(EventKind.FAILED, 3, Reason.ARM_IDLED)]
    assert not robot.orders.stopping


def test_compensation_is_chosen_before_the_grasp() -> None:
    """Index and switch are taken as given while nothing is gripped."""
    robot = Robot()
    assert robot.take(CommandKind.SET_COMPENSATION, 0.0, float(CompensationIndex.FUSED)) is Reason.NONE
    assert not robot.orders.compensation
    assert robot.grasping.index_kind is CompensationIndex.FUSED


def test_shutting_down_takes_no_new_motion() -> None:
    """After shutdown the arm stops and moves no more; the grasp is left as it is."""
    robot = Robot(GraspPhase.HOLDING)
    robot.move_wrist(token=3)
    robot.run(most=100)
    assert robot.take(CommandKind.SHUTDOWN, token=4) is Reason.NONE
    assert robot.orders.stopping
    robot.run()
    assert robot.move_wrist() is Reason.BUSY
    assert robot.phase() is GraspPhase.HOLDING


def test_the_motion_after_a_cleared_fault_goes_to_its_end() -> None:
    """A fault that found the arm standing does not stop the first motion after it."""
    robot = Robot(GraspPhase.HOLDING)
    robot.orders.fail(Reason.HAND_SILENT)
    robot.take(CommandKind.FAULT_CLEAR)
    robot.told()
    assert robot.move_wrist(token=5) is Reason.NONE
    robot.run()
    assert robot.told() == [(EventKind.COMPLETED, 5, Reason.NONE)]


def test_stop_ends_closing_too() -> None:
    """`stop` stops arm and winding, in whatever phase."""
    robot = Robot(GraspPhase.CLOSING)
    assert robot.take(CommandKind.STOP) is Reason.NONE
    wound_m = []
    for step in range(1, 400):
        robot.grasping.step(OPEN_HAND, step * 2_000_000, step * 2_000_000, 1.0)
        wound_m.append(robot.grasping.winding.position_m)
    assert wound_m[-1] == wound_m[100]


def test_a_fault_before_contact_holds_nothing() -> None:
    """Cleared, a fault that came while the fingers were closing on nothing leads to none, not to holding."""
    robot = Robot(GraspPhase.CLOSING)
    robot.orders.fail(Reason.HAND_SILENT)
    assert robot.take(CommandKind.FAULT_CLEAR) is Reason.NONE
    assert robot.phase() is GraspPhase.NONE


def test_a_wrist_pose_out_of_reach_is_told_as_such() -> None:
    """Protects a task planner from taking a wrist that got stuck half way for one that arrived."""
    robot = Robot()
    assert robot.move_wrist(1.5, token=5) is Reason.NONE
    robot.run(most=20_000)
    assert robot.told() == [(EventKind.FAILED, 5, Reason.UNREACHABLE)]
