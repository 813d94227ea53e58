"""The motion tables of one installation: found by name or path, checked against the hand, read once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from calibration.hand.parameters import Hand
from calibration.motion_table import MotionTable
from drivers.errors import CommandError, TableError

SUFFIX = ".npz"


class TableShelf:
    """Tables in one directory; a path outside it may be named too."""

    def __init__(self, directory: Path, hand: Hand) -> None:
        self._directory = directory
        self._hand = hand

    def names(self) -> list[str]:
        """Names of the tables in the directory, sorted."""
        return sorted(path.stem for path in self._directory.glob("*" + SUFFIX))

    def listing(self) -> list[dict[str, Any]]:
        """Each table with what it is for, or why it cannot be used."""
        return [self._line(name) for name in self.names()]

    def open(self, name: str) -> MotionTable:
        """The table `name` (of the directory, or a path). Raises CommandError no_table or bad_table."""
        path = Path(name)
        if path.suffix != SUFFIX:
            path = self._directory / (name + SUFFIX)
        if not path.is_file():
            known = ", ".join(self.names()) or f"none in {self._directory}"
            raise CommandError("no_table", f"There is no motion table {name!r}; known: {known}.", key="table")
        try:
            table = MotionTable.load(path)
            table.refuse_unless(hand=self._hand)
        except TableError as error:
            raise CommandError("bad_table", error.message, key="table", help=error.help) from error
        return table

    def _line(self, name: str) -> dict[str, Any]:
        try:
            header = self.open(name).header
        except CommandError as error:
            return {"name": name, "usable": False, "reason": error.message}
        return {"name": name, "usable": True, "object": header.object["name"], "grasp": header.grasp}


def excursion_at_load(table: MotionTable, load_N: float) -> float:
    """Mean excursion since contact, m, at which equal winding has the mean load `load_N`.

    Raises CommandError outside_table where the table does not reach that load.
    """
    low_m, high_m = 0.0, table.mean_excursion_end_m(0.0)

    def load_at(mean_m: float) -> float:
        return float(table.at_excursion(mean_m, 0.0).tension.mean())

    first_N, last_N = load_at(low_m), load_at(high_m)
    if not first_N <= load_N <= last_N:
        raise CommandError(
            "outside_table",
            f"load_N = {load_N:g} is outside this table.",
            key="load_N",
            accepted=f"{first_N:.1f} to {last_N:.1f} N",
            help="Nothing is extrapolated.",
        )
    for _ in range(50):
        middle_m = 0.5 * (low_m + high_m)
        low_m, high_m = (middle_m, high_m) if load_at(middle_m) < load_N else (low_m, middle_m)
    return 0.5 * (low_m + high_m)
