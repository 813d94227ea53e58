"""Parameter files of two-fingered planar hands: TOML to frozen structs.

SI units, angles in degrees where the key says so; keys as in the files beside this module, which give the source of
each number. A tendon passes a joint at a constant offset unless the joint's table says `tendon = { kind = "straight" }`
(at a pin with before_m and after_m). Finger order right, left; flexion from rest is positive when closing.
`[finger.right]` and `[finger.left]` override single keys of `[finger]`; `[preset.NAME]` overrides keys of the whole
file. Source: hand-mechanics reference 2, 4, 12.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta

from calibration.toml_files import FieldError, PositiveOrInfinite, from_document, load_document, merged
from drivers.errors import ConfigurationError

DIRECTORY = Path(__file__).parent
SIDES = ("right", "left")
JOINTS = ("proximal_joint", "distal_joint")
UNLIMITED = (-math.inf, math.inf)
TENDON_SHARE = 0.95
"""Share of a straight tendon's range that the stops may use; at its ends the tendon's arm has no derivative."""

Length = Annotated[float, Meta(gt=0, le=1)]
Offset = Annotated[float, Meta(ge=-1, le=1)]
Mass = Annotated[float, Meta(gt=0, le=20)]
Degrees = Annotated[float, Meta(ge=-180, le=180)]
Inertia = Annotated[float, Meta(ge=-1, le=1)]


class ConstantTendon(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="constant"):
    """Tendon at the constant distance `tendon_arm_m` from the joint's axis: along a flexure, or on a pulley."""


class StraightTendonAtPin(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="straight"):
    """Tendon that runs straight past a pin, between a guide `before_m` and one `after_m` from it along the tendon at
    rest, which passes the pin at the distance `tendon_arm_m`."""

    before_m: Length
    after_m: Length

    def flexion_range_rad(self, offset_m: float) -> tuple[float, float]:
        """Flexion at which guides and pin are in line, where the tendon would change sides or lose its arm."""
        upper = math.atan2(self.before_m, offset_m) + math.atan2(self.after_m, offset_m)
        return upper - math.pi, upper


class StraightTendonAtFlexure(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="straight"
):
    """Tendon that runs straight between guides at the two ends of a flexure, `tendon_arm_m` from its axis."""


