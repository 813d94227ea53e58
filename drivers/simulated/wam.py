"""A simulated WAM on the byte level: motor pucks 1 to 7, the safety puck 10 and the operator's pendant.

It hears CAN frames and answers them; behind it stands an `ArmPlant` that has joint angles (rad) and takes joint torques
(N·m), DH convention. Encoders count whole steps, torques come in puck units. Built from the rules of WAM reference 4.7;
where no source tells what a puck does (heartbeat limit, what its unasked frames hold, that ZERO is lost with the power)
it follows the reference's assumptions: this is agreement with a document, not with an instrument.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np

from drivers.clock import nanoseconds
from drivers.errors import InputError
from drivers.simulated.arm_faults import ARM_EVENTS, BrownOut, Press, SetProperty, Silence, Supply
from drivers.simulated.arm_plant import ArmPlant
from drivers.simulated.can_wire import Frame, TimedFrame
from drivers.simulated.firmware import JOINT_ENCODER_COUNTS, NODES, safety_firmware_beside
from drivers.simulated.motor_puck import MotorPuck
from drivers.simulated.puck import Puck
from drivers.simulated.puck_frames import (
    GROUP,
    GROUP_POSITION,
    HOST,
    TORQUE_BYTES,
    reported_counts,
    request,
    sending_node,
    torques,
)
from drivers.simulated.puck_settings import PuckSettings, motor_puck, safety_puck
from drivers.simulated.safety_puck import SAFETY_NODE, button_named
from drivers.simulated.safety_watch import SafetySettings
from drivers.wam.parameters import WamParameters
from drivers.wam.properties import (
    MOTOR_IDLE,
    MOTOR_TORQUE,
    SAFETY_ACTIVE,
    SAFETY_ESTOP,
    STATUS_READY,
    property_id,
)
from drivers.wam.transmission import joint_to_motor, motor_to_joint_torque

_NEVER_NS = 1 << 62
_REPLY_DELAY_NS = 17_000
"""From the end of the request to the reply's readiness: the encoders are sampled some 75 µs after its start."""
_WAKE_PAUSE_NS = nanoseconds(0.009)
_FROM_ENCODERS = ("P", "MECH", "JP")
_POSITION_TO = GROUP | GROUP_POSITION
_TO_MASK = 0x41F


