"""A robot on virtual time that grasps, and whose copies live through faults of the tendon motors and their bus.

One robot of each model goes from phase to phase; in each, a fork of the process has one fault after the other begin
with the very same robot, to the bit (`forked.py`). What is so is read from the world and the motors' registers; what
the operator was told, from what the front sends to its recorder and its clients.

Times in s from the fault on, excursions in m: of the spools, positive = pulled in, right finger first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.motion_table import MotionTable
from controller.config import RobotConfig
from controller.service.assembly import configured_hand
from controller.simulation.demo_cases import GraspCase, approach_joints, preposition, table_name
from controller.simulation.truth import WorldObserver, WorldTruth
from controller.simulation.virtual_robot import VirtualRobot
from controller.simulation.world import World
from drivers.errors import StillgraspError
from drivers.simulated.dynamixel_motor import SimulatedMotor
from drivers.simulated.faults import Fault
from tests.system.forked import in_a_fork

Array = NDArray[np.float64]
PHASES = ("start-up", "open", "closing", "squeezing", "holding", "adoption")
SQUEEZE_N, SQUEEZE_S = 60.0, 1.2
TOLD = ("fault", "warning")
TRUTH_EVERY = 5
"""Looks at the spools for one at the object."""


@dataclass(frozen=True)
class HandStall:
    """The hand process does nothing for so long: no packet is on the bus."""

    duration_s: float


@dataclass(frozen=True)
class Look:
    """Both fingers and the object at one moment."""

    time_s: float
    excursion_m: Array
    """Finger-side, (2,)."""
    object_m: Array
    """In the hand frame, (3,)."""
    contact_N: Array
    """Between each fingertip and the object, (2,)."""
    wrist_m: Array
    """In the world, (3,)."""

    @property
    def gripped(self) -> bool:
        return bool((self.contact_N > 0.5).all())


@dataclass(frozen=True)
class Told:
    """What every client was told, and when the front did so."""

    time_s: float
    event: str
    code: str
    message: str
    help: str


@dataclass
class Watch:
    """What was to be seen over some time, in plain values."""

    time_s: Array
    spool_m: Array
    """(n, 2)."""
    pulls: NDArray[np.bool_]
    """(n, 2): the motor has power and its torque is on."""
    looks: list[Look]
    told: list[Told]
    """Faults and warnings."""
    fault_s: float | None
    """When the cycle first named a fault."""
    status: dict[str, Any] = field(default_factory=dict)

    @property
    def fault(self) -> str:
        """The fault that `status` names in the end."""
        return str(self.status["state"]["grasp"]["fault"]) if self.status.get("state") else ""

    @property
    def phase(self) -> str:
        """The grasp's phase that `status` names in the end."""
        return str(self.status["state"]["grasp"]["phase"]) if self.status.get("state") else ""

    def travel_m(self, after_s: float) -> Array:
        """How far each spool still moved after a time, (2,)."""
        later = self.spool_m[self.time_s >= after_s]
        return np.ptp(later, axis=0) if len(later) else np.zeros(2)

    def wrist_travel_m(self, after_s: float) -> float:
        """How far the wrist still moved."""
        later = [look.wrist_m for look in self.looks if look.time_s >= after_s]
        return float(np.linalg.norm(np.ptp(np.array(later), axis=0))) if later else 0.0

    def object_travel_m(self, after_s: float) -> float:
        """How far the object still moved in the hand."""
        later = [look.object_m for look in self.looks if look.time_s >= after_s]
        return float(np.linalg.norm(np.ptp(np.array(later), axis=0))) if later else 0.0


@dataclass
class Seen:
    """What a robot went through: with the fault, then with the hand told to open, and beside it what became of clearing
    the fault once its cause was gone."""

    watch: Watch
    refusal: tuple[str, str, str] | None = None
    """Class, message and help of the error with which start-up ended."""
    opened: Watch | None = None
    clear_error: str = ""
    """Code with which `fault.clear` was refused."""
    told_later: list[str] = field(default_factory=list)
    """Codes that were told after the watch, before clearing."""
    cleared: Watch | None = None
    brought_up: Watch | None = None


class Recorder:
    """Keeps when something was told, and when the cycle first named a fault."""

    def __init__(self) -> None:
        self.told_ns: list[int] = []
        self.named_ns: int | None = None

    def record_cycle(self, record: dict[str, Any], time_ns: int) -> None:
        if record["reason"] and self.named_ns is None:
            self.named_ns = time_ns

    def event(self, event: dict[str, Any], time_ns: int) -> None:
        if event["event"] in TOLD:
            self.told_ns.append(time_ns)


