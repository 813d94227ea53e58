"""A grasp planned in full before the robot moves: where the hand goes, whether it holds, how hard to squeeze.

Prepositioning (paper II-A), stability (II-B), grasping force (II-C) and the parasitic motion that comes with it (II-E)
of one hand, object and grasp. Hand frame, SI, finger order right, left. Source: paper II; hand-mechanics reference 7,
13.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.grasp.constraints import RobotHandConstraints, robot_hand_constraints
from calibration.grasp.equilibrium import GraspSystem, grasp_system
from calibration.grasp.force import PER_CONTACT, Effort, ForceLevels, force_levels, squeeze_path
from calibration.grasp.friction import STANDARD_GRAVITY_M_PER_S2
from calibration.grasp.path import STEP_M, Path
from calibration.grasp.preposition import FirstContact
from calibration.grasp.specification import GraspSpec
from calibration.grasp.stability import ForceClosure, force_closure
from calibration.hand.finger import Reals
from calibration.hand.parameters import Hand
from calibration.objects import GraspObject
from drivers.errors import MechanicsError


@dataclass(frozen=True)
class GraspPlan:
    """What is known of a grasp before it is made."""

    hand: Hand
    object: GraspObject
    grasp: GraspSpec
    mass_kg: float
    system: GraspSystem
    closure: ForceClosure
    levels: ForceLevels
    constraints: RobotHandConstraints | None
    """(8)–(12) at minimal effort; None if nothing below the load cap holds the object"""
    path: Path

    @property
    def start(self) -> FirstContact:
        """First contact: contacts, normals, Q_DC, loads."""
        return self.system.start

    @property
    def T_hand_object(self) -> Reals:
        """(4, 4) object at first contact in the hand frame; its outline is turned by `start.outline_angle_rad` more."""
        x, y, _ = self.start.object_pose
        T = np.eye(4)
        T[:2, 3] = x, y
        return T

    @property
    def minimal(self) -> Effort | None:
        """Minimal effort, with the object's motion up to it."""
        return self.levels.minimal

    @property
    def largest_required_friction(self) -> float:
        """Largest |f_t|/N of both contacts along the whole path."""
        return float(np.nanmax(self.path.required_friction))

    @property
    def unstable_from_m(self) -> float | None:
        """Mean winding since first contact from which the equilibrium is unstable; None if it is stable throughout."""
        unstable = np.flatnonzero(~self.path.stable)
        return float(self.path.excursion_m[unstable[0]].mean()) if unstable.size else None


def plan_grasp(hand: Hand, object: GraspObject, grasp: GraspSpec, mass_kg: float | None = None) -> GraspPlan:
    """Plan a grasp; `mass_kg` is the object's own unless another is given.

    `grasp.supported` says whether the object drags on its support while it is squeezed; else it hangs in the
    fingers, which then carry its weight by friction. Errors: MechanicsError when the hand cannot take the object so,
    and for a mass, friction or support that do not fit.
    """
    mass_kg = object.mass_kg if mass_kg is None else mass_kg
    if not 0 < mass_kg <= 20:
        raise MechanicsError("mass_kg", f"{mass_kg!r} is not > 0 and ≤ 20 kg.")
    if grasp.supported and object.support is None:
        raise MechanicsError(
            "grasp.supported",
            f"{object.name} has no [support], but the grasp says it stands on one.",
            help="Change either.",
        )
    system = grasp_system(hand, object, grasp)
    path = squeeze_path(system, mass_kg, lifted=not grasp.supported, step_m=STEP_M)
    levels = force_levels(path, mass_kg, grasp.contact_friction, lifted=not grasp.supported)
    out_of_plane_N = 0.0 if grasp.supported else mass_kg * STANDARD_GRAVITY_M_PER_S2 / PER_CONTACT
    return GraspPlan(
        hand,
        object,
        grasp,
        mass_kg,
        system,
        force_closure(system.start.contact_points_m, system.start.normals, grasp.contact_friction),
        levels,
        None
        if levels.minimal is None
        else robot_hand_constraints(system, levels.minimal.w, grasp.contact_friction, out_of_plane_N),
        path,
    )
