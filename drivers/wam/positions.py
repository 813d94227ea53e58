"""Position replies of the seven motors, gathered into whole readings of the joints.

Joint angles in rad and speeds in rad/s (DH); motor counts as on the wire; times in ns. Cables couple joints to motors:
motors of different moments never mix: a reading is whole or it is not used. Without one all seven joints are carried on
from the last whole one, with its filtered speed, for a few cycles; then the last whole one stands, with its own time.
Source: WAM reference 2.5, 4.6, 4.7, 5.1, 5.4, 7.

    stale        a reply that waited before the request, or the earlier of two from one puck
    implausible  more than a quarter motor turn from the last (btclient's rule), half a turn once one was missed; before
                 the first reading a quarter turn for each period that has passed since start-up, eight turns at most
    jumped       three such in a row that agree among themselves: the counter has moved, its zero is lost

Of two answers of one puck in one reading the later counts: the other belongs to an earlier request. Replies that come
out of the order of nodes make the driver wait their usual time, so that a stale one cannot end the reading before the
true one is there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.wam.frames import position_counts
from drivers.wam.joint_encoders import JointEncoders
from drivers.wam.parameters import JOINTS
from drivers.wam.transmission import motor_to_joint

SAMPLING_DELAY_NS = 75_000
"""From the position request to the moment the encoders are sampled (WAM reference 4.7)."""
VELOCITY_FILTER_RAD_S = 180.0
_JUMP_READINGS = 3
_PERIOD_NS = 2_000_000
_MOST_FIRST_QUARTERS = 32
_CABLE_STRETCH_RAD = 0.05
"""Beyond this a joint encoder and its motor do not tell of the same joint, and the motor is believed [assumed]."""
_TURN = 2.0 * np.pi
_NOBODY: tuple[int, ...] = ()


class ArmSample(NamedTuple):
    """One reading of the arm."""

    joint_rad: NDArray[np.float64]
    """Joint angles (7) at `sample_ns`."""
    joint_rad_s: NDArray[np.float64]
    """Their speeds (7), through the vendor's first-order filter."""
    sample_ns: int
    """When the encoders were sampled; of an extrapolated reading, when they should have been."""
    complete: bool
    """All seven positions are of this cycle and plausible."""
    replies: int
    """Good positions of this cycle, 0 to 7."""
    missing: tuple[int, ...]
    """Nodes without a good position in this cycle."""
    stale: int
    """Positions dropped because they were older than the request or came twice."""
    rejected: int
    """Positions dropped because the motor cannot have turned so far."""
    malformed: int
    """Position replies of another length."""
    incomplete_cycles: int
    """Cycles in a row without a whole reading, this one included; 0 if it is whole."""
    extrapolated: bool
    """`joint_rad` was carried on from the last whole reading; otherwise it is that reading."""
    age_ns: int
    """How old the last whole reading was when the encoders were, or should have been, sampled."""
    repeated: bool
    """Positions were asked for twice."""


