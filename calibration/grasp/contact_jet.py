"""What every rolling contact answers: two constraints with exact derivatives, where it touches, what ends it.

Gap g_n = 0 and no-slip rolling g_t = 0, m. Multipliers λ give the force on the object: N = −λ_n along the normal n from
fingertip to object, f_t = −λ_t along t = i n. Source: hand-mechanics reference 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from calibration.hand.finger import Complexes, Reals


@dataclass(frozen=True)
class ConstraintJet:
    """g = (g_n, g_t) at B configurations: value (B, 2), gradient (B, 2, n + 3), Hessian (B, 2, n + 3, n + 3)."""

    value: Reals
    gradient: Reals
    hessian: Reals


class RollingContact(Protocol):
    """One fingertip on one outline; unknowns are the finger's n coordinates, then the object's x, y, θ.

    Everywhere `q` is (B, n) rad, `pose` (B, 3) m, m, rad, in the hand frame.
    """

    def at(self, q: Reals, pose: Reals) -> ConstraintJet:
        """Constraints with gradient and Hessian."""
        ...

    def third(self, q: Reals, pose: Reals, u: Reals, v: Reals) -> Reals:
        """∂_u ∂_v ∇g: third derivative with directions `u`, `v` (B, n + 3) put in; (B, 2, n + 3)."""
        ...

    def contact_point(self, q: Reals, pose: Reals) -> Complexes:
        """Where fingertip and object touch when g_n = 0, x + i y m; (B,)."""
        ...

    def normal(self, q: Reals, pose: Reals) -> Complexes:
        """Unit normal from fingertip to object, as a complex number; (B,)."""
        ...

    def features(self, q: Reals, pose: Reals) -> dict[str, Reals]:
        """Distances (B,) m from what would end this kind of contact, by name; ≥ 0 while it holds."""
        ...
