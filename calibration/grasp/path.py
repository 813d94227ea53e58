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

import numpy as np
from scipy.optimize import brentq

from calibration.grasp.constraints import Gap, contact_margins
from calibration.grasp.equilibrium import Drive, GraspSystem, States
from calibration.grasp.equilibrium_newton import regular
from calibration.grasp.path_grid import Event, events
from calibration.grasp.path_points import (
    NO_EQUILIBRIUM,
    Equilibria,
    Path,
    PathDrive,
    Rule,
    between,
    first_crossing,
    pressed,
    required_friction,
    state_between,
)
from calibration.grasp.stability import load_stability
from calibration.hand.finger import Reals
from drivers.errors import MechanicsError

__all__ = [
    "NO_EQUILIBRIUM",
    "Equilibria",
    "Path",
    "PathDrive",
    "Rule",
    "first_crossing",
    "required_friction",
    "state_between",
    "trace",
    "trace_back",
]

STEP_M = 1e-4
"""Largest winding between two points; 0.2 mm and less keep a stop's place within 0.1 mm of object motion."""
LOAD_STEPS = 40
"""A step raises the load by no more than the cap over this."""
SMALLEST_SHARE = 0.01
"""A step shorter than this share of the largest has failed: there is no equilibrium ahead."""
SLOW = 0.02
"""Where the load limits a step of winding to less than this share, the load leads instead."""
PREDICTED = 0.1
"""Largest scaled difference (rad, or 30 mm × that) of a solution from its tangent prediction."""
LONGEST_WINDING_M = 0.06
KINK = 3.0
"""Where joints meet or leave a stop, a step may be this many times as long as predicted; a jump to another solution
is longer."""
LOAD_JUMP = 3.0
"""Letting out, a step may lower the mean load by this many full steps of the load: friction would let it jump."""
ROUNDING = 1e-9
LOOK_EVERY = 8
"""Points after which the clearances are looked at, many at once; where one has closed is found afterwards."""


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
    """Follow the equilibria of `system` from first contact, until an event, the end of a side or of a pad, or one of
    the `clearances` going below zero ends them.

    `step_m` is the largest winding between two points; `load_cap_N` is the system's unless another is given; `rule`
    is that of equilibria unless friction adds to it. Errors: MechanicsError for a step that is not positive, or if
    there is nothing to follow.
    """
    _check_step(step_m)
    if load_cap_N is not None and not load_cap_N > system.start.tendon_load_N.max():
        raise MechanicsError(
            "load_cap_N",
            f"{load_cap_N!r} N is not above the load at first contact, {system.start.tendon_load_N.max():.2f} N.",
        )
    cap_N = system.load_cap_N if load_cap_N is None else load_cap_N
    margins = (*contact_margins(system), *clearances)
    follower = _Follower(system, drive, rule or Equilibria(system), step_m, past_stops, cap_N, margins)
    return _interrupted(follower.path(system.first_state(), np.zeros(system.joints)), margins)


def trace_back(path: Path, rule: Rule, *, step_m: float = STEP_M) -> Path:
    """Let out again from the end of `path` by `rule`, under the same drive, until a contact lets go or a tendon slacks.

    Winding and motion of the result count from its own first point. Errors: MechanicsError for a step that is not
    positive, or if there is nothing to follow.
    """
    _check_step(step_m)
    margins = tuple(contact_margins(path.system))
    follower = _Follower(path.system, path.drive, rule, step_m, True, np.inf, margins, -1.0)
    return _interrupted(follower.path(path.w[-1], path.at_stop[-1]), margins)


