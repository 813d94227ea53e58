"""The 2 ms cycle, top to bottom.

What may be touched where: `orders.py` decides what a command does, `grasping.py` how the hand winds and where the
object goes, `arm_motion.py` where the arm is commanded to be, `safety.py` and `arm_supervision.py` what ends it all.
Here they only take turns. Nothing in this file or below it logs, starts a thread, or waits for anything but the bus.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field

import numpy as np

from controller.cycle.arm_model import ArmModel
from controller.cycle.arm_motion import ArmMotion
from controller.cycle.arm_supervision import ArmSupervision, Found
from controller.cycle.attentive_clock import AttentiveClock
from controller.cycle.command_queue import CommandQueue
from controller.cycle.compensation import STILL, OffsetSmoother
from controller.cycle.cycle_record import CycleRecorder
from controller.cycle.grasp_state import ArmState
from controller.cycle.grasping import Grasping
from controller.cycle.hand_supervision import HandSupervision
from controller.cycle.joint_control import JointControl
from controller.cycle.lifted_load import LiftedLoad
from controller.cycle.orders import Orders
from controller.cycle.outcome import Outcome
from controller.cycle.pacer import Pacer
from controller.cycle.safety import SafetyMonitor, attention, governor
from controller.messages import (
    CommandKind,
    CycleCommand,
    CycleEvent,
    EventKind,
    HandState,
    Reason,
)
from controller.service.links import LatestReader, LatestSender, OrderedReader, OrderedSender
from drivers.clock import Clock, nanoseconds
from drivers.errors import BusError
from drivers.wam.arm import Arm, ArmSample
from drivers.wam.safety_puck import ArmMode
from drivers.wam.startup import Operator

_ARM_STATES = {
    ArmMode.OFFLINE: ArmState.OFFLINE,
    ArmMode.ESTOP: ArmState.ESTOP,
    ArmMode.IDLE: ArmState.IDLE,
    ArmMode.ACTIVE: ArmState.ACTIVE,
}


@dataclass(frozen=True)
class CycleLinks:
    """The cycle's ends of its links."""

    commands: OrderedReader
    events: OrderedSender
    records: LatestSender
    hand_state: LatestReader
    hand_set_point: LatestSender


@dataclass(frozen=True)
class CycleSettings:
    """Times of the cycle."""

    period_s: float = 0.002
    reply_deadline_s: float = 0.0014  # from the request; seven replies take 0.61 to 0.68 ms on the wire
    speed_limit_m_s: float = 0.06  # of the object in the hand, above which the governor slows winding down
    shutdown_idle_s: float = 0.6


@dataclass
class Parts:
    """What the cycle is made of; `service/assembly.py` puts it together."""

    arm: Arm
    model: ArmModel
    motion: ArmMotion
    control: JointControl
    grasping: Grasping
    orders: Orders
    smoother: OffsetSmoother
    safety: SafetyMonitor
    settings: CycleSettings = field(default_factory=CycleSettings)


