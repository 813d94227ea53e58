"""Catalogues of grasps and the building of all their tables, over threads, processes and a real cluster."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import pytest

from calibration.build import build_table
from calibration.catalogue import PAPER, Built, Case, Outcome, Result, build_all, counted, load_catalogue
from calibration.cluster import cluster, process_pool
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.motion_table import MotionTable
from calibration.objects import Disc, GraspObject, load_object
from drivers.errors import ConfigurationError, MechanicsError

NODES = 9
CYLINDER = load_object("cylinder40")
SYMMETRIC = Case("symmetric", load_hand("t42pp"), CYLINDER, GraspSpec())
SPLIT = Case("split", load_hand("t42pp"), CYLINDER, GraspSpec(onset_split=0.1))
TOO_WIDE = Case("wide", load_hand("t42pp"), GraspObject("drum", Disc(0.5), 0.1), GraspSpec(supported=False))
NO_SUPPORT = Case("floating", load_hand("t42pp"), GraspObject("ball", Disc(0.04), 0.1), GraspSpec())

P = ParamSpec("P")
T = TypeVar("T")


class Serving(Executor):
    """Gives every case the same table, which was built before; `heard` are the names of the cases, in order."""

    def __init__(self, table: MotionTable) -> None:
        self.heard: list[str] = []
        self.built = Built(Result.BUILT, "", (table.header, table.arrays))

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        case: Any = args[0]
        self.heard.append(case.name)
        future: Future[Any] = Future()
        future.set_result(self.built)
        return future


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Outcome]]:
    """A folder with the tables of four cases, built by a pool of processes, and what became of them."""
    directory = tmp_path_factory.mktemp("catalogue")
    with process_pool(2) as pool:
        return directory, build_all([SYMMETRIC, TOO_WIDE, NO_SUPPORT, SPLIT], directory, pool, nodes=NODES)


def test_one_failure_does_not_stop_the_others(built: tuple[Path, list[Outcome]]) -> None:
    """What the hand cannot take is unreachable, not failed; both say why; the rest is on the disk."""
    directory, outcomes = built
    assert [outcome.result for outcome in outcomes] == [Result.BUILT, Result.UNREACHABLE, Result.FAILED, Result.BUILT]
    assert outcomes[1].reason.startswith("object.shape: ")
    assert "[support]" in outcomes[2].reason
    assert sorted(file.name for file in directory.iterdir()) == ["split.npz", "symmetric.npz"]
    assert counted(outcomes) == {Result.BUILT: 2, Result.CURRENT: 0, Result.UNREACHABLE: 1, Result.FAILED: 1}


def test_a_table_from_a_worker_is_the_table_built_here(built: tuple[Path, list[Outcome]]) -> None:
    """Nothing is lost on the way between processes: same inputs, same path of the object, bit by bit."""
    stored = MotionTable.load(SPLIT.file(built[0]))
    here = build_table(SPLIT.hand, SPLIT.object, SPLIT.grasp, nodes=NODES)
    assert stored.inputs_sha256 == here.inputs_sha256
    for mean in (0.0, 1e-3, 3e-3):
        assert stored.at_excursion(mean, 0.0).rows.tolist() == here.at_excursion(mean, 0.0).rows.tolist()


def test_an_interrupted_run_goes_on_where_it_ended(built: tuple[Path, list[Outcome]], tmp_path: Path) -> None:
    """Current tables are left alone; damaged ones, and those of other inputs, are built again."""
    whole = SPLIT.file(built[0]).read_bytes()
    SPLIT.file(tmp_path).write_bytes(whole)
    SYMMETRIC.file(tmp_path).write_bytes(whole[:-1])
    other = Case("other", SPLIT.hand, SPLIT.object, GraspSpec(onset_split=0.05))
    other.file(tmp_path).write_bytes(whole)
    before = SPLIT.file(tmp_path).stat().st_mtime_ns
    executor = Serving(MotionTable.load(SPLIT.file(built[0])))
    again = build_all([SYMMETRIC, SPLIT, other], tmp_path, executor, nodes=NODES)
    assert [outcome.result for outcome in again] == [Result.BUILT, Result.CURRENT, Result.BUILT]
    assert executor.heard == ["symmetric", "other"]
    assert SPLIT.file(tmp_path).stat().st_mtime_ns == before
    build_all([SPLIT], tmp_path, executor, nodes=NODES + 2)
    assert executor.heard[2:] == ["split"]


def test_leaving_early_cancels_what_has_not_begun(built: tuple[Path, list[Outcome]], tmp_path: Path) -> None:
    """Ctrl-C while the first result is told: later cases never start, and every file there is whole."""
    table = MotionTable.load(SPLIT.file(built[0]))
    ready = Built(Result.BUILT, "", (table.header, table.arrays))
    second_runs, goes_on = threading.Event(), threading.Event()
    begun: list[str] = []

    class OneByOne(Executor):
        def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
            def run() -> Any:
                case: Any = args[0]
                begun.append(case.name)
                if len(begun) > 1:
                    second_runs.set()
                    goes_on.wait(60)
                return ready

            return pool.submit(run)

    def interrupted(_: Outcome) -> None:
        second_runs.wait(60)
        raise KeyboardInterrupt

    cases = [Case(f"case{k}", SPLIT.hand, SPLIT.object, SPLIT.grasp) for k in range(4)]
    with ThreadPoolExecutor(1) as pool:
        with pytest.raises(KeyboardInterrupt):
            build_all(cases, tmp_path, OneByOne(), nodes=NODES, on_result=interrupted)
        goes_on.set()
    assert begun == ["case0", "case1"]
    assert [file.name for file in tmp_path.iterdir()] == ["case0.npz"]
    MotionTable.load(tmp_path / "case0.npz")


def test_a_lost_worker_is_a_failed_case(tmp_path: Path) -> None:
    """Whatever an executor's future raises ends as that case's reason."""

    class Losing(Executor):
        def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
            future: Future[T] = Future()
            future.set_exception(CancelledError())
            return future

    outcome = build_all([SYMMETRIC], tmp_path, Losing(), nodes=NODES)[0]
    assert (outcome.result, outcome.reason) == (Result.FAILED, "CancelledError")


def test_a_folder_that_cannot_be_written_is_said(built: tuple[Path, list[Outcome]], tmp_path: Path) -> None:
    """A file where the folder should be: the case fails with the reason."""
    (tmp_path / "taken").write_text("")
    executor = Serving(MotionTable.load(SPLIT.file(built[0])))
    outcome = build_all([SYMMETRIC], tmp_path / "taken", executor, nodes=NODES)[0]
    assert outcome.result is Result.FAILED
    assert "cannot be written" in outcome.reason


def test_a_real_cluster_builds_the_same(tmp_path: Path, built: tuple[Path, list[Outcome]]) -> None:
    """The build knows only `concurrent.futures`; a cluster's workers need no share of the disk."""
    with cluster("local", 1) as executor:
        outcomes = build_all([SPLIT, TOO_WIDE, NO_SUPPORT], tmp_path, executor, nodes=NODES)
    assert [outcome.result for outcome in outcomes] == [Result.BUILT, Result.UNREACHABLE, Result.FAILED]
    assert "[support]" in outcomes[2].reason
    there, here = (MotionTable.load(SPLIT.file(directory)) for directory in (tmp_path, built[0]))
    assert there.at_excursion(2e-3, 0.0).rows.tolist() == here.at_excursion(2e-3, 0.0).rows.tolist()


