"""A front with its tables, for those who play client and cycle."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from calibration.motion_table import MotionTable
from tests.controller.service.front_office import TABLE, Office


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("tables")
    TABLE.save(directory / "mug.npz")
    header = msgspec.structs.replace(TABLE.header, hand={**TABLE.header.hand, "name": "another"})
    MotionTable(header, TABLE.arrays).save(directory / "stranger.npz")
    return directory


@pytest.fixture
def office(tables: Path) -> Office:
    office = Office(tables)
    office.beat()
    return office
