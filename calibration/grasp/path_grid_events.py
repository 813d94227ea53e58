"""What ends a path of equilibria: stops, load caps, slack tendons, lost contacts, edges of what a fingertip touches,
and bodies that meet.

Each is a margin, ≥ 0 inside, that ends the path by its name. Stops, loads and contact forces are linear in a state and
cheap; clearances and the fingertips' features are neither. Source: hand-mechanics reference 6, paper (8)–(12).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from calibration.grasp.constraints import gaps
from calibration.grasp.equilibrium import Flags, GraspSystem
from calibration.hand.finger import Reals

ROUNDING = 1e-9
"""Margins (rad, N, m) below zero by less are at zero."""
SIDES = ("right", "left")


@dataclass(frozen=True)
class Event:
    """A linear function of w, `row` @ w, that stays on the inner side of `limit`: `sign` · (row @ w − limit) ≥ 0."""

    name: str
    row: Reals
    limit: float
    sign: float
    stop: bool = False

    def inside(self, w: Reals) -> Reals:
        """How far inside, positive inside; (…, ) for `w` (…, size)."""
        distance: Reals = self.sign * (w @ self.row - self.limit)
        return distance


def events(system: GraspSystem) -> list[Event]:
    """All linear ones, stops first: upper and lower of each joint in the order of `joint_columns`."""
    names = [f"{side} {joint}" for side in SIDES for joint in ("proximal", "distal")]
    loads, contacts = system.load_rows(), system.contact_rows()
    found = []
    for name, index in zip(names, system.joint_columns, strict=True):
        row = system.joint_row(index)
        found.append(Event(f"{name} stop", row, float(system.upper_rad[index]), -1.0, stop=True))
        found.append(Event(f"{name} lower stop", row, float(system.lower_rad[index]), 1.0, stop=True))
    for index, side in enumerate(SIDES):
        found.append(Event(f"{side} load cap", loads[index], system.load_cap_N, -1.0))
        found.append(Event(f"{side} tendon slack", loads[index], 0.0, 1.0))
        found.append(Event(f"{side} contact lost", contacts[2 * index], 0.0, 1.0))
    return found


class Watch:
    """All margins of a grasp: first the linear ones, then the others."""

    def __init__(self, system: GraspSystem) -> None:
        self._system = system
        linear = events(system)
        self._rows = np.array([event.sign * event.row for event in linear]).T
        self._limits = np.array([event.sign * event.limit for event in linear])
        self._curved: list[Callable[[Reals], Reals]] = []
        names = [event.name for event in linear]
        for index, side in enumerate(SIDES):
            for feature in _features(system, index, system.first_state()[None]):
                names.append(f"{side} {feature}")
                self._curved.append(partial(_feature, system, index, feature))
        for gap in gaps(system):
            names.append(gap.name)
            self._curved.append(gap.at)
        self.names = tuple(names)
        self.linear = len(linear)
        """how many of the margins are linear"""
        self.later = np.array([name.endswith(("contact lost", "slack", "lower stop")) for name in names])
        """those that may be negative at first: a column begins where they no longer are"""

    def margins(self, w: Reals) -> Reals:
        """(B, events) at `w` (B, size)."""
        return np.column_stack([self.linear_margins(w), *(margin(w) for margin in self._curved)])

    def linear_margins(self, w: Reals) -> Reals:
        """(…, linear events) at `w` (…, size)."""
        margins: Reals = w @ self._rows - self._limits
        return margins

    def each_margin(self, w: Reals, event: NDArray[np.intp]) -> Reals:
        """Margin of the event `event` (B,) at each of `w` (B, size); (B,). The number after the last is stability."""
        result = np.take_along_axis(
            np.column_stack([self.linear_margins(w), np.zeros((w.shape[0], len(self._curved) + 1))]), event[:, None], 1
        )[:, 0]
        for number in np.unique(event[event >= self.linear]):
            own = event == number
            curved = number - self.linear
            margin = self._curved[curved] if curved < len(self._curved) else self._system.stability
            result[own] = margin(w[own])
        return result

    def close_margins(self, w: Reals, expected: Reals, near: float) -> Reals:
        """(B, events) at `w` (B, size) where those that are not linear are taken as `expected` (B, other events) if
        that is at least `near`; NaN expects nothing."""
        curved = np.array(expected)
        for index, margin in enumerate(self._curved):
            close = ~(curved[:, index] >= near)
            if close.any():
                curved[close, index] = margin(w[close])
        return np.concatenate([self.linear_margins(w), curved], axis=1)


def known(values: Reals) -> Flags:
    """Where the last axis is finite throughout."""
    return np.asarray(np.isfinite(values).all(-1), np.bool_)


def _features(system: GraspSystem, index: int, w: Reals) -> dict[str, Reals]:
    return system.contacts[index].features(w[:, system.parts[index]], w[:, system.joints : system.unknowns])


def _feature(system: GraspSystem, index: int, name: str, w: Reals) -> Reals:
    return _features(system, index, w)[name]
