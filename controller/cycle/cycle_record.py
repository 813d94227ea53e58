"""One flat record of all that the cycle saw and commanded in a period, in the order of `CYCLE_RECORD`."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from controller.cycle.compensation import STILL
from controller.cycle.planar_table import STATUS_NUMBERS
from controller.messages import CYCLE_RECORD, HandState
from controller.service.links import LatestSender
from drivers.wam.arm import ArmSample

if TYPE_CHECKING:  # the cycle makes its recorder itself
    from controller.cycle.cycle import Cycle, Parts

_NO_JOINTS = (0.0,) * 7
_NO_READING = (0.0,) * 4
_NO_HAND = (0.0,) * 4
_NO_MOTORS = (0.0,) * 12


class CycleRecorder:
    """Packs and sends the records of one cycle."""

    def __init__(self, cycle: Cycle, parts: Parts, sender: LatestSender) -> None:
        self._cycle, self._parts, self._sender = cycle, parts, sender
        self._pack = struct.Struct(f"<{CYCLE_RECORD.length}d").pack

    def write(
        self,
        sample: ArmSample | None,
        replies: int,
        hand: HandState | None,
        hand_sample_ns: int,
        torque_Nm: NDArray[np.float64],
        governor: float,
        now_ns: int,
    ) -> None:
        """Send the record of the period that began at `now_ns`. `sample`: the last one; `replies`: good positions of
        this period."""
        cycle, parts = self._cycle, self._parts
        motion, grasping = parts.motion, parts.grasping
        reading = grasping.reading
        # A list packed at once costs half of slices written one by one.
        self._sender.send(
            self._pack(
                cycle.number,
                cycle.pacer.missed,
                cycle.pacer.late_ns * 1e-3,
                cycle.cpu_us,
                parts.orders.arm_state,
                grasping.hand_status,
                grasping.phase,
                parts.orders.fault,
                parts.orders.compensation,
                grasping.index_kind,
                *(_NO_JOINTS if sample is None else sample.joint_rad.tolist()),
                *motion.joint_rad.tolist(),
                *motion.joint_velocity_rad_s.tolist(),
                *torque_Nm.tolist(),
                *motion.wrist_target_xyz_m.tolist(),
                *motion.T_world_wrist_plan[:3, 3].tolist(),
                *motion.T_world_wrist_plan[:3, :3].ravel().tolist(),
                parts.model.payload_fraction,
                *grasping.offset_target.pose,
                *parts.smoother.motion.pose,
                *parts.smoother.motion.rate,
                motion.scale,
                governor,
                grasping.winding.position_m,
                grasping.winding.rate_m_s,
                *(_NO_READING if reading is None else reading[:4]),
                *(STILL.pose if reading is None else reading.motion.pose),
                0 if reading is None else STATUS_NUMBERS[reading.status],
                *(_NO_HAND if hand is None else (*hand.excursion_m, *hand.tension_N)),
                0.0 if hand is None else (now_ns - hand_sample_ns) * 1e-3,
                *(_NO_MOTORS if hand is None else _motors(hand)),
                replies,
            ),
            now_ns,
        )


def _motors(hand: HandState) -> tuple[float, ...]:
    """What the tendon motors say of themselves."""
    return (
        *hand.effort,
        *hand.tension_uncertainty_N,
        *hand.temperature_C,
        *hand.voltage_V,
        *hand.derating,
        hand.read_rate_hz,
        hand.fault,
    )
