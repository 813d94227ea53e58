"""Joint torques that make the arm follow the commanded motion.

    τ = inverse dynamics of the command (gravity, inertia) + friction of the commanded velocity
        + kp e + ∫ ki e + kd (v_command − v_measured)

all at the joints, in N·m, rad and s. The velocity is the difference of two measured positions over the true time
between their samples, through the vendor's first-order filter (WAM reference 5.4): y ← (y + ω T x) / (1 + ω T), with
ω = 180 rad/s. The commanded velocity passes the same filter, so that a motion followed perfectly meets no damping.

Arm friction over kp is what the wrist is off by, so the integral matters; three things keep it from harm. It is
bounded. It stands still while the torque is limited, in the direction that would press on. And it stands still while
the commanded joint rests within a band around its goal, small at first and wider once it had time to settle: against
Coulomb friction an integral would hunt for ever.

A command that runs beyond the position limits is braked before them first (`soft_limits.py`). What is asked for then
passes the preset's bound of the feedback, and last the limits of the torque's size and rate, which always hold.
"""

from __future__ import annotations

from math import isfinite

import numpy as np
import numpy.typing as npt

from controller.cycle.arm_model import JOINTS, ArmModel, FloatArray, checked_joints
from controller.cycle.joint_friction import FrictionDirection
from controller.cycle.joint_gains import STIFF_GAINS, JointGains, TorqueLimits
from controller.cycle.soft_limits import SoftLimits
from drivers.errors import InputError
from drivers.wam.parameters import load_wam_parameters

VELOCITY_FILTER_RAD_S = 180.0
RESTING_RAD_S = 1e-4  # a commanded joint that is slower rests
SETTLING_S = 0.3  # the integral's time to bring a resting joint into its band; later it stirs only for a larger error
SETTLED_BANDS = 3.0


class JointControl:
    """The torque law of the cycle. Call `reset` on activation, then `torque` once a period.

    Plain floats inside: with seven joints, arrays cost more than they save.
    """

    def __init__(
        self,
        model: ArmModel,
        gains: JointGains | None = None,
        limits: TorqueLimits | None = None,
        soft_limits: SoftLimits | None = None,
        velocity_filter_rad_s: float = VELOCITY_FILTER_RAD_S,
    ) -> None:
        if not (isfinite(velocity_filter_rad_s) and velocity_filter_rad_s > 0.0):
            raise InputError(f"velocity_filter_rad_s is {velocity_filter_rad_s}; expected a positive number.")
        gains = gains if gains is not None else STIFF_GAINS
        limits = limits if limits is not None else TorqueLimits.from_parameters(load_wam_parameters())
        self.model = model
        self.saturated = False
        """Whether a torque or rate limit bound in the last call."""
        self.feedback_Nm: FloatArray = np.zeros(JOINTS)
        """What the last torque holds beyond the model's feed-forward (7, N·m): a collision shows here."""
        self._filter_rad_s = velocity_filter_rad_s
        self._joints = [
            _Joint(*values)
            for values in zip(
                gains.kp,
                gains.ki,
                gains.kd,
                gains.integral_limit_Nm,
                gains.resting_band_rad,
                gains.feedback_limit_Nm,
                limits.torque_Nm,
                limits.rate_Nm_per_s,
                strict=True,
            )
        ]
        self._scaled_by_inertia = gains.scaled_by_inertia
        self._soft_limits = soft_limits
        self._friction = FrictionDirection(model.friction_turnover_rad)
        self._sample_ns: int | None = None

    def reset(self, q_measured: npt.ArrayLike, sample_ns: int) -> None:
        """Start from rest at the measured configuration (7, rad), holding it against gravity."""
        q = checked_joints(q_measured, "measured joint angles")
        for joint, position, gravity in zip(self._joints, q.tolist(), self.model.gravity(q).tolist(), strict=True):
            joint.reset(position, gravity)
        self._friction.reset()
        if self._soft_limits is not None:
            self._soft_limits.reset(q.tolist())
        self._sample_ns = sample_ns
        self.saturated = False
        self.feedback_Nm = np.zeros(JOINTS)

    @property
    def velocity(self) -> FloatArray:
        """Measured and filtered joint velocity (7, rad/s)."""
        return np.array([joint.velocity for joint in self._joints])

    def torque(
        self,
        q_measured: npt.ArrayLike,
        q_commanded: npt.ArrayLike,
        v_commanded: npt.ArrayLike,
        a_commanded: npt.ArrayLike,
        sample_ns: int,
    ) -> FloatArray:
        """Joint torques (7, N·m) to apply now.

        q_measured      (7, rad), sampled at `sample_ns`
        q_commanded, v_commanded, a_commanded  (7; rad, rad/s, rad/s²), all of the same moment as the sample
        sample_ns       monotonic; with a sample that is not newer than the last one the last torque stands

        Raises InputError when an array is not (7) and finite, or before the first `reset`.
        """
        if self._sample_ns is None:
            raise InputError("joint control has no starting point; expected reset(q, sample_ns) on activation first.")
        q = checked_joints(q_measured, "measured joint angles")
        elapsed_s = (sample_ns - self._sample_ns) * 1e-9
        goal = np.asarray(q_commanded, dtype=np.float64)
        velocity = np.asarray(v_commanded, dtype=np.float64)
        acceleration = np.asarray(a_commanded, dtype=np.float64)
        if self._soft_limits is None:
            speeds = velocity.tolist()
        else:
            goal, velocity, acceleration = self._soft_limits.held(goal, velocity, acceleration)
            speeds = self._soft_limits.speeds
        direction = self._friction.step(speeds, max(elapsed_s, 0.0))
        feed_forward = self.model.feed_forward(goal, velocity, acceleration, direction)
        if elapsed_s > 0.0:
            self._sample_ns = sample_ns
            self._step(q, goal, speeds, feed_forward, elapsed_s)
        torque = np.array([joint.torque for joint in self._joints])
        self.feedback_Nm = torque - feed_forward
        return torque

    def _step(
        self, q: FloatArray, goal: FloatArray, speeds: list[float], feed_forward: FloatArray, elapsed_s: float
    ) -> None:
        share = self._filter_rad_s * elapsed_s
        errors, pressing, growing = [], [], []
        for joint, position, wanted, speed in zip(self._joints, q.tolist(), goal.tolist(), speeds, strict=True):
            error = wanted - position
            errors.append(error)
            pressing.append(joint.feedback(position, error, speed, elapsed_s, share))
            growing.append(joint.ki * error * elapsed_s)
        feedback = np.array((pressing, growing))
        if self._scaled_by_inertia:
            feedback = self.model.torque_of(q, feedback.T).T
        pressing, growing = feedback.tolist()
        saturated = False
        for joint, forward, torque, growth, error, speed in zip(
            self._joints, feed_forward.tolist(), pressing, growing, errors, speeds, strict=True
        ):
            saturated |= joint.apply(forward, torque, growth, error, speed, elapsed_s)
        self.saturated = saturated


