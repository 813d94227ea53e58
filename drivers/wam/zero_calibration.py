"""Calibrates the zero of one arm: with the arm placed in a known pose by hand, what do its absolute encoders show?

The operator's plan: leave the arm idle, place it in its home pose (the angles are told; a level and the links' flats
help), keep hands off, confirm. The encoders are then read for half a second; an arm that moves meanwhile, that another
program controls, or that is not idle is refused. Nothing is written to the pucks but IFAULT, limits and, by `zero`, the
positions. Joint angles in rad (DH), zero angles in rad of motor angle. Source: WAM reference 4.4.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock, nanoseconds
from drivers.errors import DeviceError, ProtocolError
from drivers.wam.bus import ARM_FILTERS, CanBus
from drivers.wam.dialogue import Dialogue
from drivers.wam.discovery import MOTOR_NODES
from drivers.wam.frames import GROUP_BIT, is_position, sender
from drivers.wam.homing import Homing, Positions, read_mechanical_counts
from drivers.wam.motor_settings import MotorSettings
from drivers.wam.parameters import WamParameters
from drivers.wam.safety_puck import SafetyPuck
from drivers.wam.startup import StartUp
from drivers.wam.zeroing import zero_angles

CALIBRATION_FILTERS = (*ARM_FILTERS, (GROUP_BIT, 0x7F8))
"""What the arm says, and what another host sends to groups 0 to 7: torques and position requests."""
_LISTENING_S = 0.25
_READINGS = 8
_READING_PERIOD_S = 0.06
_STANDSTILL_TURN = 0.002
"""Share of a motor turn by which a motor at rest may seem to move: 8 counts of 4096."""


@dataclass(frozen=True, eq=False)
class ZeroCalibration:
    """What was found; `home_rad` and `zero_angle_rad` belong into the arm's own file."""

    home_rad: NDArray[np.float64]
    """The pose in which the arm stood (7)."""
    zero_angle_rad: NDArray[np.float64]
    """Angle of each absolute encoder with all joints at zero (7), −1 for motors without one."""
    absolute_encoders: tuple[int, ...]
    """Motors, 1 to 7, that have one."""
    notes: tuple[str, ...]
    """What start-up had to say about the arm."""


class ZeroMeasurement:
    """First `prepare`; then, with the arm in place, `measure`; and `zero` to use what was found at once.

    Raises BusError, NoReplyError, ProtocolError and DeviceError as start-up does.
    """

    def __init__(self, bus: CanBus, clock: Clock, parameters: WamParameters) -> None:
        self._bus, self._clock, self._parameters = bus, clock, parameters
        self._dialogue = Dialogue(bus, clock)
        self._safety = SafetyPuck(bus, clock)
        self._steps = StartUp(bus, clock, parameters, self._safety)
        self._motors: MotorSettings | None = None

    def prepare(self) -> None:
        """See that nobody else controls the arm and that it is idle; find, wake and check its pucks."""
        self._require_alone()
        self._steps.open_safety_puck()
        self._steps.wake(self._steps.await_idle())
        self._motors = self._steps.settle()

    def measure(self, joint_rad: NDArray[np.float64]) -> ZeroCalibration:
        """Read the encoders of the arm that stands at `joint_rad` (7)."""
        motors = self._prepared()
        self._require_alone()
        self._steps.require_idle()
        mechanical = self._read_at_rest(motors)
        found = tuple(node for node, count in zip(MOTOR_NODES, mechanical, strict=True) if count is not None)
        angles = zero_angles(joint_rad, motors.counts_per_turn, mechanical)
        return ZeroCalibration(joint_rad, angles, found, self._steps.notes)

    def zero(self, calibration: ZeroCalibration) -> Positions:
        """Zero the arm, which still stands there, by its new calibration."""
        parameters = replace(self._parameters, home_rad=calibration.home_rad, zero_angle_rad=calibration.zero_angle_rad)
        homing = Homing(self._dialogue, parameters, self._safety, self._prepared())
        return homing.zero(homing.plan())

    def _prepared(self) -> MotorSettings:
        assert self._motors is not None, "prepare() comes first"
        return self._motors

    def _require_alone(self) -> None:
        """Listen without a word: positions that nobody here asked for, or another host's group frames, refuse."""
        while self._bus.receive(0) is not None:
            pass  # what came while the operator was busy says nothing about now
        deadline_ns = self._clock.now_ns() + nanoseconds(_LISTENING_S)
        heard = 0
        while (message := self._bus.receive(deadline_ns)) is not None:
            heard += is_position(message) or (sender(message) == 0 and bool(message.arbitration_id & GROUP_BIT))
        if heard:
            raise DeviceError(
                "WAM",
                f"another program controls the arm: {heard} frames of a control loop in {_LISTENING_S} s.",
                help="Stop it ('stillgrasp send shutdown' stops the daemon) and try again.",
            )

    def _read_at_rest(self, motors: MotorSettings) -> tuple[float | None, ...]:
        """Mean MECH of each absolute encoder in counts, None for the others; all motors must be at rest."""
        homing = Homing(self._dialogue, self._parameters, self._safety, motors)
        readings: list[tuple[int | None, ...]] = []
        positions: list[tuple[int, ...]] = []
        for _ in range(_READINGS):
            positions.append(homing.read_positions())
            readings.append(read_mechanical_counts(self._dialogue, motors))
            self._dialogue.pause(_READING_PERIOD_S)
        positions.append(homing.read_positions())
        moved = np.ptp(np.array(positions), axis=0)
        means: list[float | None] = []
        for index, turn in enumerate(motors.counts_per_turn):
            if moved[index] > _STANDSTILL_TURN * turn:
                raise DeviceError(
                    "WAM",
                    f"motor {index + 1} moved {moved[index]} counts while it was measured; "
                    f"expected at most {_STANDSTILL_TURN * turn:.0f}.",
                    help="Let the arm rest, keep hands off and measure again.",
                )
            counts = [reading[index] for reading in readings]
            means.append(None if None in counts else self._mean(index + 1, np.array(counts, dtype=float), turn))
        return tuple(means)

    def _mean(self, motor: int, counts: NDArray[np.float64], turn: int) -> float:
        """Mean on the circle of one turn; ProtocolError if an encoder jumps while its motor rests."""
        offsets = np.mod(counts - counts[0] + turn / 2, turn) - turn / 2
        if np.ptp(offsets) > _STANDSTILL_TURN * turn:
            raise ProtocolError(
                f"puck {motor}",
                f"its absolute encoder reads {counts.astype(int).tolist()} while the motor rests.",
                help="Have the encoder checked; without it the motor can be zeroed by home alone.",
            )
        return float(np.mod(counts[0] + offsets.mean(), turn))
