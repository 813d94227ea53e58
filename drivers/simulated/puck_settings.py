"""How single pucks of a simulated arm differ from their factory, and the pucks made so."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.simulated.firmware import motor_factory, safety_factory
from drivers.simulated.motor_puck import MotorPuck
from drivers.simulated.safety_puck import SafetyPuck
from drivers.simulated.safety_watch import SafetySettings
from drivers.wam.parameters import WamParameters
from drivers.wam.properties import PuckKind, property_id


@dataclass(frozen=True)
class PuckSettings:
    """What sets one puck apart from the others of its arm."""

    firmware: int | None = None
    asleep: bool | None = None
    """In its boot monitor, or not; None: as the others."""
    silent: bool = False
    """Hears and obeys, but does not answer."""
    properties: Mapping[str, int] = field(default_factory=dict)
    """By name, as it left the factory: ROLE, PIDX, GRPC, MT, CTS, …; STAT = 1 is a puck that has failed."""


def motor_puck(
    node: int, firmware: int, parameters: WamParameters, settings: PuckSettings, booted: bool, joint_encoder: bool
) -> MotorPuck:
    version = firmware if settings.firmware is None else settings.firmware
    factory = motor_factory(node, version, parameters, joint_encoder=joint_encoder) | _known(settings, version, "motor")
    return MotorPuck(node, version, factory, booted=booted if settings.asleep is None else not settings.asleep)


def safety_puck(
    firmware: int, settings: PuckSettings, zeroed: bool, watch: SafetySettings, counts: list[int]
) -> SafetyPuck:
    version = firmware if settings.firmware is None else settings.firmware
    factory = safety_factory() | {"ZERO": int(zeroed)} | _known(settings, version, "safety")
    return SafetyPuck(version, factory, watch, counts)


def _known(settings: PuckSettings, firmware: int, kind: PuckKind) -> dict[str, int]:
    """The properties of the settings; InputError for one that such a puck does not have."""
    for name in settings.properties:
        property_id(name, firmware, kind)
    return dict(settings.properties)
