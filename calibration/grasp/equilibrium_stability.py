"""Stability of an equilibrium whose excursions are held: the energy's curvature on the motions that are left.

Lengths are scaled by 30 mm and torques by the stiffest joint, so the eigenvalue is a number. Friction of the tendon
routing makes the loads' torques differ from the gradients of the excursions; then the curvature is taken on the
motions that keep contacts and excursions, against forces that these torques do not take up, and the eigenvalue with the
smallest real part counts. Source: hand-mechanics reference 6.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.grasp.equilibrium_equations import GraspEquations
from calibration.hand.finger import Reals

DEPENDENT = 1e-9
"""Scaled rows whose triangular factor falls below this are dependent: then the rank counts."""


def stability(system: GraspEquations, w: Reals, at_stop: Reals | None) -> Reals:
    """Smallest eigenvalue, > 0 is stable, inf when nothing is left to move; (B,). See `GraspSystem.stability`."""
    n = system.unknowns
    scale = system.column_scale[:n]
    terms = system.terms(w)
    H = system.curvature(w, terms) * (scale[:, None] * scale / system.torque_Nm)
    kept, resisted = np.zeros((2, w.shape[0], 6, n))
    for index, (contact, tendon, part) in enumerate(zip(terms.contacts, terms.tendons, system.parts, strict=True)):
        own = part.stop - part.start
        for rows in (kept, resisted):
            rows[:, 2 * index : 2 * index + 2, part] = contact.gradient[:, :, :own]
            rows[:, 2 * index : 2 * index + 2, system.joints :] = contact.gradient[:, :, own:]
        kept[:, 4 + index, part] = tendon.gradient.sum(1)
        resisted[:, 4 + index, part] = (system.tendon_shares[index, :, None] * tendon.gradient).sum(1)
    symmetric = bool((system.tendon_shares == 1.0).all())
    result = np.full(w.shape[0], np.inf)
    patterns = np.zeros((w.shape[0], system.joints)) if at_stop is None else at_stop
    for pattern in np.unique(patterns != 0, axis=0):
        chosen = np.flatnonzero(((patterns != 0) == pattern).all(1))
        stops = np.broadcast_to(np.eye(n)[np.flatnonzero(pattern)], (chosen.size, int(pattern.sum()), n))
        keep = np.concatenate([kept[chosen] * scale, stops], axis=1)
        resist = None if symmetric else np.concatenate([resisted[chosen] * scale, stops], axis=1)
        result[chosen] = _smallest(H[chosen], keep, resist)
    return result


def _smallest(H: Reals, keep: Reals, resist: Reals | None) -> Reals:
    """Smallest eigenvalue of H (B, n, n) on what the rows `keep` (B, rows, n) leave; (B,)."""
    Z, independent = _left_free(keep)
    if Z.shape[2] == 0:
        return np.full(H.shape[0], np.inf)
    Y = Z if resist is None else _left_free(resist)[0]
    reduced = Y.transpose(0, 2, 1) @ H @ Z
    if resist is None:
        result = np.asarray(np.linalg.eigvalsh(reduced)[:, 0], np.float64)
    else:
        result = np.linalg.eigvals(np.linalg.solve(Y.transpose(0, 2, 1) @ Z, reduced)).real.min(1)
    for index in np.flatnonzero(~independent):  # more is left to move than rows were given
        _, singular, directions = np.linalg.svd(keep[index])
        Z_more = directions[int((singular > DEPENDENT * singular[0]).sum()) :]
        result[index] = np.linalg.eigvalsh(0.5 * Z_more @ (H[index] + H[index].T) @ Z_more.T)[0]
    return result


def _left_free(rows: Reals) -> tuple[Reals, NDArray[np.bool_]]:
    """Orthonormal basis (B, n, n − rows) of what `rows` (B, rows, n) leave, and whether the rows are independent."""
    count, n = rows.shape[1:]
    if count >= n:
        return np.zeros((rows.shape[0], n, 0)), np.ones(rows.shape[0], bool)
    lengths = np.linalg.norm(rows, axis=2, keepdims=True)
    Q, R = np.linalg.qr((rows / lengths).transpose(0, 2, 1), mode="complete")
    independent = (np.abs(np.diagonal(R, axis1=1, axis2=2)) > DEPENDENT).all(1)
    return Q[:, :, count:], independent
