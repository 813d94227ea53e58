"""The equilibria of a table's nodes by other means: a general optimiser, and a physics engine that winds slowly.

Both do a sub-grid, warm-started from node to node as the table's own continuation is; what a node takes of processor
time is then reckoned up to the whole grid. Both must find the table's equilibria, or there is an error.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import NonlinearConstraint, minimize

from calibration.grasp.equilibrium import GraspSystem
from calibration.hand.parameters import Hand
from calibration.motion_table import MotionTable
from calibration.objects.parameters import GraspObject, Support
from controller.simulation.truth import WorldObserver
from controller.simulation.world import World
from drivers.errors import MechanicsError
from drivers.wam.parameters import load_wam_parameters

Array = NDArray[np.float64]
AGREED_M = 2e-5
BEHIND = 0.015
"""Share of the motion by which the physics engine may differ: its joints' damping and its soft friction."""
WINDING_M_S = 2e-3
"""Slow enough to be taken as at rest. Standing still for long is no better: soft friction lets the object creep."""
SHORT_M = 2e-4
"""So much before contact the fingers come to rest, then go on slowly."""
FIRST_ROW = 4
"""Before it the fingers press so little that an object without friction swings for long."""
SPOOL_RADIUS_M = 0.0105
WRIST_HEIGHT_M = 0.9109  # of the arm pointing straight up: hand frame and world then share their axes
LENGTHS = np.array([0.03, 0.03, 0.03, 0.03, 0.008, 0.008])
"""Typical sizes of the six constraints."""


@dataclass(frozen=True)
class Rival:
    """Processor time of one node, s, over `nodes` of them."""

    seconds_per_node: float
    nodes: int


def by_optimiser(system: GraspSystem, table: MotionTable, rows: int, columns: int) -> Rival:
    """Elastic energy minimised by SLSQP, contacts and excursions as constraints, all Jacobians analytic."""
    n, scale = system.unknowns, system.column_scale[: system.unknowns]
    difference_m = table.arrays["excursion.axis_1"]
    target = np.zeros(2)

    def state(scaled: Array) -> Array:
        return np.asarray(np.concatenate([scaled * scale, np.zeros(8)])[None])

    def energy(scaled: Array) -> float:
        return float(50.0 * (system.stiffness * (scaled * scale) ** 2).sum())

    def torques(scaled: Array) -> Array:
        return np.asarray(100.0 * system.stiffness * scaled * scale**2)

    def constraints(scaled: Array) -> Array:
        terms = system.terms(state(scaled))
        wound = [jet.value[0].sum() - wanted for jet, wanted in zip(terms.tendons, target, strict=True)]
        values = np.concatenate([terms.contacts[0].value[0], terms.contacts[1].value[0], wound])
        return np.asarray(values / LENGTHS)

    def slopes(scaled: Array) -> Array:
        terms, result = system.terms(state(scaled)), np.zeros((6, n))
        for index, (jet, tendon, part) in enumerate(zip(terms.contacts, terms.tendons, system.parts, strict=True)):
            result[2 * index : 2 * index + 2, part] = jet.gradient[0, :, : part.stop - part.start]
            result[2 * index : 2 * index + 2, system.joints :] = jet.gradient[0, :, part.stop - part.start :]
            result[4 + index, part] = tendon.gradient[0].sum(0)
        return np.asarray(result * scale / LENGTHS[:, None])

    spent_s, count = 0.0, 0
    for across in np.linspace(difference_m[10], difference_m[-11], columns):
        scaled = system.first_state()[:n] / scale
        for along in np.linspace(0.0, 0.8 * table.mean_excursion_end_m(float(across)), rows + 1)[1:]:
            target[:] = system.start.tendon_excursion_m + along + np.array([0.5, -0.5]) * across
            began_s = time.process_time()
            best = minimize(
                energy,
                scaled,
                jac=torques,
                method="SLSQP",
                constraints=NonlinearConstraint(constraints, 0.0, 0.0, jac=slopes),
                options={"ftol": 1e-13, "maxiter": 300},
            )
            spent_s += time.process_time() - began_s
            count += 1
            scaled = best.x
            found = (scaled * scale)[system.joints :] - system.start.object_pose
            _must_agree("the general optimiser", found, table, float(along), float(across))
    return Rival(spent_s / count, count)


def by_physics(hand: Hand, grasped: GraspObject, system: GraspSystem, table: MotionTable, rows: int) -> Rival:
    """Nodes of equal excursions in MuJoCo, passed slowly one after the other."""
    contact = system.start
    T_world_object = np.eye(4)
    T_world_object[:3, 3] = (*contact.object_pose[:2], WRIST_HEIGHT_M)
    world = World(
        hand,
        msgspec.structs.replace(grasped, support=Support(friction=0.0), height_m=0.02),
        load_wam_parameters(),
        T_world_base=np.eye(4),
        T_wrist_hand=np.eye(4),
        T_world_object=T_world_object,
        joint_rad=np.zeros(7),
        spool_radius_m=SPOOL_RADIUS_M,
        outline_angle_rad=contact.outline_angle_rad,
        hand_only=True,
    )
    observer = WorldObserver(world, hand)
    step_m = float(table.arrays["excursion.axis_0"][1])
    _wind(world, contact.tendon_excursion_m - SHORT_M, 1.0)
    world.advance_to(world.time_ns + round(0.3e9))
    _wind(world, np.full(2, SHORT_M + FIRST_ROW * step_m), (SHORT_M + FIRST_ROW * step_m) / WINDING_M_S)
    spent_s = 0.0
    for _ in range(rows):
        began_s = time.process_time()
        _wind(world, np.full(2, step_m), step_m / WINDING_M_S)
        spent_s += time.process_time() - began_s
        truth = observer.truth()
        pose, excursion_m = truth.T_hand_object, truth.tendon_excursion_m - contact.tendon_excursion_m
        turned_rad = float(np.arctan2(pose[1, 0], pose[0, 0]))
        found = np.array([*(pose[:2, 3] - contact.object_pose[:2]), turned_rad])
        mean_m, difference_m = float(excursion_m.mean()), float(excursion_m[0] - excursion_m[1])
        _must_agree("the physics engine", found, table, mean_m, difference_m, BEHIND * float(np.hypot(*found[:2])))
    return Rival(spent_s / rows, rows)


def _wind(world: World, excursion_m: Array, duration_s: float) -> None:
    world.wind_spools(tuple(excursion_m / SPOOL_RADIUS_M / duration_s))
    world.advance_to(world.time_ns + round(duration_s * 1e9))
    world.wind_spools((0.0, 0.0))


def _must_agree(
    who: str, motion: Array, table: MotionTable, mean_m: float, difference_m: float, within_m: float = AGREED_M
) -> None:
    expected = np.array(table.at_excursion(mean_m, difference_m).planar_motion)
    if not np.allclose(motion[:2], expected[:2], atol=within_m):
        raise MechanicsError(
            "benchmark", f"{who} finds {motion * 1e3} mm at {mean_m * 1e3:.2f} mm, the table {expected * 1e3}."
        )
