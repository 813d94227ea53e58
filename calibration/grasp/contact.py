"""Rolling contact of a fingertip on the object: two holonomic constraints with exact derivatives.

Gap g_n = 0 and no-slip rolling g_t = 0, lengths in m, in the closing plane of the hand frame. Multipliers λ give the
force on the object: N = −λ_n along the normal n from fingertip to object, f_t = −λ_t along t = i n. The rolling
constant is taken at first contact. Other shapes are further classes with the same methods. Source: hand-mechanics
reference 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from calibration.hand.finger import Complexes, FingerModel, PointJet, Reals
from calibration.objects import Disc, Shape, Sphere


@dataclass(frozen=True)
class ConstraintJet:
    """g = (g_n, g_t) at B configurations: value (B, 2), gradient (B, 2, n + 3), Hessian (B, 2, n + 3, n + 3)."""

    value: Reals
    gradient: Reals
    hessian: Reals


class RollingContact(Protocol):
    """One fingertip on one outline; unknowns are the finger's n coordinates, then the object's x, y, θ."""

    def at(self, q: Reals, pose: Reals) -> ConstraintJet:
        """Constraints at `q` (B, n) rad and `pose` (B, 3) m, m, rad."""
        ...

    def third(self, q: Reals, pose: Reals, u: Reals, v: Reals) -> Reals:
        """∂_u ∂_v ∇g: third derivative with directions `u`, `v` (B, n + 3) put in; (B, 2, n + 3)."""
        ...


@dataclass(frozen=True)
class ArcOnDisc:
    """Arc tip (radius ρ) on a disc (radius R): with D = R + ρ and ζ = object centre − arc centre, both constraints are
    parts of D log ζ: g_n = D ln(|ζ|/D), g_t = D arg ζ − ρ φ − R θ − const."""

    finger: FingerModel
    disc_radius_m: float
    reference: complex
    """Unit direction of ζ at first contact; arg is taken relative to it, so that it never wraps."""
    rolling_m: float
    """ρ φ at first contact, where the object's θ is 0."""

    @property
    def centre_distance_m(self) -> float:
        """D = R + ρ, m."""
        return self.disc_radius_m + self.finger.tip_radius_m

    def at(self, q: Reals, pose: Reals) -> ConstraintJet:
        n, D = q.shape[1], self.centre_distance_m
        zeta, d_zeta, dd_zeta = self._zeta(self.finger.tip.at(q), pose)
        logarithm: Complexes = np.asarray(D * np.log(zeta / (D * self.reference)), np.complex128)
        gradient: Complexes = D * d_zeta / zeta[:, None]
        hessian: Complexes = D * dd_zeta / zeta[:, None, None]
        hessian -= gradient[:, :, None] * gradient[:, None, :] / D
        rho, angle = self.finger.tip_radius_m, self.finger.angle_rad + q @ self.finger.angle_row
        value = _parts(logarithm)
        value[:, 1] -= rho * angle - self.rolling_m + self.disc_radius_m * pose[:, 2]
        slope = _parts(gradient)
        slope[:, 1, :n] -= rho * self.finger.angle_row
        slope[:, 1, n + 2] -= self.disc_radius_m
        return ConstraintJet(value, slope, _parts(hessian))

    def third(self, q: Reals, pose: Reals, u: Reals, v: Reals) -> Reals:
        n, D = q.shape[1], self.centre_distance_m
        zeta, d_zeta, dd_zeta = self._zeta(self.finger.tip.at(q), pose)
        inverse = 1 / zeta
        along_u, along_v = np.einsum("bj,bj->b", d_zeta, u), np.einsum("bj,bj->b", d_zeta, v)
        slope_u, slope_v = np.einsum("bjk,bk->bj", dd_zeta, u), np.einsum("bjk,bk->bj", dd_zeta, v)
        mixed = np.einsum("bj,bj->b", slope_u, v)
        directed = np.zeros_like(d_zeta)
        directed[:, :n] = -self.finger.tip.third(q, u[:, :n], v[:, :n])
        first = directed * inverse[:, None]
        second = mixed[:, None] * d_zeta + along_u[:, None] * slope_v + along_v[:, None] * slope_u
        last = 2 * (along_u * along_v)[:, None] * d_zeta
        return _parts(D * (first - second * (inverse**2)[:, None] + last * (inverse**3)[:, None]))

    def _zeta(self, tip: PointJet, pose: Reals) -> tuple[Complexes, Complexes, Complexes]:
        size, n = tip.gradient.shape
        gradient = np.zeros((size, n + 3), complex)
        gradient[:, :n], gradient[:, n], gradient[:, n + 1] = -tip.gradient, 1, 1j
        hessian = np.zeros((size, n + 3, n + 3), complex)
        hessian[:, :n, :n] = -tip.hessian
        return pose[:, 0] + 1j * pose[:, 1] - tip.value, gradient, hessian


def rolling_contact(finger: FingerModel, shape: Shape, q: Reals, pose: Reals) -> RollingContact:
    """Contact of `finger` on `shape` that first touches at coordinates `q` (n,) and object pose `pose` (3,), θ = 0."""
    assert isinstance(shape, Disc | Sphere)
    zeta = complex(pose[0], pose[1]) - complex(finger.tip.at(q[None, :]).value[0])
    angle = finger.angle_rad + float(q @ finger.angle_row)
    return ArcOnDisc(finger, shape.radius_m, zeta / abs(zeta), finger.tip_radius_m * angle)


def _parts(values: Complexes) -> Reals:
    """Real and imaginary part as a new second axis."""
    return np.stack([values.real, values.imag], axis=1)
