"""A simulated arm that does not move, talked to in text."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.simulated.can_wire import Frame
from drivers.simulated.wam import SimulatedWam
from drivers.wam.parameters import load_wam_parameters


class StillPlant:
    """Joints that turn only as the test says; records the torques."""

    def __init__(self) -> None:
        self.joint_rad: NDArray[np.float64] = np.array([0.0, -2.0, 0.0, 3.13, 0.0, 0.0, 0.0])
        self.torque_Nm: NDArray[np.float64] = np.zeros(7)
        self.braking = False
        self.at_ns = -1

    def joint_position_rad(self) -> NDArray[np.float64]:
        return self.joint_rad

    def set_joint_torque_Nm(self, torque_Nm: NDArray[np.float64], braking: bool, at_ns: int) -> None:
        self.torque_Nm, self.braking, self.at_ns = torque_Nm, braking, at_ns


class Talk:
    """A simulated arm, zeroed unless told otherwise, and a host that writes frames as text: 'id#data' in hex."""

    def __init__(self, **options: Any) -> None:
        self.plant = StillPlant()
        self.wam = SimulatedWam(self.plant, load_wam_parameters(), **{"zeroed": True, **options})
        self.now_ns = 0

    def say(self, text: str, now_ns: int | None = None) -> list[str]:
        """What the arm answers to a frame; it hears its own answers, as on the wire."""
        self.now_ns = self.now_ns if now_ns is None else now_ns
        identifier, data = text.split("#")
        pending, said = self.wam.receive(Frame(int(identifier, 16), bytes.fromhex(data)), self.now_ns), []
        while pending:
            ready_ns, frame = pending.pop(0)
            said.append(f"{frame.identifier:03X}#{frame.data.hex().upper()}")
            pending += self.wam.receive(frame, ready_ns)
        return said

    def press(self, button: str) -> list[str]:
        """Frames that follow from a button of the pendant."""
        return [
            f"{frame.identifier:03X}#{frame.data.hex().upper()}" for _, frame in self.wam.press(button, self.now_ns)
        ]


@pytest.fixture(scope="session")
def talk() -> type[Talk]:
    """To be called with the options of `SimulatedWam`."""
    return Talk