def test_the_packaged_catalogue_is_sound() -> None:
    """All hands, objects and grasps that it names exist, and no two tables share a file."""
    cases = load_catalogue()
    assert len({case.name for case in cases}) == len(cases)
    assert {"t42pp-fitted-cylinder40-symmetric", "t42pp-fitted-cylinder40-split10"} <= {case.name for case in cases}


def test_hands_and_objects_of_ones_own_lie_beside_the_catalogue(catalogue: Path) -> None:
    """Paths are relative to the catalogue's folder, wherever the command is started."""
    (case,) = load_catalogue(catalogue)
    assert (case.name, case.object.name, case.hand.name) == ("t42pp-nominal-mug-soft", "my mug", "T42PP")
    assert case.grasp == GraspSpec(onset_split=0.2, load_cap_N=50.0)


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ('["soft"]', '["firm"]', r"tables\[0\].grasps = 'firm'.*one of soft"),
        ('["soft"]', "[]", "grasps"),
        ("onset_split = 0.2", "onset_split = 2", "onset_split.*< 1"),
        ("onset_split = 0.2", "onset_spilt = 0.2", "onset_spilt.*onset_split"),
        ("t42pp", "t42xx", "t42pp"),
        ("mug.toml", "cup.toml", "cup.toml"),
        ('["nominal"]', '["stiff"]', "preset = 'stiff'.*fitted"),
        ("[[tables]]", "[tables]", "tables"),
        ("soft", "so/ft", "name.*so/ft"),
        ("[support]\nfriction = 0.3\n", "", "supported = false"),
    ],
)
def test_a_bad_catalogue_is_refused_before_anything_is_built(
    before: str, after: str, said: str, catalogue: Path
) -> None:
    """Every mistake names the file and what is accepted."""
    for file in catalogue.parent.glob("*.toml"):
        file.write_text(file.read_text().replace(before, after))
    with pytest.raises((ConfigurationError, MechanicsError), match=said):
        load_catalogue(catalogue)


def test_two_cases_for_one_file_are_refused(catalogue: Path) -> None:
    """Two hands of one name in two folders would overwrite each other."""
    other = catalogue.parent / "other"
    other.mkdir()
    (other / "mug.toml").write_text((catalogue.parent / "mug.toml").read_text().replace("0.030", "0.040"))
    catalogue.write_text(catalogue.read_text().replace('["mug.toml"]', '["mug.toml", "other/mug.toml"]'))
    with pytest.raises(ConfigurationError, match="different names"):
        load_catalogue(catalogue)


@pytest.fixture
def catalogue(tmp_path: Path) -> Path:
    """A catalogue with an object of its own."""
    (tmp_path / "mug.toml").write_text(
        'name = "my mug"\nmass_kg = 0.2\nshape = { kind = "disc", diameter_m = 0.030 }\n[support]\nfriction = 0.3\n'
    )
    file = tmp_path / "mine.toml"
    file.write_text(
        '[[grasp]]\nname = "soft"\nonset_split = 0.2\nload_cap_N = 50.0\n'
        '[[tables]]\nhands = ["t42pp"]\npresets = ["nominal"]\nobjects = ["mug.toml"]\ngrasps = ["soft"]\n'
    )
    return file


def test_the_paper_catalogue_is_packaged() -> None:
    """It lies beside the code, so that an installation has it."""
    assert PAPER.is_file()
