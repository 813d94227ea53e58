"""The fingertip's arc (radius ρ, 0 for a point) on a round outline or on a flat side.

On a round outline with support function h(ψ) the arc's centre has curvilinear coordinates (ψ, d): it stands d off the
outline's point with normal angle ψ. With r = h + h'' and directions resolved along normal (n) and tangent (t) there,

    ∂_u d = u_n,  ∂_u ψ = u_t/(r + d),   g_n = d − ρ,   g_t = ∫ r dψ + ρ (ψ − ψ_pad) − const,

ψ_pad being the outline's normal angle that faces the fingertip's pad, so that ρ (ψ − ψ_pad) is the arc travelled on the
fingertip. On a flat side ψ is fixed. Source: hand-mechanics reference 5; higher derivatives by the moving frame
∂_u n = t ∂_u ψ.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calibration.grasp.contact_frame import (
    Frame,
    arc_centre,
    arc_centre_along,
    object_frame,
    pad_frame,
)
from calibration.grasp.contact_jet import ConstraintJet
from calibration.hand.finger import Complexes, FingerModel, Reals
from calibration.objects.polygon import Side
from calibration.objects.support import SupportFunction


@dataclass(frozen=True)
class ArcOnRound:
    """Arc on a smooth convex outline, which is turned by `outline_angle_rad` in the object's axes."""

    finger: FingerModel
    support: SupportFunction
    outline_angle_rad: float
    rolling_m: float = 0.0
    """What g_t is measured from."""

    def starting_at(self, q: Reals, pose: Reals) -> ArcOnRound:
        """This contact with g_t = 0 at `q` (n,), `pose` (3,)."""
        return replace(self, rolling_m=self.rolling_m + float(self.at(q[None], pose[None]).value[0, 1]))

    def at(self, q: Reals, pose: Reals) -> ConstraintJet:
        rho, row = self.finger.tip_radius_m, self._pad_row
        centre = arc_centre(self._frame, self.finger, q, pose)
        psi, past_pad = self._normal_angle(centre.value, q, pose)
        travelled, h, h_1, h_2, h_3 = self.support.derivatives(psi, 3)
        unit = np.exp(-1j * psi)
        slope, curve = centre.gradient * unit[:, None], centre.hessian * unit[:, None, None]
        arm = (centre.value * unit).real + h_2
        turn = slope.imag / arm[:, None]
        reach, r_1 = (h + h_2 + rho)[:, None], (h_1 + h_3)[:, None, None]

        value = np.empty((psi.size, 2))
        value[:, 0] = arm - h_2 - h - rho
        value[:, 1] = h_1 + travelled + rho * past_pad - self.rolling_m
        gradient = np.empty((psi.size, 2, row.size))
        gradient[:, 0] = slope.real
        gradient[:, 1] = reach * turn - rho * row
        hessian = np.empty((psi.size, 2, row.size, row.size))
        turns = turn[:, :, None] * turn[:, None, :]
        lifted = slope.real[:, :, None] * turn[:, None, :]
        hessian[:, 0] = curve.real + arm[:, None, None] * turns
        hessian[:, 1] = curve.imag - lifted - lifted.transpose(0, 2, 1)
        if not self.support.constant:
            hessian[:, 1] -= r_1 * turns
        hessian[:, 1] *= reach[:, :, None] / arm[:, None, None]
        if not self.support.constant:
            hessian[:, 1] += r_1 * turns
        return ConstraintJet(value, gradient, hessian)

    def third(self, q: Reals, pose: Reals, u: Reals, v: Reals) -> Reals:
        along = arc_centre_along(self._frame, self.finger, q, pose, u, v)
        psi, _ = self._normal_angle(along.value, q, pose)
        _, h, h_1, h_2, h_3, h_4 = self.support.derivatives(psi, 4)
        along = along.turned(np.exp(-1j * psi))
        arm = (along.value.real + h_2)[:, None]
        r_1, r_2 = (h_1 + h_3)[:, None], (h_2 + h_4)[:, None]
        u_n, u_t = _parts(along.gradient, u)
        v_n, v_t = _parts(along.gradient, v)
        both_n, both_t = along.both.real[:, None], along.both.imag[:, None]
        normal, turn = along.gradient.real, along.gradient.imag / arm
        turn_u, turn_v = u_t / arm, v_t / arm
        # ψ differentiated twice, along u and j, v and j, u and v; j stands for each unknown
        turn_uj = (along.along_u.imag - u_n * turn - normal * turn_u - r_1 * turn_u * turn) / arm
        turn_vj = (along.along_v.imag - v_n * turn - normal * turn_v - r_1 * turn_v * turn) / arm
        turn_uv = (both_t - u_n * turn_v - v_n * turn_u - r_1 * turn_u * turn_v) / arm
        third = along.third.imag - both_n * turn
        third -= (along.along_u.real + u_t * turn) * turn_v + u_n * turn_vj
        third -= (along.along_v.real + v_t * turn) * turn_u + v_n * turn_uj
        third -= r_2 * turn * turn_u * turn_v + r_1 * (turn_uj * turn_v + turn_u * turn_vj)
        third -= (r_1 * turn + normal) * turn_uv
        result = np.empty((psi.size, 2, turn.shape[1]))
        result[:, 0] = along.third.real + both_t * turn + (along.along_u.imag - u_n * turn) * turn_v + u_t * turn_vj
        result[:, 1] = (h + h_2 + self.finger.tip_radius_m)[:, None] * third / arm
        result[:, 1] += r_1 * (turn_uv * turn + turn_uj * turn_v + turn_vj * turn_u) + r_2 * turn * turn_u * turn_v
        return result

    def contact_point(self, q: Reals, pose: Reals) -> Complexes:
        """On the fingertip."""
        return np.asarray(self.finger.tip.at(q).value + self.finger.tip_radius_m * self.normal(q, pose), np.complex128)

    def normal(self, q: Reals, pose: Reals) -> Complexes:
        angle = self._frame.angle_at(q, pose)
        place = (self.finger.tip.at(q).value - pose[:, 0] - 1j * pose[:, 1]) * np.exp(-1j * angle)
        return np.asarray(-np.exp(1j * (angle + self.support.foot(place))), np.complex128)

    def features(self, q: Reals, pose: Reals) -> dict[str, Reals]:
        return {}

    def _normal_angle(self, place: Complexes, q: Reals, pose: Reals) -> tuple[Reals, Reals]:
        """ψ, unwrapped next to ψ_pad, and ψ − ψ_pad; (B,)."""
        facing = facing_pad(self.finger, self.outline_angle_rad).angle_at(q, pose)
        past_pad: Reals = np.angle(np.exp(1j * (self.support.foot(place) - facing)))
        return facing + past_pad, past_pad

    @cached_property
    def _frame(self) -> Frame:
        return object_frame(self.finger, self.outline_angle_rad)

    @cached_property
    def _pad_row(self) -> Reals:
        return facing_pad(self.finger, self.outline_angle_rad).row


