"""What a puck leaves the factory with, by firmware generation: the values of its properties.

Their numbers are those of `drivers.wam.properties`. Source: WAM reference 1.3, 2.5, 3.2; where generations differ and
no source says at which version [assumed], the oldest arms known (below 61) count 40960 a turn, have no absolute
encoders and keep their wrist in group 5.
"""

from __future__ import annotations

from drivers.wam.parameters import JOINTS, WamParameters
from drivers.wam.properties import ABSOLUTE_ENCODER_FIRMWARE, SEPARATE_TABLES_FIRMWARE

GENERATIONS = {60: 60, 118: 118, 141: 141, 200: 197}
"""Motor firmware of each generation, and the safety puck's that goes with it."""
ROLE_JOINT_ENCODER = 0x4000
JOINT_ENCODER_COUNTS = (1578399, 655360, 655360, 327680)
"""Counts a turn of the joints that can have an encoder, 1 to 4 (WAM reference 5.1)."""
SUPPLY_V = 48
_OLD_COUNTS = 40960
_PLACES = (1, 2, 3, 4, 1, 2, 3)
_POLES = (12, 12, 12, 12, 8, 8, 6)


def safety_firmware_beside(motor_firmware: int) -> int:
    """The safety puck's firmware in an arm of this generation."""
    return GENERATIONS.get(motor_firmware, min(motor_firmware, 197))


def motor_factory(node: int, firmware: int, parameters: WamParameters, *, joint_encoder: bool) -> dict[str, int]:
    """Properties of motor puck `node`, 1 to 7, by name."""
    motor = node - 1
    old = firmware < SEPARATE_TABLES_FIRMWARE
    role = 0x01C0 if firmware >= ABSOLUTE_ENCODER_FIRMWARE else 0x00C0
    return {
        "ROLE": role | (ROLE_JOINT_ENCODER if joint_encoder and motor < len(JOINT_ENCODER_COUNTS) else 0),
        "CTS": _OLD_COUNTS if old else int(parameters.counts_per_turn[motor]),
        "IPNM": int(parameters.units_per_Nm[motor]),
        "MT": int(parameters.motor_torque_limit_units[motor]),
        "PIDX": _PLACES[motor],
        "JIDX": node,
        "POLES": _POLES[motor],
        "TEMP": 30,
        "THERM": 30,
        "OTEMP": 60,
        "VBUS": SUPPLY_V,
        "GRPA": 0,
        "GRPB": 1 if node <= 4 else 2,
        "GRPC": 5 if old and node > 4 else 4,
    }


def safety_factory() -> dict[str, int]:
    """Properties of the safety puck, by name."""
    return {
        "ROLE": 0x0082,
        "MODE": 1,
        "TEMP": 30,
        "VBUS": SUPPLY_V,
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
        "VNOM": SUPPLY_V,
    }


NODES = range(1, JOINTS + 1)
"""The motor pucks."""
