"""Where the fingertip's arc stands, seen in a frame that turns with the object or with the finger, with derivatives.

Unknowns z = [q, x, y, θ]: the finger's n coordinates, then the object's pose. Any frame here turns by an angle that is
linear in z, χ = χ_0 + b z, and has its origin at the object's reference point o. With D = c − o (c the arc's centre)

    w = D e^{−iχ},   ∂_u w = (∂_u D − i b_u D) e^{−iχ},   and so on.

The pad's outward normal has the angle φ + s π/2, φ that of the distal link and s = +1 right, −1 left: the inner side of
a finger. Hand frame, m, rad. Source: hand-mechanics reference 5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.hand.finger import Complexes, FingerModel, PointJet, Reals


@dataclass(frozen=True)
class Frame:
    """Frame at the angle `angle_rad` + `row` z; `row` (n + 3,)."""

    angle_rad: float
    row: Reals

    def angle_at(self, q: Reals, pose: Reals) -> Reals:
        """Angle from the hand's x axis, rad; (B,)."""
        n = q.shape[1]
        angle: Reals = self.angle_rad + q @ self.row[:n] + pose @ self.row[n:]
        return angle


@dataclass(frozen=True)
class DirectedJet:
    """Derivatives of w along two directions u, v: `gradient` ∇w, `along_u` ∂_u∇w, `along_v`, `third` ∂_u∂_v∇w, all
    (B, n + 3); `value` w and `both` ∂_u∂_v w (B,)."""

    value: Complexes
    gradient: Complexes
    along_u: Complexes
    along_v: Complexes
    both: Complexes
    third: Complexes

    def turned(self, unit: Complexes) -> DirectedJet:
        """All of it times `unit` (B,)."""
        one = unit[:, None]
        return DirectedJet(
            self.value * unit,
            self.gradient * one,
            self.along_u * one,
            self.along_v * one,
            self.both * unit,
            self.third * one,
        )


def object_frame(finger: FingerModel, angle_rad: float) -> Frame:
    """Turns with the object; `angle_rad` at θ = 0."""
    row = np.zeros(finger.angle_row.size + 3)
    row[-1] = 1.0
    return Frame(angle_rad, row)


def pad_frame(finger: FingerModel) -> Frame:
    """Turns with the distal link; its x axis is the pad's outward normal."""
    angle = finger.angle_rad + finger.links[1].inner_side * np.pi / 2
    return Frame(float(angle), np.concatenate([finger.angle_row, np.zeros(3)]))


def arc_centre(frame: Frame, finger: FingerModel, q: Reals, pose: Reals) -> PointJet:
    """w at `q` (B, n) and `pose` (B, 3): value (B,), gradient (B, n + 3), Hessian (B, n + 3, n + 3)."""
    tip = finger.tip.at(q)
    batch, n = tip.gradient.shape
    unit = np.exp(-1j * frame.angle_at(q, pose))
    value = (tip.value - pose[:, 0] - 1j * pose[:, 1]) * unit
    gradient = _gradient(tip.gradient, frame, value, unit)
    hessian = np.zeros((batch, n + 3, n + 3), complex)
    hessian[:, :n, :n] = tip.hessian * unit[:, None, None]
    turning = np.flatnonzero(frame.row)
    for index in turning:
        leaning = 1j * frame.row[index] * gradient
        hessian[:, index, :] -= leaning
        hessian[:, :, index] -= leaning
    for first in turning:
        for second in turning:
            hessian[:, first, second] += frame.row[first] * frame.row[second] * value
    return PointJet(value, gradient, hessian)


def arc_centre_along(frame: Frame, finger: FingerModel, q: Reals, pose: Reals, u: Reals, v: Reals) -> DirectedJet:
    """w and its derivatives along `u` and `v` (B, n + 3)."""
    n, row = q.shape[1], frame.row
    jet = arc_centre(frame, finger, q, pose)
    unit = np.exp(-1j * frame.angle_at(q, pose))
    along_u, along_v = (np.asarray((jet.hessian @ w[:, :, None])[:, :, 0], np.complex128) for w in (u, v))
    both = (along_u * v).sum(1)
    turn_u, turn_v = 1j * (u @ row), 1j * (v @ row)
    still = jet.gradient + 1j * row * jet.value[:, None]
    steady_u, steady_v = ((still * w).sum(1) for w in (u, v))
    bent = np.asarray((finger.tip.at(q).hessian * unit[:, None, None]), np.complex128)
    bent_u, bent_v = (np.zeros_like(jet.gradient) for _ in range(2))
    bent_u[:, :n], bent_v[:, :n] = ((bent @ w[:, :n, None])[:, :, 0] for w in (u, v))
    bent_both = (bent_u * v).sum(1)
    third = np.zeros_like(jet.gradient)
    third[:, :n] = finger.tip.third(q, u[:, :n], v[:, :n]) * unit[:, None]
    third -= 1j * row * bent_both[:, None] + turn_u[:, None] * bent_v + turn_v[:, None] * bent_u
    third += (turn_u * turn_v)[:, None] * still
    third += 1j * row * (turn_u * steady_v + turn_v * steady_u - turn_u * turn_v * jet.value)[:, None]
    return DirectedJet(jet.value, jet.gradient, along_u, along_v, both, third)


def _gradient(slope: Complexes, frame: Frame, value: Complexes, unit: Complexes) -> Complexes:
    """∇w from the tip's `slope` (B, n) and w itself."""
    n = slope.shape[1]
    gradient = np.empty((value.size, n + 3), complex)
    gradient[:, :n] = slope * unit[:, None]
    gradient[:, n] = -unit
    gradient[:, n + 1] = -1j * unit
    gradient[:, n + 2] = 0.0
    gradient -= 1j * frame.row * value[:, None]
    return gradient
