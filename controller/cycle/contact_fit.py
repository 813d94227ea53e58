"""Where load against excursion bends: first contact of a finger, and how well it is known. Pure functions.

Free closing is a line of known slope, which is taken off beforehand. What remains is the model

    load(x) = a + (g + s (x − c)) for x beyond c, else a

with the constant part of gear friction a, the step g by which the support's drag begins, the rise s of the gripped
object, and first contact c. a is unknown; s lies near the motion table's, which an object of another size changes by
some 20 %; g is the table's. For each c the best a and s are a linear least-squares problem (the prior of s as one more
row); the sum of squares over all c gives c with its standard deviation. The noise is what the fit itself leaves over.

Excursions in m, loads in N. Source: design 4 "Contact".
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

GRID_M = 2e-5
"""Contacts that are tried: finer than any is known, the mean over them is finer still."""
_SLOPE_DEVIATION = 0.25
_NOISE_N = 0.3
"""Never believed to be less: the position loop's saw-tooth within a mean, which a few means may hide."""
_NOISE_TURNS = 2


class ContactFit(NamedTuple):
    """First contact with its standard deviation, the free line's offset, rise N/m, and the evidence: by how much the
    bend lowers the sum of squares against a line without one, in units of the noise variance."""

    contact_m: float
    deviation_m: float
    offset_N: float
    rise_N_per_m: float
    evidence: float


def fit_contact(
    excursion_m: ArrayLike, load_N: ArrayLike, rise_N_per_m: float, step_N: float, blur_m: float
) -> ContactFit:
    """Fit the bend to samples (n ≥ 3) of rising excursion; the load less that of free closing.

    `rise_N_per_m` and `step_N`: what the table expects beyond contact. `blur_m`: stretch of winding over which each
    sample is a mean.
    """
    x, y = np.asarray(excursion_m, dtype=np.float64), np.asarray(load_N, dtype=np.float64)
    contacts = np.arange(x[0], x[-1], GRID_M)
    beyond = x - contacts[:, None]
    past = np.maximum(beyond, 0.0)
    rest = y - step_N * np.clip(beyond / blur_m + 0.5, 0.0, 1.0)
    mean_past, mean_rest = past.mean(axis=1), rest.mean(axis=1)
    past -= mean_past[:, None]
    rest -= mean_rest[:, None]
    squares_past = np.einsum("ij,ij->i", past, past)
    products = np.einsum("ij,ij->i", past, rest)
    squares_rest = np.einsum("ij,ij->i", rest, rest)
    noise_N, prior = _NOISE_N, _SLOPE_DEVIATION * rise_N_per_m
    for _ in range(_NOISE_TURNS):
        ridge = (noise_N / prior) ** 2
        rises = (products + ridge * rise_N_per_m) / (squares_past + ridge)
        squares = squares_rest - 2.0 * rises * products + rises**2 * squares_past
        cost = squares / noise_N**2 + ((rises - rise_N_per_m) / prior) ** 2 + np.log(squares_past + ridge)
        best = int(cost.argmin())
        left_N = math.sqrt(max(squares[best], 0.0) / max(len(x) - 3, 1))
        if left_N <= noise_N:
            break
        noise_N = left_N
    weights = np.exp(-0.5 * (cost - cost[best]))
    weights /= weights.sum()
    contact_m = float(weights @ contacts)
    variance_m2 = float(weights @ (contacts - contact_m) ** 2)
    without_bend = float(((y - y.mean()) ** 2).sum())
    return ContactFit(
        contact_m,
        math.sqrt(variance_m2 + GRID_M**2 / 12.0),
        float(mean_rest[best] - rises[best] * mean_past[best]),
        float(rises[best]),
        (without_bend - float(squares[best])) / noise_N**2,
    )


class TableTrust(NamedTuple):
    """How far the table's contact is believed: right to `right_m` where the table's object and spool zeros are those of
    the hand, to `wrong_m` where they are not (standard deviations), with `odds` to one that they are."""

    right_m: float = 1.5e-5
    wrong_m: float = 4e-4
    odds: float = 4.0


def weighed_with_table(excess_m: float, deviation_m: float, trust: TableTrust) -> float:
    """What is left of an excess over the table's contact that was found with this standard deviation, m.

    A mean of two cases, weighed by how well each explains what was found: found near the expected contact, that is
    where contact was; found elsewhere, the table has no weight.
    """
    mean_m = weight_sum = 0.0
    for prior_m, odds in ((trust.right_m, trust.odds), (trust.wrong_m, 1.0)):
        variance_m2 = prior_m**2 + deviation_m**2
        weight = odds * math.exp(-0.5 * min(excess_m**2 / variance_m2, 1000.0)) / math.sqrt(variance_m2)
        weight_sum += weight
        mean_m += weight * excess_m * prior_m**2 / variance_m2
    return mean_m / weight_sum
