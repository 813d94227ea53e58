"""A simulated WAM on the byte level: motor pucks 1 to 7, the safety puck 10 and the operator's pendant.

It hears CAN frames and answers them; behind it stands an `ArmPlant` that has joint angles (rad) and takes joint torques
(N·m), DH convention. Encoders count whole steps, torques come in puck units. Built from the rules of WAM reference 4.7;
where no source tells what a puck does (heartbeat limit, what its unasked frames hold, that ZERO is lost with the power)
it follows the reference's assumptions: this is agreement with a document, not with an instrument.
"""

from __future__ import annotations

from collections import Counter
from typing import Protocol

import can
import numpy as np
from numpy.typing import NDArray

from drivers.clock import nanoseconds
from drivers.errors import InputError, ProtocolError
from drivers.simulated.can_hub import TimedFrame, is_classic_frame
from drivers.simulated.puck import MotorPuck, Puck
from drivers.wam.frames import (
    GROUP_ARM,
    GROUP_BIT,
    SAFETY_NODE,
    UNASKED_SAFETY_ID,
    parse_request,
    parse_torques,
    sender,
    set_property,
)
from drivers.wam.parameters import JOINTS, WamParameters
from drivers.wam.properties import (
    IDLE_REQUEST_FIRMWARE,
    MOTOR_IDLE,
    MOTOR_TORQUE,
    SAFETY_ACTIVE,
    SAFETY_ESTOP,
    SAFETY_IDLE,
)
from drivers.wam.safety_puck import Button, Light, PendantState
from drivers.wam.transmission import joint_to_motor, motor_to_joint_torque

BUTTONS = ("idle", "activate", "estop", "release")
_PLACES = (1, 2, 3, 4, 1, 2, 3)
_POLES = (12, 12, 12, 12, 8, 8, 6)
_TORQUE_BYTES = 8
_REPLY_DELAY_NS = 17_000
"""From the end of the request to the reply's readiness: the encoders are sampled some 75 µs after its start."""
_SEGMENTS_E = 0x79
_SAFETY_FACTORY = {
    "ROLE": 0x0082,
    "MODE": SAFETY_IDLE,
    "TEMP": 30,
    "GRPA": 1,
    "GRPB": 2,
    "GRPC": 3,
    "VL1": 2048,
    "VL2": 4096,
    "TL1": 4731,
    "TL2": 5204,
    "VOLTL1": 36,
    "VOLTL2": 30,
    "VOLTH1": 54,
    "VOLTH2": 57,
}


class ArmPlant(Protocol):
    """The mechanics behind the pucks."""

    def joint_position_rad(self) -> NDArray[np.float64]:
        """Joint angles (7) now, rad."""
        ...

    def set_joint_torque_Nm(self, torque_Nm: NDArray[np.float64], braking: bool, at_ns: int) -> None:
        """Apply motor torques, as joint torques (7) in N·m, from `at_ns` until the next call. `braking`: the motors are
        idle or without power and brake resistively; the torque is then zero."""
        ...