def _check_step(step_m: float) -> None:
    if not 0 < step_m <= 0.01:
        raise MechanicsError("step_m", f"{step_m!r} is not between 0 and 0.01 m.")


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
    direction: float = 1.0
    """1 winds in, −1 lets out"""

    def __post_init__(self) -> None:
        system = self.system
        rows = {"excursion": system.excursion_rows, "load": system.load_rows, "spool": system.spool_rows}[self.kind]()
        self.difference = rows[0] - rows[1]
        self.mean = 0.5 * rows.sum(0)
        self.mean_load = 0.5 * system.load_rows().sum(0)
        self.mean_excursion = 0.5 * system.excursion_rows().sum(0)
        self.largest_load_N = system.load_cap_N / LOAD_STEPS
        found = events(system)
        self.stops = [event for event in found if event.stop]
        self.ends = [
            replace(event, limit=self.load_cap_N) if "load cap" in event.name else event
            for event in found
            if not event.stop
        ]
        self.share = 1.0

    def path(self, w: Reals, held: Reals) -> Path:
        system = self.system
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
            if len(points) % LOOK_EVERY == 0 and self._closed(np.array(points[-LOOK_EVERY:])):
                break
        if len(points) < 2:
            raise MechanicsError("grasp", "there is no equilibrium beyond first contact.")
        states_w, at_stop = np.array(points), np.array(stops)
        by_load = self.kind == "load"
        stability = load_stability(system, states_w, at_stop) if by_load else system.stability(states_w, at_stop)
        return Path(system, self.kind, states_w, at_stop, stability, tuple(segments), self.rule, end)

    def _closed(self, w: Reals) -> bool:
        return any(bool((gap.at(w) < -ROUNDING).any()) for gap in self.clearances)

    def _advanced(self, w: Reals, last: Reals | None, held: Reals) -> tuple[Drive, States] | None:
        """The next solution along the path, as far as the step that succeeds."""
        leads = self._leads(w, last, held)
        while self.share >= SMALLEST_SHARE:
            for drive, slope, length in leads:
                step = self.direction * self.share * length
                guess = w + step * slope
                target = drive.rows @ w + [step, 0.0]
                states = self.rule.solve(w, pressed(guess, held), drive, target)
                if self._accepted(w, guess, held, states):
                    self.share = min(1.0, 1.5 * self.share)
                    return drive, states
                onto = self._onto_stops(w, guess, held)
                if onto is not None:
                    return drive, onto
            self.share *= 0.5
        return None

    def _onto_stops(self, w: Reals, guess: Reals, held: Reals) -> States | None:
        """The state that just meets the stop which `guess` oversteps most, for steps that have no solution beyond it:
        the load may fall with the winding up to a stop, and rises again only there."""
        joints, limits = self.system.joints, np.stack([self.system.upper_rad, -self.system.lower_rad])
        over = np.where(held == 0, np.stack([guess[:joints], -guess[:joints]]) - limits, -1.0)
        side, joint = np.unravel_index(int(np.argmax(over)), over.shape)
        if over[side, joint] <= 0:
            return None
        event = self._stop_event(int(joint), 1.0 - 2.0 * float(side))
        target = np.array([event.limit, float(self.difference @ w)])
        states = self.rule.solve(w, w, Drive(np.array([event.row, self.difference])), target)
        q = states.w[0, :joints]
        met = (np.abs(q - self.system.upper_rad) < ROUNDING) * 1.0 - (np.abs(q - self.system.lower_rad) < ROUNDING)
        found = replace(states, at_stop=np.where(held != 0, held, met)[None])
        return found if self._accepted(w, guess, held, found) else None

    def _leads(self, w: Reals, last: Reals | None, held: Reals) -> list[tuple[Drive, Reals, float]]:
        """What may lead from here: drive, how the state changes with it, length of a full step.

        The winding leads while it moves anything; letting out, the load may lead too, since friction can hold the
        winding."""
        found = []
        for row in (self.mean,) if self.kind == "load" else (self.mean, self.mean_load):
            drive = Drive(np.array([row, self.difference]))
            if not regular(self.system, held[None], drive)[0]:
                continue
            slope = self.rule.slope(w, last, drive, held)
            length = self._length(slope)
            if length is not None and not (self.kind != "load" and row is self.mean and length < SLOW * self.step_m):
                found.append((drive, slope, length))
            if found and self.direction > 0:
                break
        return found

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
        wound = self.direction * float(self.mean_excursion @ (states.w[0] - w))
        if self.kind != "load" and wound < -1e-6 * self.step_m:
            return False  # the load leads back down where it falls with the winding
        if self.direction < 0 and float(self.mean_load @ (w - states.w[0])) > LOAD_JUMP * self.largest_load_N:
            return False
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
        margins = [(event.name, event.inside) for event in self.ends]
        found = []
        for name, margin in margins:
            if float(margin(after[None])[0]) >= -1e-9:
                continue
            if float(margin(before[None])[0]) <= 0:
                return before, name

            def inside(fraction: float, margin: Callable[[Reals], Reals] = margin) -> float:
                return float(margin(between(self.rule, drive, before, after, fraction, held).w)[0])

            share = float(brentq(inside, 0.0, 1.0, xtol=1e-12)) if inside(1.0) < 0 < inside(0.0) else 0.0
            found.append((share, name))
        if not found:
            return None
        share, name = min(found, key=lambda item: round(item[0], 6))  # right before left, where both end together
        return between(self.rule, drive, before, after, share, held).w[0], name


def _interrupted(path: Path, clearances: Sequence[Gap]) -> Path:
    """The path up to where the first of the clearances closes. Errors: MechanicsError if one is closed from the
    beginning."""
    found = []
    for gap in clearances:
        closed = np.flatnonzero(gap.at(path.w) < -ROUNDING)
        if closed.size:
            found.append((int(closed[0]), gap))
    if not found:
        return path
    last = min(index for index, _ in found)
    if last == 0:
        name = next(gap.name for index, gap in found if index == 0)
        raise MechanicsError("object", f"at first contact, {name}.", help="Take another object, or another placement.")
    shares = [(_closing_share(path, last - 1, gap), gap.name) for index, gap in found if index == last]
    share, name = min(shares, key=lambda item: round(item[0], 6))
    w = np.vstack([path.w[:last], state_between(path, last - 1, share)])
    at_stop = path.at_stop[[*range(last), last - 1]]
    stability = path.stability[[*range(last), last - 1]]
    return replace(path, w=w, at_stop=at_stop, stability=stability, segments=path.segments[:last], end=name)


def _closing_share(path: Path, index: int, gap: Gap) -> float:
    def at(share: float) -> float:
        return float(gap.at(state_between(path, index, share)[None])[0])

    return float(brentq(at, 0.0, 1.0, xtol=1e-12)) if at(0.0) > 0 > at(1.0) else 0.0
