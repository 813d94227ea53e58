"""The arm on its bus: started once, and then the bus side of one control cycle.

Joint angles in rad and joint torques in N·m, DH convention; times from the project's clock. The arm's mode is the
operator's: nothing here raises it. What a reading is says `positions.py`, what else is heard `watch.py`, what is wrong
`faults.py`. Source: WAM reference 4.6 (time-outs), 5.1 (cycle).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.errors import BusError
from drivers.wam.bus import CanBus, Reopenable, frames_of
from drivers.wam.dialogue import Dialogue
from drivers.wam.fault_table import NamedFault, Recovery
from drivers.wam.faults import FaultJudge, bus_fault
from drivers.wam.frames import (
    GROUP_ARM,
    GROUP_BIT,
    GROUP_LOWER_TORQUE,
    GROUP_UPPER_TORQUE,
    POSITION_MOTORS,
)
from drivers.wam.joint_encoders import read_joint_encoders
from drivers.wam.parameters import JOINTS, WamParameters
from drivers.wam.positions import ArmSample, PositionReader
from drivers.wam.safety_puck import ArmMode, PendantState, SafetyPuck
from drivers.wam.startup import ArmIdentity, Operator, StartUp
from drivers.wam.torques import TorquePacking
from drivers.wam.watch import ArmWatch

__all__ = ["Arm", "ArmSample", "ReadingOptions"]

_USUAL_READING_NS = 640_000
"""From the request to the last of seven replies, with usual stuff bits. To sleep so long and then read all of them
costs half the processor time of waking for each."""
_LONGEST_READING_NS = 720_000
"""The same with the most stuff bits, and an adapter's delay."""
_DEADLINE_GRACE_NS = 50_000
_MOST_FRAMES = 200
"""That are taken in one go: four times what a full bus carries in a cycle."""
_LOWER_TORQUE = GROUP_BIT | GROUP_LOWER_TORQUE
_UPPER_TORQUE = GROUP_BIT | GROUP_UPPER_TORQUE


@dataclass(frozen=True)
class ReadingOptions:
    """What is done about replies that do not come."""

    extrapolated_cycles: int = 5
    """So many cycles in a row the last whole reading is carried on; later, or with 0, it is given as it is."""
    repeat: bool = True
    """Ask once more within the cycle: at 0.72 ms, if seven more replies fit in before the deadline."""
    late_is_fault: bool = True
    """Replies that come late in most cycles are a fault."""


