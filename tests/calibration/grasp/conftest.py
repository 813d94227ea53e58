"""Grasps that the tests of paths, forces and friction share."""

from collections.abc import Callable

import pytest
from msgspec.structs import replace

from calibration.grasp.equilibrium import GraspSystem, grasp_system
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.objects import load_object


@pytest.fixture(scope="session")
def grasping() -> Callable[..., GraspSystem]:
    """A grasp by names of hand, preset and object; on request with another tip radius, stop or tendon."""

    def made(
        hand: str,
        preset: str,
        object_name: str,
        *,
        radius_m: float | None = None,
        stop_deg: float | None = None,
        tendon_stiffness_N_per_m: float | None = None,
        onset_split: float = 0.0,
    ) -> GraspSystem:
        found = load_hand(hand, preset)
        finger = found.right
        if radius_m is not None:
            finger = replace(finger, tip=replace(finger.tip, radius_m=radius_m))
        if stop_deg is not None:
            finger = replace(finger, distal_joint=replace(finger.distal_joint, flexion_limit_deg=(0.0, stop_deg)))
        if tendon_stiffness_N_per_m is not None:
            finger = replace(finger, tendon_stiffness_N_per_m=tendon_stiffness_N_per_m)
        return grasp_system(
            replace(found, right=finger, left=finger), load_object(object_name), GraspSpec(onset_split=onset_split)
        )

    return made
