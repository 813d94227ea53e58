"""The generated parts of docs/faults.md: each between two marker comments, written by the cases that tests hold to."""

from __future__ import annotations

import sys
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "faults.md"


def written(page: str, begin: str, end: str, table: str) -> str:
    """The page with a table between its markers. ValueError if the page has no place for it."""
    before, _, rest = page.partition(begin)
    _, found, after = rest.partition(end)
    if not found:
        raise ValueError(f"{PAGE} lacks the line {begin} or {end}")
    return f"{before}{begin}\n\n{table}\n\n{end}{after}"


def tell(begin: str, end: str, table: str) -> None:
    """What a cases file does as a program: print its table, or with --write put it into the page."""
    if sys.argv[1:] == ["--write"]:
        PAGE.write_text(written(PAGE.read_text(encoding="utf-8"), begin, end, table), encoding="utf-8")
    else:
        print(table)