class Cycle:
    """Runs one period a `step`."""

    def __init__(
        self,
        clock: Clock,
        links: CycleLinks,
        parts: Parts,
        processor_time_ns: Callable[[], int] = lambda: 0,
        operator: Operator | None = None,
        say: Callable[[str], None] = lambda _: None,
    ) -> None:
        """`operator` hears prompts while the arm is started; `say` is for what else they should know.

        Only with an `AttentiveClock`, which the arm's bus waits on too, does the rest go on while the arm is started
        again after a fault.
        """
        self._clock, self._links, self._parts = clock, links, parts
        self._supervision = ArmSupervision(parts.arm, parts.safety.silent_cycles, operator, say)
        self._processor_time_ns = processor_time_ns
        self._settings = parts.settings
        self._reply_ns = nanoseconds(parts.settings.reply_deadline_s)
        self.pacer = Pacer(clock, nanoseconds(parts.settings.period_s))
        self.number = 0
        self.finished = False
        self._hand: HandState | None = None
        self._newest_hand: tuple[bytes, int] | None = None
        self._hand_sample_ns = 0
        self._sample: ArmSample | None = None
        self._torque = np.zeros(7)
        self._governor = self._arm_seen = 1.0
        self._commands = CommandQueue(links.commands, parts.grasping)
        self._hand_supervision = HandSupervision(parts.safety, parts.grasping, parts.orders)
        self._load = LiftedLoad(parts.model, parts.motion, parts.grasping, parts.settings.period_s)
        self._record = CycleRecorder(self, parts, links.records)
        self.cpu_us = 0.0
        """Processor time of the last period."""
        self._idle_deadline_ns: int | None = None
        self._left_active = self._asked = False
        self._has_read = False
        self._outcomes: list[Outcome] = parts.grasping.outcomes

    def start(self) -> None:
        """Find the arm and read it once; then `step` every period. Raises DeviceError."""
        self._supervision.start()
        self.pacer.restart()

    @property
    def motor_firmware(self) -> int:
        """Of the arm's motor pucks, after `start`."""
        return self._supervision.motor_firmware

    def step(self) -> None:
        """One period: ask for positions, think while they travel, check them, send torques."""
        began_ns = self._processor_time_ns()
        now_ns = self.pacer.begin()
        self._has_read = False
        self._asked = self._on_bus(self._parts.arm.request_positions)
        self._listen(now_ns)
        self._grasp(now_ns)
        self._move()
        self._load.step()
        if self._asked and self._on_bus(lambda: self._feel(now_ns)):
            self._on_bus(self._act)
        if self._parts.orders.shutting_down and not self._parts.motion.moving:
            self._go_idle()
        self._tell(now_ns)
        self.number += 1
        self.cpu_us = (self._processor_time_ns() - began_ns) * 1e-3

    def _on_bus(self, act: Callable[[], None]) -> bool:
        """Do something on the arm's bus; a bus that takes nothing is a fault, but the hand is on another one."""
        try:
            act()
        except BusError:
            self._fail_arm(self._supervision.lose_bus())
            return False
        return True

    def _listen(self, now_ns: int) -> None:
        """Newest hand state and the commands due now."""
        newest = self._links.hand_state.newest()
        if newest is not None and newest is not self._newest_hand:
            self._newest_hand = newest
            payload, self._hand_sample_ns = newest
            self._hand = HandState.unpack(payload)
        self._parts.orders.hand = self._hand
        self._hand_supervision.look(self._hand, (now_ns - self._hand_sample_ns) * 1e-9)
        while (command := self._next_command()) is not None:
            reason = self._take(command)
            accepted = reason is Reason.NONE
            self._tell_event(EventKind.ACCEPTED if accepted else EventKind.REJECTED, command.token, reason, ())
            self._tell_outcomes(self._outcomes)
        if self._commands.closed and not self._parts.orders.shutting_down:
            self._parts.orders.take(CycleCommand(CommandKind.SHUTDOWN, 0))

    def _take(self, command: CycleCommand) -> Reason:
        """Carry out a command; before a fault is cleared the hand has to be sound, and the arm, or is started again."""
        if command.kind is CommandKind.FAULT_CLEAR and self._parts.orders.fault is not Reason.NONE:
            reason = self._recover() or self._hand_supervision.clear()
            if reason is not Reason.NONE:
                return reason
        return self._parts.orders.take(command)

    def _recover(self) -> Reason:
        """What can take seconds; all but the arm goes on meanwhile, if the clock allows."""
        clock = self._clock
        with clock.attended(self._attend, self._due_ns) if isinstance(clock, AttentiveClock) else nullcontext():
            reason = self._supervision.recover(self._sample)
        if reason is Reason.NONE:
            self._asked = False  # whatever was on its way, start-up has taken
            self._parts.safety.reset()
        return reason

    def _due_ns(self) -> int:
        return self.pacer.deadline_ns

    def _attend(self) -> None:
        """A period without the arm."""
        now_ns = self.pacer.begin()
        self._has_read = False
        self._listen(now_ns)
        self._grasp(now_ns)
        self._tell(now_ns)
        self.number += 1

    def _grasp(self, now_ns: int) -> None:
        """Wind, observe the index, look the object's motion up, smooth the opposite offset."""
        parts = self._parts
        seen = min(self._arm_seen, attention((now_ns - self._hand_sample_ns) * 1e-9))
        grasping, smoother = parts.grasping, parts.smoother
        set_point = grasping.step(self._hand, self._hand_sample_ns, now_ns, min(self._governor, seen))
        self._links.hand_set_point.send(set_point.pack(), now_ns)
        if not (grasping.compensated and parts.orders.compensation):
            self._governor = 1.0
            if smoother.motion is not STILL:
                parts.motion.keep(smoother.motion)
                smoother.reset()
            return
        offset = smoother.step(grasping.offset_target)
        target = grasping.offset_target.pose
        lag_m = ((target[0] - offset.pose[0]) ** 2 + (target[1] - offset.pose[1]) ** 2) ** 0.5
        self._governor = governor(
            lag_m, parts.motion.scale, grasping.full_rate_object_speed_m_s, self._settings.speed_limit_m_s
        )
        self._check(parts.safety.offset(grasping.offset_target, offset))

    def _move(self) -> None:
        """Commanded joint motion of this period; while the arm is not active, it is where it is measured."""
        parts = self._parts
        state = _ARM_STATES[parts.arm.mode]
        if state is ArmState.OFFLINE and parts.orders.arm_state is ArmState.ACTIVE:
            state = ArmState.ACTIVE  # nobody has ended its torque mode: it is held until that is known
        if state is not parts.orders.arm_state and self._sample is not None:
            self._change_arm_state(state, self._sample)
        if parts.orders.arm_state is not ArmState.ACTIVE:
            if self._sample is not None:
                parts.motion.place(self._sample.joint_rad, parts.smoother.motion)
            return
        was_moving = parts.motion.moving
        stopping = parts.orders.stopping
        parts.motion.step(parts.smoother.motion, 0.0 if stopping else self._arm_seen)
        if was_moving and (not parts.motion.moving or (stopping and parts.motion.stop())):
            parts.orders.finish_arm_path()

    def _feel(self, now_ns: int) -> None:
        """Positions of this period, and whether all is plausible."""
        parts = self._parts
        self._sample = sample = parts.arm.collect_positions(now_ns + self._reply_ns)
        self._has_read = True
        self._arm_seen = attention(sample.age_ns * 1e-9)
        supervision = self._supervision
        supervision.ask(self.number, sample)
        silent = parts.safety.replies(sample.complete) is not Reason.NONE
        fault = supervision.look(sample, silent, parts.orders.shutting_down)
        if fault is not None or (self._left_active and not supervision.pending):
            self._fail_arm(fault)
        supervision.go_idle(now_ns)
        if parts.orders.arm_state is ArmState.ACTIVE:
            self._check(parts.safety.tracking(sample.joint_rad, parts.motion.joint_rad))
            self._check(parts.safety.residual(parts.control.feedback_Nm))
            if parts.orders.fault and parts.safety.escapes(sample.joint_rad, parts.motion.joint_rad):
                supervision.give_up()

    def _act(self) -> None:
        """Torques: the model's for the commanded motion plus feedback; gravity alone while the arm is not active, or
        where feedback would push against positions that nobody reports any more."""
        parts, motion, sample = self._parts, self._parts.motion, self._sample
        assert sample is not None
        blind = self._supervision.blind
        if blind and sample.complete:
            motion.place(sample.joint_rad, parts.smoother.motion)  # where it has come to meanwhile
            self._supervision.see()
        if parts.orders.arm_state is ArmState.ACTIVE and not blind:
            self._torque = parts.control.torque(
                sample.joint_rad,
                motion.joint_rad,
                motion.joint_velocity_rad_s,
                motion.joint_acceleration_rad_s2,
                sample.sample_ns,
            )
        else:
            parts.control.reset(sample.joint_rad, sample.sample_ns)
            self._torque = parts.model.gravity(sample.joint_rad)
        if sample.replies:  # else the wire may be blocked, and what is sent now be heard long after it was true
            parts.arm.write_torques(self._torque)

    def _change_arm_state(self, state: ArmState, sample: ArmSample) -> None:
        orders, parts = self._parts.orders, self._parts
        self._left_active = orders.arm_state is ArmState.ACTIVE and not orders.shutting_down
        orders.arm_state = state
        self._supervision.change_mode()
        if state is ArmState.ACTIVE:
            parts.motion.place(sample.joint_rad, parts.smoother.motion)
            parts.control.reset(sample.joint_rad, sample.sample_ns)
            parts.safety.reset()

    def _fail_arm(self, fault: Found | None) -> None:
        """The arm has a fault; one that left its active mode has also failed whatever was under way."""
        orders = self._parts.orders
        if self._left_active:
            self._left_active = False
            orders.drop_arm_path(fault.reason if fault is not None else orders.fault or Reason.ARM_IDLED)
        # The operator may idle the arm at any time; only what was held makes it a fault.
        harmless = fault is None or (fault.reason is Reason.ARM_IDLED and not self._parts.grasping.compensated)
        if fault is not None and not harmless:
            orders.fail(*fault)

    def _check(self, reason: Reason) -> None:
        if reason is not Reason.NONE and self._parts.orders.fault is Reason.NONE:
            self._parts.orders.fail(reason)

    def _go_idle(self) -> None:
        """The end: ask the safety puck for idle, and stop when it is there or has had its time."""
        now_ns, arm = self._clock.now_ns(), self._parts.arm
        if self._idle_deadline_ns is None:
            self._idle_deadline_ns = now_ns + nanoseconds(self._settings.shutdown_idle_s)
            if arm.mode is ArmMode.ACTIVE:
                self._on_bus(arm.request_idle)
        told = self._on_bus(arm.poll_safety_mode) and arm.mode is not ArmMode.ACTIVE
        if told or now_ns > self._idle_deadline_ns:
            self._tell_event(EventKind.STOPPED, 0, Reason.NONE if told else Reason.ARM_SILENT, ())
            self.finished = True

    def _next_command(self) -> CycleCommand | None:
        command = self._commands.due(self.number)
        self._tell_outcomes(self._commands.told)
        return command

    def _tell_event(self, kind: EventKind, token: int, reason: Reason, values: tuple[float, ...]) -> None:
        event = CycleEvent(kind, token, self.number, reason, values)
        self._links.events.send(event.pack(), self._clock.now_ns())

    def _tell_outcomes(self, outcomes: list[Outcome]) -> None:
        for outcome in outcomes:
            self._tell_event(outcome.kind, outcome.token, outcome.reason, outcome.values)
        outcomes.clear()

    def _tell(self, now_ns: int) -> None:
        """Events of this period and one record of all that was seen and commanded."""
        self._tell_outcomes(self._outcomes)
        sample = self._sample
        replies = sample.replies if sample is not None and self._has_read else 0
        self._record.write(sample, replies, self._hand, self._hand_sample_ns, self._torque, self._governor, now_ns)
