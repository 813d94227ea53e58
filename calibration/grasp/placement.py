"""Which load closes the hand onto a given chord of an object, and how hand and object then stand to each other.

In the axes of the contact line (at the angle χ in the hand) each fingertip's arc centre stands at κ = P + ρ m, P the
contact point and m the outline's outward normal, if the arc touches, and t u further up the finger if the flat pad
touches t below the arc's foot (u the distal link's direction). With both arc centres c(T) from free closing

    c_right − t_right u_right − c_left + t_left u_left = (κ_right − κ_left) e^{iχ},

and a pad faces its contact: its normal's angle is that of −m e^{iχ}. So there is always one equation in the mean load
T: for two arcs |c_right − c_left| = |κ_right − κ_left|; one pad gives χ, two pads give T by their angles alone. The
lowest load is taken at which both fingertips touch with the part that was supposed. Hand frame, m, rad, N; right, left.
Source: hand-mechanics reference 4 to 6; paper II-A.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from calibration.grasp.free_closing import ClosingPath, path_of
from calibration.grasp.specification import GraspSpec
from calibration.hand.finger import FingerModel, Reals
from calibration.objects.chord import ChordEnd
from drivers.errors import MechanicsError

SAMPLED_LOADS = 160
"""Loads at which free closing is sampled for the first contact: about 2° of joint motion apart."""
SIDES = ("right", "left")
ARC, PAD = False, True


@dataclass(frozen=True)
class Placement:
    """Hand and object at first contact: mean load, joint coordinates, object's centre and the contact line's angle."""

    load_N: float
    joint_rad: tuple[Reals, Reals]
    centre_m: complex
    line_angle_rad: float


@dataclass(frozen=True)
class _Closing:
    """Both fingers over the chord's ends (front: right finger, back: left), touching with arc or pad each."""

    fingers: tuple[FingerModel, FingerModel]
    ends: tuple[ChordEnd, ChordEnd]
    onset_split: float
    pads: tuple[bool, bool]

    @property
    def wanted(self) -> complex:
        """κ_right − κ_left, m, in the contact line's axes."""
        right, left = self.centres()
        return right - left

    def centres(self) -> tuple[complex, complex]:
        """κ of both fingers, m."""
        right, left = (
            end.point + finger.tip_radius_m * end.normal for finger, end in zip(self.fingers, self.ends, strict=True)
        )
        return right, left

    def along(self, load_N: Reals) -> ClosingPath:
        """Free closing at mean loads `load_N` (K,)."""
        return path_of(self.fingers, load_N, self.onset_split)

    def residual(self, load_N: float) -> float:
        """The one equation: m, or rad when both touch with their pads."""
        return float(self.residuals(self.along(np.array([load_N])))[0])

    def residuals(self, path: ClosingPath) -> Reals:
        """`residual` along a whole path (K,)."""
        apart = path.arc_centre_m[0] - path.arc_centre_m[1]
        if not any(self.pads):
            return np.abs(apart) - abs(self.wanted)
        if all(self.pads):
            facing = self._facing(path, 0) - self._facing(path, 1)
            return np.asarray(np.angle(np.exp(1j * facing)), np.float64)
        index = self.pads.index(PAD)
        left_over = apart - self.wanted * np.exp(1j * self._facing(path, index))
        return np.asarray((left_over * np.exp(-1j * path.distal_angle_rad[index])).imag, np.float64)

    def line_angle_rad(self, path: ClosingPath) -> float:
        """χ at the single load of `path`."""
        if any(self.pads):
            facing = float(self._facing(path, self.pads.index(PAD))[0])
            return math.remainder(facing, 2 * math.pi)
        return cmath.phase(complex(path.arc_centre_m[0][0] - path.arc_centre_m[1][0]) / self.wanted)

    def down_pad_m(self, path: ClosingPath) -> tuple[float, float]:
        """How far below the arc's foot each pad is touched, m; 0 for arcs."""
        chi = self.line_angle_rad(path)
        left_over = complex(path.arc_centre_m[0][0] - path.arc_centre_m[1][0]) - self.wanted * cmath.exp(1j * chi)
        along = [cmath.exp(1j * float(angle[0])) for angle in path.distal_angle_rad]
        if all(self.pads):
            columns = np.array([[along[0].real, -along[1].real], [along[0].imag, -along[1].imag]])
            right, left = np.linalg.solve(columns, [left_over.real, left_over.imag])
            return float(right), float(left)
        right = (left_over / along[0]).real if self.pads[0] else 0.0
        left = -(left_over / along[1]).real if self.pads[1] else 0.0
        return right, left

    def past_pad_rad(self, path: ClosingPath, index: int) -> float:
        """Angle from the pad's normal to the contact's, towards the finger's end; > 0 when the arc touches."""
        facing = float(self._facing(path, index)[0]) - self.line_angle_rad(path)
        return self.fingers[index].links[1].inner_side * math.remainder(facing, 2 * math.pi)

    def _facing(self, path: ClosingPath, index: int) -> Reals:
        """χ at which the pad of a finger would face its contact."""
        normal_rad = path.distal_angle_rad[index] + self.fingers[index].links[1].inner_side * np.pi / 2
        return np.asarray(normal_rad - cmath.phase(-self.ends[index].normal), np.float64)


