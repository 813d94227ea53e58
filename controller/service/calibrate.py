"""Runs calibration plans on a running daemon, as any task planner would: moves by commands, sees by the state stream.

Whatever goes wrong in the middle, a refusal, a fault, Ctrl-C, a daemon that has gone, ends the run with the arm told to
hold, and with an error; nothing of what was measured is kept. Times are counted in cycles, which is the time the arm
lives in. Source: design 1, 6; WAM reference 6.6.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, field

from calibration.gravity_plan import GravityPlan, HeldPose, averaged
from controller.client import Client
from controller.service.state_stream import StateSeen, StateStream, as_seen
from drivers.errors import CommandError, DeviceError, StillgraspError

LONGEST_SILENCE_S = 3.0
"""The state comes every 10 ms; a daemon that is silent for this long has gone."""
LONGEST_MOVE_S = 90.0
_LOOK_S = 0.25
_FREE_PHASES = ("none", "prepositioned")


@dataclass
class CalibrationRun:
    """A daemon's arm in the hands of a calibration.

    `period_s`: of the daemon's cycle. `slowest_rad_s`: the lowest of the joint velocity limits, which sets the speed of
    a move that is alike on all joints. `travel_speed`: part of the limits, for the way between poses.
    """

    client: Client
    states: StateStream
    period_s: float
    slowest_rad_s: float
    travel_speed: float = 0.5
    say: Callable[[str], None] = field(default=lambda text: None)

    def measure_gravity(self, plan: GravityPlan) -> list[HeldPose]:
        """Go through all approaches of the plan. Raises CommandError, DeviceError, InputError."""
        self._require_free_arm()
        try:
            return self._hold_all_poses(plan)
        except BaseException:
            with contextlib.suppress(StillgraspError):
                self.client.arm_hold()
            raise

    def _hold_all_poses(self, plan: GravityPlan) -> list[HeldPose]:
        slow = min(plan.speed_rad_s / self.slowest_rad_s, 1.0)
        held = []
        for approach in plan.approaches():
            side = "above" if approach.side > 0 else "below"
            self.say(f"pose {approach.pose + 1} of {len(plan.poses_rad)}, from {side}")
            self._move(approach.start_rad, self.travel_speed)
            self._move(approach.pose_rad, slow)
            self._watch(plan.settling_s)
            samples = self._watch(plan.sampling_s)
            arms = [sample.arm for sample in samples]
            held.append(averaged(approach, [arm.joint_rad for arm in arms], [arm.joint_torque_Nm for arm in arms]))
        return held

    def _require_free_arm(self) -> None:
        """The arm is active, nothing is gripped, no fault. Raises CommandError."""
        state = self.client.status()["state"]
        if not state:
            raise CommandError("no_state", "The daemon has not read the arm yet.", help="Try again in a moment.")
        seen = as_seen(state)
        if seen.hand.state == "gripping" or seen.grasp.phase not in _FREE_PHASES:
            raise CommandError(
                "gripping",
                f"The hand is {seen.hand.state}, the grasp {seen.grasp.phase}; the arm must not carry anything.",
                help="Send grasp.release, then hand.open.",
            )
        self._require_well(seen)

    def _require_well(self, seen: StateSeen) -> None:
        if seen.grasp.fault:
            raise CommandError(
                seen.grasp.fault,
                f"The daemon is in the fault {seen.grasp.fault}.",
                help="Remove its cause, send fault.clear and start again.",
            )
        if seen.arm.state != "active":
            raise CommandError(
                "arm_not_active",
                f"The arm is {seen.arm.state}, not active.",
                help="Press Shift-Idle, then Shift-Activate on the pendant, and start again.",
            )

    def _move(self, joint_rad: tuple[float, ...], speed: float) -> None:
        """Move there and look on meanwhile."""
        task = self.client.arm_move_joints(joint_rad, speed=speed)
        began = self._next().cycle.number
        while not task.done:
            seen = self._next()
            self._require_well(seen)
            if (seen.cycle.number - began) * self.period_s > LONGEST_MOVE_S:
                raise CommandError("timeout", f"The arm has not arrived after {LONGEST_MOVE_S:g} s.")
        task.wait(0.0)

    def _watch(self, duration_s: float) -> list[StateSeen]:
        """All samples of the coming `duration_s`, from the next cycle that is yet to be seen."""
        while self.states.next(0.0) is not None:
            pass  # what waited to be read is of before
        samples = [self._next()]
        last = samples[0].cycle.number + round(duration_s / self.period_s)
        while samples[-1].cycle.number < last:
            samples.append(self._next())
            self._require_well(samples[-1])
        return samples

    def _next(self) -> StateSeen:
        waited_s = 0.0
        while waited_s < LONGEST_SILENCE_S:
            seen = self.states.next(_LOOK_S)
            if seen is not None:
                return seen
            waited_s += _LOOK_S
        raise DeviceError(
            "daemon",
            f"it has sent no state for {LONGEST_SILENCE_S:g} s.",
            help="See whether it still runs, and whether front.state_endpoint is the same on both sides.",
        )
