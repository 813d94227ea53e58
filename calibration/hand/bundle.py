"""Points of a finger as sums of rotating arms ("bundles"), with exact first, second and third derivatives.

Every absolute angle of a finger is linear in its coordinates q, so any point of it is

    p(q) = p_0 + Σ_m w_m exp(i (θ_m + C_m q)),

a complex number x + i y, m, with one term for each rigid link and several for each flexure. Source: hand-mechanics
reference 3.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
Complexes = NDArray[np.complex128]


@dataclass(frozen=True)
class PointJet:
    """A point at B configurations: value (B,), gradient (B, n), Hessian (B, n, n) in q; complex, m."""

    value: Complexes
    gradient: Complexes
    hessian: Complexes


@dataclass(frozen=True)
class Bundle:
    """One point of a finger: `origin` m, `weights` (m,) m, `phases` (m,) rad, `coordinates` C (m, n)."""

    origin: complex
    weights: Reals
    phases: Reals
    coordinates: Reals

    def at(self, q: Reals) -> PointJet:
        """Point with first and second derivatives at `q` (B, n)."""
        terms, n = self._terms(q), self.coordinates.shape[1]
        value = self.origin + terms.sum(1)
        # One small product for each configuration: as fast as a single large one, and BLAS starts no threads for it.
        hessian: Complexes = (terms[:, None, :] @ self._second).reshape(-1, n, n)
        return PointJet(value, terms @ self._first, hessian)

    def third(self, q: Reals, u: Reals, v: Reals) -> Complexes:
        """∂_u ∂_v ∇p at `q`: third derivative with the directions `u`, `v` (B, n) put in; (B, n)."""
        C = self.coordinates
        directed: Complexes = -1j * (self._terms(q) * (u @ C.T) * (v @ C.T)) @ C
        return directed

    def with_arm(self, offset_m: complex, angle_rad: float, angle_row: Reals) -> Bundle:
        """This point moved by `offset_m` (x along, y across, m) in a frame turned by `angle_rad + angle_row · q`."""
        if offset_m == 0:
            return self
        return Bundle(
            self.origin,
            np.append(self.weights, abs(offset_m)),
            np.append(self.phases, angle_rad + np.angle(offset_m)),
            np.vstack([self.coordinates, angle_row]),
        )

    def mirrored(self) -> Bundle:
        """The mirror image about the y axis, with the same coordinates: θ → π − θ, C → −C."""
        return Bundle(-self.origin.conjugate(), self.weights, np.pi - self.phases, -self.coordinates)

    @cached_property
    def _first(self) -> Complexes:
        return np.asarray(1j * self.coordinates, np.complex128)

    @cached_property
    def _second(self) -> Complexes:
        C = self.coordinates
        return np.asarray((-C[:, :, None] * C[:, None, :]).reshape(C.shape[0], C.shape[1] ** 2), np.complex128)

    def _terms(self, q: Reals) -> Complexes:
        terms: Complexes = self.weights * np.exp(1j * (self.phases + q @ self.coordinates.T))
        return terms
