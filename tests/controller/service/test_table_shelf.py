"""The shelf of motion tables: what is on it, what is refused, and loads as excursions."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from calibration.build import build_table
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.motion_table import MotionTable
from calibration.objects import load_object
from controller.service.table_shelf import TableShelf, excursion_at_load
from drivers.errors import CommandError

HAND = load_hand("t42pp", preset="fitted")
TABLE = build_table(HAND, load_object("cylinder40"), GraspSpec(onset_split=0.1), nodes=9)


@pytest.fixture
def shelf(tmp_path: Path) -> TableShelf:
    TABLE.save(tmp_path / "mug.npz")
    other = msgspec.structs.replace(TABLE.header, hand={**TABLE.header.hand, "name": "another"})
    MotionTable(other, TABLE.arrays).save(tmp_path / "stranger.npz")
    whole = (tmp_path / "mug.npz").read_bytes()
    (tmp_path / "cut.npz").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "notes.txt").write_text("no table")
    return TableShelf(tmp_path, HAND)


def test_a_table_is_found_by_name_and_by_path(shelf: TableShelf, tmp_path: Path) -> None:
    """The same table either way, and only tables are listed."""
    assert shelf.names() == ["cut", "mug", "stranger"]
    for name in ("mug", str(tmp_path / "mug.npz")):
        assert shelf.open(name).inputs_sha256 == TABLE.inputs_sha256


def test_an_unknown_name_is_answered_with_the_known_ones(shelf: TableShelf, tmp_path: Path) -> None:
    """Who mistypes sees what there is."""
    for name in ("jug", str(tmp_path / "jug.npz"), "../mug"):
        with pytest.raises(CommandError, match="known: cut, mug, stranger") as caught:
            shelf.open(name)
        assert (caught.value.code, caught.value.key) == ("no_table", "table")


@pytest.mark.parametrize(("name", "why"), [("stranger", "another hand"), ("cut", r"cut\.npz")])
def test_a_wrong_table_is_refused(shelf: TableShelf, name: str, why: str) -> None:
    """For another hand, or damaged: it never reaches the cycle, and says what to do."""
    with pytest.raises(CommandError, match=why) as caught:
        shelf.open(name)
    assert caught.value.code == "bad_table"
    assert caught.value.help


def test_the_listing_says_what_is_usable(shelf: TableShelf) -> None:
    """Bad tables are listed with the reason, and do not hide the good ones."""
    cut, mug, stranger = shelf.listing()
    assert (mug["name"], mug["usable"], mug["object"]) == ("mug", True, TABLE.header.object["name"])
    assert mug["grasp"] == TABLE.header.grasp
    for bad in (cut, stranger):
        assert bad["usable"] is False
        assert bad["reason"]
    assert TableShelf(Path("/nonexistent"), HAND).listing() == []


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_a_load_is_found_where_the_table_has_it(share: float) -> None:
    """The squeeze winds to exactly the excursion at which the table's mean load is the one asked for."""
    end_m = TABLE.mean_excursion_end_m(0.0)
    first_N, last_N = (float(TABLE.at_excursion(m, 0.0).tension.mean()) for m in (0.0, end_m))
    load_N = (1 - share) * first_N + share * last_N
    excursion_m = excursion_at_load(TABLE, load_N)
    assert 0.0 <= excursion_m <= end_m
    assert float(TABLE.at_excursion(excursion_m, 0.0).tension.mean()) == pytest.approx(load_N, abs=1e-6)


@pytest.mark.parametrize("load_N", [1.0, 1000.0, float("nan"), float("inf")])
def test_a_load_that_the_table_does_not_reach_is_refused(load_N: float) -> None:
    """Nothing is extrapolated; the answer tells the range."""
    with pytest.raises(CommandError, match="outside this table") as caught:
        excursion_at_load(TABLE, load_N)
    low, high = (float(word) for word in caught.value.accepted.removesuffix(" N").split(" to "))
    assert low == pytest.approx(float(TABLE.at_excursion(0.0, 0.0).tension.mean()), abs=0.1)
    assert np.isfinite(high)