class PositionReader:
    """Takes the replies of one cycle after another: `begin`, `take` each reply, `finish`."""

    def __init__(self, longest_extrapolation: int) -> None:
        """`longest_extrapolation`: cycles in a row."""
        self._longest = longest_extrapolation
        self._joint_per_count = np.zeros((JOINTS, JOINTS))
        self._quarter_turn = [1024] * JOINTS
        self._encoders = JointEncoders()
        self.know([0] * JOINTS, [4096] * JOINTS, 0)

    def know(
        self,
        motor_counts: Sequence[int],
        counts_per_turn: Sequence[int],
        sample_ns: int,
        encoders: JointEncoders | None = None,
    ) -> None:
        """Begin anew from a reading of start-up, at rest."""
        self._quarter_turn = [counts // 4 for counts in counts_per_turn]
        self._joint_per_count = np.array([motor_to_joint(row) for row in np.diag(_TURN / np.array(counts_per_turn))]).T
        self._counts = list(motor_counts)
        self._missed = [0] * JOINTS
        self._odd: list[tuple[int, int]] = [(0, 0)] * JOINTS
        self._encoders = encoders if encoders is not None else JointEncoders()
        self._joint_counts: list[int | None] = [None] * JOINTS
        self._joint_rad = self._joint_per_count @ np.array(motor_counts, dtype=np.float64)
        self._joint_rad_s = np.zeros(JOINTS)
        self._whole_ns = sample_ns
        # A joint encoder that was not read yet gives no speed: the first whole reading starts from rest.
        self._from_rest = True
        self._incomplete = 0
        self.begin(sample_ns)

    def begin(self, request_ns: int, *, stale: int = 0) -> None:
        """Positions have been asked for; `stale` of an earlier request were dropped before."""
        self._sample_ns = request_ns + SAMPLING_DELAY_NS
        if self._from_rest:
            elapsed_ns = self._sample_ns - self._whole_ns
            self._first_quarters = min(_MOST_FIRST_QUARTERS, 1 + elapsed_ns // _PERIOD_NS)
        self._fresh: list[int | None] = [None] * JOINTS
        self._last_motor = -1
        self.replies = self._rejected = self._malformed = 0
        self._stale = stale
        self._repeated = False
        self.orderly = True
        """Replies came in the order of nodes, each puck once."""

    def begin_again(self, request_ns: int) -> None:
        """They have been asked for once more: only answers to this request make the reading."""
        self._sample_ns = request_ns + SAMPLING_DELAY_NS
        self._fresh = [None] * JOINTS
        self._last_motor = -1
        self.replies = 0
        self._repeated = True
        self.orderly = True

    def take(self, motor: int, data: bytes) -> None:
        """A position reply of `motor`, 0 to 6."""
        decoded = position_counts(data)
        if decoded is None:
            self._malformed += 1
            return
        counts, joint_counts = decoded
        # A motor that was missing may have turned for longer; more than half a turn is implausible in any case.
        allowed = self._quarter_turn[motor] * (
            self._first_quarters if self._from_rest else 1 + (self._missed[motor] > 0)
        )
        if not -allowed <= counts - self._counts[motor] <= allowed:
            self._reject(motor, counts)
            return
        if motor <= self._last_motor:
            self.orderly = False
        self._last_motor = motor
        if self._fresh[motor] is None:
            self.replies += 1
        else:
            self._stale += 1
        self._fresh[motor] = counts
        self._joint_counts[motor] = joint_counts

    @property
    def missing(self) -> tuple[int, ...]:
        """Nodes that have given no good position since the request."""
        if self.replies == JOINTS:
            return _NOBODY
        return tuple(motor + 1 for motor, counts in enumerate(self._fresh) if counts is None)

    @property
    def jumped(self) -> tuple[int, ...]:
        """Nodes whose counter is somewhere else altogether, and stays there."""
        return tuple(motor + 1 for motor, (_, times) in enumerate(self._odd) if times >= _JUMP_READINGS)

    def finish(self) -> ArmSample:
        """The reading, with whatever has come."""
        fresh = self._fresh
        complete = self.replies == JOINTS
        if complete:
            self._counts = fresh  # type: ignore[assignment]  # none of seven is None
            if self._incomplete or self._rejected:
                self._missed = [0] * JOINTS
                self._odd = [(0, 0)] * JOINTS
                self._incomplete = 0
            self._take_whole(self._joint_angles())
        else:
            self._incomplete += 1
            for motor, counts in enumerate(fresh):
                if counts is None:
                    self._missed[motor] += 1
                else:
                    self._counts[motor] = counts
                    self._missed[motor] = 0
                    self._odd[motor] = (0, 0)
        age_ns = self._sample_ns - self._whole_ns
        carried = 0 < self._incomplete <= self._longest
        return ArmSample(
            self._joint_rad + self._joint_rad_s * (age_ns * 1e-9) if carried else self._joint_rad,
            self._joint_rad_s,
            self._whole_ns + age_ns if carried else self._whole_ns,
            complete,
            self.replies,
            self.missing,
            self._stale,
            self._rejected,
            self._malformed,
            self._incomplete,
            carried,
            age_ns,
            self._repeated,
        )

    def _joint_angles(self) -> NDArray[np.float64]:
        joint_rad = self._joint_per_count @ np.array(self._counts, dtype=np.float64)
        for joint, counts_per_turn in zip(self._encoders.joints, self._encoders.counts_per_turn, strict=True):
            counts = self._joint_counts[joint]
            if counts is None:
                continue
            angle_rad = counts * _TURN / counts_per_turn
            if abs(angle_rad - joint_rad[joint]) <= _CABLE_STRETCH_RAD:
                joint_rad[joint] = angle_rad
            else:
                self._rejected += 1
        return joint_rad

    def _take_whole(self, joint_rad: NDArray[np.float64]) -> None:
        """Filter the speed over the true time between two samples: y ← (y + ω T x) / (1 + ω T)."""
        elapsed_s = (self._sample_ns - self._whole_ns) * 1e-9
        if self._from_rest or elapsed_s <= 0.0:
            self._from_rest = False
        else:
            # With T x = the way between the samples.
            way = joint_rad - self._joint_rad
            way *= VELOCITY_FILTER_RAD_S
            way += self._joint_rad_s
            way *= 1.0 / (1.0 + VELOCITY_FILTER_RAD_S * elapsed_s)
            self._joint_rad_s = way
        self._joint_rad, self._whole_ns = joint_rad, self._sample_ns

    def _reject(self, motor: int, counts: int) -> None:
        self._rejected += 1
        last, times = self._odd[motor]
        again = times > 0 and abs(counts - last) <= self._quarter_turn[motor]
        self._odd[motor] = (counts, times + 1 if again else 1)
