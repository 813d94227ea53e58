"""The tendon motors' serial line pulled and put back under a daemon that holds an object: its processes, in real time.

Nothing here asserts how long something took; every wait has a generous end. A machine that stalls may give the cycle
good reasons for a fault before the object is held: then it is tried again.
"""

from __future__ import annotations

import tempfile
from contextlib import closing
from pathlib import Path

import pytest

from calibration.motion_table import MotionTable
from controller.client import Client
from controller.config import RobotConfig
from controller.simulation.demo_cases import GraspCase, approach_joints, preposition, table_name
from drivers.errors import CommandError, NoReplyError
from tests.system.daemon_rig import Installation
from tests.system.test_wam_faults_daemon import Operator

pytestmark = pytest.mark.slow
ATTEMPTS = 3
LOAD_N = 40.0
YIELD_M = 2e-4
"""A tripped watchdog holds where the spool is, without the lead that the load needs: it yields until friction helps."""
AT_THE_START = """
[[fault]]
action = { kind = "set_register", motors = [2], name = "shutdown", value = 32 }
"""
WARNED = (
    "tendon motor 2 does not shut down on overheating, electrical shock (Shutdown 32). This is switched on now "
    "(Shutdown 52)."
)


def test_an_unplugged_line_is_told_and_the_hand_taken_up_again(config: RobotConfig, symmetric_case: GraspCase) -> None:
    """While it is gone clients hear of it and the motors hold by themselves; back in, they are where they were. What
    was amiss with a motor at the start, by a script here, is still in the status."""
    interrupted = []
    for _ in range(ATTEMPTS):
        with tempfile.TemporaryDirectory(prefix="sg-") as path, closing(Installation(Path(path))) as installation:
            script = Path(path) / "faults.toml"
            script.write_text(AT_THE_START)
            options = ["--tables", config.tables.directory, "--pendant", "manual", *scene(symmetric_case)]
            options += ["--motor-faults", str(script)]
            daemon = installation.start(*options).wait_ready()
            with closing(daemon.client()) as client:
                operator = Operator(daemon, client)
                operator.make_ready()
                (warning,) = client.status()["warnings"]
                assert (warning["code"], warning["message"]) == ("hand_motor", WARNED)
                try:
                    grip(client, config, symmetric_case)
                except (CommandError, NoReplyError) as error:
                    interrupted.append(f"{error}\n{daemon.messages()}")
                    continue
                unplug_and_replug(operator)
                return
    pytest.fail("no grasp came about in real time: " + "\n".join(interrupted))


def unplug_and_replug(operator: Operator) -> None:
    """Of a hand that holds."""
    held = operator.client.status()["state"]["hand"]
    assert min(held["tension_N"]) > 0.5 * LOAD_N
    operator.type('motors {"action": {"kind": "unplug"}, "for_s": 1.5}')
    lost = operator.wait(lambda state: "bus_lost" in state["hand"]["faults"] and bool(state["grasp"]["fault"]))
    assert lost["grasp"]["fault"] in ("hand_bus_lost", "hand_silent")
    back = operator.wait(lambda state: not state["hand"]["faults"])
    for now_m, held_m in zip(back["hand"]["excursion_m"], held["excursion_m"], strict=True):
        assert abs(now_m - held_m) < YIELD_M
    operator.client.fault_clear()
    cleared = operator.wait(lambda state: not state["grasp"]["fault"])
    assert cleared["grasp"]["phase"] == "holding"


def scene(case: GraspCase) -> list[str]:
    """The case's object and its place, as options."""
    x, y, z = map(str, case.object_xyz_m)
    return ["--object", case.scene.object, "--object-xyz", x, y, z, "--object-yaw", str(case.object_yaw_rad)]


def grip(client: Client, config: RobotConfig, case: GraspCase) -> None:
    """Until the object is held. CommandError, NoReplyError if something came between."""
    table = MotionTable.load(Path(config.tables.directory) / f"{table_name(case)}.npz")
    client.arm_move_joints(approach_joints(config, table, case), speed=1.0).wait()
    preposition(client, case)
    client.grasp_close().wait()
    client.grasp_squeeze(load_N=LOAD_N, duration_s=1.0).wait()
    client.grasp_hold()
