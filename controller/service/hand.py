"""The hand process: owns the serial bus of the tendon motors and goes as fast as it is told to poll.

It follows the cycle's set-points. Without a fresh one it freezes: both excursions stay where they are, under the
holding cap. It adopts motors that already hold when it starts, and never opens the hand on its own, neither in a fault
nor on exit. A motor that lost its torque stays without until the hand is told to open; then it is brought up again.
"""

from __future__ import annotations

from dataclasses import dataclass

from controller.cycle.pacer import Pacer
from controller.messages import HandFault, HandMode, HandSetPoint, HandState, Pair
from controller.service.links import LatestReader, LatestSender
from drivers.clock import Clock, nanoseconds
from drivers.dynamixel.tendons import TendonPair, TendonSample, TendonSetPoint
from drivers.errors import BusError, DeviceError, InputError, NoReplyError, ProtocolError

_HARDWARE_FAULTS = {0x01: HandFault.VOLTAGE, 0x04: HandFault.OVERHEATED, 0x20: HandFault.OVERLOADED}
"""Bits of the motors' hardware error (dynamixel reference 6.2) that have a name of their own."""


@dataclass(frozen=True)
class HandSettings:
    """How the hand process paces itself, and when it no longer believes the cycle."""

    period_s: float = 0.0025
    set_point_age_s: float = 0.1
    opening_rate_m_s: float = 0.012
    silent_for_fault_s: float = 0.06
    """Without a good answer of a motor: told within 0.1 s, and a short disturbance is none."""


