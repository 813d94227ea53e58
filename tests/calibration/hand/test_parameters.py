"""Hand files: values of the reference, presets, overrides, and explained mistakes."""

import cmath
import math
from pathlib import Path

import pytest

from calibration.hand.parameters import DIRECTORY, FlexureJoint, PinJoint, StraightTendonAtPin, load_hand
from drivers.errors import ConfigurationError

SOURCE = (DIRECTORY / "t42pp.toml").read_text()


def write(folder: Path, text: str) -> Path:
    path = folder / "hand.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", ["t42pp", "t42pf", "t42ff", "t42pf_tactile"])
def test_presets_differ_as_the_reference_says(name: str) -> None:
    """Fitted is six times as stiff, stops at 1.8 rad instead of 1.25 and has a 6 mm tip; the rest is the same."""
    nominal, fitted = load_hand(name.upper(), "nominal"), load_hand(name)
    for soft, stiff in zip(nominal.right.joints, fitted.right.joints, strict=True):
        assert stiffness_Nm_per_rad(stiff) == pytest.approx(6 * stiffness_Nm_per_rad(soft))
    assert nominal.right.distal_joint.flexion_limit_rad[1] == pytest.approx(1.25, abs=1e-3)
    assert fitted.right.distal_joint.flexion_limit_rad[1] == pytest.approx(1.8, abs=1e-6)
    assert fitted.right.tip.radius_m == 0.006
    assert fitted.load_cap_N == 128
    assert math.isinf(fitted.left.tendon_stiffness_N_per_m)
    assert nominal.right == nominal.left


def stiffness_Nm_per_rad(joint: PinJoint | FlexureJoint) -> float:
    if isinstance(joint, PinJoint):
        return joint.stiffness_Nm_per_rad
    return joint.bending_stiffness_Nm2 / joint.length_m


@pytest.mark.parametrize(
    ("name", "links_mm", "root_mm", "masses_g", "stiffness"),
    [
        ("t42pp", (62, 47), 30, (20, 18), (0.0290, 0.0726)),
        ("t42pf", (58, 42), 30, (23, 18), (0.0290, 0.0726)),
        ("t42ff", (52, 42), 38.75, (24, 18), (0.0290, 0.0726)),
        ("t42pf_tactile", (58, 42), 30, (23, 18), (0.0580, 0.1452)),
    ],
)
def test_nominal_hands_are_those_of_table_1(
    name: str,
    links_mm: tuple[float, float],
    root_mm: float,
    masses_g: tuple[float, float],
    stiffness: tuple[float, float],
) -> None:
    """The table of reference 2: the paper's Table I, root distance, stiffness EI / l_F; rest angles 15°."""
    hand = load_hand(name, "nominal")
    finger = hand.right
    assert (1e3 * finger.proximal_link_m, 1e3 * finger.distal_link_m) == pytest.approx(links_mm)
    assert (1e3 * finger.proximal_mass_kg, 1e3 * finger.distal_mass_kg) == pytest.approx(masses_g)
    assert 1e3 * hand.root_half_distance_m == pytest.approx(root_mm)
    assert tuple(map(stiffness_Nm_per_rad, finger.joints)) == pytest.approx(stiffness)
    assert finger.tendon_arm_m == (0.008, 0.008)
    assert finger.rest_angle_deg == (15, 15)
    for joint in finger.joints:
        assert isinstance(joint, PinJoint) or (joint.length_m, joint.coordinates) == (0.010, 3)


def test_one_finger_can_differ(tmp_path: Path) -> None:
    """[finger.left] overrides single keys of [finger] for one finger."""
    hand = load_hand(
        write(tmp_path, SOURCE + "\n[finger.left]\ndistal_link_m = 0.050\ntip = { radius_m = 0.004 }\n"), "nominal"
    )
    assert (hand.right.distal_link_m, hand.left.distal_link_m) == (0.047, 0.050)
    assert (hand.right.tip.radius_m, hand.left.tip.radius_m) == (0.0105, 0.004)
    assert hand.left.proximal_link_m == hand.right.proximal_link_m


