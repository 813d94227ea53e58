"""Smooth convex outlines by their support function.

h(ψ) = c_0 + Σ_k (c_k cos kψ + s_k sin kψ) is the distance, m, of the tangent line with outward normal n = e^{iψ} from
the reference point. The outline's point there is p = (h + i h') n, its radius of curvature r = h + h'' > 0, and the arc
travelled counter-clockwise is ∫ r dψ = h' + ∫ h dψ, so that rolling needs no quadrature. A disc is the constant h = R.
Angles ψ are counter-clockwise from the outline's own x axis, rad. Source: hand-mechanics reference 5; the relations are
those of any plane convex curve.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
Complexes = NDArray[np.complex128]

NODES = 4096
"""Nodes of the periodic trapezoid rule; exact for polynomials in cos ψ, sin ψ of as high a degree."""
COARSE = 64
FOOT_STEPS = 12


@dataclass(frozen=True)
class SupportFunction:
    """Coefficients `cos_m` (c_0, c_1, …) and `sin_m` (s_1, s_2, …), m."""

    cos_m: tuple[float, ...]
    sin_m: tuple[float, ...] = ()

    @property
    def constant(self) -> bool:
        """True for a circle about the reference point."""
        return not any(self.cos_m[1:]) and not any(self.sin_m)

    @cached_property
    def _harmonics(self) -> tuple[Reals, Complexes]:
        """Orders k ≥ 1 and amplitudes a_k with h = c_0 + Re Σ a_k e^{ikψ}."""
        order = max(len(self.cos_m) - 1, len(self.sin_m))
        amplitudes = np.zeros(order, complex)
        amplitudes[: len(self.cos_m) - 1] += self.cos_m[1:]
        amplitudes[: len(self.sin_m)] -= 1j * np.array(self.sin_m)
        present = np.flatnonzero(amplitudes)
        orders = np.asarray(present + 1, np.float64)
        return orders, amplitudes[present]

    def derivatives(self, psi: Reals, highest: int) -> list[Reals]:
        """[H, h, h', …] with H = ∫_0^ψ h and derivatives of h up to `highest`, each of the shape (B,) of `psi`, m."""
        k, amplitudes = self._harmonics
        psi = np.asarray(psi, float)
        c_0 = self.cos_m[0]
        level = [c_0 * psi, np.full_like(psi, c_0)] + [np.zeros_like(psi) for _ in range(highest)]
        if k.size:
            terms = np.exp(1j * np.multiply.outer(psi, k))
            for index in range(highest + 2):
                level[index] += np.asarray((terms @ (amplitudes * (1j * k) ** (index - 1))).real, np.float64)
            level[0] -= float((amplitudes / (1j * k)).sum().real)
        return level

    def point(self, psi: Reals) -> Complexes:
        """Outline's point with outward normal angle `psi` (B,), m."""
        _, h, slope = self.derivatives(psi, 1)
        place: Complexes = (h + 1j * slope) * np.exp(1j * np.asarray(psi))
        return place

    def foot(self, place: Complexes) -> Reals:
        """Normal angle ψ of the outline's point nearest to `place` (B,) m, outside or slightly inside; (−π, π].

        ψ is where the distance from the tangent line, Re(place e^{−iψ}) − h(ψ), is largest; for a place outside it
        has one maximum where it is positive, which a coarse search brackets and Newton's method finds.
        """
        if self.constant:
            return np.angle(place)
        coarse, h_coarse = self._coarse
        distances = np.multiply.outer(place.real, np.cos(coarse)) + np.multiply.outer(place.imag, np.sin(coarse))
        psi: Reals = coarse[np.argmax(distances - h_coarse, axis=1)]
        lower, upper = psi - 2 * np.pi / COARSE, psi + 2 * np.pi / COARSE
        for _ in range(FOOT_STEPS):
            slope, curve = self.derivatives(psi, 2)[2:]
            turned = place * np.exp(-1j * psi)
            rising = turned.imag - slope
            lower, upper = np.where(rising > 0, psi, lower), np.where(rising < 0, psi, upper)
            step = rising / np.maximum(turned.real + curve, 1e-300)
            following = psi + step
            outside = (following < lower) | (following > upper)
            following = np.where(outside, (lower + upper) / 2, following)
            done = np.abs(following - psi).max(initial=0.0) < 1e-15
            psi = following
            if done:
                break
        return psi

    @cached_property
    def _coarse(self) -> tuple[Reals, Reals]:
        angles = 2 * np.pi * np.arange(COARSE) / COARSE
        return angles, self.derivatives(angles, 0)[1]

    @cached_property
    def _around(self) -> tuple[Complexes, Reals, Reals]:
        """Points, h and r dψ at the nodes of the trapezoid rule."""
        psi = 2 * np.pi * np.arange(NODES) / NODES
        _, h, slope, curve = self.derivatives(psi, 2)
        return (h + 1j * slope) * np.exp(1j * psi), h, (h + curve) * (2 * np.pi / NODES)

    @property
    def smallest_radius_m(self) -> float:
        """Lower bound of the radius of curvature, m; an outline is convex and smooth where this is > 0."""
        k, amplitudes = self._harmonics
        steepest = float((np.abs(amplitudes) * np.abs(1 - k**2) * k**2).sum())
        return float(self._around[2].min() * NODES / (2 * np.pi)) - steepest * (np.pi / NODES) ** 2 / 2

    @property
    def area_m2(self) -> float:
        """Area within the outline, m²."""
        _, h, arc = self._around
        return float(h @ arc) / 2

    @property
    def centroid_m(self) -> complex:
        """Centroid of the area, m."""
        points, h, arc = self._around
        return complex((points * h) @ arc) / (3 * self.area_m2)

    @property
    def mean_distance_m(self) -> float:
        """Mean distance of the area's points from the reference point, which lies inside, m."""
        points, h, arc = self._around
        return float((np.abs(points) * h) @ arc) / (3 * self.area_m2)
