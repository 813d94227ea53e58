"""The demo's report: reads what is really so in the world, and sets it beside what the daemon thought.

Motion is the object's true pose in the room against its pose before the fingers touch, from there until 0.5 s after the
squeeze: no filtering, no chosen window. This module and the tests are the only ones that look at the truth.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pinocchio
from numpy.typing import NDArray

from calibration.hand.parameters import Hand
from controller.simulation.truth import WorldObserver, WorldTruth
from controller.simulation.world import World

Array = NDArray[np.float64]


class Motion(msgspec.Struct, frozen=True):
    """Object motion in the room over one run: largest and root mean square displacement and rotation."""

    peak_mm: float
    rms_mm: float
    peak_deg: float
    rms_deg: float


@dataclass
class Track:
    """Looks on while a grasp runs: the truth every 2 ms, and every cycle's record."""

    hand: Hand
    watching: bool = False
    truths: list[WorldTruth] = field(default_factory=list)
    records: list[dict[str, Any]] = field(default_factory=list)
    record_times_ns: list[int] = field(default_factory=list)
    _observer: WorldObserver | None = None

    def observe(self, world: World) -> None:
        """Note what is really so."""
        if self.watching:
            self._observer = self._observer or WorldObserver(world, self.hand)
            self.truths.append(self._observer.truth())

    def record_cycle(self, record: dict[str, Any], time_ns: int) -> None:
        """Note what the cycle thought and did."""
        if self.watching:
            self.records.append(record)
            self.record_times_ns.append(time_ns)

    def event(self, event: dict[str, Any], time_ns: int) -> None:
        """Events are not needed here."""


@dataclass(frozen=True, eq=False)
class Trace:
    """One run, from the last moment before the fingers touch; arrays over time, small enough to be sent back."""

    time_s: Array
    """(n,) since that moment."""
    room_m: Array
    """(n, 3) object displacement, world axes."""
    room_deg: Array
    """(n,) object rotation."""
    hand_plane_mm: Array
    """(n, 2) the same displacement along the hand's x and y as they were before the touch."""
    seen_in_hand_mm: Array
    """(n, 3) object motion in the hand: x, y in mm, θ in deg."""
    predicted_in_hand_mm: Array
    """(n, 3) what the table said of it."""
    squeezed: dict[str, Any]

    @property
    def motion(self) -> Motion:
        """Peak and root mean square of displacement and rotation."""
        distance_mm = np.linalg.norm(self.room_m, axis=1) * 1e3
        return Motion(
            float(distance_mm.max()),
            float(np.sqrt(np.mean(distance_mm**2))),
            float(self.room_deg.max()),
            float(np.sqrt(np.mean(self.room_deg**2))),
        )


def trace(track: Track, squeezed: dict[str, Any], T_wrist_hand: Array) -> Trace:
    """Reduce a track to what the report needs."""
    touching = [index for index, truth in enumerate(track.truths) if truth.contact_force_N.any()]
    first = max(touching[0] - 1, 0) if touching else 0
    truths = track.truths[first:]
    start = truths[0]
    R_world_hand = (start.T_world_wrist @ T_wrist_hand)[:3, :3]
    room_m = np.array([truth.T_world_object[:3, 3] - start.T_world_object[:3, 3] for truth in truths])
    turns = [pinocchio.log3(t.T_world_object[:3, :3] @ start.T_world_object[:3, :3].T) for t in truths]
    times_ns = np.array([truth.time_ns for truth in truths])
    seen = np.array([_planar(start.T_hand_object, truth.T_hand_object) for truth in truths])
    predicted = np.array([record["predicted_motion"] for record in track.records])
    before = np.searchsorted(track.record_times_ns, start.time_ns)
    predicted = (predicted - predicted[before]) * (1e3, 1e3, np.degrees(1.0))
    at_truth = np.clip(np.searchsorted(track.record_times_ns, times_ns), 0, len(predicted) - 1)
    return Trace(
        (times_ns - times_ns[0]) * 1e-9,
        room_m,
        np.degrees(np.linalg.norm(turns, axis=1)),
        (room_m @ R_world_hand)[:, :2] * 1e3,
        seen,
        predicted[at_truth],
        squeezed,
    )


