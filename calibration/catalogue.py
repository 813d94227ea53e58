"""A catalogue of grasps, and all of its motion tables built over any `concurrent.futures.Executor`.

A catalogue is a TOML file: each `[[grasp]]` has a `name` and the keys of a grasp (`GraspSpec`), each `[[tables]]` asks
for every combination of its `hands`, `presets`, `objects` and `grasps`. Hands and objects are packaged names or paths
relative to the catalogue. Workers get parameters and give back tables; only the caller reads and writes files, so
that a cluster's machines need not share a disk. A run that was interrupted goes on where it ended: tables that are
there and whose inputs are still the same are not built again. Source: design 4, 8.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor, Future, as_completed
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, NamedTuple

import msgspec
from msgspec import Meta

from calibration.build import NODES, build_table, inputs_sha256
from calibration.grasp.preposition import first_contact
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import Hand, load_hand
from calibration.motion_table import MotionTable, TableHeader
from calibration.objects import GraspObject, load_object
from calibration.table_file import Arrays
from calibration.toml_files import read_toml
from drivers.errors import ConfigurationError, MechanicsError, TableError

PAPER = Path(__file__).with_name("catalogue.toml")
"""The packaged catalogue: the paper's hands, objects and grasps."""

Names = Annotated[tuple[str, ...], Meta(min_length=1)]


class Tables(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Every combination of these."""

    hands: Names
    presets: Names = ("fitted",)
    objects: Names
    grasps: Names


class NamedGrasp(GraspSpec, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A grasp with the name that tables are called by."""

    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_+-]+$")]

    @property
    def specification(self) -> GraspSpec:
        """Without the name."""
        return GraspSpec(**{key: getattr(self, key) for key in GraspSpec.__struct_fields__})


