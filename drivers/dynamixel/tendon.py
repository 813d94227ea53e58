"""One tendon of the pair: what its motor last said and is believed, in SI units, and what was sent to it.

A motor in joint mode (MX-28 with protocol 1.0) tells its position within one turn: beyond the end of it, a spool that
only just left its travel seems to be a turn away. That is noticed here, because no spool turns so fast: positions go on
beyond the turn's end (`outside_turn`), and the goal on the wire stays inside it, so that the motor goes back by the
short way, or holds at the end. Excursions positive = pulled in. Source: dynamixel reference 1.3, 2.1, 2.2.
"""

from __future__ import annotations

from collections.abc import Mapping

from drivers.clock import seconds
from drivers.dynamixel.bus import motor_name
from drivers.dynamixel.effort_filter import EffortFilter
from drivers.dynamixel.goal import TendonGoal
from drivers.dynamixel.load_law import SpoolMotion
from drivers.dynamixel.motor import Inspection, TendonMotor
from drivers.errors import DeviceError, ProtocolError

JUMP_RAD = 0.025
"""Position may change by so much from one good sample to the next, and by twice the no-load speed."""


class Tendon:
    """One motor with what is known of it. Effort is not filtered; the tension is worked out of filtered effort."""

    __slots__ = (
        "_effort_filter",
        "_effort_unit",
        "_found",
        "_jump_ticks",
        "_rate_unit_m_s",
        "_suspect",
        "_ticks_per_s",
        "_turn_ticks",
        "derating",
        "effort",
        "excursion_m",
        "goal",
        "hardware_error",
        "jumped",
        "motion",
        "motor",
        "motor_id",
        "rate_m_s",
        "restarted",
        "sample_ns",
        "sent_ceiling",
        "sent_goal",
        "settings",
        "supply_V",
        "temperature_C",
        "tension_N",
        "ticks",
        "torque_on",
        "uncertainty_N",
        "watchdog_tripped",
    )

    def __init__(
        self, motor: TendonMotor, found: Inspection, goal: TendonGoal, values: Mapping[str, int], now_ns: int
    ) -> None:
        settings, model = motor.settings, motor.model
        self.motor, self.settings, self.motor_id = motor, settings, settings.motor_id
        sign = settings.tightening_sign
        self._effort_unit = sign * model.effort_unit
        self._rate_unit_m_s = sign * model.velocity_unit_rad_s * settings.spool_radius_m
        self._jump_ticks = JUMP_RAD / model.tick_rad
        self._ticks_per_s = 2.0 * model.no_load_speed_rad_s / model.tick_rad
        self._effort_filter = EffortFilter(settings.effort_filter_s)
        self.motion = SpoolMotion.HOLDING
        self.restarted = False
        self.begin(found, goal, values["present_position"])
        self.take(values, now_ns)

    def begin(self, found: Inspection, goal: TendonGoal, ticks: int) -> None:
        """It was brought up, with this goal, here."""
        self._found, self.goal, self.ticks = found, goal, ticks
        self._turn_ticks = 0
        self.sent_goal, self.sent_ceiling = goal.ticks, goal.ceiling
        self.restarted = self.jumped = False
        self._suspect: tuple[int, int] | None = None
        self._effort_filter.reset()

    @property
    def outside_turn(self) -> bool:
        """The spool left the turn in which its motor knows its place."""
        return self._turn_ticks != 0

    @property
    def hears_goals(self) -> bool:
        """A goal may be sent to it though it does not answer: it switches nothing on."""
        return not self._found.goal_switches_on

    def wire_goal(self) -> int:
        """The goal to send: no farther from where it is than it may lead, and a position that the motor takes."""
        goal = self.goal.commanded(self.ticks) - self._turn_ticks
        if not self._turn_ticks:
            return goal
        lowest, highest = self._found.goal_range
        return max(lowest, min(highest, goal))

    def believe(self, values: Mapping[str, int], sample_ns: int, restarts_show: bool) -> DeviceError | None:
        """Take over what the motor said, unless it cannot be; then why not.

        `restarts_show`: a restart is known as such; if not, a motor without torque is taken to have restarted.
        A position that jumped is believed when the next sample says the same: the encoder failed, or a turn was lost.
        """
        if not _pulls(values):
            self.restarted |= not (restarts_show or values["hardware_error_status"])
            self.ticks, self._turn_ticks = values["present_position"], 0
        else:
            ticks = self._continued(values["present_position"], sample_ns)
            if self._stays(values["present_position"], sample_ns):
                self.jumped, self._turn_ticks = True, 0
                ticks = values["present_position"]
            if ticks is None:
                self._suspect = values["present_position"], sample_ns
                return ProtocolError(
                    motor_name(self.motor_id),
                    f"position jumped from {self.ticks} to {values['present_position'] + self._turn_ticks} ticks in "
                    f"{seconds(sample_ns - self.sample_ns) * 1e3:.1f} ms.",
                    help="The motor restarted or its encoder failed.",
                )
            self.ticks, self._suspect = ticks, None
        self.take(values, sample_ns)
        return None

    def take(self, values: Mapping[str, int], sample_ns: int) -> None:
        """Work out everything from the values of a sample, at the position that was settled on."""
        settings, model = self.settings, self.motor.model
        self.sample_ns = sample_ns
        self.torque_on = _pulls(values)
        self.hardware_error = values["hardware_error_status"]
        self.watchdog_tripped = values.get("bus_watchdog", 0) < 0
        self.excursion_m = settings.excursion_m(self.ticks, model)
        self.effort = values[model.effort_register] * self._effort_unit
        self.rate_m_s = values["present_velocity"] * self._rate_unit_m_s
        self.supply_V = values["present_input_voltage"] * model.voltage_unit_V
        self.temperature_C = float(values["present_temperature"])
        self.derating = settings.derating(self.temperature_C)
        effort, rate_m_s = self._effort_filter.step(sample_ns, self.effort, self.rate_m_s)
        law = settings.load_law
        self.motion = law.motion(rate_m_s, self.motion)
        estimate = law.tension(
            effort, self.motion, rate_m_s=rate_m_s, supply_V=self.supply_V, temperature_C=self.temperature_C
        )
        self.tension_N, self.uncertainty_N = estimate.tension_N, estimate.uncertainty_N

    def _continued(self, position: int, sample_ns: int) -> int | None:
        """The position, perhaps beyond the turn's end; None if the spool cannot have got there."""
        turn_ticks = self._turn_ticks
        if turn := self._found.wraps_ticks:  # the nearest: goals lead no farther than a fraction of a turn
            turn_ticks = round((self.ticks - position) / turn) * turn
        ticks = position + turn_ticks
        if abs(ticks - self.ticks) > self._allowed_ticks(sample_ns - self.sample_ns):
            return None
        self._turn_ticks = turn_ticks
        return ticks

    def _stays(self, position: int, sample_ns: int) -> bool:
        """Whether the sample before, which could not be, agrees with this one, rather than what was so before it."""
        if self._suspect is None:
            return False
        before, before_ns = self._suspect
        distance = abs(position - before)
        is_nearer = distance < abs(position + self._turn_ticks - self.ticks)
        return is_nearer and distance <= self._allowed_ticks(sample_ns - before_ns)

    def _allowed_ticks(self, elapsed_ns: int) -> float:
        return self._jump_ticks + self._ticks_per_s * seconds(elapsed_ns)


def _pulls(values: Mapping[str, int]) -> bool:
    """Torque is on; also false after a shutdown in protocol 1.0, which takes the Torque Limit away."""
    return values["torque_enable"] == 1 and values.get("torque_limit", 1) > 0
