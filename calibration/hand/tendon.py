"""Tendon excursion over the two joints of a finger, with exact derivatives.

Two laws for each joint. At a constant offset r (or on a pulley of radius r) a joint's turn Δθ takes up r Δθ exactly,
whatever the shape of a flexure. A straight run between a guide before the joint and one behind it takes up the loss of
their distance, |w(0)| − |w(q)|: the guides of a flexure stand at its ends, those of a pin `before_m` and `after_m` from
it, all at offset r from the joint's axis at rest. m, rad; excursion positive when taken up. Source: hand-mechanics
reference 4.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from calibration.hand.bundle import Bundle, Reals
from calibration.hand.joints import JointModel


@dataclass(frozen=True)
class ExcursionJet:
    """Excursion over one joint at B configurations: value (B,), gradient (B, n), Hessian (B, n, n)."""

    value: Reals
    gradient: Reals
    hessian: Reals


class TendonLaw(Protocol):
    """Excursion over one joint as a function of the coordinates q (B, n) of the finger (or of the joint alone)."""

    @property
    def linear(self) -> bool:
        """Whether the excursion is linear in q."""
        ...

    def at(self, q: Reals) -> ExcursionJet:
        """Excursion since rest, with derivatives."""
        ...

    def third(self, q: Reals, u: Reals, v: Reals) -> Reals:
        """∂_u ∂_v ∇l with directions `u`, `v` (B, n) put in; (B, n)."""
        ...


@dataclass(frozen=True)
class ConstantOffset:
    """l = `row` · q; `row` (n,) m/rad."""

    row: Reals

    @property
    def linear(self) -> bool:
        return True

    def at(self, q: Reals) -> ExcursionJet:
        size, n = q.shape
        return ExcursionJet(q @ self.row, np.broadcast_to(self.row, (size, n)), np.zeros((size, n, n)))

    def third(self, q: Reals, u: Reals, v: Reals) -> Reals:
        return np.zeros_like(q)


@dataclass(frozen=True)
class StraightRun:
    """l = |w(0)| − |w(q)|, w = `run`, from the guide before the joint to the one behind it.

    Valid up to where the guides meet or pull in line with the pin; parameter files keep the stops inside
    (`parameters.Finger`). At w = 0 the derivatives do not exist.
    """

    run: Bundle

    @property
    def linear(self) -> bool:
        return False

    @cached_property
    def rest_m(self) -> float:
        """Distance of the guides at rest, |w(0)|."""
        return abs(complex(self.run.at(np.zeros((1, self.run.coordinates.shape[1]))).value[0]))

    def at(self, q: Reals) -> ExcursionJet:
        value, gradient, hessian = self._length(q)
        return ExcursionJet(self.rest_m - value, -gradient, -hessian)

    def third(self, q: Reals, u: Reals, v: Reals) -> Reals:
        # From |w|² = Re(w̄ w), differentiated three times on both sides.
        w, third_w = self.run.at(q), self.run.third(q, u, v)
        value, gradient, hessian = self._length(q)
        w_u, w_v = np.einsum("bj,bj->b", w.gradient, u), np.einsum("bj,bj->b", w.gradient, v)
        slope_u, slope_v = np.einsum("bjk,bk->bj", w.hessian, u), np.einsum("bjk,bk->bj", w.hessian, v)
        w_uv = np.einsum("bj,bj->b", slope_u, v)
        square: Reals = (
            w_uv.conj()[:, None] * w.gradient
            + w_v.conj()[:, None] * slope_u
            + w_u.conj()[:, None] * slope_v
            + w.value.conj()[:, None] * third_w
        ).real
        length_u, length_v = np.einsum("bj,bj->b", gradient, u), np.einsum("bj,bj->b", gradient, v)
        bend_u, bend_v = np.einsum("bjk,bk->bj", hessian, u), np.einsum("bjk,bk->bj", hessian, v)
        length_uv = np.einsum("bj,bj->b", bend_u, v)
        square -= length_uv[:, None] * gradient + length_v[:, None] * bend_u + length_u[:, None] * bend_v
        return -square / value[:, None]

    def _length(self, q: Reals) -> tuple[Reals, Reals, Reals]:
        """|w| with its gradient and Hessian."""
        w = self.run.at(q)
        length: Reals = np.abs(w.value)
        gradient: Reals = (w.value.conj()[:, None] * w.gradient).real / length[:, None]
        hessian: Reals = (
            w.gradient.conj()[:, :, None] * w.gradient[:, None, :] + w.value.conj()[:, None, None] * w.hessian
        ).real
        hessian -= gradient[:, :, None] * gradient[:, None, :]
        return length, gradient, hessian / length[:, None, None]


def constant_offset(joint: JointModel, offset_m: float) -> ConstantOffset:
    """Law of a tendon at a constant distance from the joint's axis, in the joint's own coordinates."""
    return ConstantOffset(offset_m * joint.angle_row)


def straight_run(joint: JointModel, offset_m: float, before_m: float = 0.0, after_m: float = 0.0) -> StraightRun:
    """Law of a tendon that runs straight past the joint, in the joint's own coordinates."""
    before, after = complex(-before_m, offset_m), complex(after_m, offset_m)
    end = joint.bend.with_arm(after, 0.0, joint.angle_row)
    return StraightRun(Bundle(end.origin - before, end.weights, end.phases, end.coordinates))


@dataclass(frozen=True)
class TendonJet:
    """Excursion at B configurations over (proximal, distal) joint: value (B, 2), gradient (B, 2, n), Hessian
    (B, 2, n, n); m, rad."""

    value: Reals
    gradient: Reals
    hessian: Reals


@dataclass(frozen=True)
class TendonModel:
    """One tendon over both joints of a finger with n coordinates. Its finger-side excursion is the sum over both."""

    laws: tuple[TendonLaw, TendonLaw]
    """Proximal, distal; each in its own joint's coordinates."""
    parts: tuple[slice, slice]
    """Where those stand among the finger's."""

    @property
    def linear(self) -> bool:
        """Whether the excursion is linear in the coordinates; all Hessians are 0 then."""
        return all(law.linear for law in self.laws)

    def at(self, q: Reals) -> TendonJet:
        """Excursion since rest taken up at each joint, at `q` (B, n)."""
        size, n = q.shape
        value, gradient, hessian = np.zeros((size, 2)), np.zeros((size, 2, n)), np.zeros((size, 2, n, n))
        for index, (law, part) in enumerate(zip(self.laws, self.parts, strict=True)):
            jet = law.at(q[:, part])
            value[:, index], gradient[:, index, part] = jet.value, jet.gradient
            hessian[:, index, part, part] = jet.hessian
        return TendonJet(value, gradient, hessian)

    def third(self, q: Reals, u: Reals, v: Reals) -> Reals:
        """∂_u ∂_v ∇ of each joint's excursion with directions `u`, `v` (B, n) put in; (B, 2, n)."""
        result = np.zeros((q.shape[0], 2, q.shape[1]))
        for index, (law, part) in enumerate(zip(self.laws, self.parts, strict=True)):
            result[:, index, part] = law.third(q[:, part], u[:, part], v[:, part])
        return result