class SimulatedWam:
    """The whole arm as one device of a CAN hub. `heard` counts what it heard, by kind."""

    def __init__(
        self,
        plant: ArmPlant,
        parameters: WamParameters,
        *,
        booted: bool = True,
        zeroed: bool = False,
        motor_firmware: int = 200,
        safety_firmware: int = 197,
        heartbeat_s: float = 0.1,
    ) -> None:
        """The arm starts in idle.

        `booted`: the pucks are awake; otherwise they are in their boot monitor. `zeroed`: positions are already right
        and ZERO is 1; otherwise P has nothing to do with the joint angle. InputError for firmware below 61.
        """
        if zeroed and not booted:
            raise InputError("a simulated arm cannot be zeroed while its pucks are in their boot monitor.")
        self._plant = plant
        self._units_per_Nm = parameters.units_per_Nm
        self._heartbeat_ns = nanoseconds(heartbeat_s)
        self._motors = tuple(
            MotorPuck(node, motor_firmware, _motor_factory(node, parameters), booted=booted)
            for node in range(1, JOINTS + 1)
        )
        factory = {**_SAFETY_FACTORY, "ZERO": int(zeroed)}
        self._safety = Puck(SAFETY_NODE, "safety", safety_firmware, factory, booted=True)
        self._pucks: tuple[Puck, ...] = (*self._motors, self._safety)
        self._estop_pressed = False
        self._heartbeat_fault = False
        self._last_position_ns: int | None = None
        self.heard: Counter[str] = Counter()
        """Frames by kind: get, set, torque, malformed, foreign; and refused_mode, unknown_property among them."""
        self.silent_nodes: set[int] = set()
        """Nodes that a test makes silent: they hear and obey, but do not answer."""
        if zeroed:
            for motor in self._motors:
                motor.zero_to_encoder()
        self._drive_plant(0)

    @property
    def mode(self) -> int:
        """The safety puck's MODE: 0 E-stop, 1 idle, 2 active."""
        return self._safety.values["MODE"]

    def receive(self, message: can.Message, now_ns: int) -> list[TimedFrame]:
        """Hear a frame; the answers, each with the time from which it is ready. Nothing that is heard raises."""
        frames = self.tick(now_ns)
        if not is_classic_frame(message):
            self.heard["malformed"] += 1
            return frames
        if sender(message) != 0:
            self.heard["foreign"] += 1
            return frames
        destination = message.arbitration_id & 0x1F
        group = destination if message.arbitration_id & GROUP_BIT else None
        try:
            if len(message.data) == _TORQUE_BYTES:
                self._hear_torques(group, message, now_ns)
                return frames
            number, value = parse_request(message)
        except ProtocolError:
            self.heard["malformed"] += 1
            return frames
        self.heard["get" if value is None else "set"] += 1
        addressed = [puck for puck in self._pucks if group is not None or puck.node == destination]
        hearing = [puck for puck in addressed if puck.hears(now_ns, group)]
        self._sample_encoders()
        reported_position = False
        for puck in hearing:
            name = puck.name(number)
            if name is None:
                self.heard["unknown_property"] += 1
            elif value is not None:
                frames += self._write(puck, name, value, now_ns)
            elif puck.node not in self.silent_nodes:
                if name == "PEN":
                    puck.values["PEN"] = self._pendant().to_value()
                reported_position |= name == "P"
                frames.append((now_ns + _REPLY_DELAY_NS, puck.reply(name, number)))
        if reported_position:
            self._last_position_ns = now_ns
            self._safety.values["IFAULT"] = max(0, self._safety.values["IFAULT"] - 1)
        return frames

    def tick(self, now_ns: int) -> list[TimedFrame]:
        """Watch the heartbeat: in an active arm whose position replies stop, the safety puck idles the motors."""
        last_ns = self._last_position_ns
        if self.mode == SAFETY_ACTIVE and last_ns is not None and now_ns - last_ns > self._heartbeat_ns:
            self._heartbeat_fault = True
            return self._set_mode(SAFETY_IDLE, now_ns)
        return []

    def press(self, button: str, now_ns: int) -> list[TimedFrame]:
        """The operator presses a pendant button (idle and activate with Shift): the safety puck's frames.

        A button that does not apply does nothing: only idle leaves E-stop, after its release, and clears a fault; only
        an idle arm without fault can be activated. InputError for an unknown button.
        """
        if button not in BUTTONS:
            raise InputError(f"pendant button {button!r} is unknown; expected one of {', '.join(BUTTONS)}.")
        frames = self.tick(now_ns)
        if button == "release":
            self._estop_pressed = False
        elif button == "estop":
            self._estop_pressed = True
            frames += self._set_mode(SAFETY_ESTOP, now_ns)
        elif button == "idle" and not self._estop_pressed:
            self._heartbeat_fault = False
            frames += self._set_mode(SAFETY_IDLE, now_ns)
        elif button == "activate" and self.mode == SAFETY_IDLE and not self._heartbeat_fault:
            self._last_position_ns = None
            frames += self._set_mode(SAFETY_ACTIVE, now_ns)
        return frames

    def _hear_torques(self, group: int | None, message: can.Message, now_ns: int) -> None:
        number, values = parse_torques(message)
        self.heard["torque"] += 1
        if group is None:
            return
        taken = [motor.take_torque(group, number, values) for motor in self._motors if motor.hears(now_ns, group)]
        if any(taken):
            self._drive_plant(now_ns)

    def _write(self, puck: Puck, name: str, value: int, now_ns: int) -> list[TimedFrame]:
        if name != "MODE":
            puck.write(name, value, now_ns)
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
        listens = self._safety.values["VERS"] >= IDLE_REQUEST_FIRMWARE
        if listens and value in (SAFETY_ESTOP, SAFETY_IDLE) and value < self.mode:
            return self._set_mode(value, now_ns)
        self.heard["refused_mode"] += int(value != self.mode)
        return []

    def _sample_encoders(self) -> None:
        motor_rad = joint_to_motor(self._plant.joint_position_rad())
        for motor, angle_rad in zip(self._motors, motor_rad.tolist(), strict=True):
            motor.see_angle(angle_rad)

    def _set_mode(self, mode: int, now_ns: int) -> list[TimedFrame]:
        """Change the arm's mode: power and order the motor pucks, and tell them on the bus as the real one does."""
        before = self.mode
        self._safety.values["MODE"] = mode
        for motor in self._motors:
            motor.power(mode != SAFETY_ESTOP)
            motor.set_mode(MOTOR_TORQUE if mode == SAFETY_ACTIVE else MOTOR_IDLE)
        if mode == SAFETY_ESTOP:
            self._safety.values["ZERO"] = 0
        self._drive_plant(now_ns)
        if mode == before:
            return []
        order = set_property(0, self._safety.number("MODE"), MOTOR_TORQUE if mode == SAFETY_ACTIVE else MOTOR_IDLE)
        order.arbitration_id = UNASKED_SAFETY_ID
        order.data, order.dlc = order.data[:4], 4  # the short form
        return [(now_ns, order)]

    def _drive_plant(self, now_ns: int) -> None:
        units = np.array([motor.torque_units if motor.driving else 0 for motor in self._motors], dtype=np.float64)
        braking = not any(motor.driving for motor in self._motors)
        self._plant.set_joint_torque_Nm(motor_to_joint_torque(units / self._units_per_Nm), braking, now_ns)

    def _pendant(self) -> PendantState:
        estop = self.mode == SAFETY_ESTOP
        return PendantState(
            button=Button.ESTOP if self._estop_pressed else Button.NONE,
            activate_lit=self.mode == SAFETY_ACTIVE,
            idle_lit=self.mode == SAFETY_IDLE,
            segments=_SEGMENTS_E if estop else 0x3F,
            heartbeat=Light.FAULT if self._heartbeat_fault else Light.SAFE,
            other=Light.FAULT if estop else Light.SAFE,
        )


def _motor_factory(node: int, parameters: WamParameters) -> dict[str, int]:
    motor = node - 1
    return {
        "CTS": int(parameters.counts_per_turn[motor]),
        "IPNM": int(parameters.units_per_Nm[motor]),
        "MT": int(parameters.motor_torque_limit_units[motor]),
        "PIDX": _PLACES[motor],
        "JIDX": node,
        "POLES": _POLES[motor],
        "OTEMP": 60,
        "GRPA": 0,
        "GRPB": 1 if node <= 4 else 2,
        "GRPC": GROUP_ARM,
    }