@pytest.mark.parametrize(
    ("text", "replacement", "key"),
    [
        ("radius_m = 0.0105", "radius_m = nan", "finger.tip.radius_m"),
        ("radius_m = 0.0105", "radius_m = -1", "finger.tip.radius_m"),
        ("radius_m = 0.0105", "radius_mm = 10.5", "finger.tip.radius_mm"),
        ("radius_m = 0.006", "radius_m = inf", "preset.fitted.finger.tip.radius_m"),
        ("[0.0, 120.0]", "[10, 5]", "finger.proximal_joint.flexion_limit_deg"),
        ("[0.008, 0.008]", "[0.008]", "finger.tendon_arm_m"),
        ("mass_kg = 0.4", "mass_kg = 0", "body.mass_kg"),
        ("[4e-4, 4e-4, 4e-4,", "[4e-4, -4e-4, 4e-4,", "body.inertia_kgm2"),
        ("stiffness_Nm_per_rad = 0.0726", "stiffness_Nm_per_rad = -1", "finger.distal_joint.stiffness_Nm_per_rad"),
        ("radius_m = 0.0105", "radius_m = 0.047", "finger.tip.radius_m"),
        ("pad_length_m = 0.0", "pad_length_m = 0.037", "finger.tip.pad_length_m"),
        ("inner_m = 0.008", "inner_m = 0", "finger.outline.inner_m"),
        ("outer_m = 0.009", "thickness_m = 0.018", "finger.outline.thickness_m"),
        ("routing_friction = 0.0", "routing_friction = -0.1", "finger.routing_friction"),
        ("[body]", "[finger.left]\ndistal_link_m = -2\n[body]", "finger.left.distal_link_m"),
        ("[body]", "[right]\n[body]", "right"),
    ],
)
def test_a_mistake_is_named_as_its_author_wrote_it(tmp_path: Path, text: str, replacement: str, key: str) -> None:
    """Keys in messages are those of the file, also in overrides, also in a preset that was not asked for."""
    assert text in SOURCE
    with pytest.raises(ConfigurationError) as caught:
        load_hand(write(tmp_path, SOURCE.replace(text, replacement, 1)), "nominal")
    assert caught.value.key == key


def test_unknown_hand_and_preset_list_what_there_is() -> None:
    """A misspelt name gets the names that exist."""
    with pytest.raises(ConfigurationError, match="t42pp"):
        load_hand("t42xx")
    with pytest.raises(ConfigurationError, match="fitted, nominal"):
        load_hand("t42pp", "fited")


FLEXURES = (DIRECTORY / "t42ff.toml").read_text().split("[preset")[0]


@pytest.mark.parametrize(
    ("text", "replacement", "key"),
    [
        ("bending_stiffness_Nm2 = 7.26e-4", "bending_stiffness_Nm2 = -7e-4", "bending_stiffness_Nm2"),
        ("coordinates = 3", "coordinates = 0", "coordinates"),
        ("coordinates = 3", "coordinates = 7", "coordinates"),
        ("coordinates = 3", "stiffness_Nm_per_rad = 0.1", "stiffness_Nm_per_rad"),
        ("coordinates = 3", 'tendon = { kind = "curved" }', "tendon.kind"),
        ("coordinates = 3", 'tendon = { kind = "straight", before_m = 0.005 }', "tendon.before_m"),
        ("coordinates = 3", 'tendon = { kind = "straight" }', "flexion_limit_deg"),
        ("[0.0, 71.6]", "[71.6, 0.0]", "flexion_limit_deg"),
        ("[0.0, 71.6]", "[10.0, 71.6]", "flexion_limit_deg"),
    ],
)
def test_a_mistake_in_a_flexure_is_named(tmp_path: Path, text: str, replacement: str, key: str) -> None:
    """Stiffness, number of coordinates, keys of another joint, limits; a straight tendon only as far as it reaches."""
    before, distal = FLEXURES.split("[finger.distal_joint]")
    path = write(tmp_path, before + "[finger.distal_joint]" + distal.replace(text, replacement, 1))
    with pytest.raises(ConfigurationError) as caught:
        load_hand(path, "nominal")
    assert caught.value.key == f"finger.distal_joint.{key}"


def test_a_straight_tendon_bounds_the_stops(tmp_path: Path) -> None:
    """Past a flexure 95 % of L/r = 71.6°; past a pin 95 % of the angle at which both guides and the pin are in line."""
    straight = FLEXURES.replace("[0.0, 71.6]", "[0.0, 68.0]").replace(
        "length_m = 0.010                            # [P] Table I\nbending_stiffness_Nm2 = 7",
        'tendon = { kind = "straight" }\nlength_m = 0.010\nbending_stiffness_Nm2 = 7',
    )
    assert load_hand(write(tmp_path, straight), "nominal").right.distal_joint.flexion_limit_deg[1] == 68
    with pytest.raises(ConfigurationError, match=r"to 68\.0") as caught:
        load_hand(write(tmp_path, straight.replace("[0.0, 68.0]", "[0.0, 68.1]")), "nominal")
    assert caught.value.key == "finger.distal_joint.flexion_limit_deg"
    lower, upper = StraightTendonAtPin(0.005, 0.005).flexion_range_rad(0.008)
    for angle in (lower, upper):
        first, last = complex(-0.005, 0.008), complex(0.005, 0.008) * cmath.exp(1j * angle)
        assert (last.conjugate() * first).imag == pytest.approx(0.0, abs=1e-18)
