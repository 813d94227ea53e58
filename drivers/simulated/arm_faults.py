"""What can go wrong with a simulated WAM itself, and what its operator does: actions of fault scripts.

Nodes 1 to 7 are the motor pucks, 10 the safety puck. Source: WAM reference 4.5, 7.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

_Node = Annotated[int, Meta(ge=1, le=10)]
_Motors = Annotated[tuple[Annotated[int, Meta(ge=1, le=7)], ...], Meta(min_length=1)]
_Nodes = Annotated[tuple[_Node, ...], Meta(min_length=1)]


class _Action(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind"):
    """An action; its kind is its name in the script."""


class Press(_Action, frozen=True, kw_only=True, tag="press"):
    """The operator presses a button of the pendant."""

    button: Literal["idle", "activate", "estop", "release", "shift-idle", "shift-activate", "e-stop"]


class BrownOut(_Action, frozen=True, kw_only=True, tag="brown_out"):
    """The supply of motor pucks dips: after `down_s` they are in their boot monitor, positions lost."""

    nodes: _Motors = (1, 2, 3, 4, 5, 6, 7)
    down_s: Annotated[float, Meta(ge=0, le=60)] = 0.05


class Silence(_Action, frozen=True, kw_only=True, tag="silence"):
    """Pucks hear and obey, but do not answer, as long as it lasts."""

    nodes: _Nodes


class SetProperty(_Action, frozen=True, kw_only=True, tag="set_property"):
    """A property of a puck has another value all at once, read-only ones too; P moves the count."""

    node: _Node
    name: str
    value: Annotated[int, Meta(ge=-(2**31), lt=2**31)]


class Supply(_Action, frozen=True, kw_only=True, tag="supply"):
    """The motors' supply has another voltage."""

    volts: Annotated[float, Meta(ge=0, le=100)]


ArmAction = Press | BrownOut | Silence | SetProperty | Supply
ARM_EVENTS = (
    "idle",
    "active",
    "estop",
    "first_position",
    "first_torque",
    "waking",
    "talk_while_waking",
    "zeroed",
    "velocity_fault",
    "torque_fault",
    "voltage_fault",
    "heartbeat_fault",
)
"""What faults can wait for: changes of mode; the first position request and torque frame; a puck is woken; a host talks
while it wakes, or wakes another within 10 ms (which can drive adapters bus-off); ZERO is written; faults."""
