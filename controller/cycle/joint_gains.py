"""Gains and limits of the joint control: the presets, and the vendor's as one of them.

All at the joints, (7) each in joint order, in N·m, rad and s. Source: WAM reference 5.3, 5.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import inf, isnan

from controller.cycle.arm_model import JOINTS
from drivers.errors import InputError
from drivers.wam.parameters import WamParameters

TWO_ENCODER_COUNTS_RAD = (1e-4, 1.2e-4, 2e-4, 2e-4, 3.2e-4, 3.2e-4, 2.1e-4)
UNLIMITED = (inf,) * JOINTS


def _checked(values: Sequence[float], what: str, *, allow_zero: bool = False, allow_infinity: bool = False) -> None:
    lowest = "≥ 0" if allow_zero else "> 0"
    for value in values:
        inside = value > 0.0 or (allow_zero and value == 0.0)
        if isnan(value) or not inside or (value == inf and not allow_infinity):
            break
    else:
        if len(values) == JOINTS:
            return
    finite = "" if allow_infinity else "finite "
    raise InputError(f"{what} is {list(values)}; expected {JOINTS} {finite}values {lowest}.")


@dataclass(frozen=True)
class JointGains:
    """Gains of the joint control, (7) each, and the bounds of its integral and of all its feedback in N·m.

    Plain gains give torques: kp N·m/rad, ki N·m/(rad·s), kd N·m·s/rad. Gains `scaled_by_inertia` give accelerations
    (1/s², 1/s³, 1/s), which the mass matrix turns into torques: equally fast in every pose and with any hand.
    """

    kp: tuple[float, ...]
    ki: tuple[float, ...]
    kd: tuple[float, ...]
    integral_limit_Nm: tuple[float, ...]
    resting_band_rad: tuple[float, ...] = TWO_ENCODER_COUNTS_RAD
    feedback_limit_Nm: tuple[float, ...] = UNLIMITED
    scaled_by_inertia: bool = field(kw_only=True)

    def __post_init__(self) -> None:
        for name in ("kp", "ki", "kd", "integral_limit_Nm", "resting_band_rad"):
            _checked(getattr(self, name), f"joint gain {name}", allow_zero=True)
        _checked(self.feedback_limit_Nm, "joint gain feedback_limit_Nm", allow_infinity=True)


LIBBARRETT_GAINS = JointGains(
    kp=(900.0, 2500.0, 600.0, 500.0, 50.0, 50.0, 8.0),
    ki=(2.5, 5.0, 2.0, 0.5, 0.5, 0.5, 0.1),
    kd=(10.0, 20.0, 5.0, 2.0, 0.5, 0.5, 0.05),
    integral_limit_Nm=(25.0, 20.0, 15.0, 15.0, 5.0, 5.0, 5.0),
    feedback_limit_Nm=(25.0, 20.0, 15.0, 15.0, 5.0, 5.0, 5.0),
    scaled_by_inertia=False,
)
"""The vendor's position controller with its output limits (WAM reference 5.4). It leans on the arm's friction for its
damping. Unlike the vendor's it rides on this control's whole feed-forward, its integral is bounded, and its derivative
passes the velocity filter; the vendor differentiates the raw error."""

STIFF_GAINS = JointGains(
    kp=(4500.0,) * JOINTS,
    ki=(60000.0,) * JOINTS,
    kd=(120.0,) * JOINTS,
    integral_limit_Nm=(5.0, 6.0, 4.0, 3.0, 1.0, 1.0, 0.5),
    scaled_by_inertia=True,
)
"""As stiff as a 500 Hz loop with 1.5 ms from sample to torque and the velocity filter bears without friction's help:
twice these gains are still stable (tested)."""

CALM_GAINS = JointGains(
    kp=(900.0,) * JOINTS,
    ki=(4000.0,) * JOINTS,
    kd=(55.0,) * JOINTS,
    integral_limit_Nm=(5.0, 6.0, 4.0, 3.0, 1.0, 1.0, 0.5),
    scaled_by_inertia=True,
)
"""For a simulation in real time on a machine that does not keep time, where torques come late."""

GAIN_PRESETS = {"stiff": STIFF_GAINS, "calm": CALM_GAINS, "libbarrett": LIBBARRETT_GAINS}


def preset_gains(
    preset: str,
    *,
    kp_Nm_per_rad: Sequence[float] | None = None,
    ki_Nm_per_rad_s: Sequence[float] | None = None,
    kd_Nms_per_rad: Sequence[float] | None = None,
) -> JointGains:
    """The gains of a preset, of which rows (7) given as torques replace those of the preset.

    Raises InputError for an unknown preset, wrong rows, or rows for a preset whose gains are accelerations.
    """
    gains = GAIN_PRESETS.get(preset)
    if gains is None:
        raise InputError(f"joint gain preset is {preset!r}; expected one of {', '.join(GAIN_PRESETS)}.")
    given = {"kp": kp_Nm_per_rad, "ki": ki_Nm_per_rad_s, "kd": kd_Nms_per_rad}
    rows = {name: tuple(row) for name, row in given.items() if row is not None}
    if rows and gains.scaled_by_inertia and len(rows) < len(given):
        raise InputError(
            f"joint gains {', '.join(rows)} are torques, those of the preset {preset!r} are accelerations; "
            "expected kp, ki and kd together, or the preset 'libbarrett'."
        )
    if not rows:
        return gains
    return replace(gains, scaled_by_inertia=False, **rows)


@dataclass(frozen=True)
class TorqueLimits:
    """Joint-side limits of the commanded torque, (7) each: size (N·m) and rate (N·m/s)."""

    torque_Nm: tuple[float, ...]
    rate_Nm_per_s: tuple[float, ...]

    def __post_init__(self) -> None:
        for name, values in vars(self).items():
            _checked(values, f"torque limit {name}")

    @classmethod
    def from_parameters(
        cls,
        parameters: WamParameters,
        *,
        torque_Nm: Sequence[float] | None = None,
        rate_Nm_per_s: Sequence[float] | None = None,
        full_swing_s: float = 0.02,
    ) -> TorqueLimits:
        """The arm's effort limits, or `torque_Nm` where that is lower, reached from zero in `full_swing_s` at the
        soonest, or at `rate_Nm_per_s`."""
        efforts = tuple(float(effort) for effort in parameters.joint_effort_limit_Nm)
        if torque_Nm is not None:
            _checked(torque_Nm, "torque limit torque_Nm")
            efforts = tuple(min(effort, wanted) for effort, wanted in zip(efforts, torque_Nm, strict=True))
        rates = tuple(effort / full_swing_s for effort in efforts) if rate_Nm_per_s is None else tuple(rate_Nm_per_s)
        return cls(efforts, rates)
