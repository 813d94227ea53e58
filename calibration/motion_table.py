"""The motion table: where a squeezed object goes in the hand, looked up by tendon excursion or by tendon load.

Native index: mean and difference (right − left) of the finger-side tendon excursions since first contact, m. Second
index: mean tendon load, N, and the same difference. Poses are of the object in the hand frame, 6-D: position, m, and
rotation vector, rad; motion is since first contact (negative y: towards the palm). Planar hands fill x, y and the
rotation about z. Tendon and finger order: right, left. A supported object drags: then loads jump at first contact, and
the load index begins above the contact's own load. Source: design 4.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import Hand
from calibration.objects import GraspObject
from calibration.table_file import REBUILD, Arrays, read_file, read_memory, write_file, write_memory
from calibration.table_grid import GridNodes, Place, Reals, TableGrid, cell_coefficients
from drivers.errors import InputError, TableError

FORMAT_VERSION = 2
POSE = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")
GRIDS = {
    "excursion": ("mean_excursion_m", "excursion_difference_m"),
    "load": ("mean_load_N", "excursion_difference_m"),
}
NODE_FIELDS = ("value", "along_0", "along_1", "mixed")


class Status(enum.Enum):
    """What a sample is worth."""

    INSIDE = "inside"
    BEFORE_CONTACT = "before_contact"
    """The fingers do not press yet: contact pose, no motion, zero Jacobian."""
    OUTSIDE = "outside"
    """Not in the domain: the values are those at its nearest edge and the Jacobian is zero. Do not use them to move."""
    FROZEN = "frozen"
    """All closing joints are at their stops: the pose stands still (with flexures it creeps) while the load rises."""
    INVALID = "invalid"
    """No equilibrium was found near here: contact pose, zero Jacobian. Do not use it to move."""


class ContactData(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """State at first contact: what the cycle compares the motors with."""

    excursion_m: list[float]
    """finger-side, zero at rest"""
    tension_N: list[float]
    pose: list[float]
    free_closing_stiffness_N_per_m: list[float]


class TableHeader(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a table is for and how it was made."""

    format_version: int
    package_version: str
    inputs_sha256: str
    hand: dict[str, Any]
    object: dict[str, Any]
    grasp: dict[str, Any]
    settings: dict[str, float]
    solver: dict[str, float]
    axes: dict[str, list[str]]
    tendons: list[str]
    channels: list[str]
    contact: ContactData
    column_end: list[str]
    """per difference, what ends the domain"""


@dataclass(frozen=True, slots=True)
class TableSample:
    """One look-up. `rows` (1 + index axes, channels): values, then slopes along each index axis."""

    status: Status
    rows: Reals
    contact_pose: Reals
    tendons: int

    @property
    def motion(self) -> Reals:
        """(6,) object motion since first contact, hand frame: m and rad (rotation vector)."""
        return self.rows[0, :6]

    @property
    def object_pose(self) -> Reals:
        """(6,) object pose in the hand frame: m and rad; the object's axes are the hand's at first contact."""
        pose: Reals = self.contact_pose + self.rows[0, :6]
        return pose

    @property
    def jacobian(self) -> Reals:
        """(6, index axes) change of pose per change of index, per m or N as the axes say."""
        return self.rows[1:, :6].T

    @property
    def tension(self) -> Reals:
        """(m,) tendon loads at the fingers, N. Before contact: those of first contact."""
        return self.rows[0, 6 : 6 + self.tendons]

    @property
    def contact_force(self) -> Reals:
        """(m,) normal force of each finger on the object, N."""
        return self.rows[0, 6 + self.tendons : 6 + 2 * self.tendons]

    @property
    def contact_tangential(self) -> Reals:
        """(m,) tangential force of each finger on the object, N, along i × its normal."""
        return self.rows[0, 6 + 2 * self.tendons : 6 + 3 * self.tendons]

    @property
    def required_friction(self) -> float:
        """Least friction coefficient at the fingertips that keeps them from slipping; 0 without contact force."""
        pairs = zip(self.contact_force.tolist(), self.contact_tangential.tolist(), strict=True)
        return max((abs(along) / normal for normal, along in pairs if normal > 1e-9), default=0.0)

    @property
    def planar_motion(self) -> tuple[float, float, float]:
        """(x m, y m, θ rad) since first contact, hand frame."""
        row = self.rows[0]
        return float(row[0]), float(row[1]), float(row[5])


