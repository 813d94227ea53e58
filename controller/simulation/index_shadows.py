"""What each index leaves of an object's motion, of one run on virtual time that is compensated by one of them.

The daemon compensates by one index, the *carrier*. Beside it the others are fed the same samples, and what they would
have left is worked out exactly: with the hand's planned pose H₀, the carrier's offset D_c and the hand as it truly
stood H, the arm's own error is E = D_c⁻¹ · H₀⁻¹ · H, and by another index the object stands at H₀ · D · E · T_HO. So
all indices cost one run, under the same noise and the same errors of the arm; only the governor's part is the
carrier's.

Motion is the object's in the room against its pose before the fingers touch, with no filter and no chosen window, in
three phases: winding (touch to the squeeze's end), holding, unwinding (until the first finger lets go). Like the demo's
report and the tests, this module looks at the truth.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np
import pinocchio
from numpy.typing import NDArray

from calibration.hand.parameters import Hand
from controller.cycle.compensation import STILL, PlanarMotion
from controller.cycle.grasping import Grasping
from controller.cycle.motion_index import IndexReading, IndexSettings, MotionIndex
from controller.cycle.planar_table import PlanarTable
from controller.cycle.winding import WindingState
from controller.messages import CompensationIndex, HandState, Pair
from controller.service.assembly import INDEX_NAMES
from controller.simulation.truth import WorldObserver
from controller.simulation.world import World

Array = NDArray[np.float64]

INDICES = tuple(INDEX_NAMES)
NO_INDEX = "none"
"""Without compensation."""
PHASES = ("winding", "holding", "unwinding")
_HOLD_EVERY = 10
"""While holding, every so many of the observations count: each looks at the physics anew."""


class Residual(msgspec.Struct, frozen=True):
    """Object motion in the room over one phase: largest and root mean square displacement and rotation."""

    peak_mm: float
    rms_mm: float
    peak_deg: float
    rms_deg: float


class Cell(msgspec.Struct, frozen=True):
    """One index in one grasp: residuals in the three phases. `index` "none": without compensation."""

    model: str
    condition: str
    grasp: str
    index: str
    carrier: str
    hold_s: float
    load_N: float
    """True mean tension at the end of winding."""
    winding: Residual
    holding: Residual
    unwinding: Residual


class ShadowedIndex(MotionIndex):
    """An index with one of each kind beside it, fed the same."""

    def __init__(self, table: PlanarTable, period_s: float, settings: IndexSettings, contact_zone_m: float) -> None:
        super().__init__(table, period_s, settings, contact_zone_m)
        self._shadows = {
            name: (kind, MotionIndex(table, period_s, settings, contact_zone_m)) for name, kind in INDEX_NAMES.items()
        }
        self.pose = dict.fromkeys(self._shadows, table.contact_pose)
        """Object in the hand, x, y, θ, as each index has it."""

    def start(self, hand: HandState) -> None:
        """As the index itself."""
        super().start(hand)
        for _, shadow in self._shadows.values():
            shadow.start(hand)

    def set_contact(self, contact_excursion_m: Pair, onset_load_N: Pair) -> None:
        """As the index itself."""
        super().set_contact(contact_excursion_m, onset_load_N)
        for _, shadow in self._shadows.values():
            shadow.set_contact(contact_excursion_m, onset_load_N)

    def take(self, hand: HandState, sample_ns: int, now_ns: int, *, winding: bool) -> None:
        """As the index itself."""
        super().take(hand, sample_ns, now_ns, winding=winding)
        for _, shadow in self._shadows.values():
            shadow.take(hand, sample_ns, now_ns, winding=winding)

    def advance(self, profile: WindingState, kind: CompensationIndex) -> IndexReading:
        """As the index itself; outside the table the last pose stands."""
        for name, (own_kind, shadow) in self._shadows.items():
            reading = shadow.advance(profile, own_kind)
            if reading.usable:
                self.pose[name] = reading.motion.pose
        return super().advance(profile, kind)


@dataclass(frozen=True, eq=False)
class Moment:
    """What is so at one time."""

    time_ns: int
    T_world_hand: Array
    T_hand_object: Array
    touching: int
    """Fingers on the object."""
    tension_N: float
    offset: dict[str, Array]
    """D by each index, 4×4."""


@dataclass
class StudyWatch:
    """Looks on while a grasp runs, up to its release; `hand` is the world's."""

    hand: Hand
    T_wrist_hand: Array
    grasping: Grasping | None = None
    watching: bool = False
    holding: bool = False
    moments: list[Moment] = field(default_factory=list)
    _observer: WorldObserver | None = None
    _count: int = 0

    def observe(self, world: World) -> None:
        """Note what is really so, and what each index says."""
        self._count += 1
        if not self.watching or (self.holding and self._count % _HOLD_EVERY):
            return
        self._observer = self._observer or WorldObserver(world, self.hand)
        truth = self._observer.truth()
        assert self.grasping is not None
        self.moments.append(
            Moment(
                truth.time_ns,
                truth.T_world_wrist @ self.T_wrist_hand,
                truth.T_hand_object,
                int(np.count_nonzero(truth.contact_force_N)),
                float(truth.tendon_tension_N.mean()),
                self._offsets(self.grasping),
            )
        )

    @staticmethod
    def _offsets(grasping: Grasping) -> dict[str, Array]:
        """What every index wants of the wrist now."""
        index, table = grasping.index, grasping.table
        if not isinstance(index, ShadowedIndex) or table is None:
            return dict.fromkeys(INDICES, np.eye(4))
        motions = {name: PlanarMotion(pose, STILL.rate, STILL.acceleration) for name, pose in index.pose.items()}
        return {name: _planar_pose(grasping.offset_of(table, motion).pose) for name, motion in motions.items()}

    def record_cycle(self, record: dict[str, Any], time_ns: int) -> None:
        """Not needed here."""

    def event(self, event: dict[str, Any], time_ns: int) -> None:
        """Not needed here."""