def _planar(start: Array, now: Array) -> tuple[float, float, float]:
    """Motion in hand axes: x, y in mm and θ in deg."""
    shift = (now[:3, 3] - start[:3, 3]) * 1e3
    turn = pinocchio.log3(now[:3, :3] @ start[:3, :3].T)
    return float(shift[0]), float(shift[1]), float(np.degrees(turn[2]))


@dataclass(frozen=True)
class CaseResult:
    """One grasp with one index: without and with compensation."""

    name: str
    grasp: dict[str, Any]
    index: str
    default: bool
    without: Trace
    compensated: Trace

    def as_json(self) -> dict[str, Any]:
        """The case in the form that programs rely on."""
        return {
            "name": self.name,
            "grasp": self.grasp,
            "index": self.index,
            "default": self.default,
            "motion_without": msgspec.to_builtins(self.without.motion),
            "motion_with": msgspec.to_builtins(self.compensated.motion),
            "squeeze": self.compensated.squeezed.get("applied", {}),
        }

    @property
    def left_percent(self) -> float:
        """What is left of the peak displacement, %."""
        return 100.0 * self.compensated.motion.peak_mm / self.without.motion.peak_mm

    @property
    def accepted(self) -> bool:
        """≥ 8 mm without; with, ≤ 10 % of the millimetres, and of the degrees where they were ≥ 1° (else 0.2°)."""
        without, left = self.without.motion, self.compensated.motion
        turn_deg = 0.1 * without.peak_deg if without.peak_deg >= 1.0 else 0.2
        return without.peak_mm >= 8.0 and left.peak_mm <= 0.1 * without.peak_mm and left.peak_deg <= turn_deg


def draw(results: list[CaseResult], file: Path) -> None:
    """The demo's picture: for each grasp the object's path in the room, its displacement over time, and what the table
    said of the motion in the hand beside what was so."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    shown = [result for result in results if result.default]
    figure, rows = plt.subplots(len(shown), 3, figsize=(12.5, 3.6 * len(shown)), squeeze=False, layout="constrained")
    for (path, time, hand), result in zip(rows, shown, strict=True):
        without, left = result.without, result.compensated
        path.plot(*without.hand_plane_mm.T, color="tab:red", label="without compensation")
        path.plot(*left.hand_plane_mm.T, "o", color="tab:green", markersize=3, label="with")
        path.set(title=f"{result.name}: object in the room", xlabel="across the hand, mm", ylabel="out of the palm, mm")
        path.axis("equal")
        path.legend(loc="best", fontsize="small")
        time.semilogy(without.time_s, np.maximum(np.linalg.norm(without.room_m, axis=1) * 1e3, 1e-3), color="tab:red")
        time.semilogy(left.time_s, np.maximum(np.linalg.norm(left.room_m, axis=1) * 1e3, 1e-3), color="tab:green")
        time.axhline(0.1 * without.motion.peak_mm, color="grey", linestyle=":", label="10 % of the peak")
        time.set(
            title=f"left: {result.left_percent:.1f} % of {without.motion.peak_mm:.1f} mm",
            xlabel="time since first touch, s",
            ylabel="displacement, mm",
        )
        time.legend(loc="best", fontsize="small")
        for column, (name, colour) in enumerate(
            (("x, mm", "tab:blue"), ("y, mm", "tab:orange"), ("θ, deg", "tab:purple"))
        ):
            hand.plot(left.time_s, left.seen_in_hand_mm[:, column], color=colour, label=f"{name}, so")
            hand.plot(left.time_s, left.predicted_in_hand_mm[:, column], "k--", linewidth=0.9)
        hand.set(title="in the hand: so (colour), predicted (dashed)", xlabel="time since first touch, s")
        hand.legend(loc="best", fontsize="small")
    figure.savefig(file, dpi=110)
    plt.close(figure)
