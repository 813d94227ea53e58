"""Normal forces between fingertips and what they touch, from the physics' contacts."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray


def fingertip_forces_N(model: mujoco.MjModel, data: mujoco.MjData, tips: Sequence[int]) -> NDArray[np.float64]:
    """Sum of the normal forces at each tip geom of `tips`, as of the last forward computation in `data`."""
    force_N, wrench = np.zeros(len(tips)), np.zeros(6)
    for index, geoms in enumerate(data.contact.geom[: data.ncon].tolist()):
        for finger, tip in enumerate(tips):
            if tip in geoms:
                mujoco.mj_contactForce(model, data, index, wrench)
                force_N[finger] += wrench[0]
    return force_N
