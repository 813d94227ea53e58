"""Recovery of the arm while everything else lives, on virtual time: faults cleared, buses opened again, pucks woken.

What the pucks did is read from the simulated pucks, what the operator hears from a client's events.
"""

from __future__ import annotations

from typing import Any

import pytest

from controller.client import Client
from controller.config import RobotConfig
from controller.messages import Reason
from controller.simulation.scene import Scene
from controller.simulation.virtual_robot import VirtualRobot
from drivers.errors import CommandError
from drivers.simulated.arm_faults import BrownOut, SetProperty, Silence, Supply
from drivers.simulated.can_fault_actions import BusOff, QueueFull, Unplug
from drivers.simulated.faults import Fault, FaultScript
from drivers.wam.arm import ArmSample
from drivers.wam.parameters import load_wam_parameters

HOME = tuple(load_wam_parameters().home_rad.tolist())


class Lab:
    """A robot whose arm stands in its home pose, active, and a client."""

    def __init__(self, config: RobotConfig) -> None:
        self.robot = VirtualRobot(config, Scene(joint_rad=HOME), faults=FaultScript())
        self.robot.run_for(0.3)
        self.robot.press("activate")
        self.robot.run_for(0.2)
        self.client: Client = self.robot.client()
        self.client.hello()

    @property
    def wam(self) -> Any:
        return self.robot.devices.wam

    def has(self, action: Any, for_s: float | None = None) -> None:
        """Have a fault now."""
        self.robot.add_fault(Fault(action=action, for_s=for_s))

    def state(self) -> tuple[str, str]:
        self.robot.run_for(0.02)
        state = self.client.status()["state"]
        return state["arm"]["state"], state["grasp"]["fault"]

    def faults(self) -> list[str]:
        """Codes of the faults that were told, in order."""
        self.client.status()
        return [str(event.fields["code"]) for event in self.client.events if event.event == "fault"]

    def activate(self) -> None:
        self.robot.press("activate")
        self.robot.run_for(0.2)


@pytest.fixture
def lab(config: RobotConfig) -> Lab:
    return Lab(config)


def test_after_estop_the_arm_is_woken_and_zeroed_again(lab: Lab) -> None:
    """Protects the day's work: E-stop costs the positions, not the daemon; torque waits for the operator."""
    assert lab.state() == ("active", "")
    lab.robot.press("estop")
    lab.robot.run_for(0.1)
    assert lab.state() == ("estop", "estop")
    with pytest.raises(CommandError) as refused:
        lab.client.fault_clear()
    assert refused.value.code == "estop"
    lab.robot.press("release")
    lab.robot.press("idle")
    lab.robot.run_for(0.2)
    records = lab.robot.cycle.number
    lab.client.fault_clear()
    assert lab.robot.cycle.number - records > 400  # waking takes over a second, and no period of it is lost
    assert lab.client.status()["cycle_lost"] == ""
    assert lab.state() == ("idle", "")
    assert lab.faults() == ["estop"]
    assert lab.wam.mode == 1
    lab.activate()
    # Nobody held the arm's weight: it has sunk, and is not where it was taken to be. That too would be noticed.
    assert lab.state()[0] == "active"


@pytest.mark.parametrize(("action", "code"), [(Unplug(), "can_adapter_gone"), (BusOff(refuse=True), "can_queue_full")])
def test_a_lost_bus_is_opened_again(lab: Lab, action: Any, code: str) -> None:
    """Protects against a restart for a plug: the fault claims no stop; the arm is started over a bus opened anew."""
    lab.has(action, for_s=0.5)
    lab.robot.run_for(0.1)
    assert lab.state()[1] == code
    told = next(event for event in lab.client.events if event.event == "fault")
    assert "Nothing can be commanded" in told.fields["message"]
    with pytest.raises(CommandError) as refused:
        lab.client.fault_clear()
    assert refused.value.code == "arm_not_ready"
    lab.robot.run_for(0.6)
    assert lab.wam.mode == 1  # the safety puck's heartbeat
    lab.client.fault_clear()
    assert lab.state() == ("idle", "")
    lab.robot.press("idle")
    lab.activate()
    assert lab.state() == ("active", "")
    assert lab.client.arm_move_joints([0.05, -2.0, 0.0, 3.0, 0.0, 0.0, 0.0]).wait()


