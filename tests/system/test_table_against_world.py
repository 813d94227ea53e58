"""The motion table against the simulated world, which shares none of its mechanics: bodies, springs, contacts instead.

Both tendons are wound at equal rate from first contact, slowly, with the hand held fast; at equal finger-side
excursions the object must be where the table says. The table knows no support friction, so the object stands on a
slippery support here: on a rough one the fingertips slip on the object until they press harder than it drags
(hand-mechanics reference 8).
"""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.build import build_table
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.motion_table import MotionTable, Status
from calibration.objects.parameters import Support, load_object
from controller.simulation.truth import WorldObserver, WorldTruth
from controller.simulation.world import World
from drivers.wam.parameters import load_wam_parameters

END_LOAD_N = 78.0
RATE_M_S = 1e-3
SPOOL_RADIUS_M = 0.0105
POINTS = 24
WRIST_HEIGHT_M = (
    0.9109  # of the arm pointing straight up (WAM reference 6.1): hand frame and world then share their axes
)


@dataclass(frozen=True, eq=False)
class Seen:
    """Object motion in the hand since first contact, (points, 3): x, y in m and θ in rad; and what goes with it."""

    motion: NDArray[np.float64]
    truths: list[WorldTruth]


def table_for(onset_split: float) -> MotionTable:
    return build_table(load_hand("t42pp"), load_object("cylinder40"), GraspSpec(onset_split=onset_split))


def squeeze(table: MotionTable, support_friction: float) -> Seen:
    """Wind a hand without arm, at `POINTS` steps up to the demo's end."""
    contact = table.header.contact
    x_m, y_m = contact.pose[:2]
    T_world_object = np.eye(4)
    T_world_object[:3, 3] = (x_m, y_m, WRIST_HEIGHT_M)
    world = World(
        load_hand("t42pp"),
        msgspec.structs.replace(load_object("cylinder40"), support=Support(friction=support_friction)),
        load_wam_parameters(),
        T_world_base=np.eye(4),
        T_wrist_hand=np.eye(4),
        T_world_object=T_world_object,
        joint_rad=np.zeros(7),
        spool_radius_m=SPOOL_RADIUS_M,
        hand_only=True,
    )
    short_m = 2e-4  # close to this side of contact, let the fingers come to rest, then go on slowly
    before_m = np.array(contact.excursion_m) - short_m
    for rate_m_s, duration_s in ((before_m, 1.0), (np.zeros(2), 0.3), (np.full(2, RATE_M_S), short_m / RATE_M_S)):
        world.wind_spools(tuple(rate_m_s / SPOOL_RADIUS_M))
        world.advance_to(world.time_ns + round(duration_s * 1e9))
    observer = WorldObserver(world, load_hand("t42pp"))
    start = observer.truth().T_hand_object
    end_m = end_excursion_m(table)
    truths = []
    for _ in range(POINTS):
        world.advance_to(world.time_ns + round(end_m / POINTS / RATE_M_S * 1e9))
        truths.append(observer.truth())
    poses = np.array([truth.T_hand_object for truth in truths])
    turned = poses[:, :3, :3] @ start[:3, :3].T
    motion = np.column_stack([poses[:, :2, 3] - (x_m, y_m), np.arctan2(turned[:, 1, 0], turned[:, 0, 0])])
    return Seen(motion, truths)


def end_excursion_m(table: MotionTable) -> float:
    """Mean excursion at which the table's mean load reaches the demo's end."""
    excursions_m = np.linspace(0.0, table.mean_excursion_end_m(0.0), 400)
    loads_N = [table.at_excursion(float(excursion_m), 0.0).tension.mean() for excursion_m in excursions_m]
    return float(np.interp(END_LOAD_N, loads_N, excursions_m))


@pytest.mark.parametrize("onset_split", [0.0, 0.1])
def test_object_is_where_the_table_says(onset_split: float) -> None:
    """The compensation is only as good as the table: 3 % of the motion, at equal excursions up to the demo's end."""
    table = table_for(onset_split)
    seen = squeeze(table, support_friction=0.02)
    contact_m = np.array(table.header.contact.excursion_m)
    total_m = np.linalg.norm(seen.motion[-1, :2])
    total_rad = abs(seen.motion[-1, 2])
    assert total_m > 0.013
    for motion, truth in zip(seen.motion, seen.truths, strict=True):
        excursion_m = truth.tendon_excursion_m - contact_m
        sample = table.at_excursion(float(excursion_m.mean()), float(excursion_m[0] - excursion_m[1]))
        assert sample.status is Status.INSIDE
        difference = motion - np.array(sample.planar_motion)
        assert np.linalg.norm(difference[:2]) <= 0.03 * total_m
        assert abs(difference[2]) <= max(0.03 * total_rad, np.radians(0.1))
        assert truth.tendon_tension_N == pytest.approx(sample.tension, rel=0.02)
        assert truth.contact_force_N == pytest.approx(sample.contact_force, rel=0.03, abs=0.03)


def test_rough_support_costs_only_the_first_slip() -> None:
    """100 g on friction 0.3: the tips slip some tenths of a millimetre at first, then the object follows the table."""
    table = table_for(0.0)
    seen = squeeze(table, support_friction=0.3)
    contact_m = np.array(table.header.contact.excursion_m)
    lag_m = np.array(
        [
            motion[1] - table.at_excursion(float((truth.tendon_excursion_m - contact_m).mean()), 0.0).planar_motion[1]
            for motion, truth in zip(seen.motion, seen.truths, strict=True)
        ]
    )
    later_m = lag_m[POINTS // 4 :]
    assert np.abs(lag_m).max() <= 0.03 * np.linalg.norm(seen.motion[-1, :2])
    assert np.all(later_m > 1e-4)  # behind the table, towards the fingertips
    assert np.ptp(later_m) < 1e-4
