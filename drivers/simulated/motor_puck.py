"""A simulated motor puck: encoders, position counter and torque register behind a puck's properties.

Motor counts come from the arm (`see`), torques are puck units. P and MECH move together and a host sets only P. A joint
encoder counts from where it was switched on until its index has passed, then from the joint's zero [assumed]. Source:
WAM reference 2.4, 2.5, 3.2 and 4.7.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi

from drivers.simulated.can_wire import Frame
from drivers.simulated.firmware import ROLE_JOINT_ENCODER
from drivers.simulated.puck import Puck
from drivers.simulated.puck_frames import joint_encoder, position
from drivers.wam.properties import MOTOR_IDLE, MOTOR_TORQUE, ROLE_ABSOLUTE_ENCODER

_INDEXED = {"ECMIN": -1, "ECMAX": 1}
"""Not zero once the index has passed; what else they hold is in no source."""


class MotorPuck(Puck):
    """One of pucks 1 to 7."""

    def __init__(self, node: int, firmware: int, factory: Mapping[str, int], *, booted: bool) -> None:
        super().__init__(node, "motor", firmware, factory, booted=booted)
        self.counts_per_turn = factory["CTS"]
        """What the encoder really counts, whatever CTS says."""
        self._encoder = 0
        self._joint_encoder = 0
        self._mech_offset: int | None = None
        self._position_offset: int | None = None
        self._joint_offset: int | None = None
        self._indexed = False
        self.torque_units = 0

    # --- encoders

    def see(self, motor_counts: int) -> None:
        """Sample the motor's encoder, whole counts from the joint's zero; after a loss of power it starts to count."""
        if self._position_offset is None:
            absolute = self.values["ROLE"] & ROLE_ABSOLUTE_ENCODER
            self._mech_offset = _magnet_counts(self.node) if absolute else -motor_counts
            self._position_offset = (motor_counts + self._mech_offset) % self.counts_per_turn - motor_counts
        self._encoder = motor_counts

    def see_joint(self, joint_rad: float, counts_per_turn: int) -> None:
        """Sample the joint's encoder, if there is one; where the joint passes zero, so does the encoder's index."""
        if not self.values["ROLE"] & ROLE_JOINT_ENCODER:
            return
        counts = round(joint_rad * counts_per_turn / (2.0 * pi))
        if self._joint_offset is None:
            self._joint_offset = -counts
        elif not self._indexed and (counts >= 0) != (self._joint_encoder >= 0):
            self._pass_index()
        self._joint_encoder = counts

    def know_positions(self) -> None:
        """Count from the joint's zero, as after zeroing, with the joint encoder's index passed."""
        self._position_offset = 0
        self._mech_offset = _magnet_counts(self.node)
        self._pass_index()

    @property
    def position_counts(self) -> int:
        """P, unwrapped."""
        return self._encoder + (self._position_offset or 0)

    @property
    def joint_counts(self) -> int | None:
        """JP; None without joint encoder."""
        if not self.values["ROLE"] & ROLE_JOINT_ENCODER:
            return None
        return self._joint_encoder + (self._joint_offset or 0) + self.values.get("JOFST", 0)

    def read(self, name: str) -> int:
        if name == "MECH":
            return (self._encoder + (self._mech_offset or 0)) % self.counts_per_turn
        return super().read(name)

    def reply(self, name: str, number: int) -> Frame:
        """As any puck's, but positions have their own short frames."""
        if name == "P":
            return position(self.node, self.position_counts, self.joint_counts)
        if name == "JP":
            return joint_encoder(self.node, self.joint_counts or 0)
        return super().reply(name, number)

    def write(self, name: str, value: int, now_ns: int) -> None:
        if name == "P" and not self.in_monitor:
            self._position_offset = value - self._encoder
            return
        super().write(name, value, now_ns)
        if self.in_monitor:
            self._forget_position()

    def power(self, on: bool, now_ns: int, *, starts_after_ns: int = 0) -> None:
        super().power(on, now_ns, starts_after_ns=starts_after_ns)
        if not on:
            self._forget_position()

    # --- torque

    def take_torque(self, number: int, values: tuple[int, int, int, int]) -> bool:
        """Obey a packed torque frame that it hears, if it is in torque mode: hold it until the next."""
        place = self.values["PIDX"]
        if number != self.number("T") or not 1 <= place <= 4 or not self.driving:
            return False
        limit = abs(self.values["MT"])
        self.torque_units = max(-limit, min(limit, values[place - 1]))
        return True

    @property
    def driving(self) -> bool:
        """In torque mode, powered and awake."""
        return self.powered and not self.in_monitor and self.values["MODE"] == MOTOR_TORQUE

    def set_mode(self, mode: int) -> None:
        """Take the safety puck's order; with every change the torque starts from zero."""
        if self.powered and not self.in_monitor and self.values["MODE"] != mode:
            self.values["MODE"] = mode
            self.torque_units = 0

    def _pass_index(self) -> None:
        self._indexed = True
        self._joint_offset = 0
        if self.values["ROLE"] & ROLE_JOINT_ENCODER:
            self.values.update(_INDEXED)

    def _forget_position(self) -> None:
        self._position_offset = self._joint_offset = None
        self._indexed = False
        self.values.update(dict.fromkeys(_INDEXED, 0), MODE=MOTOR_IDLE)
        self.torque_units = 0


def _magnet_counts(node: int) -> int:
    """How an absolute encoder happens to sit on its motor, counts."""
    return 607 * node