class _Joint:
    """Gains, limits and memory of one joint."""

    __slots__ = (
        "band",
        "feedback_limit",
        "integral",
        "integral_limit",
        "kd",
        "ki",
        "kp",
        "lag",
        "last_position",
        "rate_limit",
        "rested_s",
        "torque",
        "torque_limit",
        "velocity",
    )

    def __init__(
        self,
        kp: float,
        ki: float,
        kd: float,
        integral_limit: float,
        band: float,
        feedback_limit: float,
        torque_limit: float,
        rate_limit: float,
    ) -> None:
        self.kp, self.ki, self.kd = kp, ki, kd
        self.integral_limit, self.band = integral_limit, band
        self.feedback_limit, self.torque_limit, self.rate_limit = feedback_limit, torque_limit, rate_limit
        self.reset(0.0, 0.0)

    def reset(self, position: float, gravity: float) -> None:
        self.last_position = position
        self.torque = min(max(gravity, -self.torque_limit), self.torque_limit)
        self.integral = 0.0
        self.velocity = 0.0
        self.lag = 0.0
        self.rested_s = 0.0

    def feedback(self, position: float, error: float, v_commanded: float, elapsed_s: float, share: float) -> float:
        """Proportional and derivative part; `share` is ω T of the filter."""
        rate = (position - self.last_position) / elapsed_s
        self.last_position = position
        self.velocity = (self.velocity + share * rate) / (1.0 + share)
        self.lag = (self.lag + share * (v_commanded - rate)) / (1.0 + share)
        return self.kp * error + self.kd * self.lag

    def apply(
        self, forward: float, feedback: float, growth: float, error: float, v_commanded: float, elapsed_s: float
    ) -> bool:
        """Limit feed-forward, feedback and integral, then let that grow. Returns whether a torque limit bound."""
        asked = feedback + self.integral
        wanted = forward + min(max(asked, -self.feedback_limit), self.feedback_limit)
        reach = self.rate_limit * elapsed_s
        least = max(self.torque - reach, -self.torque_limit)
        greatest = min(self.torque + reach, self.torque_limit)
        self.torque = min(max(wanted, least), greatest)

        self.rested_s = self.rested_s + elapsed_s if abs(v_commanded) < RESTING_RAD_S else 0.0
        band = self.band if self.rested_s < SETTLING_S else SETTLED_BANDS * self.band
        resting = self.rested_s > 0.0 and abs(error) < band
        pressing_on = (forward + asked - self.torque) * growth > 0.0
        if not (resting or pressing_on):
            self.integral = min(max(self.integral + growth, -self.integral_limit), self.integral_limit)
        return wanted != self.torque
