"""Winds and unwinds one tendon motor slowly against a known tension, and reads what it tells meanwhile.

The motor is driven as in a grasp, by excursions under a load cap and within its travel; the other one holds where it
stands. Every exchange is looked at: a motor that let go, stalled, ran hot, fell silent or was dragged away from its
goal ends the run, and holds. Nothing here lets go, however it ends.

Strokes begin and end at rest; the readings are means over the even part between. Each step of the goal makes the effort
jump, and it falls until the next one: it is read midway, where it is that of an even ramp. Plan: `motor_load_plan.py`.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from calibration.motor_load import Reading
from calibration.motor_load_plan import LoadPlan
from drivers.clock import Clock, nanoseconds, seconds
from drivers.dynamixel.bus import motor_name
from drivers.dynamixel.load_law import LoadLaw, SpoolMotion
from drivers.dynamixel.motor import hardware_error_text
from drivers.dynamixel.sample import Pair, TendonSample, TendonSetPoint
from drivers.dynamixel.settings import MotorSettings
from drivers.dynamixel.tendons import TendonPair
from drivers.errors import DeviceError, InputError, NoReplyError, StillgraspError

SETTLE_S = 0.6
"""Rest before a stroke, and before a scale is read: a weight that was touched swings on."""
TRAVEL_SPEED_M_S = 0.010
UNEVEN_S, UNEVEN_PART = 0.3, 0.25
"""Of the beginning of a stroke that are not read: the spool comes up to speed."""
LARGEST_LAG_M = 0.008
LONGEST_SILENCE_S = 0.5
FEWEST_SAMPLES = 20
UNSTEADY_N, UNSTEADY_PART = 4.0, 0.15
"""By how much the two halves of a stroke may differ, of the tension too."""
START_S = 0.15
"""It takes some effort to get a spool going, which is no level of a scale."""
SCALE_LAST_M = 0.0025
SCALE_LEAST_M = 0.0006
"""Of the way to a level: what is read, and the least that must be."""


@dataclass(frozen=True, slots=True)
class _Sample:
    """One exchange of the motor that is measured."""

    time_s: float
    excursion_m: float
    rate_m_s: float
    effort: float
    voltage_V: float
    temperature_C: float


@contextlib.contextmanager
def held(pair: TendonPair) -> Iterator[None]:
    """However it ends, by an error or by Ctrl-C: both motors hold where they are, and need no more telling."""
    try:
        yield
    except BaseException:
        for last in (pair.freeze, pair.stop):  # one that is gone must not hide why this ended
            with contextlib.suppress(StillgraspError):
                last()
        raise
    pair.freeze()
    pair.stop()


class LoadRun:
    """Motor `index` (0 right, 1 left) of a pair that was started."""

    def __init__(
        self,
        pair: TendonPair,
        clock: Clock,
        motors: tuple[MotorSettings, MotorSettings],
        index: int,
        plan: LoadPlan,
        period_s: float,
    ) -> None:
        self._pair, self._clock, self._plan = pair, clock, plan
        self._index, self._settings = index, motors[index]
        self._name = motor_name(self._settings.motor_id)
        self._period_ns = nanoseconds(period_s)
        sample = pair.exchange()
        first, second = (_within(motor.travel_m, x) for motor, x in zip(motors, sample.excursion_m, strict=True))
        self._goals: Pair = (first, second)
        caps = [motor.start_cap_N for motor in motors]
        caps[index] = plan.cap_N
        self._caps_N: Pair = (caps[0], caps[1])
        self._next_ns = clock.now_ns()
        self._start_ns = self._next_ns

    @property
    def law(self) -> LoadLaw:
        """The law that the motor is driven by."""
        return self._settings.load_law

    def hold(self) -> TendonSample:
        """One exchange, goals unchanged: for whoever waits."""
        return self._exchange(self._goals[self._index])

    def go(self, end_m: float, speed_m_s: float = TRAVEL_SPEED_M_S) -> None:
        """To this excursion, and come to rest there."""
        self._move(end_m, speed_m_s)
        self._rest(SETTLE_S)

    def weigh(self, tension_N: float, step: str) -> list[Reading]:
        """Both branches at each speed of the plan, under a weight. InputError if the weight did not hang still."""
        plan, readings = self._plan, []
        for speed_m_s in plan.speeds_m_s:
            for motion in (SpoolMotion.WINDING, SpoolMotion.UNWINDING):
                place = f"{step}, {motion.name.lower()} at {speed_m_s * 1e3:g} mm/s"
                self._rest(SETTLE_S)
                end_m = plan.start_m + (plan.stroke_m if motion is SpoolMotion.WINDING else 0.0)
                samples = self._even(self._move(end_m, speed_m_s), speed_m_s, place)
                self._check_steady(samples, tension_N, motion, place)
                readings.append(_mean(samples, motion, tension_N, place))
        return readings

    def approach(self, level_N: float, motion: SpoolMotion, speed_m_s: float, place: str) -> Callable[[float], Reading]:
        """Pull a spring scale to about this level, or let it back to it; what makes a reading of what the scale says.

        InputError if the scale cannot be brought there, or is too stiff to read anything on the way.
        """
        plan, taken = self._plan, []
        end_m = plan.start_m + (plan.stroke_m if motion is SpoolMotion.WINDING else 0.0)
        reached = False
        for sample, tension_N in self._moving(end_m, speed_m_s):
            taken.append(sample)
            reached = motion.value * (tension_N - level_N) >= 0.0 and abs(sample.rate_m_s) > 0.5 * speed_m_s
            if reached and sample.time_s - taken[0].time_s > START_S:
                break
        stopped_m = self._rest(2.0 * SETTLE_S)
        if not reached and motion is SpoolMotion.WINDING:
            raise InputError(
                f"{place}: {level_N:.0f} N were not reached within {plan.stroke_m * 1e3:.1f} mm.",
                help="Tie the scale shorter, take a stiffer one, or name lower levels.",
            )
        last = [one for one in taken if abs(one.rate_m_s) > 0.7 * speed_m_s]
        last = [one for one in last if abs(one.excursion_m - taken[-1].excursion_m) <= SCALE_LAST_M]
        way_m = abs(last[-1].excursion_m - last[0].excursion_m) if last else 0.0
        if len(last) < FEWEST_SAMPLES or way_m < SCALE_LEAST_M:
            raise InputError(
                f"{place}: only {way_m * 1e3:.2f} mm were wound evenly on the way; expected {SCALE_LEAST_M * 1e3:g} or "
                "more.",
                help="Tie a spring or an elastic cord between, or name levels that are farther apart.",
            )
        x_m, effort = np.array([one.excursion_m for one in last]), np.array([one.effort for one in last])
        _, offset = np.polyfit(x_m - stopped_m, effort, 1)

        def read(tension_N: float) -> Reading:
            mean = _mean(last, motion, tension_N, place)
            return Reading(motion, tension_N, float(offset), mean.rate_m_s, mean.voltage_V, mean.temperature_C, place)

        return read

    def _rest(self, duration_s: float) -> float:
        """Hold for so long; mean excursion in the last third, m."""
        end_ns = self._clock.now_ns() + nanoseconds(duration_s)
        taken_m = [self.hold().excursion_m[self._index]]
        while self._clock.now_ns() < end_ns:
            taken_m.append(self.hold().excursion_m[self._index])
        return float(np.mean(taken_m[-max(1, len(taken_m) // 3) :]))

    def _move(self, end_m: float, speed_m_s: float) -> list[_Sample]:
        return [sample for sample, _ in self._moving(end_m, speed_m_s)]

    def _moving(self, end_m: float, speed_m_s: float) -> Iterator[tuple[_Sample, float]]:
        """Ramp the goal; each new sample, and its tension by the law that the motor is driven by, until the goal is
        there."""
        began_ns, began_m = self._clock.now_ns(), self._goals[self._index]
        direction = 1.0 if end_m > began_m else -1.0
        seen_ns = 0
        while self._goals[self._index] != end_m:
            way_m = speed_m_s * (self._next_ns + self._period_ns - began_ns) * 1e-9
            goal_m = end_m if way_m >= abs(end_m - began_m) else began_m + direction * way_m
            self._exchange(goal_m)
            sample = self._exchange(None)
            index = self._index
            if sample.sample_ns[index] == seen_ns:
                continue  # it was missed
            seen_ns = sample.sample_ns[index]
            yield (
                _Sample(
                    (seen_ns - self._start_ns) * 1e-9,
                    sample.excursion_m[index],
                    sample.rate_m_s[index],
                    sample.effort[index],
                    sample.voltage_V[index],
                    sample.temperature_C[index],
                ),
                sample.tension_N[index],
            )

    def _even(self, samples: list[_Sample], speed_m_s: float, place: str) -> list[_Sample]:
        """Those of a stroke in which the spool turned evenly."""
        duration_s = samples[-1].time_s - samples[0].time_s
        from_s = samples[0].time_s + max(UNEVEN_S, UNEVEN_PART * duration_s)
        even = [sample for sample in samples if sample.time_s >= from_s]
        if len(even) < FEWEST_SAMPLES:
            raise InputError(
                f"{place}: {len(even)} samples; expected {FEWEST_SAMPLES} or more.",
                help="Name a longer --stroke-mm or a lower --speed-mm-s, or a higher baud rate.",
            )
        rate_m_s = abs(_rate(even))
        if not 0.7 * speed_m_s <= rate_m_s <= 1.3 * speed_m_s:
            raise InputError(
                f"{place}: the spool turned at {rate_m_s * 1e3:.1f} mm/s; expected {speed_m_s * 1e3:g}.",
                help="See that nothing blocks it, and that the weight is not too heavy.",
            )
        return even

    def _check_steady(self, samples: list[_Sample], tension_N: float, motion: SpoolMotion, place: str) -> None:
        """A weight that swings, rests on something or has come off."""
        newton_per_effort = self.law.torque_per_effort_Nm / self.law.spool_radius_m
        effort, half = np.array([sample.effort for sample in samples]), len(samples) // 2
        change_N = abs(float(effort[:half].mean() - effort[half:].mean())) * newton_per_effort
        allowed_N = UNSTEADY_N + UNSTEADY_PART * tension_N
        if change_N > allowed_N:
            raise InputError(
                f"{place}: the load changed by {change_N:.1f} N within the stroke; expected {allowed_N:.1f} or less.",
                help="Let the weight hang free and still.",
            )
        mean = _mean(samples, motion, tension_N, place)
        seen_N = self.law.tension(
            mean.effort, motion, rate_m_s=mean.rate_m_s, supply_V=mean.voltage_V, temperature_C=mean.temperature_C
        ).tension_N
        if seen_N + self.law.friction_tension_N < 0.5 * tension_N:
            raise InputError(
                f"{place}: the motor carries some {seen_N:.0f} N; expected about {tension_N:.0f}.",
                help="Has the weight come off, or does it rest on something?",
            )

    def _with_goal(self, goal_m: float) -> Pair:
        return (goal_m, self._goals[1]) if self._index == 0 else (self._goals[0], goal_m)

    def _exchange(self, goal_m: float | None) -> TendonSample:
        """One exchange at its time, with a goal or without."""
        self._clock.sleep_until_ns(self._next_ns)
        self._next_ns = max(self._next_ns + self._period_ns // 2, self._clock.now_ns())
        if goal_m is None:
            sample = self._pair.exchange()
        else:
            self._goals = self._with_goal(goal_m)
            sample = self._pair.exchange(TendonSetPoint(self._goals, self._caps_N))
        self._check(sample)
        return sample

    def _check(self, sample: TendonSample) -> None:
        """DeviceError for a motor that does not do as it is told."""
        index = self._index
        if error := sample.hardware_error[index]:
            raise self._error(f"reports {hardware_error_text(error)} and may have let go.", "Secure the weight.")
        if not sample.torque_on[index] or sample.restarted[index]:
            raise self._error("let go: it restarted, or was switched off.", "Secure the weight; check the supply.")
        if seconds(self._clock.now_ns() - sample.sample_ns[index]) > LONGEST_SILENCE_S:
            raise self._pair.last_miss or NoReplyError(self._name, "has fallen silent.", help="Check its plug.")
        if sample.watchdog_tripped[index]:
            raise self._error("heard nothing for too long, and holds.", "Start again on a machine less busy.")
        if sample.stalled[index]:
            raise self._error(
                f"stands at its cap of {self._plan.cap_N:.0f} N, and holds.", "See what blocks it; take less weight."
            )
        if sample.derating[index] < 1.0:
            raise self._error(
                f"is at {sample.temperature_C[index]:.0f} °C, and holds.", "Take the weight off, and let it cool."
            )
        lag_m = sample.excursion_m[index] - self._goals[index]
        if abs(lag_m) > LARGEST_LAG_M:
            raise self._error(
                f"is {lag_m * 1e3:+.1f} mm from where it shall be; expected within {LARGEST_LAG_M * 1e3:g}.",
                "The weight is too heavy for it, or something blocks the spool. It holds; take the weight off.",
            )

    def _error(self, message: str, help: str) -> DeviceError:
        return DeviceError(self._name, message, help=help)


def _rate(samples: list[_Sample]) -> float:
    """Tendon rate over all of them, m/s."""
    time_s = np.array([sample.time_s for sample in samples])
    return float(np.polyfit(time_s - time_s[0], [sample.excursion_m for sample in samples], 1)[0])


def _mean(samples: list[_Sample], motion: SpoolMotion, tension_N: float, place: str) -> Reading:
    return Reading(
        motion=motion,
        tension_N=tension_N,
        effort=float(np.mean([sample.effort for sample in samples])),
        rate_m_s=_rate(samples),
        voltage_V=float(np.mean([sample.voltage_V for sample in samples])),
        temperature_C=float(np.mean([sample.temperature_C for sample in samples])),
        place=place,
    )


def _within(travel_m: Pair, excursion_m: float) -> float:
    return max(travel_m[0], min(travel_m[1], excursion_m))
