"""Who is on the bus: a survey of nodes 1 to 31, and the verdict on whether that is a seven-joint arm.

Each node is asked for STAT, 1 ms after the one before; answers are taken until 50 ms after the last question, because
an adapter may need a millisecond for a round trip. Arm nodes that keep silent are asked twice. Roles and versions of
those who answered follow; a puck in its boot monitor tells the monitor's version, and may not tell its role.
Source: WAM reference 1.2, 3.2 (STAT, ROLE), 4.2; 8.6 on the monitor.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from drivers.clock import nanoseconds
from drivers.errors import DeviceError, NoReplyError, ProtocolError
from drivers.wam.dialogue import STATUS_ID, Dialogue
from drivers.wam.frames import SAFETY_NODE, get_property, parse_property
from drivers.wam.parameters import JOINTS
from drivers.wam.properties import (
    ROLE_FORCE_SENSOR,
    ROLE_GIMBALS,
    ROLE_HAND,
    ROLE_KIND,
    ROLE_MOTOR,
    ROLE_SAFETY,
    STATUS_ERROR,
    STATUS_MONITOR,
    STATUS_READY,
    property_id,
)

MOTOR_NODES = range(1, JOINTS + 1)
ALL_NODES = range(1, 32)
_SPACING_S = 0.001
_LAST_ANSWER_S = 0.05
_ROLE_ID = property_id("ROLE", 0, "monitor")
_VERSION_ID = property_id("VERS", 0, "monitor")
_EXPECTED_ROLES = {
    **dict.fromkeys(MOTOR_NODES, ROLE_MOTOR),
    8: ROLE_FORCE_SENSOR,
    SAFETY_NODE: ROLE_SAFETY,
    **dict.fromkeys(range(11, 15), ROLE_HAND),
}


@dataclass(frozen=True)
class FoundPuck:
    """A node that answered."""

    node: int
    status: int
    """STAT: 0 boot monitor, 1 error, 2 main firmware."""
    role: int | None
    """ROLE with its option bits; None if it does not tell."""
    firmware: int | None
    """VERS; of the boot monitor while STAT is 0."""


@dataclass(frozen=True)
class Survey:
    """All nodes that answered, in node order."""

    pucks: tuple[FoundPuck, ...]

    @property
    def motors(self) -> tuple[FoundPuck, ...]:
        """Those at nodes 1 to 7."""
        return tuple(puck for puck in self.pucks if puck.node in MOTOR_NODES)

    @property
    def safety(self) -> FoundPuck | None:
        """The one at node 10."""
        return next((puck for puck in self.pucks if puck.node == SAFETY_NODE), None)

    @property
    def hand(self) -> tuple[FoundPuck, ...]:
        """Pucks of a vendor's hand."""
        return tuple(puck for puck in self.pucks if 11 <= puck.node <= 14 and not _out_of_place(puck))

    @property
    def force_sensor(self) -> FoundPuck | None:
        """The one at node 8."""
        return next((puck for puck in self.pucks if puck.node == 8 and not _out_of_place(puck)), None)

    @property
    def foreign(self) -> tuple[FoundPuck, ...]:
        """Pucks at a place where the arm, its hand and its sensor have none of that role. They are let be."""
        own = (*MOTOR_NODES, SAFETY_NODE)
        return tuple(puck for puck in self.pucks if puck.node not in own and _out_of_place(puck))

    @property
    def asleep(self) -> tuple[int, ...]:
        """Motor nodes in their boot monitor."""
        return tuple(puck.node for puck in self.motors if puck.status == STATUS_MONITOR)


def survey(dialogue: Dialogue, nodes: Iterable[int] = ALL_NODES) -> Survey:
    """Ask `nodes` who they are. Takes some 0.1 s for all; BusError if the bus fails."""
    asked = tuple(nodes)
    statuses = _statuses(dialogue, asked)
    missing = tuple(node for node in asked if node in (*MOTOR_NODES, SAFETY_NODE) and node not in statuses)
    if missing:
        statuses |= _statuses(dialogue, missing)
    pucks = []
    for node in sorted(statuses):
        role, firmware = (dialogue.ask_or_none(node, number) for number in (_ROLE_ID, _VERSION_ID))
        pucks.append(FoundPuck(node, statuses[node], role, firmware))
    return Survey(tuple(pucks))


