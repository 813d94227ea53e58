"""One path of equilibria, from first contact until something ends it: how the object moves while the hand squeezes.

Three drives. "excursion": both tendons are wound in at equal rate, as position-driven motors do with stiff tendons;
"spool": the same at the motors' side of tendons that stretch; "load": both tensions rise equally, which is unstable
from some point on (flagged point by point, never hidden). Joints that meet a stop stay there while the rest goes on.
Where stops leave the winding nothing to move, or nearly nothing, the same curve is followed by mean load instead, up
to the load cap. Hand frame, SI, finger order right, left. Source: hand-mechanics reference 6, 11, 14.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np
from scipy.optimize import brentq

from calibration.grasp.constraints import Gap
from calibration.grasp.equilibrium import Drive, GraspSystem, States
from calibration.grasp.path_grid import Event, events
from calibration.grasp.stability import load_stability
from calibration.hand.finger import Reals
from drivers.errors import MechanicsError

PathDrive = Literal["excursion", "load", "spool"]

STEP_M = 1e-4
"""Largest winding between two points; 0.2 mm and less keep a stop's place within 0.1 mm of object motion."""
LOAD_STEPS = 40
"""A step raises the load by no more than the cap over this."""
SMALLEST_SHARE = 1e-3
"""A step shorter than this share of the largest has failed: there is no equilibrium ahead."""
SLOW = 0.02
"""Where the load limits a step of winding to less than this share, the load leads instead."""
PREDICTED = 0.1
"""Largest scaled difference (rad, or 30 mm × that) of a solution from its tangent prediction."""
LONGEST_WINDING_M = 0.06
KINK = 3.0
"""Where joints meet or leave a stop, a step may be this many times as long as predicted; a jump to another solution
is longer."""
ROUNDING = 1e-9
BEYOND_STOP_RAD = 1e-6
NO_EQUILIBRIUM = "no equilibrium beyond it"


class Rule(Protocol):
    """How the next state of a path follows from the last one. Without friction it needs the drive alone."""

    @property
    def without_solution(self) -> str:
        """What to call the end of a path beyond which there is no next state."""
        ...

    def solve(self, before: Reals, guess: Reals, drive: Drive, target: Reals) -> States:
        """States (one) at the drive's `target` (2,), near `guess` (size,), coming from `before` (size,)."""
        ...

    def slope(self, before: Reals, last: Reals | None, drive: Drive, held: Reals) -> Reals:
        """Expected change (size,) of the state per change of the drive's first target; `last` is the state ahead of
        `before`, `held` (joints,) what is at a stop."""
        ...


@dataclass(frozen=True)
class Equilibria:
    """Nothing resists but springs: states depend on the drive's targets, not on how they were reached."""

    system: GraspSystem
    without_solution: str = NO_EQUILIBRIUM

    def solve(self, before: Reals, guess: Reals, drive: Drive, target: Reals) -> States:
        """An equilibrium, joints at their stops."""
        return self.system.solve(guess[None], drive, target[None], stops=True)

    def slope(self, before: Reals, last: Reals | None, drive: Drive, held: Reals) -> Reals:
        """The tangent of the equilibria."""
        tangent: Reals = self.system.tangent(before[None], drive, held[None])[0, :, 0]
        return tangent


@dataclass(frozen=True)
class Path:
    """K equilibria in order of winding."""

    system: GraspSystem
    drive: PathDrive
    w: Reals
    """(K, size) states"""
    at_stop: Reals
    """(K, joints) 1 at the upper, −1 at the lower stop, else 0; on the side that follows the point"""
    stability: Reals
    """(K,) smallest eigenvalue under this drive, dimensionless; > 0 is stable, inf when nothing is left to move"""
    segments: tuple[Drive, ...]
    """K − 1 drives; the target of each rises linearly from one point to the next"""
    rule: Rule
    """how a state follows from the one before"""
    end: str
    """what ends the path: the name of a stop, a load cap, a collision, …"""

    @property
    def excursion_m(self) -> Reals:
        """(K, 2) finger-side excursion since first contact, m."""
        wound: Reals = self.w @ self.system.excursion_rows().T
        wound -= wound[0].copy()
        return wound

    @property
    def load_N(self) -> Reals:
        """(K, 2) tendon loads, N."""
        loads: Reals = self.w @ self.system.load_rows().T
        return loads

    @property
    def pose(self) -> Reals:
        """(K, 3) object x m, y m, θ rad in the hand frame."""
        pose: Reals = self.w[:, self.system.joints : self.system.unknowns]
        return pose

    @property
    def motion(self) -> Reals:
        """(K, 3) object motion since first contact, m, m, rad; negative y is towards the palm."""
        pose = self.pose
        motion: Reals = pose - pose[0]
        return motion

    @property
    def contact_force_N(self) -> Reals:
        """(K, 4) force on the object: right N, f_t, left N, f_t, N."""
        forces: Reals = self.w @ self.system.contact_rows().T
        return forces

    @property
    def required_friction(self) -> Reals:
        """(K,) largest |f_t|/N of both contacts; NaN where a finger does not press, as at first contact."""
        return required_friction(self.contact_force_N)

    @property
    def stable(self) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """(K,) whether the equilibrium is stable under this drive."""
        return np.asarray(self.stability > 0, np.bool_)

    @property
    def first_stop(self) -> int | None:
        """Index of the point at which the first joint meets a stop; None if none does."""
        held = np.flatnonzero((self.at_stop != 0).any(1))
        return int(held[0]) if held.size else None