class Joint(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind"):
    """What all joints share: flexion from rest, deg, between the stops."""

    flexion_limit_deg: tuple[Degrees, Degrees]

    def __post_init__(self) -> None:
        if not self.flexion_limit_deg[0] < self.flexion_limit_deg[1]:
            raise FieldError("flexion_limit_deg", "lower limit < upper limit")
        if not self.flexion_limit_deg[0] <= 0 <= self.flexion_limit_deg[1]:
            raise FieldError("flexion_limit_deg", "limits that enclose 0, the rest angle")

    @property
    def flexion_limit_rad(self) -> tuple[float, float]:
        """Flexion from rest at the two stops, rad."""
        return math.radians(self.flexion_limit_deg[0]), math.radians(self.flexion_limit_deg[1])


class PinJoint(Joint, frozen=True, tag="pin"):
    """Pin with a linear spring."""

    stiffness_Nm_per_rad: Annotated[float, Meta(gt=0, le=100)]
    tendon: ConstantTendon | StraightTendonAtPin = ConstantTendon()

    def tendon_range_rad(self, offset_m: float) -> tuple[float, float]:
        """Flexion between which the tendon's law holds, for a tendon `offset_m` from the pin."""
        return self.tendon.flexion_range_rad(offset_m) if isinstance(self.tendon, StraightTendonAtPin) else UNLIMITED


class FlexureJoint(Joint, frozen=True, tag="flexure"):
    """Elastic beam, smooth curvature model with `coordinates` Legendre terms (hand-mechanics reference 3)."""

    length_m: Length
    bending_stiffness_Nm2: Annotated[float, Meta(gt=0, le=10)]
    coordinates: Annotated[int, Meta(ge=1, le=6)] = 3
    tendon: ConstantTendon | StraightTendonAtFlexure = ConstantTendon()

    def tendon_range_rad(self, offset_m: float) -> tuple[float, float]:
        """Flexion between which the tendon's law holds; guides of a straight tendon meet at length / offset."""
        straight = isinstance(self.tendon, StraightTendonAtFlexure)
        return (-math.pi / 2, self.length_m / offset_m) if straight else UNLIMITED


class Tip(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Arc at the fingertip; its centre lies `radius_m` before the link's end; 0 is a point.

    The flat pad on the inner side is tangent to the arc and reaches `pad_length_m` back from the arc's centre.
    """

    radius_m: Annotated[float, Meta(ge=0, le=0.1)]
    pad_length_m: Annotated[float, Meta(ge=0, le=1)] = 0.0


class Outline(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Outline of both phalanges: how far they reach from their axis to the inner (palmar) and the outer side."""

    inner_m: Annotated[float, Meta(gt=0, le=0.1)]
    outer_m: Annotated[float, Meta(gt=0, le=0.1)]


class Finger(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One finger: two links, two joints, one tendon over both."""

    proximal_link_m: Length
    distal_link_m: Length
    proximal_mass_kg: Mass
    distal_mass_kg: Mass
    tendon_arm_m: tuple[Annotated[float, Meta(gt=0, le=0.1)], Annotated[float, Meta(gt=0, le=0.1)]]
    tendon_stiffness_N_per_m: PositiveOrInfinite
    rest_angle_deg: tuple[Degrees, Degrees]
    routing_friction: Annotated[float, Meta(ge=0, le=2)]
    proximal_joint: PinJoint | FlexureJoint
    distal_joint: PinJoint | FlexureJoint
    tip: Tip
    outline: Outline

    def __post_init__(self) -> None:
        if self.tip.radius_m >= self.distal_link_m:
            raise FieldError("tip.radius_m", "less than distal_link_m, to whose end the arc reaches")
        if self.tip.pad_length_m > self.distal_link_m - self.tip.radius_m:
            raise FieldError(
                "tip.pad_length_m", "at most distal_link_m − tip.radius_m, the link behind the arc's centre"
            )
        for name, joint, offset_m in zip(JOINTS, self.joints, self.tendon_arm_m, strict=True):
            lower, upper = (TENDON_SHARE * limit for limit in joint.tendon_range_rad(offset_m))
            if not lower <= joint.flexion_limit_rad[0] <= joint.flexion_limit_rad[1] <= upper:
                raise FieldError(
                    f"{name}.flexion_limit_deg",
                    f"limits from {math.degrees(lower):.1f} to {math.degrees(upper):.1f}: {TENDON_SHARE:.0%} of the "
                    f"range in which a straight tendon can run past this joint",
                )

    @property
    def rest_angle_rad(self) -> tuple[float, float]:
        """Proximal link above the palm plane and distal link relative to it at rest, rad."""
        return math.radians(self.rest_angle_deg[0]), math.radians(self.rest_angle_deg[1])

    @property
    def joints(self) -> tuple[PinJoint | FlexureJoint, PinJoint | FlexureJoint]:
        """Proximal and distal joint."""
        return self.proximal_joint, self.distal_joint


class Body(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Palm and motors in the hand frame; inertia about the centre of mass, xx yy zz xy xz yz, tensor signs."""

    mass_kg: Mass
    com_m: tuple[Offset, Offset, Offset]
    inertia_kgm2: tuple[Inertia, Inertia, Inertia, Inertia, Inertia, Inertia]

    def __post_init__(self) -> None:
        moments = np.linalg.eigvalsh(self.inertia_matrix_kgm2)
        if moments[0] <= 0 or moments[2] > moments[0] + moments[1] + 1e-12:
            raise FieldError("inertia_kgm2", "principal moments > 0, none larger than the sum of the others")

    @property
    def inertia_matrix_kgm2(self) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
        """Inertia about the centre of mass in hand axes, 3×3."""
        xx, yy, zz, xy, xz, yz = self.inertia_kgm2
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


class Hand(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A two-fingered planar hand with overrides and preset applied; hand frame H."""

    name: Annotated[str, Meta(min_length=1, max_length=80)]
    root_half_distance_m: Length
    load_cap_N: Annotated[float, Meta(gt=0, le=2000)]
    right: Finger
    left: Finger
    body: Body
    preset: str = "nominal"

    @property
    def fingers(self) -> tuple[Finger, Finger]:
        """Right and left finger."""
        return self.right, self.left


def load_hand(name_or_path: str | Path, preset: str = "fitted") -> Hand:
    """Hand from a packaged file (by name, any case) or from a TOML path. `preset` "nominal" is the file as it stands.

    Every preset in the file is checked, not only the one that is asked for. Errors: ConfigurationError.
    """
    path = packaged_or_path(name_or_path, DIRECTORY, "hand")
    document = load_document(path)
    presets = document.pop("preset", {})
    if not isinstance(presets, Mapping) or not all(isinstance(table, Mapping) for table in presets.values()):
        raise ConfigurationError(path, "preset", presets, "tables [preset.NAME]")
    hands = {name: _hand(document, presets.get(name, {}), name, path) for name in {"nominal", *presets}}
    if preset not in hands:
        raise ConfigurationError(path, "preset", preset, "one of " + ", ".join(sorted(hands)))
    return hands[preset]


def packaged_or_path(name_or_path: str | Path, directory: Path, what: str) -> Path:
    """Path of a packaged TOML file by name, or the path itself when it ends in .toml or names a folder."""
    text = str(name_or_path)
    if text.endswith(".toml") or "/" in text:
        return Path(name_or_path)
    path = directory / f"{text.lower()}.toml"
    if not path.is_file():
        names = ", ".join(sorted(file.stem for file in directory.glob("*.toml")))
        raise ConfigurationError("(command)", what, text, f"one of {names}, or the path of a .toml file")
    return path


def _hand(document: Mapping[str, Any], override: Mapping[str, Any], preset: str, path: Path) -> Hand:
    content = merged(document, override)
    shared = content.pop("finger", None)
    if not isinstance(shared, Mapping):
        raise ConfigurationError(path, "finger", shared, "a table [finger]")
    own: dict[str, Mapping[str, Any]] = {}
    for side in SIDES:
        table = shared.get(side, {})
        if not isinstance(table, Mapping):
            raise ConfigurationError(path, f"finger.{side}", table, f"a table [finger.{side}]")
        own[side] = table
    for key in (*SIDES, "preset"):
        if key in content:
            raise ConfigurationError(
                path, key, content[key], f"[finger.{key}] for one finger, [preset.NAME] for a preset"
            )
    both = {key: value for key, value in shared.items() if key not in SIDES}
    content |= {side: merged(both, own[side]) for side in SIDES}
    content["preset"] = preset

    def written_as(key: str) -> str:
        side, _, rest = key.partition(".")
        if side in SIDES:
            key = f"finger.{side}.{rest}" if _holds(own[side], rest) else f"finger.{rest}"
        return f"preset.{preset}.{key}" if _holds(override, key) else key

    return from_document(content, Hand, path, written_as=written_as)


def _holds(table: Any, key: str) -> bool:
    for step in key.split("[")[0].split("."):
        if not isinstance(table, Mapping) or step not in table:
            return False
        table = table[step]
    return True