class HandPart:
    """Exchanges set-points and samples with the motors, one transaction a step."""

    def __init__(
        self,
        clock: Clock,
        tendons: TendonPair,
        set_points: LatestReader,
        states: LatestSender,
        settings: HandSettings,
    ) -> None:
        self._clock = clock
        self._tendons = tendons
        self._set_points = set_points
        self._states = states
        self._settings = settings
        self.pacer = Pacer(clock, nanoseconds(settings.period_s))
        self._goal_m: Pair = (0.0, 0.0)
        self._mode = HandMode.FREEZE
        self._last: TendonSample | None = None
        self._warnings: list[str] = []

    def start(self) -> None:
        """Find both motors and adopt what they hold. Raises DeviceError."""
        for identity in self._tendons.start():
            found = [*identity.warnings, *([identity.refusal] if identity.refusal else [])]
            self._warnings += [f"tendon motor {identity.motor_id} {text}" for text in found]
        self._last = self._tendons.exchange()
        self._goal_m = self._last.excursion_m
        self.pacer.restart()

    def step(self) -> None:
        """One transaction: the newest set-point out, a sample in, the state published."""
        fault = HandFault.NONE
        try:
            fault = self._ask(self._aim(self.pacer.begin()))
            self._last = self._tendons.exchange()
            fault |= self._judge(self._last)
            if any(self._last.watchdog_tripped):
                # The motors stopped and hold, and take no goals until told so (dynamixel reference 6.3).
                self._tendons.rearm()
        except InputError:
            fault = HandFault.REFUSED
        except BusError:
            fault = HandFault.BUS_LOST
        except DeviceError:
            pass  # an answer was lost while rearming: the watchdog still shows, and the next round tries again
        if self._last is not None:
            self._publish(self._last, fault)

    def take_warnings(self) -> list[str]:
        """What the operator has not been told yet: how the motors were found, or why one cannot be brought up."""
        taken, self._warnings = self._warnings, []
        return taken

    def stop(self) -> None:
        """The end: both motors hold their excursions by themselves. Raises DeviceError."""
        self._tendons.freeze()
        self._tendons.stop()

    def _aim(self, now_ns: int) -> TendonSetPoint | None:
        """What to ask of the motors; None leaves their goals as they are."""
        newest = self._set_points.newest()
        if newest is None:
            return None
        payload, sample_ns = newest
        wanted = HandSetPoint.unpack(payload)
        stale = self._set_points.closed or now_ns - sample_ns > nanoseconds(self._settings.set_point_age_s)
        before, self._mode = self._mode, HandMode.FREEZE if stale else wanted.mode
        if self._mode is HandMode.FREEZE:
            if before is not HandMode.FREEZE:
                # A motor that stalled at its cap short of its goal would go on pulling: the goal comes to where it is.
                try:
                    self._tendons.freeze(wanted.load_cap_N)
                except InputError:  # a cap that no motor takes: held all the same, under the ceilings as they are
                    self._tendons.freeze()
            return None
        if self._mode is HandMode.TRACK:
            self._goal_m = wanted.excursion_m
        elif before is not HandMode.OPEN and self._last is not None:
            self._restore(self._last)
            self._goal_m = self._last.excursion_m
        else:
            step_m = self._settings.opening_rate_m_s * self._settings.period_s
            self._goal_m = (_towards_zero(self._goal_m[0], step_m), _towards_zero(self._goal_m[1], step_m))
        return TendonSetPoint(self._goal_m, wanted.load_cap_N)

    def _ask(self, set_point: TendonSetPoint | None) -> HandFault:
        """Hand the set-point over; one that the motors refuse does not keep them from being read."""
        if set_point is not None:
            try:
                self._tendons.set_excursion(*set_point.excursion_m, set_point.load_cap_N)
            except InputError:
                return HandFault.REFUSED
        return HandFault.NONE

    def _restore(self, sample: TendonSample) -> None:
        """The hand is to open, so that nothing is held any more: a motor without torque may be switched on again."""
        if all(sample.torque_on) or any(sample.hardware_error):
            return
        try:
            self._tendons.restore()
        except (NoReplyError, ProtocolError):
            pass  # it still shows, and the next opening tries again
        except BusError:
            raise
        except DeviceError as error:
            self._warnings.append(str(error))

    def _judge(self, sample: TendonSample) -> HandFault:
        fault = HandFault.NONE
        limit_ns = self._clock.now_ns() - nanoseconds(self._settings.silent_for_fault_s)
        silent = [
            missed > 0 and sample_ns < limit_ns
            for missed, sample_ns in zip(sample.missed, sample.sample_ns, strict=True)
        ]
        if any(silent):
            fault |= HandFault.NO_REPLY if all(silent) else HandFault.NO_REPLY | HandFault.ONE_SILENT
        if bits := sample.hardware_error[0] | sample.hardware_error[1]:
            fault |= HandFault.HARDWARE
            for bit, named in _HARDWARE_FAULTS.items():
                fault |= named if bits & bit else HandFault.NONE
        if not all(sample.torque_on):
            # A motor without torque lets go of its tendon (dynamixel reference 6.2): the object may have been dropped.
            fault |= HandFault.TORQUE_LOST
        if any(sample.jumped):
            fault |= HandFault.POSITION_JUMP
        if min(sample.derating) < 1.0:
            fault |= HandFault.HOT
        if any(sample.restarted):
            fault |= HandFault.RESTARTED
        if any(sample.outside_turn):
            fault |= HandFault.OUTSIDE_TURN
        if any(identity.refusal for identity in self._tendons.identities):
            fault |= HandFault.OTHER_MODE
        return fault

    def _publish(self, sample: TendonSample, fault: HandFault) -> None:
        state = HandState(
            sample.excursion_m,
            sample.rate_m_s,
            sample.tension_N,
            sample.effort,
            self._mode,
            fault,
            sample.tension_uncertainty_N,
            sample.temperature_C,
            sample.voltage_V,
            sample.derating,
            sample.read_rate_hz,
        )
        self._states.send(state.pack(), sample.oldest_ns)


def _towards_zero(value: float, step: float) -> float:
    return 0.0 if abs(value) <= step else value - step if value > 0.0 else value + step