class Arm:
    """Seven motor pucks and a safety puck on one bus. First `start`, then in each cycle `request_positions`,
    `collect_positions`, `write_torques`.

    Anything that the bus refuses to send raises BusError from the call that sent it; nothing is sent later in its
    place, and `fault` names it.
    """

    def __init__(
        self, bus: CanBus, clock: Clock, parameters: WamParameters, options: ReadingOptions | None = None
    ) -> None:
        self._bus, self._frames = bus, frames_of(bus)
        self._clock = clock
        self._parameters = parameters
        self._options = options if options is not None else ReadingOptions()
        self._safety = SafetyPuck(bus, clock)
        self.watch = ArmWatch()
        """What is heard beside positions."""
        self._judge = FaultJudge(self.watch, late_is_fault=self._options.late_is_fault)
        self._reader = PositionReader(self._options.extrapolated_cycles)
        self._requests = [(GROUP_BIT | GROUP_ARM, bytes((48,)))]
        self._torques = TorquePacking(parameters.units_per_Nm, parameters.motor_torque_limit_units, 42)
        self._request_ns = 0
        self._bus_fault: NamedFault | None = None
        self.refused_frames = 0
        """Frames that the bus did not take."""
        self.repeated_requests = 0

    @property
    def mode(self) -> ArmMode:
        """Last known mode of the arm; OFFLINE before `start` and when the safety puck no longer answers."""
        return self.watch.mode

    @property
    def zeroed(self) -> bool | None:
        """Last seen ZERO of the safety puck; False means that positions are meaningless."""
        return self.watch.zeroed

    @property
    def pendant(self) -> PendantState | None:
        """Last seen pendant state."""
        return self.watch.pendant

    def start(self, operator: Operator | None = None) -> ArmIdentity:
        """Find, wake, check and, if positions were lost, zero the arm at `home_rad`, where the operator has put it.

        Takes some 0.3 s, over a second more if pucks have to be woken, and as long as `operator` lets it wait for what
        only they can do; without one the arm must be idle. Raises NoReplyError for missing pucks, ProtocolError for an
        inconsistent arm, DeviceError in E-stop or active.
        """
        found = StartUp(self._bus, self._clock, self._parameters, self._safety, operator).run()
        motors = found.motors
        encoders = read_joint_encoders(Dialogue(self._bus, self._clock), motors, self._parameters)
        self._requests = [(GROUP_BIT | group, bytes((motors.position_id,))) for group in motors.position_groups]
        limit_units = np.minimum(motors.torque_limit_units, self._parameters.motor_torque_limit_units)
        self._torques = TorquePacking(motors.units_per_Nm, limit_units, motors.torque_id)
        self._drain()  # what came during start-up says nothing about now
        self._reader.know(found.first_counts, motors.counts_per_turn, self._clock.now_ns(), encoders)
        self.watch.forget(found.safety_firmware, motors.firmware[0])
        self.forget_faults()
        return replace(found, notes=(*found.notes, *encoders.notes))

    def restart(self, recovery: Recovery, operator: Operator | None = None) -> ArmIdentity:
        """Start again after a fault, over a bus that is opened again if that is what was lost.

        Raises as `start`, and BusError if the bus cannot be opened.
        """
        if recovery is Recovery.REOPEN and isinstance(self._bus, Reopenable):
            self._bus.reopen()
        return self.start(operator)

    # --- one cycle

    def request_positions(self) -> None:
        """Ask all pucks for their positions; what still waits on the bus is read first, and its positions dropped."""
        try:
            stale = self._drain()
        except BusError as error:
            self._bus_fault = bus_fault(error)
            raise
        self._request_ns = self._clock.now_ns()
        self._reader.begin(self._request_ns, stale=stale)
        self._ask()

    def _drain(self) -> int:
        """Read what waits on the bus; the number of positions among it."""
        stale, now_ns = 0, self._clock.now_ns()
        receive, notice = self._frames.receive_frame, self.watch.notice
        for _ in range(_MOST_FRAMES):
            frame = receive(now_ns)
            if frame is None:
                break
            if frame[0] not in POSITION_MOTORS:
                notice(*frame)
            elif len(frame[1]) in (3, 6):
                stale += 1
            else:
                self.watch.malformed += 1
        return stale

    def collect_positions(self, deadline_ns: int) -> ArmSample:
        """Collect the replies to the last request until all seven are there or `deadline_ns` has come.

        Positions that are missing after the usual time are asked for once more, if there is time for seven replies and
        none has come since.
        """
        reader, asked_ns = self._reader, self._request_ns
        self._clock.sleep_until_ns(min(deadline_ns, asked_ns + _USUAL_READING_NS))
        try:
            again_ns = asked_ns + _LONGEST_READING_NS
            if not self._options.repeat or again_ns + _LONGEST_READING_NS > deadline_ns + _DEADLINE_GRACE_NS:
                again_ns = deadline_ns
            self._read(asked_ns + _USUAL_READING_NS)
            in_time = reader.replies
            self._read(min(again_ns, deadline_ns))
            if in_time < reader.replies < JOINTS:
                self._read(deadline_ns)  # what still comes is late, not lost: a second answer would only come later
            elif reader.replies < JOINTS and again_ns < deadline_ns:
                reader.begin_again(self._clock.now_ns())
                self.repeated_requests += 1
                self._ask()
                self._read(deadline_ns)
        except BusError as error:
            self._bus_fault = bus_fault(error)
            raise
        return reader.finish()

    def _read(self, deadline_ns: int) -> None:
        """Take frames until the reading is whole, and if its replies were disorderly until all have had their time."""
        reader, receive, notice = self._reader, self._frames.receive_frame, self.watch.notice
        take, motors = reader.take, POSITION_MOTORS
        for _ in range(_MOST_FRAMES):
            if reader.replies == JOINTS:
                if reader.orderly:
                    return
                deadline_ns = min(deadline_ns, self._request_ns + _LONGEST_READING_NS)
            frame = receive(deadline_ns)
            if frame is None:
                return
            motor = motors.get(frame[0])
            if motor is None:
                notice(*frame)
            else:
                take(motor, frame[1])

    def _ask(self) -> None:
        for identifier, data in self._requests:
            self._send(identifier, data)

    def write_torques(self, joint_torque_Nm: Sequence[float] | NDArray[np.float64]) -> None:
        """Send joint torques (7), N·m: as motor torques, each within its motor's limit, in two frames.

        InputError, and nothing sent, if they are not seven finite numbers.
        """
        # Both frames are ready before the first goes out.
        lower, upper = self._torques.frames(joint_torque_Nm)
        self._send(_LOWER_TORQUE, lower)
        self._send(_UPPER_TORQUE, upper)

    def request_idle(self) -> None:
        """Ask for idle and return at once; `mode` tells when it is so. InputError before safety firmware 197."""
        try:
            self._safety.request_idle()
        except BusError as error:
            self._bus_fault = bus_fault(error)
            raise

    def poll_safety_mode(self) -> None:
        """Ask the safety puck for its mode; a later `collect_positions` or `request_positions` notices the reply."""
        self._send(*self.watch.mode_question())

    def poll_state(self, missing: tuple[int, ...] = ()) -> None:
        """Ask one more question about the arm's state, as `ArmWatch.question` has it; its answer is noticed later."""
        self._send(*self.watch.question(missing))

    # --- faults

    def fault(self, sample: ArmSample, *, silent: bool = False, idle_wanted: bool = False) -> NamedFault | None:
        """What is wrong, by the reading of this cycle and all that was heard. `silent`: readings have been missing for
        longer than the caller bears; `idle_wanted`: it has asked for idle, which is then no fault."""
        judge = self._judge
        if judge.asks_pendant and (question := self.watch.pendant_question()) is not None:
            self._send(*question)
        return judge.judge(sample, self._reader.jumped, silent, idle_wanted)

    @property
    def explains_later(self) -> bool:
        """The arm went idle unasked, and the pendant may still tell why."""
        return self._judge.unexplained

    @property
    def bus_fault(self) -> NamedFault | None:
        """What the last BusError means, until `forget_faults`."""
        return self._bus_fault

    def forget_faults(self) -> None:
        """The operator has cleared the fault: what was counted and heard of it is past."""
        self._judge.forget()
        self._bus_fault = None

    def _send(self, identifier: int, data: bytes) -> None:
        try:
            self._frames.send_frame(identifier, data)
        except BusError as error:
            self.refused_frames += 1
            self._bus_fault = bus_fault(error)
            raise
