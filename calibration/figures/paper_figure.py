"""One counterpart of a figure of the paper: the picture, what it shows, and what of it is predicted, fitted, assumed.

Files beside one another: the picture (.png), the caption (.md), the numbers (.json, SI).
"""

from __future__ import annotations

import json
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from drivers.errors import InputError

NO_CURVES = "The paper's measured curves are not available as data: none is drawn; what it prints is quoted as text."


@dataclass(frozen=True)
class PaperFigure:
    """Figure `number` of the paper, from the models; `values` are the numbers in it, SI, keys with units."""

    number: int
    title: str
    shows: str
    predicted: str
    fitted: str
    values: Mapping[str, Any]
    picture: Figure

    @property
    def name(self) -> str:
        """Of its files, without the ending."""
        return f"figure-{self.number:02d}"

    @property
    def caption(self) -> str:
        """All that belongs below the picture, one paragraph."""
        return (
            f"Fig. {self.number}, {self.title}. {self.shows} Predicted: {self.predicted} Fitted or assumed: "
            f"{self.fitted} {NO_CURVES}"
        )

    def save(self, directory: str | Path) -> list[Path]:
        """Write picture, caption and numbers; their paths. Errors: InputError when the folder cannot be written."""
        folder = Path(directory)
        files = [folder / f"{self.name}{ending}" for ending in (".png", ".md", ".json")]
        content = {
            "figure": self.number,
            "title": self.title,
            "shows": self.shows,
            "predicted": self.predicted,
            "fitted": self.fitted,
            "values": dict(self.values),
        }
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self.picture.savefig(files[0])
            text = textwrap.fill(self.caption, 120)
            files[1].write_text(f"![{self.title}]({files[0].name})\n\n{text}\n", encoding="utf-8")
            files[2].write_text(json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n", "utf-8")
        except OSError as error:
            raise InputError(
                f"{error.filename or folder}: the figure cannot be written: {error.strerror}.",
                help="Give a folder that can be written.",
            ) from error
        return files
