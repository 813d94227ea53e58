"""The simulated safety puck: node 10, which holds the arm's mode, watches over it and shows the pendant's lights.

It decides; the arm (`wam.py`) powers and orders the motor pucks. Motor torques are puck units, times ns. Source: WAM
reference 2.6, 4.1, 4.5, 4.7.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from drivers.clock import nanoseconds
from drivers.errors import InputError
from drivers.simulated.can_wire import Frame
from drivers.simulated.puck import Puck
from drivers.simulated.puck_frames import motor_mode_order
from drivers.simulated.safety_watch import SafetySettings, SafetyWatch, lights_value
from drivers.wam.properties import (
    IDLE_REQUEST_FIRMWARE,
    MOTOR_IDLE,
    MOTOR_TORQUE,
    PENDANT_FIRMWARE,
    SAFETY_ACTIVE,
    SAFETY_ESTOP,
    SAFETY_IDLE,
)

SAFETY_NODE = 10
BUTTONS = ("idle", "activate", "estop", "release")
"""The operator's: Shift-Idle, Shift-Activate, E-stop pressed, E-stop released."""
_OTHER_NAMES = {"shift-idle": "idle", "shift-activate": "activate", "e-stop": "estop"}
_BUTTON_CODES = {"estop": 0, "activate": 1, "idle": 2}
_NO_BUTTON = 3
_BUTTON_SHOWN_NS = nanoseconds(0.1)
_SHOWS_ZERO, _SHOWS_E = 0x3F, 0x79


def button_named(word: str) -> str:
    """One of BUTTONS, also by the name that stands on the pendant. InputError for any other word."""
    button = _OTHER_NAMES.get(word, word)
    if button not in BUTTONS:
        raise InputError(f"pendant button {word[:40]!r} is unknown; expected one of {', '.join(BUTTONS)}.")
    return button


class SafetyPuck(Puck):
    """Node 10. Methods that may change the mode return the new one (0 E-stop, 1 idle, 2 active) or None."""

    def __init__(
        self, firmware: int, factory: Mapping[str, int], settings: SafetySettings, counts_per_turn: Sequence[int]
    ) -> None:
        super().__init__(SAFETY_NODE, "safety", firmware, factory, booted=True)
        self.set_gap_ns = nanoseconds(settings.set_gap_s)
        self.watch = SafetyWatch(self.values, settings, counts_per_turn)
        self.estop_pressed = False
        self._button = _NO_BUTTON
        self._button_until_ns = 0

    @property
    def mode(self) -> int:
        """0 E-stop, 1 idle, 2 active."""
        return self.values["MODE"]

    def set_mode(self, mode: int) -> None:
        """Be in a mode; positions and ZERO are lost with the motors' power [assumed]."""
        if mode == SAFETY_ACTIVE != self.mode:
            self.watch.listen_anew()
        self.values["MODE"] = mode
        if mode == SAFETY_ESTOP:
            self.values["ZERO"] = 0
            self.watch.forget_positions()

    def press(self, button: str, now_ns: int) -> int | None:
        """The operator's wish. One that does not apply does nothing: only idle leaves E-stop, after its release, and
        clears a fault; only an idle arm without fault can be activated."""
        if button == "release":
            self.estop_pressed = False
            return None
        self._button, self._button_until_ns = _BUTTON_CODES[button], now_ns + _BUTTON_SHOWN_NS
        if button == "estop":
            self.estop_pressed = True
            return SAFETY_ESTOP
        if button == "idle" and not self.estop_pressed:
            self.watch.clear()
            return SAFETY_IDLE
        if button == "activate" and self.mode == SAFETY_IDLE and not self.watch.faulty:
            return SAFETY_ACTIVE
        return None

    def asked_for_mode(self, mode: int) -> int | None:
        """The host's wish: lower modes only, and only from firmware 197 on."""
        listens = self.firmware >= IDLE_REQUEST_FIRMWARE
        return mode if listens and SAFETY_ESTOP <= mode < self.mode else None

    def pendant_value(self, now_ns: int) -> int:
        """PEN; before firmware 197 its coding is unknown, and it is 0 here."""
        if self.firmware < PENDANT_FIRMWARE:
            return 0
        button = _NO_BUTTON if now_ns >= self._button_until_ns else self._button
        if self.estop_pressed:
            button = _BUTTON_CODES["estop"]
        estop = self.mode == SAFETY_ESTOP
        lit = (self.mode == SAFETY_ACTIVE) << 1 | (self.mode == SAFETY_IDLE)
        segments = _SHOWS_E if estop else _SHOWS_ZERO
        return button << 26 | lit << 24 | segments << 16 | lights_value(self.watch.lights, estop)

    def order_to_motors(self) -> Frame:
        """The frame with which it tells the motor pucks their mode."""
        mode = MOTOR_TORQUE if self.mode == SAFETY_ACTIVE else MOTOR_IDLE
        return motor_mode_order(SAFETY_NODE, self.number("MODE"), mode)
