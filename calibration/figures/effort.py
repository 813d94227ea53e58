"""Fig. 17: a light and a heavy object, at minimal effort and where the motion ends, on a table and lifted."""

from __future__ import annotations

from dataclasses import dataclass

from matplotlib.axes import Axes

from calibration.figures.drawing import GHOST, MM, as_picture, draw_forces, draw_path, draw_state
from calibration.figures.paper_figure import PaperFigure
from calibration.figures.style import BLACK, new_figure
from calibration.grasp.constraints import gaps
from calibration.grasp.equilibrium import GraspSystem, grasp_system
from calibration.grasp.force import minimal_effort
from calibration.grasp.friction import OnTable, sliding
from calibration.grasp.path import Path, trace
from calibration.grasp.specification import GraspSpec
from calibration.hand.bundle import Reals
from calibration.hand.parameters import load_hand
from calibration.objects import load_object

OBJECTS = (("strawberry", 90.0), ("mustard", 128.0))
"""Object, and the tendon load that ends its maximum."""
PRINTED_MM = {
    "strawberry": {"minimal effort, lifted": "0", "maximum on the table": "22", "maximum lifted": "23"},
    "mustard": {"minimal effort, lifted": "28", "maximum on the table": "38", "maximum lifted": "44"},
}
FRICTION = 0.3
STEP_M = 2e-4


@dataclass(frozen=True)
class Shown:
    """One picture: a path, and the state on it that is shown."""

    path: Path
    w: Reals

    @property
    def motion_mm(self) -> float:
        """Towards the palm."""
        system = self.path.system
        return -float(self.w[system.joints + 1] - self.path.pose[0, 1]) * MM


def figure_17() -> PaperFigure:
    """T42PF, fitted, on the strawberry and the mustard bottle."""
    figure, axes = new_figure(9.6, 6.4, 2, 3)
    values: dict[str, dict[str, float]] = {}
    for row, (name, load_N) in enumerate(OBJECTS):
        shown = _shown(name, load_N)
        values[name] = {f"{what}, motion_m": state.motion_mm / MM for what, state in shown.items()}
        values[name] |= {"load_at_maximum_N": load_N}
        for picture, (what, state) in zip(axes[3 * row : 3 * row + 3], shown.items(), strict=True):
            _draw(picture, state, f"{name.capitalize()}: {what}", PRINTED_MM[name][what])
    return PaperFigure(
        17,
        "minimal effort and maximum",
        "A T42PF on a strawberry (44 mm, 18 g) and a mustard bottle (58 × 95 mm, 600 g): minimal effort when lifted, "
        "and the most it moves them on the table (friction 0.3) and lifted. White boxes: motion towards the palm, and "
        "what the paper prints for it. Dashed: first contact.",
        "that the strawberry hardly moves at minimal effort; that the table's friction matters for the bottle only.",
        "stiffness × 6, the distal stop of 1.8 rad and the load cap of 128 N are fitted to the bottle's 28, 38 and 44 "
        "mm: consistent, not validated. The strawberry's maximum is taken at 90 N, because one stop and one cap cannot "
        "give both objects' maxima in this model. Fingertips do not slip.",
        values,
        figure,
    )


def _shown(name: str, load_N: float) -> dict[str, Shown]:
    system = grasp_system(load_hand("t42pf"), load_object(name), GraspSpec(supported=False))
    lifted = _squeezed(system, load_N, on_table=False)
    table = _squeezed(system, load_N, on_table=True)
    least = minimal_effort(lifted, system.object.mass_kg, FRICTION, lifted=True)
    shown = {} if least is None else {"minimal effort, lifted": Shown(lifted, least.w)}
    return shown | {
        "maximum on the table": Shown(table, table.w[-1]),
        "maximum lifted": Shown(lifted, lifted.w[-1]),
    }


def _squeezed(system: GraspSystem, load_N: float, *, on_table: bool) -> Path:
    rule = OnTable(system, sliding(system.object)) if on_table else None
    return trace(system, step_m=STEP_M, clearances=gaps(system), rule=rule, load_cap_N=load_N)


def _draw(axes: Axes, shown: Shown, title: str, printed_mm: str) -> None:
    system, start = shown.path.system, shown.path.w[0]
    draw_state(axes, system, start, GHOST)
    draw_state(axes, system, shown.w)
    poses = shown.path.pose[: 1 + int((shown.path.pose[:, 1] > shown.w[system.joints + 1]).sum())]
    if shown.motion_mm > 2:
        draw_path(axes, poses)
    draw_forces(axes, system, shown.w, 1.6)
    as_picture(axes, title)
    axes.text(
        0.03,
        0.97,
        f"{shown.motion_mm:.1f} mm\n(paper {printed_mm})",
        transform=axes.transAxes,
        va="top",
        fontsize=8,
        color=BLACK,
        bbox={"boxstyle": "round", "fc": "white", "ec": BLACK, "lw": 0.8},
        zorder=10,
    )
