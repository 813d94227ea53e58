"""What a child process is told when it is started: its role, the installation, the ends of its links.

The front encodes it as msgpack and writes it to the child's standard input; descriptors are inherited under the same
numbers. Nothing in it comes from outside: what a user wrote was checked when the configuration was read.
"""

from __future__ import annotations

from typing import Annotated, BinaryIO, Literal

import msgspec
from msgspec import Meta

from controller.config import RobotConfig
from controller.pose import Coordinate
from drivers.simulated.arm_faults import ArmAction
from drivers.simulated.can_fault_actions import CanAction
from drivers.simulated.faults import FaultScript
from drivers.simulated.serial_fault_actions import SerialAction
from drivers.simulated.takktile_fault_actions import TakktileAction

Role = Literal["cycle", "hand", "tactile", "world"]


class SceneChoice(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the command line says of the simulated scene; None leaves it to the scene's own default.

    `object` is a name or a file; `object_xyz_m` and `object_yaw_rad` place it in the world, and `outline_angle_rad`
    turns its outline further, as first contact places it in the hand; `seed` draws the arm's imperfections.
    `arm_faults`, `motor_faults`, `pad_faults`: what goes wrong with the devices, timed from the world's beginning.
    """

    object: str | None = None
    object_xyz_m: tuple[Coordinate, Coordinate, Coordinate] | None = None
    object_yaw_rad: Annotated[float, Meta(ge=-6.3, le=6.3)] | None = None
    outline_angle_rad: Annotated[float, Meta(ge=-6.3, le=6.3)] | None = None
    seed: Annotated[int, Meta(ge=0, le=2**32 - 1)] | None = None
    arm_faults: FaultScript[CanAction | ArmAction] | None = None
    motor_faults: FaultScript[SerialAction] | None = None
    pad_faults: FaultScript[TakktileAction] | None = None


class Assignment(msgspec.Struct, frozen=True, kw_only=True):
    """One child's task. `descriptors` by name: `front` (the lifeline) and the links of its role."""

    role: Role
    config: RobotConfig
    descriptors: dict[str, int]
    parent: int
    """Process id of the front."""
    simulated: bool
    scene: SceneChoice = SceneChoice()

    def encode(self) -> bytes:
        """The bytes for the child's standard input."""
        return msgspec.msgpack.encode(self)


def read_assignment(source: BinaryIO) -> Assignment:
    """The assignment that the parent wrote to `source`, which is read to its end."""
    return msgspec.msgpack.decode(source.read(), type=Assignment)
