"""From a bus to an arm that is ready to run: safety puck, idle, pucks found, woken and checked, positions right.

The order is the vendor's (WAM reference 4.2) with every wait bounded and named. Nothing here raises the arm's mode:
where an operator is needed, a `Prompt` says what to do. At the end the caller's loop must run at once, asking for
positions and sending zero torques, and only then is Activate awaited: silence would be a heartbeat fault.
Joint angles in rad (DH). Source: WAM reference 4.1 to 4.4, 7; 8 for what stays uncertain.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from drivers.clock import Clock, nanoseconds
from drivers.errors import DeviceError, NoReplyError
from drivers.wam.bus import CanBus
from drivers.wam.dialogue import STATUS_ID, Dialogue
from drivers.wam.discovery import Survey, require_motors, require_safety_puck, survey
from drivers.wam.frames import GROUP_BIT, SAFETY_NODE
from drivers.wam.homing import Homing
from drivers.wam.motor_settings import MotorSettings, read_motor_settings
from drivers.wam.parameters import JOINTS, WamParameters
from drivers.wam.properties import (
    IDLE_REQUEST_FIRMWARE,
    MOTOR_IDLE,
    STATUS_MONITOR,
    STATUS_READY,
    property_id,
)
from drivers.wam.safety_puck import ArmMode, SafetyPuck

WAKE_SPACING_S = 0.011
"""Between pucks that are woken, at least 10 ms: one that comes on while others talk can drive the bus off."""
WAKE_SILENCE_S = 1.0
_SECOND_SILENCE_S = 0.25
"""For a puck that is still silent then: the most patient driver waits 1.2 s."""
POWER_UP_S = 4.0
"""How long pucks may take to come on after the arm has become idle."""
MODE_POLL_S = 0.25


class PromptKind(Enum):
    """What the operator is asked for, or told; stable, for programs."""

    RELEASE_ESTOP = "release_estop"
    PRESS_IDLE = "press_idle"
    AWAIT_POWER = "await_power"
    ZEROING = "zeroing"


@dataclass(frozen=True)
class Prompt:
    """A word to the operator."""

    kind: PromptKind
    text: str


_MODE_PROMPTS = {
    ArmMode.ESTOP: Prompt(PromptKind.RELEASE_ESTOP, "The arm is in E-stop: release it, then press Shift+Idle."),
    ArmMode.ACTIVE: Prompt(PromptKind.PRESS_IDLE, "The arm is active without control: press Shift+Idle."),
}


@dataclass(frozen=True)
class Operator:
    """Who stands at the pendant: how prompts reach them, and how long start-up waits for what only they can do.

    Without `wait_s` nothing is waited for: an arm that is not idle and powered is an error at once. `still_wanted` is
    asked a few times a second; False ends the waiting.
    """

    on_prompt: Callable[[Prompt], None] = lambda _: None
    wait_s: float = 0.0
    still_wanted: Callable[[], bool] = lambda: True


@dataclass(frozen=True)
class ArmIdentity:
    """What start-up found; tuples in motor order 1 to 7."""

    motors: MotorSettings
    safety_firmware: int
    woken: tuple[int, ...]
    """Nodes that were in their boot monitor."""
    zeroed_at_home: bool
    """True if this start-up declared the present pose to be home; False if the pucks remembered their positions."""
    corrected: tuple[int, ...]
    """Motors whose place in home an absolute encoder told."""
    first_counts: tuple[int, ...]
    """P of each motor at the end of start-up."""
    notes: tuple[str, ...]
    """What the operator should know: what is not possible with this arm, who else is on the bus."""


class StartUp:
    """The steps, in order: `open_safety_puck`, `await_idle`, `wake`, `settle`; `run` does them all.

    All raise BusError if the bus fails, NoReplyError for what keeps silent beyond its time, ProtocolError for an
    inconsistent arm and DeviceError for a state that only the operator or a repair can change.
    """

    def __init__(
        self, bus: CanBus, clock: Clock, parameters: WamParameters, safety: SafetyPuck, operator: Operator | None = None
    ) -> None:
        self._bus, self._clock, self._parameters, self._safety = bus, clock, parameters, safety
        self._operator = operator if operator is not None else Operator()
        self._dialogue = Dialogue(bus, clock)
        self._deadline_ns = 0
        self._notes: list[str] = []

    @property
    def notes(self) -> tuple[str, ...]:
        """What the operator should know so far."""
        return tuple(self._notes)

    def run(self) -> ArmIdentity:
        """Bring the arm up and make its positions right, zeroing it at home if they were lost."""
        self.open_safety_puck()
        woken = self.wake(self.await_idle())
        motors = self.settle()
        homing = Homing(self._dialogue, self._parameters, self._safety, motors)
        found = homing.restore(woken, lambda text: self._operator.on_prompt(Prompt(PromptKind.ZEROING, text)))
        return ArmIdentity(
            motors=motors,
            safety_firmware=self._safety.firmware,
            woken=woken,
            zeroed_at_home=found.plan is not None,
            corrected=found.plan.corrected if found.plan is not None else (),
            first_counts=found.counts,
            notes=self.notes,
        )

    def open_safety_puck(self) -> None:
        """Find the safety puck, ask its version, check what it hears and set its limits."""
        self._deadline_ns = self._clock.now_ns() + nanoseconds(self._operator.wait_s)
        seen = survey(self._dialogue, (SAFETY_NODE,))
        if seen.safety is None:
            seen = survey(self._dialogue)  # to say who else is there
        found = require_safety_puck(seen)
        if found.status == STATUS_MONITOR:
            self._wake_nodes((SAFETY_NODE,))
        self._safety.firmware = self._dialogue.ask(SAFETY_NODE, property_id("VERS", 0, "monitor"), "VERS")
        self._safety.check_groups()
        self._safety.set_limits(self._parameters.safety_velocity_m_s, self._parameters.safety_motor_torque_Nm)
        if self._safety.firmware < IDLE_REQUEST_FIRMWARE:
            self._notes.append(
                f"safety puck firmware {self._safety.firmware} takes no idle request and tells no pendant state: only "
                "the operator can idle the arm, faults are seen as a changed mode, and if the controlling process "
                "dies the guard can but send zero torques"
            )

    def await_idle(self) -> Survey:
        """Wait until the arm is idle and all its motor pucks answer; who is there then."""
        self.require_idle()
        power_ns = min(self._clock.now_ns() + nanoseconds(POWER_UP_S), self._deadline_ns)
        told = False
        while True:
            found = survey(self._dialogue)
            try:
                require_motors(found)
            except NoReplyError as error:
                if self._clock.now_ns() >= power_ns:
                    raise
                if not told:
                    self._operator.on_prompt(Prompt(PromptKind.AWAIT_POWER, f"Waiting for power: {error.message}"))
                told = True
                self._wait(error.message)
                continue
            break
        for puck in found.foreign:
            role = "unknown role" if puck.role is None else f"ROLE {puck.role:#06x}"
            self._notes.append(f"node {puck.node} ({role}) does not belong to the arm; it is let be")
        return found

    def wake(self, found: Survey) -> tuple[int, ...]:
        """Start the main firmware of motor pucks in their boot monitor; the nodes that were."""
        asleep = found.asleep
        if asleep:
            self._wake_nodes(asleep)
        if 0 < len(asleep) < JOINTS:
            self._notes.append(
                f"pucks {list(asleep)} had been reset while the others ran: look for a brown-out of the supply or a "
                "loose cable"
            )
        return asleep

    def settle(self) -> MotorSettings:
        """Read and check the motors' settings, and make sure that they are idle."""
        motors = read_motor_settings(self._dialogue, self._parameters)
        for group in motors.position_groups:
            mode_id = property_id("MODE", motors.firmware[0], "motor")
            self._dialogue.tell(GROUP_BIT | group, mode_id, MOTOR_IDLE)
        self._notes += motors.notes
        return motors

    def require_idle(self) -> None:
        """Wait until the safety puck says idle; DeviceError if it does not while `operator` lets it wait."""
        prompted: ArmMode | None = None
        while (mode := self._safety.mode()) is not ArmMode.IDLE:
            if self._clock.now_ns() >= self._deadline_ns:
                message = f"the arm is {'in E-stop' if mode is ArmMode.ESTOP else 'active'}; expected idle."
                help_text = "Press Shift-Idle and start again."
                if mode is ArmMode.ESTOP:
                    help_text = "Release E-stop, press Shift-Idle, wait four seconds and start again."
                raise DeviceError("WAM", message, help=help_text)
            if mode is not prompted:
                self._operator.on_prompt(_MODE_PROMPTS[mode])
                prompted = mode
            self._wait(f"the arm is {mode.value}")

    def _wait(self, state: str) -> None:
        """Let the operator act; DeviceError if nobody wants the arm any more."""
        if not self._operator.still_wanted():
            raise DeviceError("WAM", f"start-up was ended while {state}", help="Start again when the arm is ready.")
        self._dialogue.pause(MODE_POLL_S)

    def _wake_nodes(self, nodes: tuple[int, ...]) -> None:
        """Wake with the silences that keep the bus alive, twice where it did not help; each must then be ready."""
        asleep = self._wake_once(self._wake_once(nodes))
        if asleep:
            raise DeviceError(
                f"puck {asleep[0]}",
                f"STAT of pucks {list(asleep)} is not {STATUS_READY} after waking.",
                help="Switch the arm off and on again.",
            )

    def _wake_once(self, nodes: tuple[int, ...]) -> tuple[int, ...]:
        """Wake `nodes`; those that are not ready then. NoReplyError for one that has fallen silent."""
        if not nodes:
            return ()
        for node in nodes:
            self._dialogue.tell(node, STATUS_ID, STATUS_READY, quiet_s=WAKE_SPACING_S)
        self._dialogue.pause(WAKE_SILENCE_S)
        statuses = {node: self._dialogue.ask_or_none(node, STATUS_ID, attempts=1) for node in nodes}
        if None in statuses.values():
            self._dialogue.pause(_SECOND_SILENCE_S)
        for node, status in statuses.items():
            statuses[node] = self._dialogue.ask(node, STATUS_ID, "STAT") if status is None else status
        return tuple(node for node, status in statuses.items() if status != STATUS_READY)