def required_friction(contact_force_N: Reals) -> Reals:
    """Largest |f_t|/N of contact forces (B, 4); NaN where a finger does not press."""
    normal, along = contact_force_N[:, ::2], np.abs(contact_force_N[:, 1::2])
    ratio = np.divide(along, normal, out=np.full_like(along, np.nan), where=normal > 1e-9)
    largest: Reals = ratio.max(1)
    return largest


def trace(
    system: GraspSystem,
    drive: PathDrive = "excursion",
    *,
    step_m: float = STEP_M,
    past_stops: bool = True,
    load_cap_N: float | None = None,
    clearances: Sequence[Gap] = (),
    rule: Rule | None = None,
) -> Path:
    """Follow the equilibria of `system` from first contact; `clearances` end the path where one goes below zero.

    `step_m` is the largest winding between two points; `load_cap_N` is the system's unless another is given; `rule`
    is that of equilibria unless friction adds to it. Errors: MechanicsError for a step that is not positive, or if
    there is nothing to follow.
    """
    if not 0 < step_m <= 0.01:
        raise MechanicsError("step_m", f"{step_m!r} is not between 0 and 0.01 m.")
    if load_cap_N is not None and not load_cap_N > system.start.tendon_load_N.max():
        raise MechanicsError(
            "load_cap_N",
            f"{load_cap_N!r} N is not above the load at first contact, {system.start.tendon_load_N.max():.2f} N.",
        )
    cap_N = system.load_cap_N if load_cap_N is None else load_cap_N
    follower = _Follower(system, drive, rule or Equilibria(system), step_m, past_stops, cap_N, tuple(clearances))
    return follower.path()


def state_between(path: Path, index: int, fraction: float) -> Reals:
    """State (size,) that share of the way from point `index` to the next, solved anew; NaN if it cannot be."""
    before, after = path.w[index], path.w[index + 1]
    found = _between(path.rule, path.segments[index], before, after, fraction, path.at_stop[index])
    state: Reals = found.w[0] if found.converged[0] else np.full(before.size, np.nan)
    return state


def first_crossing(path: Path, margin: Callable[[Reals], Reals], start: int = 0) -> tuple[int, Reals] | None:
    """First place at or after point `start` where `margin` (B, size) → (B,) is ≥ 0, and stays so to the next point.

    The index of the point before it and the state (size,), found to rounding; None if there is none. A margin that
    is NaN counts as negative.
    """
    values = np.nan_to_num(margin(path.w), nan=-1.0)
    reached = np.flatnonzero(values[start:] >= 0)
    if reached.size == 0:
        return None
    first = start + int(reached[0])
    if first == start:
        return first, path.w[first]

    def at(fraction: float) -> float:
        return float(np.nan_to_num(margin(state_between(path, first - 1, fraction)[None])[0], nan=-1.0))

    if at(0.0) >= 0:
        return first - 1, path.w[first - 1]
    share = float(brentq(at, 0.0, 1.0, xtol=1e-13)) if at(1.0) >= 0 else 1.0
    return first - 1, state_between(path, first - 1, share)