def require_safety_puck(found: Survey) -> FoundPuck:
    """The safety puck. NoReplyError if node 10 is silent, ProtocolError if it is another kind of puck."""
    safety = found.safety
    if safety is None:
        others = [puck.node for puck in found.pucks]
        if others:
            message = f"no reply from node {SAFETY_NODE} within 50 ms, while nodes {others} answer."
            help_text = "Check the safety puck's cable; without it the arm cannot be run."
        else:
            message = f"no reply from node {SAFETY_NODE} nor from any other within 50 ms."
            help_text = "Check that the arm's power supply is on, the CAN cable connected and its rate 1 Mbit/s."
        raise NoReplyError("safety puck", message, help=help_text)
    if safety.role is not None and safety.role & ROLE_KIND != ROLE_SAFETY:
        raise ProtocolError(
            f"puck {SAFETY_NODE}",
            f"ROLE {safety.role:#06x} is not a safety puck's; expected {ROLE_SAFETY} in its low bits.",
            help="Another puck has the safety puck's id: correct it with the vendor's btutil.",
        )
    return safety


def require_motors(found: Survey) -> None:
    """Nodes 1 to 7 are arm motors in a usable state.

    Raises NoReplyError naming all that are silent, ProtocolError for a puck of another kind or an unknown STAT,
    DeviceError for one that reports an error.
    """
    present = {puck.node for puck in found.motors}
    silent = [node for node in MOTOR_NODES if node not in present]
    if silent:
        what = "no motor puck answers" if len(silent) == JOINTS else f"pucks {silent} of 1 to 7 do not answer"
        raise NoReplyError(
            "WAM",
            f"{what}; expected seven.",
            help="Check the arm's cables; E-stop takes the pucks' power, and after Shift-Idle they need four seconds.",
        )
    for puck in found.motors:
        if puck.status == STATUS_ERROR:
            raise DeviceError(
                f"puck {puck.node}", "STAT is 1: it reports an error.", help="Switch the arm off and on again."
            )
        if puck.status not in (STATUS_MONITOR, STATUS_READY):
            raise ProtocolError(f"puck {puck.node}", f"STAT {puck.status} is unknown; expected 0, 1 or 2.")
        if puck.role is not None:
            require_motor_role(puck.node, puck.role)


def require_motor_role(node: int, role: int) -> None:
    """ProtocolError unless `role` is that of an arm motor with a wrist."""
    kind = role & ROLE_KIND
    if kind == ROLE_GIMBALS:
        raise ProtocolError(
            f"puck {node}",
            f"ROLE {role:#06x} belongs to gimbals; expected a wrist.",
            help="Only the seven-joint arm with a wrist is modelled here.",
        )
    if kind != ROLE_MOTOR:
        raise ProtocolError(
            f"puck {node}",
            f"ROLE {role:#06x} is not an arm motor's; expected {ROLE_MOTOR} in its low bits.",
            help="A puck is out of its place: check the ids with the vendor's btutil.",
        )


def _statuses(dialogue: Dialogue, nodes: tuple[int, ...]) -> dict[int, int]:
    """STAT of the nodes that answer."""
    bus, clock = dialogue.bus, dialogue.clock
    statuses: dict[int, int] = {}
    for place, node in enumerate(nodes, start=1):
        bus.send(get_property(node, STATUS_ID))
        wait_s = _SPACING_S if place < len(nodes) else _LAST_ANSWER_S
        deadline_ns = clock.now_ns() + nanoseconds(wait_s)
        while len(statuses) < len(nodes) and (message := bus.receive(deadline_ns)) is not None:
            try:
                reply = parse_property(message)
            except ProtocolError:
                continue
            if reply.property_id == STATUS_ID and reply.node in nodes:
                statuses[reply.node] = reply.value
    return statuses


def _out_of_place(puck: FoundPuck) -> bool:
    expected = _EXPECTED_ROLES.get(puck.node)
    return expected is None or (puck.role is not None and puck.role & ROLE_KIND != expected)