class Catalogue(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a catalogue file holds."""

    grasp: Annotated[tuple[NamedGrasp, ...], Meta(min_length=1)]
    tables: Annotated[tuple[Tables, ...], Meta(min_length=1)]


@dataclass(frozen=True)
class Case:
    """One table to build; `name` is that of its file, without the ending."""

    name: str
    hand: Hand
    object: GraspObject
    grasp: GraspSpec

    def file(self, directory: str | Path) -> Path:
        """Where its table belongs in a folder."""
        return Path(directory) / f"{self.name}.npz"


class Result(StrEnum):
    """What became of a case."""

    BUILT = "built"
    CURRENT = "current"
    """its table was there, of the same inputs"""
    UNREACHABLE = "unreachable"
    """the hand cannot take the object so; the reason says why"""
    FAILED = "failed"


@dataclass(frozen=True)
class Outcome:
    """A case, what became of it, and why; `seconds` of a worker's processor time."""

    case: Case
    result: Result
    reason: str = ""
    seconds: float = 0.0


class Built(NamedTuple):
    """What a worker gives back: a table's parts, or the reason why there is none."""

    result: Result
    reason: str = ""
    table: tuple[TableHeader, Arrays] | None = None
    seconds: float = 0.0


def load_catalogue(path: str | Path = PAPER) -> list[Case]:
    """All cases of a catalogue file; every hand, object and grasp in it is checked. Errors: ConfigurationError."""
    content = read_toml(path, Catalogue)
    grasps = {grasp.name: grasp.specification for grasp in content.grasp}
    if len(grasps) < len(content.grasp):
        raise ConfigurationError(path, "grasp", [grasp.name for grasp in content.grasp], "each name once")
    hands: dict[tuple[str, str], Hand] = {}
    objects: dict[str, GraspObject] = {}
    cases: dict[str, Case] = {}
    for index, tables in enumerate(content.tables):
        for name in tables.grasps:
            if name not in grasps:
                raise ConfigurationError(path, f"tables[{index}].grasps", name, "one of " + ", ".join(grasps))
        for hand_name in tables.hands:
            for preset in tables.presets:
                if (hand_name, preset) not in hands:
                    hands[hand_name, preset] = load_hand(_beside(path, hand_name), preset)
        for object_name in tables.objects:
            if object_name not in objects:
                objects[object_name] = load_object(_beside(path, object_name))
        for case in _combinations(tables, grasps, hands, objects):
            if case.grasp.supported and case.object.support is None:
                raise ConfigurationError(
                    path,
                    f"tables[{index}].grasps",
                    case.name,
                    f"a grasp with supported = false, because {case.object.name} has no [support]",
                )
            if cases.setdefault(case.name, case) != case:
                raise ConfigurationError(
                    path, f"tables[{index}]", case.name, "cases whose files have different names; rename one of them"
                )
    return list(cases.values())


def build_all(
    cases: Iterable[Case],
    directory: str | Path,
    executor: Executor,
    *,
    nodes: int = NODES,
    on_result: Callable[[Outcome], None] = lambda _: None,
) -> list[Outcome]:
    """Build what is not there yet, each file written whole; in the order of `cases`.

    `on_result` hears every outcome as it comes, in the caller's thread. A case that fails does not stop the others.
    When this is left early (Ctrl-C), what has not begun is cancelled.
    """
    outcomes: dict[int, Outcome] = {}
    pending: dict[Future[Built], tuple[int, Case]] = {}

    def tell(index: int, outcome: Outcome) -> None:
        outcomes[index] = outcome
        on_result(outcome)

    listed = list(cases)
    try:
        for index, case in enumerate(listed):
            if _is_current(case, directory, nodes):
                tell(index, Outcome(case, Result.CURRENT))
            else:
                pending[executor.submit(build_case, case, nodes)] = index, case
        for future in as_completed(list(pending)):
            index, case = pending.pop(future)
            tell(index, _stored(case, future, directory))
    finally:
        for future in pending:
            future.cancel()
    return [outcomes[index] for index in range(len(listed))]


def build_case(case: Case, nodes: int) -> Built:
    """A worker's task: a table, or why there is none."""
    begin = time.process_time()
    result = Result.UNREACHABLE
    try:
        first_contact(case.hand, case.object, case.grasp)
        result = Result.FAILED
        table = build_table(case.hand, case.object, case.grasp, nodes=nodes)
    except MechanicsError as error:
        return Built(result, str(error), None, time.process_time() - begin)
    return Built(Result.BUILT, "", (table.header, table.arrays), time.process_time() - begin)


def counted(outcomes: Sequence[Outcome]) -> dict[Result, int]:
    """How many of each result."""
    return {result: sum(outcome.result is result for outcome in outcomes) for result in Result}


def _beside(catalogue: str | Path, name: str) -> str | Path:
    return Path(catalogue).parent / name if name.endswith(".toml") or "/" in name else name


def _combinations(
    tables: Tables,
    grasps: dict[str, GraspSpec],
    hands: dict[tuple[str, str], Hand],
    objects: dict[str, GraspObject],
) -> list[Case]:
    return [
        Case(
            f"{Path(hand).stem}-{preset}-{Path(object_).stem}-{grasp}",
            hands[hand, preset],
            objects[object_],
            grasps[grasp],
        )
        for hand in tables.hands
        for preset in tables.presets
        for object_ in tables.objects
        for grasp in tables.grasps
    ]


def _is_current(case: Case, directory: str | Path, nodes: int) -> bool:
    file = case.file(directory)
    if not file.exists():
        return False
    try:
        return MotionTable.load(file).inputs_sha256 == inputs_sha256(case.hand, case.object, case.grasp, nodes=nodes)
    except TableError:
        return False  # damaged or of an older format: built again


def _stored(case: Case, future: Future[Built], directory: str | Path) -> Outcome:
    """Outcome of a finished future; its table is on the disk when it says so."""
    try:
        built = future.result()
        if built.table is not None:
            MotionTable(*built.table, case.name).save(case.file(directory))
    except Exception as error:  # whatever happened to one case, in a worker or on the way, is its own outcome
        return Outcome(case, Result.FAILED, str(error) or type(error).__name__)
    return Outcome(case, built.result, built.reason, built.seconds)
