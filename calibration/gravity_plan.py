"""Where the arm goes to have its gravity measured, and what is made of the samples taken there.

Each pose is approached twice, from `offset_rad` above and below on all joints at a slow speed; Coulomb friction then
presses once with and once against gravity, and the mean of both holding torques is gravity's alone. Half of their
difference is friction. Poses, offset, speed and duration are the vendor's (WAM reference 6.6). Joint angles in rad
(DH), torques in N·m, (7) in joint order. Pure.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from math import pi

import numpy as np
import numpy.typing as npt

from drivers.errors import InputError

Array = npt.NDArray[np.float64]

JOINTS = 7
_QUARTER = pi / 2
POSES_RAD: tuple[tuple[float, ...], ...] = (
    (0.0, -_QUARTER, 0.0, _QUARTER, 0.0, 0.0, 0.0),
    (0.7854, -_QUARTER, _QUARTER, _QUARTER, -_QUARTER, 0.0, 0.0),
    (-0.7854, -_QUARTER, -_QUARTER, _QUARTER, -_QUARTER, 0.0, 0.0),
    (-0.7854, _QUARTER, _QUARTER, _QUARTER, 0.0, 1.5, 0.0),
    (0.0, 0.7854, 0.0, 2.3562, 0.0, -0.7854, 0.0),
    (0.7854, _QUARTER, -_QUARTER, _QUARTER, 0.0, 1.5, 0.0),
    (0.0, 0.0, 0.7854, _QUARTER, 0.7854, 0.7854, 0.7854),
    (0.0, _QUARTER, -_QUARTER, -0.3927, 0.7854, -1.0781, -0.7854),
    (-0.7854, 0.7854, -0.7854, -0.7854, 0.7854, -0.7854, 0.7854),
)
STOP_MARGIN_RAD = 0.03
"""What is left between the furthest commanded angle and a joint's limit."""
LARGEST_SHIFT_RAD = 0.25
"""A pose that would have to be moved further than this to fit between the limits is another pose."""
REACHED_RAD = 0.02
RESTING_RAD = 0.004
FEWEST_SAMPLES = 20
_SATURATED = 0.98


@dataclass(frozen=True)
class Approach:
    """One way to a pose: from `start_rad` slowly to `pose_rad`. `side`: 1 from above on all joints, −1 from below."""

    pose: int
    side: int
    start_rad: tuple[float, ...]
    pose_rad: tuple[float, ...]


@dataclass(frozen=True)
class GravityPlan:
    """The measurement: poses in their order, how each is approached, and how long torques are averaged there."""

    poses_rad: tuple[tuple[float, ...], ...] = POSES_RAD
    offset_rad: float = 0.03
    speed_rad_s: float = 0.05
    settling_s: float = 0.5
    sampling_s: float = 4.0
    notes: tuple[str, ...] = field(default=())
    """What was changed to suit this arm."""

    def approaches(self) -> Iterator[Approach]:
        """All ways in their order: each pose from above, then from below."""
        for number, pose in enumerate(self.poses_rad):
            for side in (1, -1):
                yield Approach(number, side, tuple(angle + side * self.offset_rad for angle in pose), pose)


@dataclass(frozen=True, eq=False)
class HeldPose:
    """What was sampled at the end of one approach: means (7), the joints' range (7), and the number of samples."""

    pose: int
    side: int
    joint_rad: Array
    torque_Nm: Array
    range_rad: Array
    samples: int


@dataclass(frozen=True, eq=False)
class Balanced:
    """Both approaches of every pose put together, (n, 7) each."""

    joint_rad: Array
    torque_Nm: Array
    """What holds the arm, without friction."""
    friction_Nm: Array
    """What friction took on the way up; its mean estimates Coulomb friction."""