@pytest.mark.parametrize(
    ("action", "code"),
    [
        (SetProperty(node=10, name="TL2", value=1), "arm_torque"),
        (SetProperty(node=10, name="VL2", value=1), "arm_velocity"),
        (Supply(volts=20.0), "arm_voltage"),
    ],
)
def test_a_safety_fault_is_named_and_needs_no_start(lab: Lab, action: Any, code: str) -> None:
    """Protects the operator: the pendant's light names the cause, and positions are kept: Idle, clear, Activate."""
    lab.has(action)
    if code == "arm_velocity":
        lab.client.arm_move_joints([0.3, -1.8, 0.0, 3.0, 0.0, 0.0, 0.0])
    lab.robot.run_for(0.4)
    assert lab.state() == ("idle", code)
    repaired = {"arm_torque": ("TL2", 8100), "arm_velocity": ("VL2", 6144), "arm_voltage": ("VNOM", 48)}[code]
    if code == "arm_voltage":
        lab.has(Supply(volts=48.0))
    else:
        lab.has(SetProperty(node=10, name=repaired[0], value=repaired[1]))
    lab.robot.run_for(0.1)
    lab.robot.press("idle")
    started = lab.robot.cycle.number
    lab.client.fault_clear()
    assert lab.robot.cycle.number - started < 50
    lab.activate()
    assert lab.state() == ("active", "")
    assert lab.faults() == [code]


def test_a_brown_out_is_told_from_silence(lab: Lab) -> None:
    """Protects the operator: a reset puck, found while others answer, is named; started again it needs home."""
    lab.has(BrownOut(nodes=(3, 5), down_s=0.0))
    lab.robot.run_for(0.1)
    assert lab.state() == ("idle", "puck_reset")
    told = [event.fields for event in lab.client.events if event.event == "fault"]
    assert told[-1]["reset_nodes"] in (3.0, 5.0, 35.0)
    with pytest.raises(CommandError) as refused:
        lab.client.fault_clear()  # it has sunk, and what the other pucks know says that it is not at home
    assert refused.value.code == "arm_not_ready"
    lab.has(BrownOut(down_s=0.0))
    lab.robot.run_for(0.05)
    lab.client.fault_clear()
    assert lab.state() == ("idle", "")


def test_silent_pucks_are_named_and_recover_without_a_start(lab: Lab) -> None:
    """Protects against a needless zeroing: an arm that answers again is as it was."""
    lab.has(Silence(nodes=(2, 6)), for_s=0.05)
    lab.robot.run_for(0.2)
    assert lab.state() == ("idle", "arm_silent")
    told = [event.fields for event in lab.client.events if event.event == "fault"]
    assert told[0]["silent_nodes"] == 26.0
    lab.client.fault_clear()
    lab.activate()
    assert lab.state() == ("active", "")


def test_a_reply_lost_just_when_a_fault_is_cleared_starts_no_arm(lab: Lab) -> None:
    """Protects the operator from a refused `fault.clear`: one reading that is not whole is not a silent arm."""
    lab.has(Silence(nodes=(2, 6)), for_s=0.05)
    lab.robot.run_for(0.2)
    assert lab.state() == ("idle", "arm_silent")
    supervision = lab.robot.cycle._supervision
    recover, found = supervision.recover, []

    def watched(sample: ArmSample | None) -> Reason:
        found.append(sample.incomplete_cycles if sample is not None else None)
        return recover(sample)

    supervision.recover = watched  # type: ignore[method-assign]
    for n in range(8):  # four cycles in five; only five in a row are a silent arm
        lab.robot.add_fault(Fault(action=Silence(nodes=(4,)), at_s=0.003 + 0.01 * n, for_s=0.0085))
    began = lab.robot.cycle.number
    lab.client.fault_clear()
    assert 0 < (found[0] or 0) < 5
    assert lab.robot.cycle.number - began < 20
    assert lab.state() == ("idle", "")


def test_a_queue_that_was_full_resumes_with_fresh_torques(lab: Lab) -> None:
    """Protects against old torques: what was refused is gone; the arm is held where it is found, or goes idle."""
    lab.has(QueueFull(), for_s=0.03)
    lab.robot.run_for(0.1)
    assert lab.state() == ("active", "can_queue_full")
    before = lab.wam.heard["torque"]
    lab.robot.run_for(0.02)
    assert lab.wam.heard["torque"] - before == 20
