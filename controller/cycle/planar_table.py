"""The motion table as the cycle reads it: plain numbers of a planar hand with two tendons.

With three numbers a pose, plain floats are quicker than arrays; everything the cycle needs of a sample is unpacked
once.
"""

from __future__ import annotations

from typing import NamedTuple

from calibration.motion_table import MotionTable, Status, TableSample
from controller.cycle.compensation import Vector3
from controller.messages import Pair
from drivers.errors import TableError

USABLE = frozenset({Status.INSIDE, Status.BEFORE_CONTACT, Status.FROZEN})
STATUS_NUMBERS = {status: number for number, status in enumerate(Status)}


class PlanarSample(NamedTuple):
    """Object pose (x, y, θ) in the hand with its slopes along both index axes; both tendon loads, and the slope of
    their mean along the first axis."""

    status: Status
    pose: Vector3
    along_first: Vector3
    along_second: Vector3
    tension_N: Pair
    mean_tension_slope: float

    @property
    def usable(self) -> bool:
        """Whether the pose may be followed."""
        return self.status in USABLE

    @property
    def mean_tension_N(self) -> float:
        """Mean tendon load, N."""
        return 0.5 * (self.tension_N[0] + self.tension_N[1])


class PlanarTable:
    """A motion table of a planar two-tendon hand. Raises TableError for any other."""

    def __init__(self, table: MotionTable) -> None:
        if len(table.header.tendons) != 2:
            tendons = len(table.header.tendons)
            raise TableError(table.source, f"is for {tendons} tendons; the cycle drives two.")
        self.table = table
        right, left = table.contact_excursion_m.tolist()
        self.contact_excursion_m: Pair = (right, left)
        right, left = table.contact_tension_N.tolist()
        self.contact_tension_N: Pair = (right, left)
        right, left = table.free_closing_stiffness_N_per_m.tolist()
        self.free_slope_N_per_m: Pair = (right, left)
        x, y, _, _, _, angle = table.contact_pose.tolist()
        self.contact_pose: Vector3 = (x, y, angle)
        self.object_mass_kg = float(table.header.object["mass_kg"])
        hand = table.header.hand
        self.compliance_m_per_N: Pair = (_compliance(hand["right"]), _compliance(hand["left"]))

    @property
    def mean_contact_m(self) -> float:
        """Mean of both contact excursions, m."""
        return 0.5 * (self.contact_excursion_m[0] + self.contact_excursion_m[1])

    def at_excursion(self, mean_m: float, difference_m: float) -> PlanarSample:
        """Look up by mean excursion since contact and difference right − left, m."""
        return self._planar(self.table.at_excursion(mean_m, difference_m))

    def _planar(self, sample: TableSample) -> PlanarSample:
        value, first, second = sample.rows.tolist()
        x, y, angle = self.contact_pose
        return PlanarSample(
            sample.status,
            (x + value[0], y + value[1], angle + value[5]),
            (first[0], first[1], first[5]),
            (second[0], second[1], second[5]),
            (value[6], value[7]),
            0.5 * (first[6] + first[7]),
        )


def _compliance(finger: dict[str, object]) -> float:
    """Stretch of the tendon between spool and finger, m/N; the header writes an infinite stiffness as text."""
    stiffness = float(str(finger["tendon_stiffness_N_per_m"]))
    return 1.0 / stiffness


def finger_excursion_m(table: PlanarTable, finger: int, winding_m: float, contact_zone_m: float) -> float:
    """Finger-side excursion of one finger (0 right, 1 left) at a winding coordinate, m.

    From `contact_zone_m` before contact on both fingers wind at equal rate; before that each covers its own way from
    the open hand, so that both enter the zone together.
    """
    contact_m = table.contact_excursion_m[finger]
    if winding_m >= -contact_zone_m:
        return contact_m + winding_m
    share = (winding_m + table.mean_contact_m) / (table.mean_contact_m - contact_zone_m)
    return (contact_m - contact_zone_m) * share