class SimulatedWam:
    """The whole arm as one device of a CAN hub. `heard` counts what it heard, by kind."""

    fault_instants: tuple[type, ...] = (Press, BrownOut, SetProperty, Supply)
    fault_events: tuple[str, ...] = ARM_EVENTS

    def __init__(
        self,
        plant: ArmPlant,
        parameters: WamParameters,
        *,
        booted: bool = True,
        zeroed: bool = False,
        motor_firmware: int = 200,
        safety_firmware: int | None = None,
        joint_encoders: bool = False,
        pucks: Mapping[int, PuckSettings] | None = None,
        safety: SafetySettings | None = None,
        set_gap_s: float = 0.0,
        power_up_s: float = 0.0,
        start_ns: int = 0,
    ) -> None:
        """The arm starts in idle.

        `booted`: the pucks are awake; otherwise they are in their boot monitor. `zeroed`: positions are already right
        and ZERO is 1; otherwise P has nothing to do with the joint angle. Without `safety_firmware` the safety puck is
        of the motors' generation. `joint_encoders`: on joints 1 to 4. `pucks`: differences of single nodes, 1 to 7 and
        10. `set_gap_s`: motor pucks lose a property that is set within this time of the last. `power_up_s`: how long
        they are silent when they get their power back. InputError for firmware, nodes and properties that are unknown.
        """
        special = dict(pucks or {})
        if strangers := special.keys() - {*NODES, SAFETY_NODE}:
            raise InputError(f"pucks {sorted(strangers)} do not exist; expected 1 to 7 and {SAFETY_NODE}.")
        if zeroed and not booted:
            raise InputError("a simulated arm cannot be zeroed while its pucks are in their boot monitor.")
        self._plant = plant
        self._units_per_Nm = parameters.units_per_Nm
        self._power_up_ns = nanoseconds(power_up_s)
        self._motors = tuple(
            motor_puck(node, motor_firmware, parameters, special.get(node, PuckSettings()), booted, joint_encoders)
            for node in NODES
        )
        for motor in self._motors:
            motor.set_gap_ns = nanoseconds(set_gap_s)
        counts = [motor.counts_per_turn for motor in self._motors]
        self._counts_per_rad = np.array(counts) / (2.0 * np.pi)
        self._safety = safety_puck(
            safety_firmware_beside(motor_firmware) if safety_firmware is None else safety_firmware,
            special.get(SAFETY_NODE, PuckSettings()),
            zeroed,
            safety or SafetySettings(),
            counts,
        )
        self._watch = self._safety.watch
        self._pucks: tuple[Puck, ...] = (*self._motors, self._safety)
        self._node_puck = {puck.node: puck for puck in self._pucks}
        self._events: list[tuple[int, str]] = []
        self._happened: set[str] = set()
        self._woken_ns: int | None = None
        self._hearers: dict[int | None, tuple[Puck, ...]] = {}
        self._hearing_until_ns = 0
        self._torque_number = self._motors[0].number("T")
        self.heard: Counter[str] = Counter()
        """Frames by kind: get, set, torque, malformed, foreign; and refused_mode, unknown_property, lost_set."""
        self.silent_nodes: set[int] = {node for node, settings in special.items() if settings.silent}
        """Nodes that hear and obey, but do not answer."""
        if zeroed:
            for motor in self._motors:
                motor.know_positions()
        self._driven: tuple[object, ...] = ()
        self._torque_ns: int | None = None
        self._drive_plant(start_ns)

    @property
    def mode(self) -> int:
        """The safety puck's MODE: 0 E-stop, 1 idle, 2 active."""
        return self._safety.mode

    @property
    def torque_ns(self) -> int | None:
        """When an active arm was last told its torques; None while it is not active, or was told none yet."""
        return self._torque_ns if self.mode == SAFETY_ACTIVE else None

    # --- the bus

    def receive(self, frame: Frame, now_ns: int) -> list[TimedFrame]:
        """Hear a frame; the answers, each with the time from which it is ready. Nothing that is heard raises."""
        frames = self.tick(now_ns)
        identifier, data = frame
        if sending_node(identifier) != HOST:
            return frames + self._hear_puck(identifier, data, now_ns)
        group = identifier & 0x1F if identifier & GROUP else None
        if len(data) == TORQUE_BYTES:
            return frames + self._hear_torques(group, data, now_ns)
        asked = request(data)
        if asked is None:
            self.heard["malformed"] += 1
            return frames
        number, value = asked
        self._notice_talk(group, number, value, now_ns)
        self.heard["get" if value is None else "set"] += 1
        sampled = False
        for puck in self._hearing(group, now_ns):
            if group is None and puck.node != identifier & 0x1F:
                continue
            name = puck.name(number)
            if name in _FROM_ENCODERS and not sampled:
                self._sample_encoders()
                sampled = True
            if name is None:
                self.heard["unknown_property"] += 1
            elif value is not None:
                frames += self._write(puck, name, value, now_ns)
            elif puck.node not in self.silent_nodes:
                if name == "PEN":
                    self._safety.values["PEN"] = self._safety.pendant_value(now_ns)
                frames.append((now_ns + _REPLY_DELAY_NS, puck.reply(name, number)))
                if name == "P":
                    self._tell("first_position", now_ns)
        return frames

    def tick(self, now_ns: int) -> list[TimedFrame]:
        """Watch the life signs, and what comes of faults: the safety puck may lower the mode."""
        return [] if now_ns < self._watch.due_ns else self._react(self._watch.tick(now_ns, self.mode), now_ns)

    # --- the operator and the power

    def press(self, button: str, now_ns: int) -> list[TimedFrame]:
        """The operator presses a pendant button (idle and activate with Shift): the safety puck's frames.

        A button that does not apply does nothing: only idle leaves E-stop, after its release, and clears a fault; only
        an idle arm without fault can be activated. InputError for an unknown button.
        """
        button = button_named(button)
        frames = self.tick(now_ns)
        mode = self._safety.press(button, now_ns)
        return frames if mode is None else frames + self._set_mode(mode, now_ns)

    def set_supply_V(self, volts: float, now_ns: int) -> list[TimedFrame]:
        """The motors' supply has this voltage: the safety puck's frames."""
        for puck in self._pucks:
            puck.values["VBUS"] = round(volts)
        return self._react(self._watch.see_supply(volts, now_ns, self.mode), now_ns)

    def brown_out(self, nodes: tuple[int, ...], now_ns: int, down_s: float = 0.0) -> None:
        """Motor pucks lose their power and start again, in their boot monitor, without positions."""
        self._hearing_until_ns = 0
        for motor in self._motors:
            if motor.node in nodes and motor.powered:
                motor.power(False, now_ns)
                motor.power(True, now_ns, starts_after_ns=nanoseconds(down_s))
        self._drive_plant(now_ns)

    # --- faults of a script (drivers.simulated.can_faults.FaultyDevice)

    def check_fault(self, action: object) -> None:
        """InputError if this arm cannot have such a fault."""
        if isinstance(action, SetProperty):
            puck = self._node_puck.get(action.node)
            if puck is None:
                raise InputError(f"node {action.node} does not exist; expected 1 to 7 or {SAFETY_NODE}.")
            property_id(action.name, puck.firmware, "safety" if puck is self._safety else "motor")
        elif not isinstance(action, Press | BrownOut | Silence | Supply):
            raise InputError(f"a simulated WAM has no fault {type(action).__name__}.")

    def begin_fault(self, action: object, now_ns: int) -> list[TimedFrame]:
        """Have a fault of a script; the frames that follow from it."""
        match action:
            case Press():
                return self.press(action.button, now_ns)
            case Supply():
                return self.set_supply_V(action.volts, now_ns)
            case BrownOut():
                self.brown_out(action.nodes, now_ns, action.down_s)
            case Silence():
                self.silent_nodes.update(action.nodes)
            case SetProperty():
                return self._change(action, now_ns)
        return []

    def end_fault(self, action: object, now_ns: int) -> list[TimedFrame]:
        """Be sound again."""
        if isinstance(action, Silence):
            self.silent_nodes.difference_update(action.nodes)
        return []

    def take_events(self) -> list[tuple[int, str]]:
        """What has happened since the last call: time and one of `fault_events`."""
        events, self._events = self._events, []
        return events

    # --- inside

    def _hearing(self, group: int | None, now_ns: int) -> tuple[Puck, ...]:
        """Pucks that a frame to a group, or to any node, reaches; kept until something changes that."""
        if now_ns >= self._hearing_until_ns:
            self._hearers.clear()
            waking = [puck.silent_until_ns for puck in self._pucks if puck.is_waking(now_ns)]
            self._hearing_until_ns = min(waking, default=_NEVER_NS)
        hearers = self._hearers.get(group)
        if hearers is None:
            hearers = tuple(puck for puck in self._pucks if puck.hears(now_ns, group))
            self._hearers[group] = hearers
        return hearers

    def _hear_puck(self, identifier: int, data: bytes, now_ns: int) -> list[TimedFrame]:
        """The safety puck listens to positions, whoever sends them."""
        node = sending_node(identifier)
        if node not in self._node_puck:
            self.heard["foreign"] += 1
        if identifier & _TO_MASK != _POSITION_TO or self._safety not in self._hearing(GROUP_POSITION, now_ns):
            return []
        counts = reported_counts(data)
        if counts is None:
            return []
        return self._react(self._watch.hear_position(node, counts, now_ns, self._safety.mode), now_ns)

    def _hear_torques(self, group: int | None, data: bytes, now_ns: int) -> list[TimedFrame]:
        heard = torques(data)
        if heard is None:
            self.heard["malformed"] += 1
            return []
        self.heard["torque"] += 1
        if group is None:
            return []
        number, values = heard
        self._tell("first_torque", now_ns)
        hearers = self._hearing(group, now_ns)
        taken = [puck.take_torque(number, values) for puck in hearers if isinstance(puck, MotorPuck)]
        if any(taken):
            self._torque_ns = now_ns
            self._drive_plant(now_ns)
        if self._safety not in hearers or number != self._torque_number:
            return []
        return self._react(self._watch.hear_torques(values, now_ns, self.mode), now_ns)

    def _write(self, puck: Puck, name: str, value: int, now_ns: int) -> list[TimedFrame]:
        if not puck.takes_set(now_ns):
            self.heard["lost_set"] += 1
            return []
        if name != "P":
            self._hearing_until_ns = 0
        if name != "MODE":
            if name == "STAT" and value == STATUS_READY and puck.in_monitor:
                self._tell("waking", now_ns)
                self._woken_ns = now_ns
            puck.write(name, value, now_ns)
            if name == "ZERO" and value:
                self._tell("zeroed", now_ns)
            if name == "STAT":
                self._drive_plant(now_ns)
            return []
        if isinstance(puck, MotorPuck):
            # A real puck would obey a host's torque mode, and the safety system would object.
            if value == MOTOR_IDLE:
                puck.set_mode(MOTOR_IDLE)
                self._drive_plant(now_ns)
            else:
                self.heard["refused_mode"] += 1
            return []
        mode = self._safety.asked_for_mode(value)
        if mode is not None:
            return self._set_mode(mode, now_ns)
        self.heard["refused_mode"] += int(value != self.mode)
        return []

    def _change(self, action: SetProperty, now_ns: int) -> list[TimedFrame]:
        puck = self._node_puck[action.node]
        self._hearing_until_ns = 0
        if puck is self._safety and action.name == "MODE":
            return self._set_mode(action.value, now_ns)
        if action.name == "P":
            self._sample_encoders()
            puck.write("P", action.value, now_ns)
        elif action.name == "STAT":
            puck.write("STAT", action.value, now_ns)
        else:
            puck.values[action.name] = action.value
        self._drive_plant(now_ns)
        return []

    def _sample_encoders(self) -> None:
        joint_rad = self._plant.joint_position_rad()
        counts = np.floor(joint_to_motor(joint_rad) * self._counts_per_rad).astype(np.int64).tolist()
        for motor, motor_counts in zip(self._motors, counts, strict=True):
            motor.see(motor_counts)
        for motor, joint, per_turn in zip(self._motors, joint_rad.tolist(), JOINT_ENCODER_COUNTS, strict=False):
            motor.see_joint(joint, per_turn)

    def _react(self, mode: int | None, now_ns: int) -> list[TimedFrame]:
        """What the safety puck's watch leads to."""
        told = self._watch.told
        if told:
            self._events += [(now_ns, event) for event in told if event in ARM_EVENTS]
            told.clear()
        return [] if mode is None else self._set_mode(mode, now_ns)

    def _set_mode(self, mode: int, now_ns: int) -> list[TimedFrame]:
        """Change the arm's mode: power and order the motor pucks, and tell them on the bus as the real one does."""
        self._hearing_until_ns = 0
        before = self.mode
        self._safety.set_mode(mode)
        for motor in self._motors:
            motor.power(mode != SAFETY_ESTOP, now_ns, starts_after_ns=self._power_up_ns)
            motor.set_mode(MOTOR_TORQUE if mode == SAFETY_ACTIVE else MOTOR_IDLE)
        self._drive_plant(now_ns)
        if mode == before:
            return []
        self._events.append((now_ns, ("estop", "idle", "active")[mode]))
        return [(now_ns, self._safety.order_to_motors())]

    def _drive_plant(self, now_ns: int) -> None:
        units = [motor.torque_units if motor.driving else 0 for motor in self._motors]
        braking = not any(motor.driving for motor in self._motors)
        if self._driven != (driven := (braking, *units)):
            self._driven = driven
            torque_Nm = motor_to_joint_torque(np.array(units, dtype=np.float64) / self._units_per_Nm)
            self._plant.set_joint_torque_Nm(torque_Nm, braking, now_ns)

    def _notice_talk(self, group: int | None, number: int, value: int | None, now_ns: int) -> None:
        """Whether a host talks while pucks wake; waking the next after 10 ms is what it should do."""
        if self._woken_ns is None or not any(motor.is_waking(now_ns) for motor in self._motors):
            return
        wakes = value == STATUS_READY and number == self._safety.number("STAT")
        if not wakes or now_ns - self._woken_ns < _WAKE_PAUSE_NS:
            self._tell("talk_while_waking", now_ns)

    def _tell(self, event: str, now_ns: int) -> None:
        """An event of which only the first matters."""
        if event not in self._happened:
            self._happened.add(event)
            self._events.append((now_ns, event))