def plan_gravity(
    lower_rad: Array, upper_rad: Array, *, settling_s: float = 0.5, sampling_s: float = 4.0
) -> GravityPlan:
    """The vendor's plan for an arm with these joint limits (7): poses too near to a limit are moved inwards.

    Raises InputError where a pose does not fit between them.
    """
    plan = GravityPlan(settling_s=settling_s, sampling_s=sampling_s)
    inset = plan.offset_rad + STOP_MARGIN_RAD
    poses, notes = [], []
    for number, pose in enumerate(plan.poses_rad, start=1):
        wanted = np.array(pose)
        moved = np.minimum(np.maximum(wanted, lower_rad + inset), upper_rad - inset)
        for joint in np.flatnonzero(moved != wanted):
            told = f"pose {number}: joint {joint + 1} at {moved[joint]:.3f} instead of {wanted[joint]:.3f} rad"
            if (
                not abs(moved[joint] - wanted[joint]) <= LARGEST_SHIFT_RAD
                or upper_rad[joint] - lower_rad[joint] < 2 * inset
            ):
                raise InputError(
                    f"gravity cannot be calibrated within these joint limits: {told} is another pose; expected limits "
                    f"of joint {joint + 1} around {wanted[joint]:.3f} rad, not "
                    f"{lower_rad[joint]:.3f} to {upper_rad[joint]:.3f}.",
                    help="Calibrate with the arm's own limits: take lower_rad and upper_rad out of robot.toml.",
                )
            notes.append(f"{told}, for its limit")
        poses.append(tuple(moved.tolist()))
    return GravityPlan(tuple(poses), settling_s=settling_s, sampling_s=sampling_s, notes=tuple(notes))


def averaged(
    approach: Approach, joint_rad: Sequence[Sequence[float]], torque_Nm: Sequence[Sequence[float]]
) -> HeldPose:
    """Samples of one held pose, (k, 7) each, as their means. Raises InputError on too few or unusable ones."""
    angles, torques = np.array(joint_rad, dtype=np.float64), np.array(torque_Nm, dtype=np.float64)
    where = _where(approach.pose, approach.side)
    if len(angles) < FEWEST_SAMPLES or angles.shape != torques.shape or angles.shape[1:] != (JOINTS,):
        raise InputError(
            f"{where}: {len(angles)} samples came; expected at least {FEWEST_SAMPLES} of seven joints each."
        )
    if not (np.isfinite(angles).all() and np.isfinite(torques).all()):
        raise InputError(f"{where}: the samples hold values that are not finite; expected numbers only.")
    return HeldPose(
        approach.pose, approach.side, angles.mean(axis=0), torques.mean(axis=0), np.ptp(angles, axis=0), len(angles)
    )


def balanced(plan: GravityPlan, held: Sequence[HeldPose], torque_limit_Nm: Array) -> Balanced:
    """The two approaches of every pose put together.

    Raises InputError if one is missing or doubled, if the arm was not where it should be, moved, or was at its torque
    limits `torque_limit_Nm` (7): such data tell nothing of gravity.
    """
    found = {(one.pose, one.side): one for one in held}
    wanted = {(approach.pose, approach.side): approach for approach in plan.approaches()}
    if len(found) != len(held) or found.keys() != wanted.keys():
        missing = ", ".join(_where(*key) for key in sorted(wanted.keys() - found.keys())) or "none"
        raise InputError(
            f"{len(held)} measurements came, missing: {missing}; expected each of {len(plan.poses_rad)} poses once "
            "from above and once from below."
        )
    for key, one in found.items():
        _check_held(_where(*key), one, np.array(wanted[key].pose_rad), torque_limit_Nm)
    above = [found[pose, 1] for pose in range(len(plan.poses_rad))]
    below = [found[pose, -1] for pose in range(len(plan.poses_rad))]
    torque_above, torque_below = (np.array([one.torque_Nm for one in side]) for side in (above, below))
    return Balanced(
        joint_rad=np.array([0.5 * (a.joint_rad + b.joint_rad) for a, b in zip(above, below, strict=True)]),
        torque_Nm=0.5 * (torque_above + torque_below),
        friction_Nm=0.5 * (torque_below - torque_above),
    )


def _check_held(where: str, one: HeldPose, pose_rad: Array, torque_limit_Nm: Array) -> None:
    if not all(np.isfinite(values).all() for values in (one.joint_rad, one.torque_Nm, one.range_rad)):
        raise InputError(f"{where}: the measurement holds values that are not finite; expected numbers only.")
    checks = (
        (
            np.abs(one.joint_rad - pose_rad),
            np.full(JOINTS, REACHED_RAD),
            "rad away from the pose",
            "let nothing block it",
        ),
        (one.range_rad, np.full(JOINTS, RESTING_RAD), "rad of motion while it was measured", "let it rest, hands off"),
        (np.abs(one.torque_Nm), _SATURATED * torque_limit_Nm, "N·m, its limit", "take loads off the arm"),
    )
    for values, most, what, cure in checks:
        for joint in np.flatnonzero(values > most):
            raise InputError(
                f"{where}: joint {joint + 1} had {values[joint]:.4g} {what}; expected at most {most[joint]:.4g}.",
                help=f"See that nothing touches the arm, {cure}, and measure again.",
            )


def _where(pose: int, side: int) -> str:
    return f"pose {pose + 1} from {'above' if side > 0 else 'below'}"