@dataclass(frozen=True)
class ArcOnSide:
    """Arc on a flat side. Where the finger has a pad, the arc's contact ends when the pad lies on the side."""

    finger: FingerModel
    side: Side
    outline_angle_rad: float
    pad_length_m: float = 0.0
    rolling_m: float = 0.0

    def starting_at(self, q: Reals, pose: Reals) -> ArcOnSide:
        """This contact with g_t = 0 at `q` (n,), `pose` (3,)."""
        return replace(self, rolling_m=self.rolling_m + float(self.at(q[None], pose[None]).value[0, 1]))

    def at(self, q: Reals, pose: Reals) -> ConstraintJet:
        rho, facing = self.finger.tip_radius_m, self._facing
        centre = arc_centre(self._frame, self.finger, q, pose)
        value = _two(centre.value)
        value[:, 0] -= self.side.distance_m + rho
        value[:, 1] += rho * (self.side.angle_rad - facing.angle_at(q, pose)) - self.rolling_m
        gradient = _two(centre.gradient)
        gradient[:, 1] -= rho * facing.row
        return ConstraintJet(value, gradient, _two(centre.hessian))

    def third(self, q: Reals, pose: Reals, u: Reals, v: Reals) -> Reals:
        return _two(arc_centre_along(self._frame, self.finger, q, pose, u, v).third)

    def contact_point(self, q: Reals, pose: Reals) -> Complexes:
        """On the fingertip."""
        return np.asarray(self.finger.tip.at(q).value + self.finger.tip_radius_m * self.normal(q, pose), np.complex128)

    def normal(self, q: Reals, pose: Reals) -> Complexes:
        return np.asarray(-np.exp(1j * self._frame.angle_at(q, pose)), np.complex128)

    def features(self, q: Reals, pose: Reals) -> dict[str, Reals]:
        """ "side end": the contact from the side's nearer end; "pad lies flat": the pad's far end from the side."""
        place = ((self.finger.tip.at(q).value - pose[:, 0] - 1j * pose[:, 1]) * -self.normal(q, pose).conj()).imag
        margins: dict[str, Reals] = {"side end": np.minimum(place - self.side.start_m, self.side.end_m - place)}
        if self.pad_length_m > 0:
            leaning = self._facing.angle_at(q, pose) - self.side.angle_rad
            margins["pad lies flat"] = self.pad_length_m * np.sin(self.finger.links[1].inner_side * leaning)
        return margins

    @cached_property
    def _frame(self) -> Frame:
        return object_frame(self.finger, self.outline_angle_rad + self.side.angle_rad)

    @cached_property
    def _facing(self) -> Frame:
        return facing_pad(self.finger, self.outline_angle_rad)


def facing_pad(finger: FingerModel, outline_angle_rad: float) -> Frame:
    """ψ_pad as a frame: angle, in the outline's axes, of the outward normal that is opposite to the pad's."""
    pad, turn = pad_frame(finger), object_frame(finger, outline_angle_rad)
    return Frame(pad.angle_rad + np.pi - turn.angle_rad, pad.row - turn.row)


def _parts(gradient: Complexes, direction: Reals) -> tuple[Reals, Reals]:
    """Normal and tangential part of the derivative along `direction`; (B, 1) each."""
    along = (gradient * direction).sum(1, keepdims=True)
    return along.real, along.imag


def _two(values: Complexes) -> Reals:
    """Real and imaginary part as a new second axis."""
    return np.stack([values.real, values.imag], axis=1)
