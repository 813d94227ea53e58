"""Differential inverse kinematics: the joint velocity that makes the wrist follow its target, within the arm's limits.

Works on the *commanded* configuration. World axes, wrist twists at the wrist's origin, linear part first; rad, m, s.

The task is V = V* + K e, with V* the target's twist over the coming period and e = [p* − p ; log3(R* Rᵀ)] less what V*
covers in that period. Damped least squares give the velocity, the posture acts where the task leaves freedom:

    v_u = argmin |J v − V|² + λ² |v − v_posture|²,      λ grows near singularities

Joint bounds come from acceleration, speed and stopping distance (`joint_bounds.py`). Inside them v_u is the answer.
Otherwise a QP finds the nearest velocity along the same path, slower by s in [0, 1]:

    min (v − s v_u)ᵀ H (v − s v_u) + ρ |v_u|²_H (1 − s)²   subject to the bounds,      H = JᵀJ + λ²

with λ in H at least `bounded_damping`. That is v_u, s = 1 where no bound binds, so nothing jumps where one begins to.
`solver="pseudoinverse"` is the paper's equations 17 and 18 under the same bounds: v_u = Jᵀ(J Jᵀ)⁻¹ V, slowed as a
whole, then clipped.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import copysign, isfinite, sqrt
from typing import Any, Literal, cast

import daqp
import numpy as np
import numpy.typing as npt
import pinocchio

from controller.cycle.arm_model import JOINTS, ArmModel, FloatArray, checked_joints
from controller.cycle.joint_bounds import JointBounds, JointLimits
from drivers.errors import InputError

Solver = Literal["qp", "pseudoinverse"]


QP_ITERATIONS = 60  # eight bounds need a dozen; a step that does not end in time is slowed as a whole instead


@dataclass(frozen=True)
class TrackingSettings:
    """How hard the wrist is pulled to its target, and what happens near singularities.

    The feedback speed is K e for small errors and never more than can be braked at the stated acceleration, so that a
    far target is approached without overshoot.
    """

    position_gain_per_s: float = 20.0
    rotation_gain_per_s: float = 20.0
    feedback_acceleration_m_s2: float = 0.5
    feedback_acceleration_rad_s2: float = 2.0
    feedback_speed_m_s: float = 0.25
    feedback_speed_rad_s: float = 1.0
    posture_gain_per_s: float = 0.5
    posture_speed_rad_s: float = 0.1
    posture_band_rad: float = 0.1  # nothing pulls this near the posture: creep would show friction at the wrist
    rotation_length_m: float = 0.2  # 1 rad of rotation weighs as much as this translation
    damping: float = 1e-4  # λ far from singularities, in m
    bounded_damping: float = 0.003  # least λ of the QP: how cheaply free motion replaces a bounded joint's
    singular_damping: float = 0.02  # λ at a singularity, in m
    singular_threshold_m: float = 0.015  # below this least singular value the damping grows
    slowing_weight: float = 0.002  # ρ: leaving the path costs 1, slowing down costs this

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            lowest = 0.0 if name.startswith("posture") else 1e-9
            if not (isfinite(value) and value >= lowest):
                raise InputError(f"tracking setting {name} is {value}; expected a positive finite number.")


@dataclass(frozen=True)
class IkStep:
    """One step's answer. Integrate as q ← q + velocity · period."""

    velocity: FloatArray
    """Commanded joint velocity (7, rad/s) over the coming period."""
    scale: float
    """s in [0, 1]: the part of the wanted wrist speed that the bounds allow."""
    position_error_m: float
    """Distance to the target before this step's correction."""
    rotation_error_rad: float
    """Angle to the target before this step's correction."""
    bounded: bool
    """Whether a joint bound changed the answer."""