def rates(sample: TableSample, index_rate: Sequence[float] | Reals) -> Reals:
    """(6,) object velocity in the hand, m/s and rad/s, for index rates (index axes,) per second."""
    velocity: Reals = sample.jacobian @ np.asarray(index_rate, dtype=float)
    return velocity


class MotionTable:
    """A table ready for look-up; from `build_table`, `load` or `from_memfd`. Look-up is not for several threads at
    once."""

    def __init__(self, header: TableHeader, arrays: Arrays, source: str | Path = "(built table)") -> None:
        _check(header, arrays, source)
        self.header = header
        self.arrays = arrays
        self.source = str(source)
        self._tendons = len(header.tendons)
        self._excursion, self._load = self._grid("excursion"), self._grid("load")
        contact = header.contact
        self.contact_excursion_m = np.array(contact.excursion_m)
        self.contact_tension_N = np.array(contact.tension_N)
        self.contact_pose = np.array(contact.pose)
        self.free_closing_stiffness_N_per_m = np.array(contact.free_closing_stiffness_N_per_m)
        rows = np.zeros((3, len(header.channels)))
        rows[0, 6 : 6 + self._tendons] = contact.tension_N
        rows.setflags(write=False)
        self._contact_rows = rows

    # -- look-up -----------------------------------------------------------------------------------------------------

    def at(self, index: Sequence[float] | Reals) -> TableSample:
        """Look up by native index (mean_excursion_m, excursion_difference_m). Wrong length, not finite: InputError."""
        if len(index) != 2:
            raise InputError(f"a look-up by {len(index)} indices; this table has 2: {', '.join(GRIDS['excursion'])}.")
        return self.at_excursion(float(index[0]), float(index[1]))

    def at_excursion(self, mean_m: float, difference_m: float) -> TableSample:
        """Look up by mean finger-side excursion since first contact and difference right − left, m."""
        grid = self._excursion
        rows = grid.inside(mean_m, difference_m)
        if rows is not None:
            return TableSample(Status.INSIDE, rows, self.contact_pose, self._tendons)
        place, near_0, near_1 = grid.place(mean_m, difference_m)
        if place is Place.BEYOND_END and self._frozen(near_1) is not None:
            return self._edge(Status.FROZEN, grid, near_0, near_1)
        return self._beside(grid, place, near_0, near_1)

    def at_load(self, mean_N: float, difference_m: float) -> TableSample:
        """Look up by mean tendon load, N, and excursion difference right − left, m. Beyond `load_range` the load no
        longer tells the pose, until all stops are met: then contact forces rise with the load, and the pose is frozen;
        with flexures it creeps on, as far as that is linear in the load."""
        grid = self._load
        rows = grid.inside(mean_N, difference_m)
        if rows is not None:
            return TableSample(Status.INSIDE, rows, self.contact_pose, self._tendons)
        place, near_0, near_1 = grid.place(mean_N, difference_m)
        column = self._frozen(near_1) if place is Place.BEYOND_END else None
        if column is not None and self.arrays["frozen.load_N"][column] <= mean_N <= self.arrays["frozen.end_N"][column]:
            sample = self._edge(Status.FROZEN, self._excursion, self._excursion.end_at(near_1), near_1)
            slope = self.arrays["frozen.slope_per_N"][column]
            if sample.status is Status.FROZEN:
                sample.rows[0] += slope * (mean_N - float(sample.tension.mean()))
                sample.rows[1] = slope
            return sample
        return self._beside(grid, place, near_0, near_1)

    # -- what is in it -----------------------------------------------------------------------------------------------

    @property
    def inputs_sha256(self) -> str:
        """SHA-256 of hand, object, grasp, settings and versions."""
        return self.header.inputs_sha256

    @property
    def excursion_range(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Mean excursion and difference, m: smallest and largest of each. See `mean_excursion_end_m` for the curve."""
        grid = self._excursion
        return grid.range_0, grid.range_1

    @property
    def load_range(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Mean load, N, and difference, m: smallest and largest of each. See `mean_load_end_N` for the curve."""
        grid = self._load
        return grid.range_0, grid.range_1

    def mean_excursion_end_m(self, difference_m: float) -> float:
        """Mean excursion since first contact at which the domain ends for an excursion difference, m."""
        return self._excursion.end_at(difference_m)

    def mean_load_end_N(self, difference_m: float) -> float:
        """Mean load up to which the load tells the pose for an excursion difference, N."""
        return self._load.end_at(difference_m)

    def refuse_unless(
        self, *, hand: Hand | None = None, object: GraspObject | None = None, grasp: GraspSpec | None = None
    ) -> None:
        """Nothing if the table was built for these; else TableError that names the first difference."""
        for what, given, own in (
            ("hand", hand, self.header.hand),
            ("object", object, self.header.object),
            ("grasp", grasp, self.header.grasp),
        ):
            if given is not None and (difference := first_difference(own, described(given))):
                key, there, here = difference
                raise TableError(
                    self.source,
                    f"is for another {what}: {what}.{key} is {there!r} there and {here!r} here.",
                    help=REBUILD,
                )

    # -- files -------------------------------------------------------------------------------------------------------

    def save(self, path: str | Path) -> None:
        """Write the table file atomically. Errors: TableError."""
        stored = {name: array for name, array in self.arrays.items() if not name.endswith(".coefficients")}
        write_file(path, msgspec.to_builtins(self.header), stored)

    @classmethod
    def load(cls, path: str | Path) -> MotionTable:
        """Read a table file; damaged, altered or of another format: TableError."""
        header, arrays = read_file(path)
        return cls(_header(header, path), arrays, path)

    def to_memfd(self) -> int:
        """Descriptor of a sealed memory file with all of the table, coefficients included; the caller closes it."""
        grids = {"excursion": self._excursion, "load": self._load}
        coefficients = {f"{name}.coefficients": grid.coefficients for name, grid in grids.items()}
        return write_memory(msgspec.to_builtins(self.header), self.arrays | coefficients)

    @classmethod
    def from_memfd(cls, descriptor: int) -> MotionTable:
        """Map a table handed over by `to_memfd`, read-only. The descriptor may be closed afterwards. Errors:
        TableError."""
        header, arrays = read_memory(descriptor)
        source = f"memory file {descriptor}"
        return cls(_header(header, source), arrays, source)

    # -- inside ------------------------------------------------------------------------------------------------------

    def _grid(self, name: str) -> TableGrid:
        get = self.arrays
        axis_0, axis_1 = get[f"{name}.axis_0"], get[f"{name}.axis_1"]
        step = float(axis_0[1] - axis_0[0]), float(axis_1[1] - axis_1[0])
        coefficients = get.get(f"{name}.coefficients")
        if coefficients is None:
            coefficients = cell_coefficients(GridNodes(*(get[f"{name}.{item}"] for item in NODE_FIELDS)), *step)
        origin = float(axis_0[0]), float(axis_1[0])
        return TableGrid(origin, step, coefficients, get[f"{name}.start"], get[f"{name}.end"])

    def _sample(self, status: Status, rows: Reals) -> TableSample:
        return TableSample(status, rows, self.contact_pose, self._tendons)

    def _beside(self, grid: TableGrid, place: Place, near_0: float, near_1: float) -> TableSample:
        if place is Place.BEFORE_START:
            return self._sample(Status.BEFORE_CONTACT, self._contact_rows)
        return self._edge(Status.OUTSIDE, grid, near_0, near_1) if place is not Place.HOLE else self._invalid()

    def _edge(self, status: Status, grid: TableGrid, near_0: float, near_1: float) -> TableSample:
        """Sample held at an edge of the domain: its values, zero slopes."""
        rows = grid.nearest(near_0, near_1)
        if rows is None:
            return self._invalid()
        rows[1:] = 0.0
        return self._sample(status, rows)

    def _invalid(self) -> TableSample:
        return self._sample(Status.INVALID, self._contact_rows)

    def _frozen(self, difference_m: float) -> int | None:
        """Nearest column if all stops are met together at its end (within the build's frozen travel), else None."""
        share = (difference_m - self._excursion.origin[1]) / self._excursion.step[1]
        travel = self.arrays["frozen.travel_m"]
        j = min(max(int(share), 0), len(travel) - 2)
        t = share - j
        left = (1 - t) * travel[j] + t * travel[j + 1] if t > 0 else travel[j]
        return round(share) if left <= self.header.settings["frozen_travel_m"] else None


def described(item: Hand | GraspObject | GraspSpec) -> dict[str, Any]:
    """Parameters as plain JSON values; an infinite number becomes the text 'inf'."""

    def plain(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {key: plain(inner) for key, inner in value.items()}
        if isinstance(value, list | tuple):
            return [plain(inner) for inner in value]
        return "inf" if value == float("inf") else value

    result: dict[str, Any] = plain(msgspec.to_builtins(item))
    return result


def first_difference(there: Any, here: Any, key: str = "") -> tuple[str, Any, Any] | None:
    """Dotted key and both values of the first difference between two JSON trees, or None."""
    if isinstance(there, Mapping) and isinstance(here, Mapping):
        for name in sorted({*there, *here}):
            found = first_difference(there.get(name), here.get(name), f"{key}.{name}".lstrip("."))
            if found:
                return found
        return None
    return None if there == here else (key, there, here)


def _header(content: dict[str, Any], source: str | Path) -> TableHeader:
    version = content.get("format_version")
    if version != FORMAT_VERSION:
        raise TableError(source, f"has format version {version!r}, expected {FORMAT_VERSION}.", help=REBUILD)
    try:
        return msgspec.convert(content, TableHeader)
    except msgspec.ValidationError as error:
        raise TableError(source, f"has a wrong header: {error}.", help=REBUILD) from error


def _check(header: TableHeader, arrays: Arrays, source: str | Path) -> None:
    """Names, types and shapes of all arrays against the header, and values where there must be some."""
    channels = len(header.channels)
    if channels != 6 + 3 * len(header.tendons) or {*header.axes} != {*GRIDS}:
        raise TableError(source, f"has {channels} channels for {len(header.tendons)} tendons.", help=REBUILD)
    for name, axes in header.axes.items():
        if len(axes) != 2:
            raise TableError(source, f"has {len(axes)} {name} axes; look-up is for 2.", help=REBUILD)
    tendons = len(header.tendons)
    lists = {"excursion_m": tendons, "tension_N": tendons, "pose": 6, "free_closing_stiffness_N_per_m": tendons}
    for name, length in lists.items():
        values = getattr(header.contact, name)
        if len(values) != length or not all(math.isfinite(value) for value in values):
            raise TableError(source, f"has contact.{name} = {values}, expected {length} finite numbers.", help=REBUILD)
    for name in ("nodes", "load_cap_N", "frozen_travel_m"):
        if not math.isfinite(header.settings.get(name, math.nan)):
            raise TableError(source, f"lacks the setting {name!r}, or it is not finite.", help=REBUILD)
    try:
        columns = arrays["excursion.axis_1"].size
        expected: dict[str, tuple[int, ...]] = {
            "frozen.travel_m": (columns,),
            "frozen.load_N": (columns,),
            "frozen.end_N": (columns,),
            "frozen.slope_per_N": (columns, channels),
        }
        for name in GRIDS:
            n0, n1 = arrays[f"{name}.axis_0"].size, arrays[f"{name}.axis_1"].size
            expected |= {f"{name}.axis_0": (n0,), f"{name}.axis_1": (n1,), f"{name}.start": (n1,), f"{name}.end": (n1,)}
            expected |= {f"{name}.{item}": (n0, n1, channels) for item in NODE_FIELDS}
        for key, shape in expected.items():
            array = arrays[key]
            if array.shape != shape or array.dtype != np.float64 or min(shape) < 2:
                raise TableError(
                    source, f"has {key} of {array.dtype} {array.shape}, expected float64 {shape}.", help=REBUILD
                )
            if not key.endswith(NODE_FIELDS) and not np.isfinite(array).all():
                raise TableError(source, f"has values in {key} that are not finite.", help=REBUILD)
            if "axis" in key and not (np.diff(array) > 0).all():
                raise TableError(source, f"has a {key} that does not rise.", help=REBUILD)
        if len(header.column_end) != columns:
            raise TableError(source, f"names {len(header.column_end)} ends of {columns} columns.", help=REBUILD)
    except KeyError as error:
        raise TableError(source, f"lacks the array {error}.", help=REBUILD) from error
