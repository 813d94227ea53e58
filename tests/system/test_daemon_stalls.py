"""The daemon as its processes on a machine that keeps them waiting: a laptop that is busy is no fault of a robot.

Processes are stopped and go on, as a scheduler would have it. Real time, so nothing here asserts how long something
took; every wait has a generous end.
"""

from __future__ import annotations

import signal
import time

import numpy as np

from tests.system.daemon_rig import Installation, ThirdClient, active

TARGET_RAD = [-0.8, 0.15, 0.05, 2.25, 0.05, -0.75, 0.05]
STALL_S = 0.1


def test_a_moving_arm_bears_stalls_of_its_processes(installation: Installation) -> None:
    """The arm does not fall while its cycle waits, and is not too far behind when its world did."""
    daemon = active(installation.start().wait_ready())
    with daemon.client() as client:
        client.hello()
        motion = client.arm_move_joints(TARGET_RAD, speed=1.0)
        for role in ("cycle", "world", "hand") * 4:
            daemon.send_signal(role, signal.SIGSTOP)
            time.sleep(STALL_S)
            daemon.send_signal(role, signal.SIGCONT)
            time.sleep(STALL_S)
        motion.wait()
        assert [event.fields for event in client.events if event.event == "fault"] == []
    third = ThirdClient(daemon)
    with third.bus:
        assert np.allclose(third.joint_rad(), TARGET_RAD, atol=0.03)