def placed(
    fingers: tuple[FingerModel, FingerModel],
    ends: tuple[ChordEnd, ChordEnd],
    grasp: GraspSpec,
    cap_N: float,
    *,
    pads_roll: bool,
) -> Placement:
    """First contact on the chord with `ends` (front, back) up to the mean load `cap_N`. Errors: MechanicsError.

    `pads_roll`: the outline is round there, so that a flat pad may touch it; on flat sides only arcs are sought.
    """
    last_N = _last_moving_load_N(fingers, grasp.onset_split, cap_N)
    path = path_of(fingers, np.linspace(0.0, last_N, SAMPLED_LOADS + 1), grasp.onset_split)
    arcs = _Closing(fingers, ends, grasp.onset_split, (ARC, ARC))
    touching = [(load, arcs) for load in _roots(arcs, path)]
    refused = bool(touching)
    if pads_roll:
        for pads in [(PAD, ARC), (ARC, PAD), (PAD, PAD)]:
            if all(finger.pad is not None or not pad for finger, pad in zip(fingers, pads, strict=True)):
                closing = replace(arcs, pads=pads)
                touching += [(load, closing) for load in _roots(closing, path)]
        touching = [(load, closing) for load, closing in touching if _touches(closing, load)]
    if not touching:
        raise _pads_refuse(grasp) if refused else _out_of_reach(path, arcs, cap_N)
    load, closing = min(touching, key=lambda item: item[0])
    here = closing.along(np.array([load]))
    joints = here.joint_rad[0][0], here.joint_rad[1][0]
    for side, finger, q in zip(SIDES, fingers, joints, strict=True):
        if np.any(q >= finger.upper_rad) or np.any(q <= finger.lower_rad):
            raise MechanicsError(
                "onset_split" if grasp.onset_split else "object.shape",
                f"the {side} finger meets a stop before it touches the object.",
                help="Take a wider object or a smaller onset split.",
            )
    chi = closing.line_angle_rad(here)
    centres = [
        complex(centre[0]) - down * cmath.exp(1j * float(angle[0])) - kappa * cmath.exp(1j * chi)
        for centre, down, angle, kappa in zip(
            here.arc_centre_m, closing.down_pad_m(here), here.distal_angle_rad, closing.centres(), strict=True
        )
    ]
    return Placement(load, joints, (centres[0] + centres[1]) / 2, chi)


def _last_moving_load_N(fingers: tuple[FingerModel, FingerModel], onset_split: float, cap_N: float) -> float:
    """A mean load up to `cap_N`, less than twice the one at which the last joint meets its stop."""
    load_N = cap_N
    for _ in range(20):
        half = path_of(fingers, np.array([load_N / 2]), onset_split).joint_rad
        moving = [(q[0] < finger.upper_rad)[list(finger.joint_index)] for finger, q in zip(fingers, half, strict=True)]
        if np.any(moving):
            break
        load_N /= 2
    return load_N


def _roots(closing: _Closing, path: ClosingPath) -> list[float]:
    """Loads at which the equation holds, lowest first."""
    values = closing.residuals(path)
    if not any(closing.pads):
        crossed = (values[:-1] > 0) & (values[1:] <= 0)
    else:
        crossed = (np.sign(values[:-1]) * np.sign(values[1:]) <= 0) & (np.abs(np.diff(values)) < 1.0)
    return [
        float(brentq(closing.residual, path.load_N[index], path.load_N[index + 1], xtol=1e-14, rtol=1e-15))
        for index in np.flatnonzero(crossed & (values[:-1] != 0))
    ]


def _touches(closing: _Closing, load_N: float) -> bool:
    """Whether every fingertip touches with the part that `closing` says."""
    here = closing.along(np.array([load_N]))
    for index, (finger, pad) in enumerate(zip(closing.fingers, closing.pads, strict=True)):
        if finger.pad is None:
            continue
        if pad and not 0 <= closing.down_pad_m(here)[index] <= finger.pad.length_m:
            return False
        if not pad and closing.past_pad_rad(here, index) < 0:
            return False
    return True


def _pads_refuse(grasp: GraspSpec) -> MechanicsError:
    return MechanicsError(
        "object_offset_m",
        f"with the centre {grasp.object_offset_m * 1e3:.1f} mm off the line between the contacts, the fingers' "
        "flat pads do not face the object where they would have to touch it.",
        help="Shift the object, take another size, or fingertips without pads (pad_length_m = 0).",
    )


def _out_of_reach(path: ClosingPath, arcs: _Closing, cap_N: float) -> MechanicsError:
    """Why the fingertips never come as near to each other as the object asks."""
    width = f"a width of {abs(arcs.ends[0].point - arcs.ends[1].point) * 1e3:.1f} mm"
    gap_m = arcs.residuals(path)
    if gap_m[0] <= 0:
        return MechanicsError(
            "object.shape", f"{width} does not fit between the open fingers.", help="Take a narrower object."
        )
    nearest = int(np.argmin(gap_m))
    short = f"without touching {width}; they come within {gap_m[nearest] * 1e3:.1f} mm of it"
    stopped = [
        side
        for side, finger, q in zip(SIDES, arcs.fingers, path.joint_rad, strict=True)
        if np.any(q[nearest] >= finger.upper_rad)
    ]
    if stopped:
        return MechanicsError(
            "onset_split" if arcs.onset_split else "object.shape",
            f"the {' and '.join(stopped)} finger meets a stop {short}.",
            help="Take a wider object or a smaller onset split.",
        )
    if nearest < gap_m.size - 1:
        return MechanicsError(
            "onset_split" if arcs.onset_split else "object.shape",
            f"the fingers close past each other {short}.",
            help="Take a wider object or a smaller onset split.",
        )
    return MechanicsError(
        "load_cap_N",
        f"the fingers close freely up to {cap_N:.1f} N mean load {short}.",
        help="Take a wider object, a smaller onset split or a higher load cap.",
    )
