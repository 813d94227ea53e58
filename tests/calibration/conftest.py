"""Grasps and tables that several tests share; built once."""

import pytest

from calibration.build import build_table
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.motion_table import MotionTable
from calibration.objects import load_object


@pytest.fixture(scope="session")
def symmetric_table() -> MotionTable:
    """T42PP, fitted, 40 mm cylinder, symmetric, lifted."""
    return build_table(load_hand("t42pp"), load_object("cylinder40"), GraspSpec(supported=False))


@pytest.fixture(scope="session")
def split_table() -> MotionTable:
    """T42PP, fitted, 40 mm cylinder, 10 % onset split, lifted."""
    return build_table(load_hand("t42pp"), load_object("cylinder40"), GraspSpec(onset_split=0.1, supported=False))


@pytest.fixture(scope="session")
def supported_table() -> MotionTable:
    """T42PP, fitted, 40 mm cylinder, symmetric, standing on its support."""
    return build_table(load_hand("t42pp"), load_object("cylinder40"), GraspSpec())
