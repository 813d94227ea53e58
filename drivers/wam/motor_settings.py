"""What the seven motor pucks say of themselves, read once and checked: versions, encoders, current scale, groups.

A puck that would take another's torque, would not hear the position request, or counts in other units than believed, is
refused here, before any torque. Units: encoder counts a motor turn, puck units per N·m of motor torque, puck units of
torque. Tuples in motor order 1 to 7. Source: WAM reference 0.5, 1.3, 3.2, 4.2; 8.4 for what old firmware lacks.
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.errors import ProtocolError
from drivers.wam.dialogue import Dialogue
from drivers.wam.discovery import MOTOR_NODES, require_motor_role
from drivers.wam.frames import GROUP_ALL_MOTORS, GROUP_ARM, GROUP_LOWER_TORQUE, GROUP_UPPER_TORQUE
from drivers.wam.parameters import JOINTS, WamParameters
from drivers.wam.properties import property_id, property_numbers
from drivers.wam.zeroing import has_absolute_encoder

GROUP_WRIST = 5
"""The group of pucks 5 to 7 in older arms; in newer ones that of the vendor's hand."""
_PLACES = (1, 2, 3, 4, 1, 2, 3)
_TORQUE_GROUPS = (GROUP_LOWER_TORQUE,) * 4 + (GROUP_UPPER_TORQUE,) * 3
_KNOWN_COUNTS = (4096, 40960)
_WRIST_POLES, _GIMBALS_POLES = 6, 8


@dataclass(frozen=True)
class MotorSettings:
    """Settings of motor pucks 1 to 7, consistent with each other."""

    firmware: tuple[int, ...]
    roles: tuple[int, ...]
    counts_per_turn: tuple[int, ...]
    units_per_Nm: tuple[float, ...]
    torque_limit_units: tuple[int, ...]
    """MT: the largest torque that each puck applies."""
    position_groups: tuple[int, ...]
    """Groups that together reach all seven: (4,), or (4, 5) where wrist pucks listen to group 5."""
    notes: tuple[str, ...]
    """What firmware of this age cannot tell, and what stands in for it."""

    @property
    def position_id(self) -> int:
        """Number of P, the same in all seven."""
        return property_id("P", self.firmware[0], "motor")

    @property
    def torque_id(self) -> int:
        """Number of T, the same in all seven."""
        return property_id("T", self.firmware[0], "motor")

    @property
    def absolute_encoder(self) -> tuple[bool, ...]:
        """Whether MECH of each motor may be used for zeroing."""
        return tuple(has_absolute_encoder(*pair) for pair in zip(self.firmware, self.roles, strict=True))


