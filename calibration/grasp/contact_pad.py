"""The fingertip's flat pad on a round outline, and the whole fingertip: pad and arc with the change between them.

In the pad's frame (x axis its outward normal, angle ν) let y = (o − c) e^{−iν}, c the arc's centre, o the object's
reference point. The outline's point that faces the pad has the normal angle ψ = ν + π − θ − outline angle, linear in
the unknowns, and with the support function h

    g_n = Re y − ρ − h(ψ),   g_t = Im y + ∫ h dψ − const,   travelled down the pad: s (Im y − h'(ψ)),

since what h' takes from the place on the pad it gives to the arc on the object. At the junction with the arc the latter
is 0, and value and gradient of both kinds of contact agree there. Source: hand-mechanics reference 5.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calibration.grasp.contact_arc import ArcOnRound, facing_pad
from calibration.grasp.contact_frame import Frame, arc_centre, arc_centre_along, pad_frame
from calibration.grasp.contact_jet import ConstraintJet
from calibration.hand.finger import Complexes, FingerModel, Reals
from calibration.objects.support import SupportFunction


@dataclass(frozen=True)
class PadOnRound:
    """Flat pad, taken as endless, on a smooth convex outline turned by `outline_angle_rad` in the object's axes."""

    finger: FingerModel
    support: SupportFunction
    outline_angle_rad: float
    rolling_m: float = 0.0
    """What g_t is measured from; the same constant as of the arc's contact."""

    def at(self, q: Reals, pose: Reals) -> ConstraintJet:
        centre = arc_centre(self._frame, self.finger, q, pose)
        row = self._facing.row
        travelled, h, h_1, h_2 = self.support.derivatives(self._facing.angle_at(q, pose), 2)
        value = np.stack([-centre.value.real, -centre.value.imag], axis=1)
        value[:, 0] -= self.finger.tip_radius_m + h
        value[:, 1] += travelled - self.rolling_m
        gradient = np.stack([-centre.gradient.real, -centre.gradient.imag], axis=1)
        gradient += np.stack([-h_1, h], axis=1)[:, :, None] * row
        hessian = np.stack([-centre.hessian.real, -centre.hessian.imag], axis=1)
        hessian += np.stack([-h_2, h_1], axis=1)[:, :, None, None] * np.outer(row, row)
        return ConstraintJet(value, gradient, hessian)

    def third(self, q: Reals, pose: Reals, u: Reals, v: Reals) -> Reals:
        along = arc_centre_along(self._frame, self.finger, q, pose, u, v)
        row = self._facing.row
        h_2, h_3 = self.support.derivatives(self._facing.angle_at(q, pose), 3)[3:]
        turned = (u @ row) * (v @ row)
        third = np.stack([-along.third.real, -along.third.imag], axis=1)
        third += (np.stack([-h_3, h_2], axis=1) * turned[:, None])[:, :, None] * row
        return third

    def contact_point(self, q: Reals, pose: Reals) -> Complexes:
        """On the pad."""
        down = -1j * self.finger.links[1].inner_side * self.normal(q, pose)
        place = self.finger.tip.at(q).value + self.finger.tip_radius_m * self.normal(q, pose)
        return np.asarray(place - down * self.down_pad_m(q, pose), np.complex128)

    def normal(self, q: Reals, pose: Reals) -> Complexes:
        return np.asarray(np.exp(1j * self._frame.angle_at(q, pose)), np.complex128)

    def features(self, q: Reals, pose: Reals) -> dict[str, Reals]:
        return {}

    def down_pad_m(self, q: Reals, pose: Reals) -> Reals:
        """Distance of the contact from the arc's foot towards the finger's root, m; < 0 beyond the junction; (B,)."""
        place = (pose[:, 0] + 1j * pose[:, 1] - self.finger.tip.at(q).value) * self.normal(q, pose).conj()
        slope = self.support.derivatives(self._facing.angle_at(q, pose), 1)[2]
        down: Reals = self.finger.links[1].inner_side * (place.imag - slope)
        return down

    @cached_property
    def _frame(self) -> Frame:
        return pad_frame(self.finger)

    @cached_property
    def _facing(self) -> Frame:
        return facing_pad(self.finger, self.outline_angle_rad)


@dataclass(frozen=True)
class TipOnRound:
    """Pad of the length `pad_length_m` and arc: every state is a contact of the one or the other."""

    arc: ArcOnRound
    pad: PadOnRound
    pad_length_m: float

    def starting_at(self, q: Reals, pose: Reals) -> TipOnRound:
        """This contact with g_t = 0 at `q` (n,), `pose` (3,)."""
        rolling_m = self.arc.rolling_m + float(self.at(q[None], pose[None]).value[0, 1])
        return replace(self, arc=replace(self.arc, rolling_m=rolling_m), pad=replace(self.pad, rolling_m=rolling_m))

    def at(self, q: Reals, pose: Reals) -> ConstraintJet:
        on_pad = self.pad.down_pad_m(q, pose) > 0
        if on_pad.all() or not on_pad.any():
            return (self.pad if on_pad.all() else self.arc).at(q, pose)
        batch, size = q.shape[0], q.shape[1] + 3
        whole = ConstraintJet(np.empty((batch, 2)), np.empty((batch, 2, size)), np.empty((batch, 2, size, size)))
        for contact, chosen in ((self.pad, on_pad), (self.arc, ~on_pad)):
            jet = contact.at(q[chosen], pose[chosen])
            whole.value[chosen], whole.gradient[chosen], whole.hessian[chosen] = jet.value, jet.gradient, jet.hessian
        return whole

    def third(self, q: Reals, pose: Reals, u: Reals, v: Reals) -> Reals:
        on_pad = self.pad.down_pad_m(q, pose) > 0
        return np.where(on_pad[:, None, None], self.pad.third(q, pose, u, v), self.arc.third(q, pose, u, v))

    def contact_point(self, q: Reals, pose: Reals) -> Complexes:
        on_pad = self.pad.down_pad_m(q, pose) > 0
        return np.where(on_pad, self.pad.contact_point(q, pose), self.arc.contact_point(q, pose))

    def normal(self, q: Reals, pose: Reals) -> Complexes:
        on_pad = self.pad.down_pad_m(q, pose) > 0
        return np.where(on_pad, self.pad.normal(q, pose), self.arc.normal(q, pose))

    def features(self, q: Reals, pose: Reals) -> dict[str, Reals]:
        """ "pad end": from the contact to the end of the pad nearer the finger's root, along the fingertip's outline
        where the contact is on the pad, at least the pad's length where it is on the arc."""
        return {"pad end": self.pad_length_m - self.pad.down_pad_m(q, pose)}
