"""The operator's part in calibrating a load law: what to hang, what hangs there, what the scale says.

While an answer is awaited the motor goes on holding and being watched. An answer that is no weight is asked for again;
a stroke that was not steady too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum

from calibration.grasp.friction import STANDARD_GRAVITY_M_PER_S2
from calibration.motor_load import Reading
from calibration.motor_load_plan import LoadPlan
from controller.motor_load_run import LoadRun
from controller.prompts import Prompts
from drivers.dynamixel.load_law import SpoolMotion
from drivers.errors import InputError

SKIP = "skip"
_ABOVE_PLAN = 1.05
"""A weight may be this much heavier than the plan's heaviest: the cap was worked out for that one."""


class Unit(StrEnum):
    """In which weights are named and scales read."""

    kg = "kg"
    N = "N"

    @property
    def in_N(self) -> float:
        """Newtons of one unit."""
        return STANDARD_GRAVITY_M_PER_S2 if self is Unit.kg else 1.0

    def told(self, tension_N: float) -> str:
        """A tension in this unit."""
        return f"{tension_N / self.in_N:.4g} {self.value}"


@dataclass(frozen=True, slots=True)
class LoadDialogue:
    """With one operator, about one motor."""

    run: LoadRun
    plan: LoadPlan
    prompts: Prompts
    unit: Unit
    side: str
    say: Callable[[str], None]

    def measure(self) -> Iterator[Reading]:
        """All readings of the plan that were not skipped, as they come. Raises InputError, DeviceError."""
        for step, tension_N in enumerate(self.plan.steps_N):
            name = f"step {step + 1} of {len(self.plan.steps_N)}"
            yield from self._scale(step, tension_N, name) if self.plan.scale else self._weight(tension_N, name)
        what = "ease the scale" if self.plan.scale else "take the weight"
        self._ask(f"{what} off the {self.side} motor's cord and press Enter; the motor goes on holding")

    def _weight(self, tension_N: float, name: str) -> list[Reading]:
        request = (
            f"{name}: hang {self.unit.told(tension_N)} on the {self.side} motor's cord, let it hang free and still, "
            f"and press Enter; or type what hangs there, in {self.unit.value}, or {SKIP}"
        )
        while True:
            hung_N = self._tension(request, tension_N)
            if hung_N is None:
                return []
            self.say(f"{name}: winding and unwinding {self.plan.stroke_m * 1e3:g} mm")
            try:
                return self.run.weigh(hung_N, f"{name} ({self.unit.told(hung_N)})")
            except InputError as error:
                self.say(str(error))
                self.run.go(self.plan.start_m)

    def _scale(self, step: int, tension_N: float, name: str) -> list[Reading]:
        motion, speed_m_s = self.plan.motion(step), self.plan.speed_m_s(step)
        verb = "winding up" if motion is SpoolMotion.WINDING else "unwinding"
        self.say(f"{name}: {verb} to about {self.unit.told(tension_N)}")
        try:
            read = self.run.approach(tension_N, motion, speed_m_s, f"{name}, {motion.name.lower()}")
        except InputError as error:
            self.say(f"{error} This step is left out.")
            return []
        said_N = self._tension(f"{name}: what does the scale say, in {self.unit.value}? Or type {SKIP}", None)
        return [] if said_N is None else [read(said_N)]

    def _tension(self, request: str, planned_N: float | None) -> float | None:
        """What the operator says, N; `planned_N` for an empty line, None to skip."""
        most_N = _ABOVE_PLAN * self.plan.most_N * (2.0 if self.plan.scale else 1.0)
        while True:
            answer = self._ask(request)
            if answer.lower() == SKIP:
                return None
            if not answer and planned_N is not None:
                return planned_N
            try:
                tension_N = (
                    float(answer.lower().removesuffix(self.unit.value.lower()).replace(",", ".")) * self.unit.in_N
                )
            except ValueError:
                tension_N = math.nan
            if 0.0 < tension_N <= most_N:
                return tension_N
            self.say(
                f"{answer!r} is no such weight; expected above 0, to {self.unit.told(most_N)}, or {SKIP}. A heavier "
                "one needs another plan: --weight."
            )

    def _ask(self, request: str) -> str:
        return self.prompts.ask(request, self.run.hold)
