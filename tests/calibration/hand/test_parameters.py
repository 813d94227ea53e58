"""Hand files: values of the reference, presets, overrides, and explained mistakes."""

import math
from pathlib import Path

import pytest

from calibration.hand.parameters import DIRECTORY, load_hand
from drivers.errors import ConfigurationError

SOURCE = (DIRECTORY / "t42pp.toml").read_text()


def write(folder: Path, text: str) -> Path:
    path = folder / "hand.toml"
    path.write_text(text)
    return path


def test_presets_differ_as_the_reference_says() -> None:
    """Fitted is six times as stiff, stops at 1.8 rad and has a 6 mm tip; nominal is the file as it stands."""
    nominal, fitted = load_hand("T42PP", "nominal"), load_hand("t42pp")
    for joint in ("proximal_joint", "distal_joint"):
        soft, stiff = getattr(nominal.right, joint), getattr(fitted.right, joint)
        assert stiff.stiffness_Nm_per_rad == pytest.approx(6 * soft.stiffness_Nm_per_rad)
    assert nominal.right.distal_joint.flexion_limit_rad[1] == pytest.approx(1.25, abs=1e-3)
    assert fitted.right.distal_joint.flexion_limit_rad[1] == pytest.approx(1.8, abs=1e-6)
    assert (nominal.right.tip.radius_m, fitted.right.tip.radius_m) == (0.0105, 0.006)
    assert fitted.load_cap_N == 128
    assert math.isinf(fitted.left.tendon_stiffness_N_per_m)


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