class Robot:
    """A whole robot in front of a world; `advance` takes it to a phase."""

    def __init__(self, config: RobotConfig, case: GraspCase) -> None:
        table = MotionTable.load(Path(config.tables.directory) / f"{table_name(case)}.npz")
        scene = replace(case.scene, joint_rad=tuple(approach_joints(config, table, case)))
        self._case = case
        self.recorder = Recorder()
        self.phase = PHASES[0]
        self.virtual = VirtualRobot(
            config, scene, recorder=self.recorder, observe=self._observe, observe_period_s=0.001
        )
        self.motors = self.virtual.devices.motors
        self.client = self.virtual.client()
        self._observer = WorldObserver(self.virtual.world, configured_hand(config))
        self._spool_radius_m = np.array([config.tendons.right.spool_radius_m, config.tendons.left.spool_radius_m])
        self._seen: list[tuple[int, Array, tuple[bool, bool]]] = []
        self._truths: list[WorldTruth] = []
        self._watching = False

    # to the phases

    def advance(self, phase: str) -> None:
        """Go on to a phase; ValueError for one that is over."""
        if PHASES.index(phase) < PHASES.index(self.phase):
            raise ValueError(f"the robot is in phase {self.phase!r}, which comes after {phase!r}")
        while self.phase != phase:
            following = PHASES[PHASES.index(self.phase) + 1]
            getattr(self, f"_to_{following}")()
            self.phase = following

    def _to_open(self) -> None:
        self.virtual.activate()
        case = self._case
        preposition(self.client, case, approach_m=0.02)

    def _to_closing(self) -> None:
        self._closing = self.client.grasp_close()
        self.virtual.run_for(0.3)

    def _to_squeezing(self) -> None:
        self._closing.wait()
        self.squeeze = self.client.grasp_squeeze(load_N=SQUEEZE_N, duration_s=SQUEEZE_S)
        self.virtual.run_for(0.4)

    def _to_holding(self) -> None:
        self.squeeze.wait()
        self.virtual.run_for(0.1)

    def _to_adoption(self) -> None:
        """The same; the hand process begins anew with the fault."""

    # faults

    def suffer(
        self,
        faults: Sequence[Fault[Any] | HandStall],
        watch_s: float,
        *,
        rest_s: float = 0.0,
        mend: Sequence[Fault[Any]] = (),
        opening_s: float = 0.0,
        bring_up_s: float = 0.0,
    ) -> Seen:
        """Have faults, timed from now, and tell what came of it after `watch_s`; then what comes of opening the hand
        (for `opening_s`), of clearing once `rest_s` have passed and `mend` has been done, and behind that of opening
        for `bring_up_s` and clearing again."""
        if self.phase == "start-up":
            for fault in faults:
                self._strike(fault)
            begin_ns = 0
        else:
            begin_ns = self.virtual.hand.pacer.deadline_ns
            self.virtual.time.run_until(begin_ns - 1)  # in step with the hand's exchanges
            for fault in faults:
                self._strike(fault)
            if self.phase == "adoption":
                self.virtual.restart_hand()
        refusal = None
        try:
            watch = self._watch(watch_s)
        except StillgraspError as error:
            refusal = type(error).__name__, error.message, error.help
            watch = self._taken(begin_ns)
            return Seen(watch, refusal)
        seen = Seen(watch)
        if opening_s:
            seen.opened = in_a_fork(lambda: self._open(opening_s))
        if rest_s:
            for fault in mend:
                self._strike(fault)
            self.client.events.clear()
            self.virtual.run_for(rest_s)
            self.client.poll()
            seen.told_later = [str(event.fields["code"]) for event in self.client.events if event.event in TOLD]
            try:
                self.client.fault_clear()
            except StillgraspError as error:
                seen.clear_error = getattr(error, "code", type(error).__name__)
            seen.cleared = self._watch(0.15)
        if bring_up_s:
            self.client.start("hand.open")
            self.virtual.run_for(bring_up_s)
            self.client.fault_clear()
            seen.brought_up = self._watch(0.05)
        return seen

    def _open(self, duration_s: float) -> Watch:
        self.client.start("hand.open")
        return self._watch(duration_s)

    def _strike(self, fault: Fault[Any] | HandStall) -> None:
        if isinstance(fault, HandStall):
            self.virtual.stall_hand(fault.duration_s)
        else:
            self.virtual.add_motor_fault(fault)

    # watching

    def _watch(self, duration_s: float) -> Watch:
        begin_ns = self.virtual.time.now_ns
        self._seen.clear()
        self._truths.clear()
        self.client.poll()
        self.client.events.clear()
        self.recorder.told_ns.clear()
        self.recorder.named_ns = None
        self._watching = True
        self.virtual.run_for(duration_s)
        self._watching = False
        watch = self._taken(begin_ns)
        if self.phase != "start-up":
            watch.status = self.client.status()
        return watch

    def _taken(self, begin_ns: int) -> Watch:
        named_ns = self.recorder.named_ns
        self.client.poll()
        events = [event for event in self.client.events if event.event in TOLD and event.seq is None]
        return Watch(
            np.array([(time_ns - begin_ns) * 1e-9 for time_ns, _, _ in self._seen]),
            np.array([spools for _, spools, _ in self._seen]),
            np.array([pulls for _, _, pulls in self._seen]),
            [_look(truth, begin_ns) for truth in self._truths],
            [
                Told(
                    (time_ns - begin_ns) * 1e-9,
                    event.event,
                    *(event.fields[name] for name in ("code", "message", "help")),
                )
                for time_ns, event in zip(self.recorder.told_ns, events, strict=False)
            ],
            None if named_ns is None else (named_ns - begin_ns) * 1e-9,
        )

    def _observe(self, world: World) -> None:
        if not self._watching:
            return
        spools = np.array([world.shaft_angle_rad(motor) for motor in (0, 1)]) * self._spool_radius_m
        right, left = (pulls(motor) for motor in self.motors.motors)
        if len(self._seen) % TRUTH_EVERY == 0:
            self._truths.append(self._observer.truth())
        self._seen.append((world.time_ns, spools, (right, left)))


def pulls(motor: SimulatedMotor) -> bool:
    """Whether a motor has power, is up, and may pull."""
    limited = "torque_limit" in motor.model.registers and not motor.value("torque_limit")
    return motor.powered and bool(motor.value("torque_enable")) and not limited


def _look(truth: WorldTruth, begin_ns: int) -> Look:
    return Look(
        (truth.time_ns - begin_ns) * 1e-9,
        truth.tendon_excursion_m,
        truth.T_hand_object[:3, 3],
        truth.contact_force_N,
        truth.T_world_wrist[:3, 3],
    )
