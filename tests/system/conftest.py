"""What the system tests share: an installation of their own, with small motion tables built once."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from calibration.build import build_table
from calibration.grasp.specification import GraspSpec
from calibration.objects import load_object
from controller.config import RobotConfig, load_config
from controller.service.assembly import configured_hand
from controller.simulation.demo_cases import OBJECT, GraspCase, demo_cases, table_name
from tests.system.daemon_rig import Installation

if TYPE_CHECKING:
    from tests.system.motor_fault_runs import Robots

pytest.register_assert_rewrite("tests.system.motor_fault_judge")


@pytest.fixture(scope="session")
def symmetric_case() -> GraspCase:
    """The demo's symmetric grasp."""
    return demo_cases(0)[0]


@pytest.fixture(scope="session")
def split_case() -> GraspCase:
    """The demo's grasp with a 10 % onset split: it turns the object."""
    return demo_cases(0)[1]


@pytest.fixture(scope="session")
def config(tmp_path_factory: pytest.TempPathFactory, symmetric_case: GraspCase, split_case: GraspCase) -> RobotConfig:
    """The default installation with the tables of both cases on its shelf, 21 nodes each."""
    directory = tmp_path_factory.mktemp("tables")
    config = load_config(overrides={"tables": {"directory": str(directory)}})
    for case in (symmetric_case, split_case):
        grasp = GraspSpec(onset_split=case.onset_split, compensated=True)
        table = build_table(configured_hand(config), load_object(OBJECT), grasp, nodes=21)
        table.save(directory / f"{table_name(case)}.npz")
    return config


@pytest.fixture
def installation() -> Iterator[Installation]:
    """A place of its own for a daemon; with its end all is ended that was started in it."""
    with tempfile.TemporaryDirectory(prefix="sg-") as directory, closing(Installation(Path(directory))) as place:
        yield place


@pytest.fixture(scope="module")
def robot_in(config: RobotConfig, symmetric_case: GraspCase) -> Robots:
    """Robots for the fault matrix of the tendon motors, in a phase."""
    from tests.system.motor_fault_runs import Robots  # only then: the judge's asserts are to be told in detail

    return Robots(config.tables.directory, symmetric_case)
