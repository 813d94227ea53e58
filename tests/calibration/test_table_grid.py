"""The C¹ grid: exact for bicubics, smooth across cells, honest about its edges and holes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.table_grid import GridNodes, Place, Reals, TableGrid, cell_coefficients
from drivers.errors import InputError

RNG = np.random.default_rng(7)
N0, N1, STEP_0, STEP_1 = 7, 6, 0.25, 0.1
ORIGIN = (1.0, -0.25)


def grid(nodes: GridNodes, start: float = 1.0, end: float = 2.5) -> TableGrid:
    coefficients = cell_coefficients(nodes, STEP_0, STEP_1)
    return TableGrid(ORIGIN, (STEP_0, STEP_1), coefficients, np.full(N1, start), np.full(N1, end))


def random_nodes() -> GridNodes:
    return GridNodes(*RNG.normal(size=(4, N0, N1, 3)))


ROUGH = grid(random_nodes())
inside_0, inside_1 = st.floats(1.0, 2.5), st.floats(-0.25, 0.25)


def read(table: TableGrid, x: float, y: float) -> Reals:
    rows = table.inside(x, y)
    assert rows is not None
    return rows


@settings(max_examples=50)
@given(x=inside_0, y=inside_1)
def test_bicubics_are_reproduced_exactly(x: float, y: float) -> None:
    """A polynomial of third degree in both axes, and its slopes, come back as they are."""
    C = np.array([[1.0, -2, 0.5, 3], [0.3, 1, -1, 2], [2, 0.1, 0.2, -0.7], [-1, 0.4, 1.1, 0.6]])

    def power(t: Reals, slope: bool) -> Reals:
        one, zero = np.ones_like(t), np.zeros_like(t)
        return np.stack([zero, one, 2 * t, 3 * t * t] if slope else [one, t, t * t, t**3], -1)

    def value(u: Reals, v: Reals, du: bool, dv: bool) -> Reals:
        found: Reals = np.einsum("...i,ij,...j->...", power(u, du), C, power(v, dv))[..., None]
        return found

    u, v = np.meshgrid(1.0 + STEP_0 * np.arange(N0), -0.25 + STEP_1 * np.arange(N1), indexing="ij")
    table = grid(
        GridNodes(*(value(u, v, *which) for which in ((False, False), (True, False), (False, True), (True, True))))
    )
    rows = read(table, x, y)
    at = np.array(x), np.array(y)
    expected = [value(*at, False, False), value(*at, True, False), value(*at, False, True)]
    assert rows == pytest.approx(np.array(expected), abs=1e-9)


@settings(max_examples=50)
@given(i=st.integers(1, N0 - 2), y=inside_1)
def test_value_and_slopes_are_continuous_across_cells(i: int, y: float) -> None:
    """C¹ as a law: for any node data, both sides of a cell boundary agree in value and slopes."""
    x = ORIGIN[0] + i * STEP_0
    assert read(ROUGH, x - 1e-12, y) == pytest.approx(read(ROUGH, x + 1e-12, y), abs=1e-8)
    share, z = 1.0 + (y + 0.25) * 3.0, -0.25 + min(i, N1 - 2) * STEP_1
    assert read(ROUGH, share, z - 1e-12) == pytest.approx(read(ROUGH, share, z + 1e-12), abs=1e-8)


@settings(max_examples=50)
@given(x=st.floats(1.001, 2.499), y=st.floats(-0.249, 0.249))
def test_slopes_belong_to_the_values(x: float, y: float) -> None:
    """The Jacobian rows are the derivative of what is returned as value."""
    step = 1e-7
    rows = read(ROUGH, x, y)
    along_0 = (read(ROUGH, x + step, y)[0] - read(ROUGH, x - step, y)[0]) / (2 * step)
    along_1 = (read(ROUGH, x, y + step)[0] - read(ROUGH, x, y - step)[0]) / (2 * step)
    assert np.array([along_0, along_1]) == pytest.approx(rows[1:], rel=1e-4, abs=2e-4)


@pytest.mark.parametrize(
    ("x", "y", "place", "near"),
    [
        (0.9, 0.0, Place.BEFORE_START, (1.0, 0.0)),
        (2.6, 0.0, Place.BEYOND_END, (2.5, 0.0)),
        (1.5, 0.3, Place.BESIDE, (1.5, 0.25)),
        (0.5, -9.0, Place.BEFORE_START, (1.0, -0.25)),
        (9.0, -9.0, Place.BESIDE, (2.5, -0.25)),
    ],
)
def test_outside_is_never_read(x: float, y: float, place: Place, near: tuple[float, float]) -> None:
    """Beyond any edge there is no value, but the kind of edge and the nearest index."""
    assert ROUGH.inside(x, y) is None
    found, *nearest = ROUGH.place(x, y)
    assert found is place
    assert nearest == pytest.approx(near)


def test_corners_of_the_domain_can_be_read() -> None:
    """The edges themselves belong to the domain."""
    for x in (1.0, 2.5):
        for y in (-0.25, 0.25):
            assert ROUGH.inside(x, y) is not None


def test_no_cell_with_a_missing_corner_is_read() -> None:
    """One node without a solution makes its four cells unreadable, and no others."""
    nodes = random_nodes()
    nodes.value[3, 2] = np.nan
    table = grid(nodes)
    unreadable = {
        (i, j)
        for i in range(N0 - 1)
        for j in range(N1 - 1)
        if table.inside(ORIGIN[0] + (i + 0.5) * STEP_0, ORIGIN[1] + (j + 0.5) * STEP_1) is None
    }
    assert unreadable == {(2, 1), (2, 2), (3, 1), (3, 2)}
    assert table.place(1.0 + 2.5 * STEP_0, -0.25 + 1.5 * STEP_1)[0] is Place.HOLE


@pytest.mark.parametrize("index", [(np.nan, 0.0), (1.2, np.nan), (np.inf, 0.0), (1.2, -np.inf)])
def test_an_index_that_is_not_finite_is_an_error(index: tuple[float, float]) -> None:
    """NaN never becomes a pose."""
    assert ROUGH.inside(*index) is None
    with pytest.raises(InputError, match="not finite"):
        ROUGH.place(*index)
