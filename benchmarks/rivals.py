"""The cycle's look-up, smoothing and inverse kinematics, each beside another way to do it.

Every function returns processor time in µs (median, 99th percentile) of one call on one thread.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import cast

import numpy as np
import pinocchio
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline
from scipy.optimize import lsq_linear

from calibration.motion_table import MotionTable
from controller.config import RobotConfig
from controller.cycle.arm_model import ArmModel
from controller.cycle.compensation import OffsetLimits, OffsetSmoother, PlanarMotion
from controller.cycle.inverse_kinematics import DifferentialInverseKinematics, Solver
from controller.cycle.joint_bounds import JointLimits
from controller.cycle.planar_table import PlanarTable
from controller.service.assembly import arm_model, configured_hand
from drivers.wam.parameters import load_wam_parameters

Array = NDArray[np.float64]
PERIOD_S = 0.002
CHANNELS = (0, 1, 5)  # x, y, θ of a planar hand


@dataclass(frozen=True)
class Figure:
    """One measured call."""

    name: str
    median_us: float
    p99_us: float | None
    target_us: float | None = None


def measured(name: str, calls: list[Callable[[], object]], target_us: float | None = None) -> Figure:
    """Times every call once, after a warm-up with the first few."""
    for call in calls[:20]:
        call()
    taken_us = []
    for call in calls:
        began_ns = time.thread_time_ns()
        call()
        taken_us.append((time.thread_time_ns() - began_ns) * 1e-3)
    median, p99 = np.percentile(taken_us, (50, 99))
    return Figure(name, float(median), float(p99), target_us)


def look_up(table: MotionTable, count: int = 2000) -> list[Figure]:
    """The table at places along a squeeze, against SciPy's spline of the same three channels with both slopes."""
    planar = PlanarTable(table)
    end_m = table.mean_excursion_end_m(0.0)
    means = np.linspace(0.02 * end_m, 0.98 * end_m, count)
    differences = 2e-4 * np.sin(np.linspace(0, 20, count))
    places = list(zip(means.tolist(), differences.tolist(), strict=True))
    mean_axis, difference_axis = table.arrays["excursion.axis_0"], table.arrays["excursion.axis_1"]
    values = np.nan_to_num(table.arrays["excursion.value"])
    splines = [RectBivariateSpline(mean_axis, difference_axis, values[:, :, channel]) for channel in CHANNELS]

    def by_spline(mean_m: float, difference_m: float) -> list[Array]:
        return [
            spline.ev([mean_m], [difference_m], dx=along, dy=across)
            for spline in splines
            for along, across in ((0, 0), (1, 0), (0, 1))
        ]

    def each(function: Callable[[float, float], object]) -> list[Callable[[], object]]:
        return [partial(function, mean_m, difference_m) for mean_m, difference_m in places]

    return [
        measured("table look-up", each(table.at_excursion), 10.0),
        measured("table look-up, unpacked for the cycle", each(planar.at_excursion)),
        measured("rival: RectBivariateSpline.ev, x y θ with slopes", each(by_spline)),
    ]


def smoothing(count: int = 2000) -> list[Figure]:
    """Ruckig on the wrist's offset along a squeeze."""
    smoother = OffsetSmoother(PERIOD_S, OffsetLimits())
    targets = []
    for step in range(count):
        w, t = 2.6, step * PERIOD_S
        s, ds, dds = 1 - np.cos(w * t), w * np.sin(w * t), w * w * np.cos(w * t)
        pose, rate, change = ((0.002 * k, 0.006 * k, 0.05 * k) for k in (float(s), float(ds), float(dds)))
        targets.append(PlanarMotion(pose, rate, change))
    return [measured("smoothing (Ruckig, 3 numbers)", [partial(smoother.step, target) for target in targets], 15.0)]


def inverse_kinematics(config: RobotConfig, joint_rad: tuple[float, ...], count: int = 1500) -> list[Figure]:
    """Following a wrist that moves 12 mm as in a squeeze: the QP, the pseudo-inverse, and SciPy's lsq_linear."""
    parameters = load_wam_parameters()
    limits = config.arm.limits
    bounds = JointLimits(
        parameters.joint_lower_rad,
        parameters.joint_upper_rad,
        np.array(limits.velocity_rad_s),
        np.array(limits.acceleration_rad_s2),
    )
    model = arm_model(config, configured_hand(config))
    start = np.array(joint_rad)
    T_start = model.wrist_pose(start).copy()

    def follow(solver: str) -> list[Callable[[], object]]:
        kinematics = DifferentialInverseKinematics(model, bounds, PERIOD_S, start, solver=cast(Solver, solver))
        q, v = start.copy(), np.zeros(7)

        def step(number: int) -> None:
            T, twist = _target(T_start, number, count)
            answer = kinematics.step(q, v, T, twist)
            v[:] = answer.velocity
            q[:] += PERIOD_S * v

        return [partial(step, number) for number in range(count)]

    return [
        measured("inverse kinematics (QP with bounds)", follow("qp"), 80.0),
        measured("inverse kinematics (pseudo-inverse)", follow("pseudoinverse")),
        measured("rival: scipy.optimize.lsq_linear with bounds", _bounded_rival(model, bounds, start, T_start, 300)),
    ]


def _target(T_start: Array, number: int, count: int) -> tuple[Array, Array]:
    phase = number / count
    T = T_start.copy()
    T[0, 3] += 0.012 * phase**2 * (3 - 2 * phase)
    twist = np.zeros(6)
    twist[0] = 0.012 * 6 * phase * (1 - phase) / (count * PERIOD_S)
    return T, twist


def _bounded_rival(
    model: ArmModel, limits: JointLimits, start: Array, T_start: Array, count: int
) -> list[Callable[[], object]]:
    q = start.copy()

    def step(number: int) -> None:
        T, twist = _target(T_start, number, count)
        pose = model.wrist_pose(q)
        turn = pinocchio.log3(T[:3, :3] @ pose[:3, :3].T)
        wanted = twist + 20.0 * np.concatenate((T[:3, 3] - pose[:3, 3], turn))
        v = lsq_linear(model.jacobian(q), wanted, bounds=(-limits.velocity_rad_s, limits.velocity_rad_s)).x
        q[:] += PERIOD_S * v

    return [partial(step, number) for number in range(count)]