@dataclass
class _Follower:
    """The state of one trace: where it is, and with what step it goes on."""

    system: GraspSystem
    kind: PathDrive
    rule: Rule
    step_m: float
    past_stops: bool
    load_cap_N: float
    clearances: tuple[Gap, ...]

    def __post_init__(self) -> None:
        system = self.system
        rows = {"excursion": system.excursion_rows, "load": system.load_rows, "spool": system.spool_rows}[self.kind]()
        self.difference = rows[0] - rows[1]
        self.mean = 0.5 * rows.sum(0)
        self.mean_load = 0.5 * system.load_rows().sum(0)
        self.mean_excursion = 0.5 * system.excursion_rows().sum(0)
        self.largest_load_N = self.load_cap_N / LOAD_STEPS
        found = events(system)
        self.stops = [event for event in found if event.stop]
        self.ends = [
            replace(event, limit=self.load_cap_N) if "load cap" in event.name else event
            for event in found
            if not event.stop
        ]
        self.share = 1.0

    def path(self) -> Path:
        system = self.system
        w = system.first_state()
        held = np.zeros(system.joints)
        points, stops, segments = [w], [held], list[Drive]()
        end = ""
        while not end:
            if (w - points[0]) @ self.mean_excursion > LONGEST_WINDING_M:
                end = "the longest winding that is followed"
                break
            ahead = self._advanced(w, points[-2] if len(points) > 1 else None, held)
            if ahead is None:
                end = self.rule.without_solution
                break
            drive, states = ahead
            after, active = states.w[0], states.at_stop[0]
            met = self._stop_met(w, after, held, active)
            if met is not None:
                after = met[0]
            final = self._ended(w, after, drive, held)
            if final is not None:
                after, end = final
                active = held
            elif met is not None and not self.past_stops:
                end = met[1]
            points.append(after)
            stops.append(active)
            segments.append(drive)
            w, held = after, active
        if len(points) < 2:
            raise MechanicsError("grasp", "there is no equilibrium beyond first contact.")
        states_w, at_stop = np.array(points), np.array(stops)
        by_load = self.kind == "load"
        stability = load_stability(system, states_w, at_stop) if by_load else system.stability(states_w, at_stop)
        return Path(system, self.kind, states_w, at_stop, stability, tuple(segments), self.rule, end)

    def _advanced(self, w: Reals, last: Reals | None, held: Reals) -> tuple[Drive, States] | None:
        """The next solution along the path, as far as the step that succeeds."""
        while self.share >= SMALLEST_SHARE:
            for row in (self.mean,) if self.kind == "load" else (self.mean, self.mean_load):
                drive = Drive(np.array([row, self.difference]))
                slope = self.rule.slope(w, last, drive, held)
                length = self._length(slope)
                if length is None or (row is self.mean and self.kind != "load" and length < SLOW * self.step_m):
                    continue
                guess = w + self.share * length * slope
                target = drive.rows @ w + [self.share * length, 0.0]
                states = self.rule.solve(w, _pressed(guess, held), drive, target)
                if self._accepted(w, guess, held, states):
                    self.share = min(1.0, 1.5 * self.share)
                    return drive, states
            self.share *= 0.5
        return None

    def _length(self, slope: Reals) -> float | None:
        """Length of a full step of a path parameter that changes the state by `slope`; None if it cannot lead."""
        winding, load = abs(float(slope @ self.mean_excursion)), abs(float(slope @ self.mean_load))
        if not np.isfinite(slope).all() or (winding == 0 and load == 0):
            return None
        steps = (self.step_m / winding if winding else np.inf, self.largest_load_N / load if load else np.inf)
        return min(steps)

    def _accepted(self, w: Reals, guess: Reals, held: Reals, states: States) -> bool:
        if not states.converged[0]:
            return False
        scale = self.system.column_scale[: self.system.size]
        unknowns = self.system.unknowns
        predicted, found = (np.abs((to - w) / scale)[:unknowns].max() for to in (guess, states.w[0]))
        if (states.at_stop[0] != held).any():  # a kink: the prediction knows nothing of it
            return bool(found < KINK * predicted + ROUNDING)
        return bool(np.abs((states.w[0] - guess) / scale)[:unknowns].max() < PREDICTED)

    def _stop_met(self, before: Reals, after: Reals, held: Reals, active: Reals) -> tuple[Reals, str] | None:
        """State and name of the first stop that is met on the way, if one is."""
        found = []
        for joint in np.flatnonzero((active != 0) & (held == 0)):
            event = self._stop_event(int(joint), float(active[joint]))
            drive = Drive(np.array([event.row, self.difference]))
            target = np.array([event.limit, float(self.difference @ before)])
            states = self.rule.solve(before, before, drive, target)
            if states.converged[0]:
                found.append((float((states.w[0] - before) @ self.mean_excursion), states.w[0], event.name))
        if not found:
            return None
        _, state, name = min(found, key=lambda item: item[0])
        return state, name

    def _stop_event(self, joint: int, side: float) -> Event:
        return next(event for event in self.stops if event.row[joint] != 0 and event.sign == -side)

    def _ended(self, before: Reals, after: Reals, drive: Drive, held: Reals) -> tuple[Reals, str] | None:
        """State and name of the first event on the way that ends the path, if one does."""
        margins: list[tuple[str, Callable[[Reals], Reals]]] = [(event.name, event.inside) for event in self.ends]
        margins += [(gap.name, gap.at) for gap in self.clearances]
        found = []
        for name, margin in margins:
            if float(margin(after[None])[0]) >= -1e-9:
                continue
            if float(margin(before[None])[0]) <= 0:
                return before, name

            def inside(fraction: float, margin: Callable[[Reals], Reals] = margin) -> float:
                return float(margin(_between(self.rule, drive, before, after, fraction, held).w)[0])

            share = float(brentq(inside, 0.0, 1.0, xtol=1e-12)) if inside(1.0) < 0 < inside(0.0) else 0.0
            found.append((share, name))
        if not found:
            return None
        share, name = min(found, key=lambda item: round(item[0], 6))  # right before left, where both end together
        return _between(self.rule, drive, before, after, share, held).w[0], name


def _pressed(guess: Reals, held: Reals) -> Reals:
    """The guess with joints that are at a stop a little beyond it, so that the solver begins with them held."""
    pressed = guess.copy()
    pressed[: held.size] += BEYOND_STOP_RAD * held
    return pressed


def _between(rule: Rule, drive: Drive, before: Reals, after: Reals, fraction: float, held: Reals) -> States:
    mixed: Reals = before + fraction * (after - before)
    return rule.solve(before, _pressed(mixed, held), drive, drive.rows @ mixed)
