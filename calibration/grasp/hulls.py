"""Convex bodies in the plane, and how far two of them are apart.

Phalanges, round and polygonal objects are all convex hulls of a few discs: a corner is a disc of radius 0, a rounded
fingertip one of its own radius. Two convex bodies A and B are apart by max over directions n of (min over B of n·b −
max over A of n·a). The sign of that is exact with a few directions: the normals of the edges, and, where an arc may
touch, the lines between the centres. Between two corners the true distance may be larger. Points are complex numbers,
hand frame, m; B states at once. Source: paper (11), (12).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from calibration.hand.finger import Complexes, Reals
from calibration.objects.support import SupportFunction

SMALLEST = 1e-300


class Body(Protocol):
    """A convex body at B places."""

    def reach_m(self, directions: Complexes) -> Reals:
        """Support function: farthest extent along unit `directions` (B, D); (B, D) m."""
        ...

    def normals_towards(self, other: Hull) -> Complexes:
        """Outward unit normals (B, D) along which this body may touch the other."""
        ...


@dataclass(frozen=True)
class Hull:
    """Convex hull of discs: `centres` (B, K) in counter-clockwise order, `radii_m` (K,); none hides another."""

    centres: Complexes
    radii_m: Reals

    def reach_m(self, directions: Complexes) -> Reals:
        """Support function: farthest extent along unit `directions` (B, D); (B, D) m."""
        x, y = self.centres.real[:, None, :], self.centres.imag[:, None, :]
        along = x * directions.real[:, :, None] + y * directions.imag[:, :, None] + self.radii_m
        reach: Reals = along.max(2)
        return reach

    def normals_towards(self, other: Hull) -> Complexes:
        """Normals of the edges, and lines to the other's centres wherever one of both is round."""
        first, second = np.nonzero(self.radii_m[:, None] + other.radii_m > 0)
        between = other.centres[:, second] - self.centres[:, first]
        return np.concatenate([self.edge_normals(), between / np.maximum(np.abs(between), SMALLEST)], axis=1)

    def edge_normals(self) -> Complexes:
        """Of the lines that touch one disc and the next; (B, K), none for a single disc."""
        if self.radii_m.size == 1:
            return self.centres[:, :0]
        step = np.roll(self.centres, -1, axis=1) - self.centres
        length = np.maximum(np.abs(step), SMALLEST)
        tilt = np.clip((self.radii_m - np.roll(self.radii_m, -1)) / length, -1.0, 1.0)
        normals: Complexes = step / length * (tilt - 1j * np.sqrt(1.0 - tilt**2))
        return normals


@dataclass(frozen=True)
class SmoothBody:
    """A smooth convex outline, its reference point at `centres` (B,), turned by `turns_rad` (B,)."""

    support: SupportFunction
    centres: Complexes
    turns_rad: Reals

    def reach_m(self, directions: Complexes) -> Reals:
        """Support function of the outline where it stands; (B, D) m."""
        angles = np.angle(directions) - self.turns_rad[:, None]
        height = self.support.derivatives(angles.ravel(), 0)[1].reshape(angles.shape)
        reach: Reals = (self.centres[:, None] * directions.conj()).real + height
        return reach

    def normals_towards(self, other: Hull) -> Complexes:
        """Normals at the outline's points nearest to the other's centres."""
        turn = np.exp(1j * self.turns_rad)[:, None]
        places = (other.centres - self.centres[:, None]) / turn
        normals: Complexes = np.exp(1j * self.support.foot(places.ravel())).reshape(places.shape) * turn
        return normals


def separation_m(body: Body, hull: Hull) -> Reals:
    """Gap between a body and a hull, below zero where they overlap; (B,) m."""
    directions = np.concatenate([body.normals_towards(hull), -hull.edge_normals()], axis=1)
    gap: Reals = (-hull.reach_m(-directions) - body.reach_m(directions)).max(1)
    return gap