class DifferentialInverseKinematics:
    """Turns wrist targets into joint velocities, once a period.

    model        shared with the torques: `model.pose` and `model.jacobian_now` are those of `q_commanded` after `step`
    limits       joint limits; the acceleration is never exceeded, a position limit never newly violated
    period_s     of the cycle
    posture_rad  (7) where the arm's free motion leans to
    """

    def __init__(
        self,
        model: ArmModel,
        limits: JointLimits,
        period_s: float,
        posture_rad: npt.ArrayLike,
        *,
        settings: TrackingSettings | None = None,
        solver: Solver = "qp",
    ) -> None:
        if solver not in ("qp", "pseudoinverse"):
            raise InputError(f"inverse kinematics solver is {solver!r}; expected 'qp' or 'pseudoinverse'.")
        self.model = model
        self.bounds = JointBounds(limits, period_s)
        self.settings = settings if settings is not None else TrackingSettings()
        self.posture_rad = checked_joints(posture_rad, "posture").copy()
        self._solver = solver
        self._period_s = period_s
        self._row_weight = np.array([1.0] * 3 + [self.settings.rotation_length_m] * 3)
        self._weight_column = self._row_weight[:, None].copy()
        self._weighted_jacobian = np.zeros((6, JOINTS))
        self._gram = np.zeros((6, 6))
        self._gram_diagonal = self._gram.reshape(-1)[::7]
        self._task = np.zeros(6)
        self._normal = np.zeros((JOINTS, JOINTS))
        self._normal_diagonal = self._normal.reshape(-1)[:: JOINTS + 1]
        self._hessian = np.zeros((JOINTS + 1, JOINTS + 1))
        self._gradient = np.zeros(JOINTS + 1)
        self._lower = np.zeros(JOINTS + 1)
        self._upper = np.ones(JOINTS + 1)
        self._no_rows = np.zeros((0, JOINTS + 1))
        self._solve_qp = cast(Callable[..., tuple[FloatArray, float, int, dict[str, Any]]], daqp.solve)

    def set_posture(self, posture_rad: npt.ArrayLike) -> None:
        """Lean to `posture_rad` (7) from now on; where the arm starts to grip, so that nothing pulls while it holds."""
        self.posture_rad = checked_joints(posture_rad, "posture").copy()

    def step(
        self,
        q_commanded: npt.ArrayLike,
        v_commanded: npt.ArrayLike,
        T_world_wrist_target: FloatArray,
        twist_target: FloatArray,
    ) -> IkStep:
        """Joint velocity for the coming period.

        q_commanded, v_commanded  (7) configuration now, and the velocity of the period that ends now
        T_world_wrist_target      (4×4) where the wrist shall be at the *end* of the coming period
        twist_target              (6) mean twist of the target over the coming period: m/s, rad/s, world axes

        Raises InputError when something has the wrong shape or is not finite.
        """
        q = checked_joints(q_commanded, "commanded joint angles")
        v_previous = checked_joints(v_commanded, "commanded joint velocities")
        self.model.update(q)
        position_error_m, rotation_error_rad = self._wanted_twist(T_world_wrist_target, twist_target)

        np.multiply(self.model.jacobian_now, self._weight_column, out=self._weighted_jacobian)
        self._task *= self._row_weight
        damping_squared, unbounded = self._unbounded_velocity(q)

        wanted = unbounded.tolist()
        lower, upper = self.bounds.at(q.tolist(), v_previous.tolist())
        if all(map(_between, lower, wanted, upper)):
            return IkStep(unbounded, 1.0, position_error_m, rotation_error_rad, False)
        if self._solver == "qp":
            velocity, scale = self._along_path(unbounded, damping_squared, lower, upper)
        else:
            velocity, scale = _slowed(wanted, lower, upper)
        # The bounds are laws; the solver keeps them to its tolerance only.
        kept = np.array([min(max(v, low), high) for v, low, high in zip(velocity, lower, upper, strict=True)])
        return IkStep(kept, scale, position_error_m, rotation_error_rad, True)

    def _wanted_twist(self, T_target: FloatArray, twist_target: FloatArray) -> tuple[float, float]:
        """Fill `_task` with V* + K e; returns the sizes of e (m, rad)."""
        if T_target.shape != (4, 4) or twist_target.shape != (6,):
            raise InputError(
                f"wrist target has shape {T_target.shape} and its twist {twist_target.shape}; expected (4, 4) and (6,)."
            )
        settings = self.settings
        T = self.model.pose
        rotation = pinocchio.log3(T_target[:3, :3].dot(T[:3, :3].T)).tolist()
        twist = twist_target.tolist()
        period_s = self._period_s
        # What the target's own motion covers in this period is no error.
        (x, y, z), (x_now, y_now, z_now) = T_target[:3, 3].tolist(), T[:3, 3].tolist()
        ex = x - x_now - period_s * twist[0]
        ey = y - y_now - period_s * twist[1]
        ez = z - z_now - period_s * twist[2]
        rx = rotation[0] - period_s * twist[3]
        ry = rotation[1] - period_s * twist[4]
        rz = rotation[2] - period_s * twist[5]
        distance_m = sqrt(ex * ex + ey * ey + ez * ez)
        angle_rad = sqrt(rx * rx + ry * ry + rz * rz)
        if not isfinite(distance_m + angle_rad):
            raise InputError(
                f"wrist target {T_target.tolist()} or its twist {twist} is not finite; expected finite numbers."
            )
        k = settings.position_gain_per_s
        if distance_m * k > 1e-9:
            k = _feedback_speed(distance_m, k, settings.feedback_acceleration_m_s2, settings.feedback_speed_m_s)
            k /= distance_m
        h = settings.rotation_gain_per_s
        if angle_rad * h > 1e-9:
            h = _feedback_speed(angle_rad, h, settings.feedback_acceleration_rad_s2, settings.feedback_speed_rad_s)
            h /= angle_rad
        self._task[:] = (
            twist[0] + k * ex,
            twist[1] + k * ey,
            twist[2] + k * ez,
            twist[3] + h * rx,
            twist[4] + h * ry,
            twist[5] + h * rz,
        )
        return distance_m, angle_rad

    def _unbounded_velocity(self, q: FloatArray) -> tuple[float, FloatArray]:
        """λ² and the damped least-squares velocity (7), in the dual form: (6×6) and exact for small λ."""
        settings = self.settings
        J = self._weighted_jacobian
        np.dot(J, J.T, out=self._gram)
        damping_squared = settings.damping * settings.damping
        self._gram_diagonal += damping_squared
        inverse = np.linalg.inv(self._gram)
        if self._solver == "pseudoinverse":
            return damping_squared, J.T.dot(inverse.dot(self._task))
        # 1 / trace of the inverse lies between a sixth of the least squared singular value and that value itself.
        measure = 1.0 / float(inverse.trace()) / settings.singular_threshold_m**2
        if measure < 1.0:
            extra = (settings.singular_damping * (1.0 - measure)) ** 2
            self._gram_diagonal += extra
            damping_squared += extra
            inverse = np.linalg.inv(self._gram)
        band, gain, limit = settings.posture_band_rad, settings.posture_gain_per_s, settings.posture_speed_rad_s
        away = (self.posture_rad - q).tolist()
        if max(away) <= band and min(away) >= -band:
            return damping_squared, J.T.dot(inverse.dot(self._task))
        posture = np.array([copysign(min(gain * max(abs(x) - band, 0.0), limit), x) for x in away])
        self._task -= J.dot(posture)
        posture += J.T.dot(inverse.dot(self._task))
        return damping_squared, posture

    def _along_path(
        self, unbounded: FloatArray, damping_squared: float, lower: list[float], upper: list[float]
    ) -> tuple[list[float], float]:
        """The QP in (v, s) of the module's docstring: velocity (7) and s."""
        H = self._hessian
        J = self._weighted_jacobian
        normal = self._normal
        np.dot(J.T, J, out=normal)
        self._normal_diagonal += max(damping_squared, self.settings.bounded_damping**2)
        Hv = normal.dot(unbounded)
        size = float(Hv.dot(unbounded))
        slowing = self.settings.slowing_weight * size
        H[:JOINTS, :JOINTS] = normal
        H[JOINTS, :JOINTS] = H[:JOINTS, JOINTS] = -Hv
        H[JOINTS, JOINTS] = size + slowing
        self._gradient[JOINTS] = -slowing
        self._lower[:JOINTS] = lower
        self._upper[:JOINTS] = upper
        # Tolerances are absolute: a slow task would otherwise vanish below them.
        factor = 1.0 / max(size, 1e-12)
        solution, _, status, _ = self._solve_qp(
            H * factor, self._gradient * factor, self._no_rows, self._upper, self._lower, iter_limit=QP_ITERATIONS
        )
        if status < 1:
            return _slowed(unbounded.tolist(), lower, upper)
        *velocity, scale = solution.tolist()
        return velocity, min(1.0, max(0.0, scale))


def _feedback_speed(error: float, gain_per_s: float, acceleration: float, limit: float) -> float:
    """Speed of the correction: gain · error near the target, what `acceleration` can still brake further away."""
    linear_until = acceleration / (gain_per_s * gain_per_s)
    if error <= linear_until:
        return min(gain_per_s * error, limit)
    return min(sqrt(acceleration * (2.0 * error - linear_until)), limit)


def _between(low: float, value: float, high: float) -> bool:
    return low <= value <= high


def _slowed(unbounded: list[float], lower: list[float], upper: list[float]) -> tuple[list[float], float]:
    """`unbounded` times the greatest s in [0, 1] that lies within the bounds; as near as s can come if none does."""
    scale = 1.0
    for speed, low, high in zip(unbounded, lower, upper, strict=True):
        if speed != 0.0:
            scale = min(scale, max(0.0, low / speed, high / speed))
    return [speed * scale for speed in unbounded], scale
