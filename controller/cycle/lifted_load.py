"""When the arm carries the object: its weight enters the arm model as soon as it is lifted, not when it is gripped.

While the object stands on its support, the support carries it, however hard the fingers pull. Lifted is what the
planned wrist has been raised by more than `LIFTED_M` since the fingers began to close; set down again at that height,
or let go, it is the support's once more. The weight is ramped so that torques do not jump (design 4, "Arm model").

The object is the motion table's: its mass, and its place in the hand at first contact. Along the hand's z its centre is
taken to lie in the fingers' plane, and its inertia about its centre is left out [assumed]: grams and centimetres beside
the rotors of the arm.
"""

from __future__ import annotations

from controller.cycle.arm_model import ArmModel, Payload
from controller.cycle.arm_motion import ArmMotion
from controller.cycle.grasp_state import GraspPhase
from controller.cycle.grasping import Grasping

LIFTED_M = 1e-4
"""The plan is exact: it moves when a command moves it."""
RAMP_S = 0.2
_STILL_GRIPPED = frozenset({GraspPhase.CONTACT, GraspPhase.SQUEEZING, GraspPhase.HOLDING, GraspPhase.CARRYING})


class LiftedLoad:
    """Tells the arm model, period by period, which part of the object it carries."""

    def __init__(self, model: ArmModel, motion: ArmMotion, grasping: Grasping, period_s: float) -> None:
        self._model, self._motion, self._grasping = model, motion, grasping
        self._step = period_s / RAMP_S
        self._phase = GraspPhase.NONE
        self._gripped_at_m = 0.0

    def step(self) -> None:
        """One period."""
        phase, before = self._grasping.phase, self._phase
        self._phase = phase
        if phase is GraspPhase.CLOSING and before is not GraspPhase.CLOSING:
            self._gripped_at_m = self._height_m()
            self._model.set_payload(_object_of(self._grasping))
        carried = self._model.payload_fraction
        wanted = 1.0 if self._is_carried(phase) else 0.0
        if carried != wanted:
            self._model.set_payload_fraction(min(max(wanted, carried - self._step), carried + self._step))

    def _is_carried(self, phase: GraspPhase) -> bool:
        gripped = phase in _STILL_GRIPPED or (phase is GraspPhase.FAULT and self._grasping.gripping)
        return gripped and self._height_m() - self._gripped_at_m > LIFTED_M

    def _height_m(self) -> float:
        """Of the planned wrist over the world's origin: the compensation's offset on top of it lifts nothing."""
        return float(self._motion.T_world_wrist_plan[2, 3])


def _object_of(grasping: Grasping) -> Payload | None:
    table = grasping.table
    if table is None:
        return None
    x_m, y_m, _ = table.contact_pose
    return Payload(table.object_mass_kg, (x_m, y_m, 0.0))