def cells(moments: list[Moment], ends_ns: tuple[int, int], what: tuple[str, str, str, str, float]) -> list[Cell]:
    """Residuals by every index. `ends_ns`: of winding and of holding; `contact`: object in the hand, 4×4."""
    touches = [number for number, moment in enumerate(moments) if moment.touching]
    first = max(touches[0] - 1, 0)
    both = next(number for number, moment in enumerate(moments) if moment.touching == 2)
    last = next(
        (n for n in range(both, len(moments)) if moments[n].touching < 2 and moments[n].time_ns > ends_ns[1]), -1
    )
    seen = moments[first:last]
    times_ns = np.array([moment.time_ns for moment in seen])
    phases = np.searchsorted(ends_ns, times_ns)
    squeezed = seen[int(np.searchsorted(times_ns, ends_ns[0])) - 1]
    model, condition, grasp, carrier, hold_s = what
    start = seen[0]

    def offset(moment: Moment, index: str) -> Array:
        """D by an index; without one, none."""
        return np.eye(4) if index == NO_INDEX else moment.offset[index]

    # before the touch the wrist may have moved already, where contact comes later than the table expects it
    T_world_planned = start.T_world_hand @ np.linalg.inv(offset(start, carrier))
    errors = [np.linalg.inv(T_world_planned @ offset(moment, carrier)) @ moment.T_world_hand for moment in seen]
    cells = []
    for index in (NO_INDEX, *INDICES):
        poses = [
            T_world_planned @ offset(moment, index) @ error @ moment.T_hand_object
            for moment, error in zip(seen, errors, strict=True)
        ]
        residuals = [_distance(poses[0], pose) for pose in poses]
        rows = np.array(residuals)
        by_phase = [_residual(rows[phases == number]) for number in range(len(PHASES))]
        cells.append(Cell(model, condition, grasp, index, carrier, hold_s, round(squeezed.tension_N, 2), *by_phase))
    return cells


def _planar_pose(pose: tuple[float, float, float]) -> Array:
    """Pose (4×4) of x, y, θ."""
    x, y, angle = pose
    T = np.eye(4)
    T[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    T[:2, 3] = x, y
    return T


def _distance(start: Array, now: Array) -> tuple[float, float]:
    """Displacement mm and rotation deg between two poses."""
    turn = pinocchio.log3(now[:3, :3] @ start[:3, :3].T)
    return float(np.linalg.norm(now[:3, 3] - start[:3, 3])) * 1e3, float(np.degrees(np.linalg.norm(turn)))


def _residual(rows: Array) -> Residual:
    """Of displacements mm and rotations deg, (n, 2)."""
    peak, rms = rows.max(axis=0), np.sqrt(np.mean(rows**2, axis=0))
    return Residual(*(round(float(value), 3) for value in (peak[0], rms[0], peak[1], rms[1])))
