"""The arm's faults in the cycle: what is asked of it besides positions, which fault stands, and what has to be done.

    hold     the arm stops along its path; `Orders.fail` sees to that
    idle     the safety puck is asked for idle, again and again until it is so; meanwhile gravity alone is held up where
             there are no positions, because feedback would push against what nobody reports
    restart  with `fault.clear`: the bus is opened again if it was lost, pucks are found, woken, and zeroed at home

Torque never comes back by itself: what restarts is an idle arm, and activating it is the operator's.
Source: WAM reference 4.1, 4.5, 4.6; design 5.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from controller.messages import Reason
from controller.reasons import ARM_REASONS
from drivers.errors import DeviceError, InputError
from drivers.wam.arm import Arm, ArmSample
from drivers.wam.fault_table import ARM_FAULTS, ArmFault, NamedFault, Reaction, Recovery
from drivers.wam.safety_puck import ArmMode
from drivers.wam.startup import ArmIdentity, Operator

POLL_CYCLES = 25
"""Between two questions for the mode, and between two others, in turn."""
LONGEST_POWER_UP_S = 5.0
_LOST_BUS_CYCLES = 5
_QUESTIONS = 3
"""That are asked about missing positions before their silence is a fault."""
_VAGUE = (Reason.ARM_SILENT, Reason.ARM_IDLED, Reason.BUS_FAILED)


class Found(NamedTuple):
    """A fault of the arm, and its values as events carry them."""

    reason: Reason
    values: tuple[float, ...] = ()


def tells_more(reason: Reason, standing: Reason) -> bool:
    """Whether a fault is worth telling though another stands: it names the cause of a vague one, or needs more to
    recover from."""
    if reason is standing or standing is Reason.NONE:
        return standing is Reason.NONE
    return (standing in _VAGUE and reason not in _VAGUE) or _recovery(reason) > _recovery(standing)


class ArmSupervision:
    """Watches one arm. `say` is for the operator."""

    def __init__(
        self,
        arm: Arm,
        silent_cycles: int,
        operator: Operator | None = None,
        say: Callable[[str], None] = lambda _: None,
    ) -> None:
        """`silent_cycles` without a whole reading are a fault; why they are missing is asked before."""
        self._arm = arm
        self._silent_cycles = silent_cycles
        self._suspicious_cycles = max(1, silent_cycles - _QUESTIONS)
        self._operator = operator if operator is not None else Operator()
        self._say = say
        self._needed = Recovery.NOTHING
        self._asked_ns: int | None = None
        self._lost_cycles = 0
        self._since_bus = _LOST_BUS_CYCLES
        self._starting = False
        self.motor_firmware = 0
        """Of the motor pucks, once the arm was started."""
        self.given_up = False
        """The arm cannot be held: it is to go idle."""
        self.blind = False
        """And there are no positions to hold it by."""
        self.pending = False
        """The arm left its active mode, and why is not known yet."""

    def start(self) -> None:
        """Find the arm. Raises DeviceError."""
        self._take(self._arm.start(self._operator))

    # --- each cycle

    def ask(self, number: int, sample: ArmSample) -> None:
        """One question in passing, when it is time for one. Raises BusError."""
        if number % POLL_CYCLES == 0:
            self._arm.poll_safety_mode()
        elif sample.incomplete_cycles >= self._suspicious_cycles:
            self._arm.poll_state(sample.missing)
        elif number % POLL_CYCLES == POLL_CYCLES // 2:
            self._arm.poll_state()

    def look(self, sample: ArmSample, silent: bool, idle_wanted: bool) -> Found | None:
        """The fault that the arm has now; after a reading. Raises BusError."""
        self._since_bus += 1
        fault = self._arm.fault(sample, silent=silent, idle_wanted=idle_wanted or self.given_up)
        self.pending = fault is None and self._arm.explains_later
        if fault is None:
            self._lost_cycles = 0
            return None
        if fault.code is ArmFault.BUS_OFF:
            return self.lose_bus(fault)
        if fault.code is ArmFault.ARM_SILENT and self._since_bus < _LOST_BUS_CYCLES:
            return None  # the bus has just come back, and with it the arm may
        self._lost_cycles = 0
        if ARM_FAULTS[fault.code].reaction is Reaction.IDLE and self._arm.mode is ArmMode.ACTIVE:
            self.given_up = True
            self.blind = self.blind or not sample.complete
        return self._found(fault)

    def lose_bus(self, fault: NamedFault | None = None) -> Found:
        """The bus has failed in this cycle: what that means. An arm that was not seen for a few cycles is held where it
        is found, if the bus comes back before the pucks' heartbeat ends it."""
        self._since_bus = 0
        self._lost_cycles += 1
        if self._lost_cycles >= _LOST_BUS_CYCLES:
            self.blind = True
        return self._found(fault or self._arm.bus_fault or NamedFault(ArmFault.BUS_FAILED))

    def give_up(self) -> None:
        """The arm does not hold although it shall: it is to go idle."""
        self.given_up = True

    def go_idle(self, now_ns: int) -> None:
        """Ask for idle, again every 50 ms, as long as an arm that was given up is active. Raises BusError."""
        if not self.given_up or self._arm.mode is not ArmMode.ACTIVE:
            return
        if self._asked_ns is None or now_ns - self._asked_ns >= 50_000_000:
            self._asked_ns = now_ns
            try:
                self._arm.request_idle()
            except InputError:
                # Safety firmware before 197 leaves idling to the pendant: hold where it is, once that is known.
                self.given_up = False

    def see(self) -> None:
        """The command was set to where the arm is seen again: an arm that cannot be idled may be held there."""
        self.blind = self.given_up

    def change_mode(self) -> None:
        """The arm has another mode: what was asked for is done, or the operator has decided."""
        self.given_up = self.blind = False
        self._asked_ns = None

    # --- the end of a fault

    def recover(self, sample: ArmSample | None) -> Reason:
        """Do what the arm needs before its fault may be cleared: NONE, or why it may not. Takes as long as a start-up
        if one is needed; the operator hears why it fails."""
        if self._starting:
            return Reason.BUSY
        needed = self._needed
        silent = sample is None or sample.incomplete_cycles >= self._silent_cycles  # one lost reply is no silent arm
        if silent or self._arm.mode is ArmMode.OFFLINE:
            needed = max(needed, Recovery.START)
        if needed is not Recovery.NOTHING:
            if needed is Recovery.START and self._arm.mode is ArmMode.ESTOP:
                return Reason.ARM_ESTOP
            self._starting = True
            try:
                operator = replace(self._operator, wait_s=min(self._operator.wait_s, LONGEST_POWER_UP_S))
                self._take(self._arm.restart(needed, operator))
            except (DeviceError, InputError) as error:
                self._say(f"the arm cannot be started again: {error}")
                return Reason.ARM_NOT_READY
            finally:
                self._starting = False
        self._arm.forget_faults()
        self._needed = Recovery.NOTHING
        self._lost_cycles = 0
        self.change_mode()
        return Reason.NONE

    def _found(self, fault: NamedFault) -> Found:
        self._needed = max(self._needed, ARM_FAULTS[fault.code].recovery)
        return Found(ARM_REASONS[fault.code], fault.values)

    def _take(self, found: ArmIdentity) -> None:
        self.motor_firmware = found.motors.firmware[0]
        for note in found.notes:
            self._say(f"arm: {note}")


def _recovery(reason: Reason) -> Recovery:
    return _RECOVERIES.get(reason, Recovery.NOTHING)


_RECOVERIES = {reason: ARM_FAULTS[fault].recovery for fault, reason in ARM_REASONS.items()}
