"""The general TOML decoder: what it accepts, and how it explains what it does not."""

import math
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import pytest
from msgspec import Meta

from calibration.toml_files import PositiveOrInfinite, merged, read_toml
from drivers.errors import ConfigurationError


class Inner(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    gains: tuple[Annotated[float, Meta(ge=0, le=10)], Annotated[float, Meta(ge=0, le=10)]]
    mode: Literal["slow", "fast"] = "slow"
    limit: Annotated[float, Meta(gt=0)] | None = None


class Outer(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    inner: Inner
    count: Annotated[int, Meta(ge=1, le=4)]
    names: list[str] = []
    stiffness: PositiveOrInfinite = math.inf


GOOD = "count = 2\nnames = ['a']\n[inner]\ngains = [1, 2.5]\n"


def write(folder: Path, text: str) -> Path:
    path = folder / "file.toml"
    path.write_text(text)
    return path


def test_good_file_is_decoded(tmp_path: Path) -> None:
    """Whole numbers are numbers, defaults fill in, inf is allowed where it is meant."""
    found = read_toml(write(tmp_path, GOOD), Outer)
    assert found == Outer(Inner((1.0, 2.5)), 2, ["a"], math.inf)


@pytest.mark.parametrize(
    ("line", "replacement", "key", "accepted"),
    [
        ("count = 2", "count = 5", "count", "a whole number ≥ 1 and ≤ 4"),
        ("count = 2", "count = true", "count", "a whole number ≥ 1 and ≤ 4"),
        ("count = 2", "", "count", "a whole number ≥ 1 and ≤ 4"),
        ("count = 2", "count = 2\ncuont = 3", "cuont", "no such key, but one of inner, count, names, stiffness"),
        ("[1, 2.5]", "[1, nan]", "inner.gains[1]", "a finite number ≥ 0 and ≤ 10"),
        ("[1, 2.5]", "[1, 11]", "inner.gains[1]", "a finite number ≥ 0 and ≤ 10"),
        ("[1, 2.5]", "[1]", "inner.gains", "an array of 2, each a finite number ≥ 0 and ≤ 10"),
        ("[1, 2.5]", "[1, 2]\nmode = 'x'", "inner.mode", "one of 'fast', 'slow'"),
        ("[1, 2.5]", "[1, 2]\nlimit = inf", "inner.limit", "a finite number > 0"),
        ("[1, 2.5]", "[1, 2]\nlimit = 0", "inner.limit", "a finite number > 0"),
        ("count = 2", "count = 2\nstiffness = -inf", "stiffness", "a finite number > 0 or inf"),
        ("['a']", "['a', 3]", "names[1]", "a text"),
        ("count = 2", "count = ", "(file)", "valid TOML"),
    ],
)
def test_bad_file_names_file_key_and_what_is_accepted(
    tmp_path: Path, line: str, replacement: str, key: str, accepted: str
) -> None:
    """Every kind of mistake says where it is and what would be right."""
    path = write(tmp_path, GOOD.replace(line, replacement))
    with pytest.raises(ConfigurationError) as caught:
        read_toml(path, Outer)
    assert (caught.value.file, caught.value.key, caught.value.accepted) == (str(path), key, accepted)


def test_missing_file_is_a_configuration_error(tmp_path: Path) -> None:
    """A wrong path is explained like any other mistake."""
    with pytest.raises(ConfigurationError, match=r"nowhere\.toml"):
        read_toml(tmp_path / "nowhere.toml", Outer)


def test_merging_replaces_a_table_of_another_kind() -> None:
    """Overriding a pin by a flexure must not leave the pin's keys behind."""
    base = {"joint": {"kind": "pin", "k": 1}, "tip": {"r": 1, "s": 2}}
    over = {"joint": {"kind": "flexure", "EI": 2}, "tip": {"r": 3}}
    assert merged(base, over) == {"joint": {"kind": "flexure", "EI": 2}, "tip": {"r": 3, "s": 2}}