def read_motor_settings(dialogue: Dialogue, parameters: WamParameters) -> MotorSettings:
    """Read and check all seven pucks; they must be awake.

    Raises NoReplyError for a silent puck, ProtocolError for settings that do not make an arm, InputError for firmware
    that nobody knows.
    """
    firmware = tuple(dialogue.ask(node, property_id("VERS", 0, "monitor"), "VERS") for node in MOTOR_NODES)
    for name in ("P", "T"):
        numbers = {property_id(name, version, "motor") for version in firmware}
        if len(numbers) > 1:
            raise ProtocolError(
                "WAM",
                f"firmware {firmware} numbers property {name} in {len(numbers)} ways; expected one.",
                help="Have the pucks updated to the same firmware.",
            )

    def ask_all(name: str) -> tuple[int, ...]:
        pairs = zip(MOTOR_NODES, firmware, strict=True)
        return tuple(dialogue.ask(node, property_id(name, version, "motor"), name) for node, version in pairs)

    def known_by_all(name: str) -> bool:
        return all(name in property_numbers(version, "motor") for version in firmware)

    roles = ask_all("ROLE")
    for node, role in zip(MOTOR_NODES, roles, strict=True):
        require_motor_role(node, role)
    places = ask_all("PIDX")
    if places != _PLACES:
        help_text = "A puck was exchanged: write its PIDX with the vendor's btutil."
        raise ProtocolError("WAM", f"PIDX of pucks 1 to 7 is {places}; expected {_PLACES}.", help=help_text)
    groups = _check_groups({name: ask_all(name) for name in ("GRPA", "GRPB", "GRPC")})
    notes: list[str] = []
    if len(groups) > 1:
        notes.append("wrist pucks listen to group 5 (GRPC): positions are asked of groups 4 and 5")
    if known_by_all("POLES"):
        _require_wrist(dialogue.ask(JOINTS, property_id("POLES", firmware[-1], "motor"), "POLES"))
    else:
        notes.append("firmware before 44 tells no POLES: that there is a wrist and no gimbals is taken on trust")
    # 40960 in a reply with two value bytes reads as a negative number.
    counts = tuple(count & 0xFFFF if count < 0 else count for count in ask_all("CTS"))
    for node, count, configured in zip(MOTOR_NODES, counts, parameters.counts_per_turn.tolist(), strict=True):
        if count not in (*_KNOWN_COUNTS, int(configured)):
            raise ProtocolError(
                f"puck {node}",
                f"CTS is {count}; expected {' or '.join(map(str, _KNOWN_COUNTS))} counts a motor turn.",
                help="Repair the puck's settings, or write counts_per_turn into the arm's own file if it is right.",
            )
    limits = ask_all("MT")
    _require_positive("MT", limits)
    if known_by_all("IPNM"):
        units = ask_all("IPNM")
        _require_positive("IPNM", units)
        units_per_Nm = tuple(float(unit) for unit in units)
    else:
        units_per_Nm = tuple(parameters.units_per_Nm.tolist())
        notes.append("firmware 32 tells no IPNM: units_per_Nm of the arm's parameters is used")
    return MotorSettings(firmware, roles, counts, units_per_Nm, limits, groups, tuple(notes))


def _check_groups(groups: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    """Groups to ask for positions. ProtocolError if a puck would miss an order, its torque or the request."""
    expected: dict[str, tuple[tuple[int, ...], ...]] = {
        "GRPA": ((GROUP_ALL_MOTORS,),) * JOINTS,
        "GRPB": tuple((group,) for group in _TORQUE_GROUPS),
        "GRPC": ((GROUP_ARM,),) * 4 + ((GROUP_ARM, GROUP_WRIST),) * 3,
    }
    for name, found in groups.items():
        accepted = expected[name]
        wrong = [node for node, group, good in zip(MOTOR_NODES, found, accepted, strict=True) if group not in good]
        if wrong:
            raise ProtocolError(
                "WAM",
                f"{name} of pucks 1 to 7 is {found}; "
                f"expected {', '.join(' or '.join(map(str, good)) for good in accepted)}.",
                help=f"Write {name} of pucks {wrong} with the vendor's btutil.",
            )
    return (GROUP_ARM, GROUP_WRIST) if GROUP_WRIST in groups["GRPC"] else (GROUP_ARM,)


def _require_wrist(poles: int) -> None:
    if poles == _GIMBALS_POLES:
        raise ProtocolError(
            f"puck {JOINTS}",
            f"POLES is {poles}: the arm has gimbals; expected a wrist with {_WRIST_POLES}.",
            help="Only the seven-joint arm with a wrist is modelled here.",
        )
    if poles != _WRIST_POLES:
        raise ProtocolError(
            f"puck {JOINTS}",
            f"POLES is {poles}; expected {_WRIST_POLES}, a wrist's.",
            help="Repair the puck's settings with the vendor's btutil.",
        )


def _require_positive(name: str, values: tuple[int, ...]) -> None:
    if min(values) <= 0:
        raise ProtocolError(
            "WAM",
            f"{name} of pucks 1 to 7 is {values}; expected positive numbers.",
            help="Repair the puck's settings with the vendor's btutil.",
        )
