"""The installation file: what the default one says, and that every wrong entry is named."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calibration.hand.parameters import load_hand
from controller.config import load_config
from controller.pose import Pose
from drivers.errors import ConfigurationError


def refusal(directory: Path, text: str) -> ConfigurationError:
    file = directory / "robot.toml"
    file.write_text(text)
    with pytest.raises(ConfigurationError) as caught:
        load_config(file)
    assert caught.value.file == str(file)
    return caught.value


def test_the_default_installation_is_complete_and_its_hand_exists() -> None:
    """`load_config()` needs no file of the user's, and points to things that are there."""
    config = load_config()
    hand = load_hand(config.hand.source, preset=config.hand.preset)
    assert hand.name == "T42PP"
    assert config.cycle.period_s == 0.002
    assert config.compensation.index == "auto"
    assert "{" not in config.front.command_endpoint + config.tables.directory + config.arm.channel


def test_the_default_mount_points_the_palm_out_of_the_flange() -> None:
    """Hand y (out of the palm) is tool z, hand z is −tool x, hand x is −tool y; 80 mm along tool z."""
    T_wrist_hand = load_config().T_wrist_hand
    x_hand, y_hand, z_hand = T_wrist_hand[:3, :3].T
    np.testing.assert_allclose(y_hand, [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(z_hand, [-1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(x_hand, [0, -1, 0], atol=1e-15)
    np.testing.assert_allclose(T_wrist_hand[:3, 3], [0, 0, 0.08])


@given(
    st.tuples(*[st.floats(-1, 1)] * 4),
    st.tuples(*[st.floats(-2, 2)] * 3),
)
def test_a_pose_is_the_matrix_that_scipy_makes(quaternion: tuple[float, ...], xyz: tuple[float, ...]) -> None:
    """The component order w, x, y, z is kept from file to matrix."""
    length = math.hypot(*quaternion)
    assume(length > 1e-3)
    w, x, y, z = (component / length for component in quaternion)
    matrix = Pose((xyz[0], xyz[1], xyz[2]), (w, x, y, z)).matrix()
    np.testing.assert_allclose(matrix[:3, :3], Rotation.from_quat([x, y, z, w]).as_matrix(), atol=1e-12)
    np.testing.assert_array_equal(matrix[:3, 3], xyz)


def test_a_file_holds_only_what_differs(tmp_path: Path) -> None:
    """Keys that a user's file leaves out keep their default; overrides of the command line come last."""
    file = tmp_path / "robot.toml"
    file.write_text("[tendons.left]\nid = 7\n[cycle]\npriority = 0\ncpu = 1\n")
    config = load_config(file, {"cycle": {"priority": 60}})
    assert (config.tendons.left.id, config.tendons.left.spool_radius_m) == (7, 0.0105)
    assert (config.cycle.priority, config.cycle.cpu) == (60, 1)
    assert config.tendons.right == load_config().tendons.right


def test_directories_follow_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    """Under systemd sockets and data go where the unit says."""
    monkeypatch.setenv("RUNTIME_DIRECTORY", "/run/stillgrasp")
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/stillgrasp")
    config = load_config()
    assert config.front.command_endpoint == "ipc:///run/stillgrasp/command"
    assert config.tables.directory == "/var/lib/stillgrasp/tables"


@pytest.mark.parametrize(
    ("text", "key", "value", "accepted"),
    [
        ("[cycle]\nperiod_s = 0.5", "cycle.period_s", 0.5, "≤ 0.02"),
        ("[cycle]\nperiod_ms = 2", "cycle.period_ms", 2, "period_s"),
        ("[cycle]\nperiod_s = true", "cycle.period_s", True, "a finite number"),
        ("[squeeze]\nload_cap_N = nan", "squeeze.load_cap_N", None, "a finite number > 0"),
        ("[squeeze]\nload_cap_N = inf", "squeeze.load_cap_N", math.inf, "a finite number > 0"),
        ("[arm.limits]\nvelocity_rad_s = [1, 1, 1]", "arm.limits.velocity_rad_s", [1, 1, 1], "an array of 7"),
        ("[arm.gains]\nkp_Nm_per_rad = [1, 1, 1, 1, 1, 1, nan]", "arm.gains.kp_Nm_per_rad[6]", None, "a finite number"),
        ("[arm.limits]\nlower_rad = [0, 0, 0, 0, 0, 0, 0]", "arm.limits.upper_rad", "(missing)", "both limits"),
        ("[arm.limits]\ntorque_Nm = [60, 60, 45, 28, 10, 10, 0]", "arm.limits.torque_Nm[6]", 0, "> 0"),
        ("[arm.friction]\nturnover_rad = 0", "arm.friction.turnover_rad", 0, "> 0"),
        ("[arm.base]\nquaternion_wxyz = [1, 1, 0, 0]", "arm.base.quaternion_wxyz", [1, 1, 0, 0], "of length 1"),
        ("[arm]\ninterface = 'pcan'", "arm.interface", "pcan", "'socketcan'"),
        ("[tendons.left]\nid = 1", "tendons.left.id", 1, "another id"),
        ("[tendons.right]\ntightening_sign = 0", "tendons.right.tightening_sign", 0, "one of -1, 1"),
        ("[compensation]\nindex = 'torque'", "compensation.index", "torque", "'excursion'"),
        ("[front]\ncommand_endpoint = 'tcp://0.0.0.0:9'", "front.command_endpoint", "tcp://0.0.0.0:9", "ipc://"),
        ("[front]\nstate_endpoint = 'tcp://*:9872'", "front.state_endpoint", "tcp://*:9872", "tcp://127.0.0.1"),
        ("arm = 3", "arm", 3, "a table with the keys interface"),
        ("[wrist]\nx = 1", "wrist", {"x": 1}, "no such key"),
    ],
)
def test_a_wrong_entry_names_file_key_value_and_what_is_accepted(
    tmp_path: Path, text: str, key: str, value: object, accepted: str
) -> None:
    """Whoever mistypes a value learns from the message alone what to write."""
    error = refusal(tmp_path, text)
    assert error.key == key
    assert error.value == value or value is None
    assert accepted in error.accepted
    assert key in error.message
    assert accepted in error.message


def test_crossed_limits_name_the_joint(tmp_path: Path) -> None:
    """A rule between two keys is told like a range."""
    error = refusal(
        tmp_path, "[arm.limits]\nlower_rad = [-1, -1, -1, 2, -1, -1, -1]\nupper_rad = [1, 1, 1, 1, 1, 1, 1]"
    )
    assert error.key == "arm.limits.lower_rad[3]"
    assert error.value == 2


def test_unreadable_files_are_refused(tmp_path: Path) -> None:
    """A missing file, broken TOML and bytes that are not text each give a clear error."""
    assert "valid TOML" in refusal(tmp_path, "[arm\n").message
    (tmp_path / "noise.toml").write_bytes(bytes(range(256)))
    for name in ("noise.toml", "absent.toml", "."):
        with pytest.raises(ConfigurationError):
            load_config(tmp_path / name)
