"""Starting motors on a line that loses or damages an answer now and then: nobody is refused for it."""

from __future__ import annotations

import pytest

from drivers.clock import VirtualClock
from drivers.dynamixel.control_tables import MX_28, XM430_W350, MotorModel
from drivers.dynamixel.port import WaitingPort
from drivers.dynamixel.settings import MotorSettings
from drivers.dynamixel.tendons import TendonPair
from drivers.errors import NoReplyError
from drivers.simulated.dynamixel import SimulatedMotors, SimulatedMotorSettings
from drivers.simulated.faults import Fault, FaultScript
from drivers.simulated.serial_fault_actions import Corrupt, Drop, SerialAction, Silence
from drivers.simulated.serial_lines import MemoryLine
from drivers.simulated.spring_tendons import SpringTendons


class Rig:
    def __init__(self, model: MotorModel, *faults: Fault[SerialAction], seed: int = 0) -> None:
        clock = VirtualClock()
        settings = SimulatedMotorSettings(1, 500, 1, model), SimulatedMotorSettings(2, 500, 1, model)
        self.motors = SimulatedMotors(SpringTendons(), settings, faults=FaultScript(seed=seed, faults=faults))
        line = MemoryLine(self.motors, clock)
        wanted = MotorSettings(1, 1, 500, model=model.name), MotorSettings(2, 1, 500, model=model.name)
        self.pair = TendonPair(WaitingPort(line, clock), clock, wanted)

    def pulling(self) -> list[int]:
        return [motor.value("torque_enable") for motor in self.motors.motors]


@pytest.mark.parametrize("model", [XM430_W350, MX_28])
@pytest.mark.parametrize(("action", "stride"), [(Drop(), 2), (Corrupt(), 5)])
def test_any_one_bad_answer_is_asked_for_again(model: MotorModel, action: SerialAction, stride: int) -> None:
    """Whichever answer of a start-up is bad, both motors come up, and what is read is what a sound start-up reads."""
    sound = Rig(model)
    sound.pair.start()
    expected = sound.pair.exchange().excursion_m
    struck = 1
    for number in range(1, 200, stride):
        rig = Rig(model, Fault(action=action, at_frame=number))
        rig.pair.start()
        assert rig.pulling() == [1, 1], number
        assert rig.pair.exchange().excursion_m == expected
        struck = rig.motors.faults.struck
        if not struck:
            break
    assert not struck, "the last answer was not reached"
    assert number > 40


@pytest.mark.parametrize("seed", range(5))
def test_one_in_twenty_bad_answers_is_no_reason_to_refuse(seed: int) -> None:
    """A poor cable: found out by the read rate, not by a daemon that does not start."""
    rig = Rig(XM430_W350, Fault(action=Corrupt(), for_s=10.0, chance=0.05), seed=seed)
    rig.pair.start()
    assert rig.pulling() == [1, 1]


def test_a_motor_that_falls_silent_in_the_middle_is_refused() -> None:
    """Asking again has an end, and the other motor was not touched yet."""
    rig = Rig(XM430_W350, Fault(action=Silence(motors=(2,)), at_s=0.01))
    with pytest.raises(NoReplyError, match="tendon motor 2"):
        rig.pair.start()
    assert rig.pulling() == [0, 0]
