"""Object files."""

from pathlib import Path

import pytest

from calibration.objects import Disc, Rectangle, Sphere, Support, load_object
from calibration.objects.parameters import DIRECTORY
from drivers.errors import ConfigurationError

PACKAGED = sorted(path.stem for path in DIRECTORY.glob("*.toml"))


@pytest.mark.parametrize(
    ("name", "shape", "mass_kg"),
    [
        ("cylinder30", Disc(0.030), 0.1),
        ("cylinder40", Disc(0.040), 0.1),
        ("cylinder45", Disc(0.045), 0.1),
        ("sphere10", Sphere(0.020), 0.0021),
        ("sphere50", Sphere(0.100), 0.2618),
        ("rectangle40", Rectangle(0.040, 0.040), 0.1),
        ("rectangle60", Rectangle(0.060, 0.060), 0.1),
        ("strawberry", Disc(0.044), 0.018),
        ("rubiks_cube", Rectangle(0.057, 0.057), 0.094),
        ("mustard", Rectangle(0.058, 0.095), 0.600),
    ],
)
def test_sizes_and_masses_of_the_paper(name: str, shape: object, mass_kg: float) -> None:
    """Sizes and masses are those that the paper and hand-mechanics reference 2 and 12 name."""
    found = load_object(name)
    assert (found.shape, found.mass_kg, found.support) == (shape, mass_kg, Support(0.3))


def test_pear_is_as_wide_and_long_as_the_public_list_says() -> None:
    """The pear's curve is 66.2 mm wide and 100 mm long, thin end away from the palm."""
    pear = load_object("pear").shape
    outline = pear.outline_m(20000)
    assert pear.extent_m(0.0) == pytest.approx(0.0662)
    assert outline[:, 1].max() - outline[:, 1].min() == pytest.approx(0.100, abs=1e-7)
    assert outline[:, 1].max() > -outline[:, 1].min()


@pytest.mark.parametrize("name", PACKAGED)
def test_packaged_objects_are_whole(name: str) -> None:
    """Every packaged object stands on a table and has a height, so that every program can use it."""
    found = load_object(name)
    assert found.support is not None
    assert found.height_m is not None
    assert found.shape.area_m2 > 0


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("name='a'\nmass_kg=1\nshape={kind='disc',diameter_m=-1}", "shape.diameter_m"),
        ("name='a'\nmass_kg=1\nshape={kind='sphere',diameter_m=2}", "shape.diameter_m"),
        ("name='a'\nmass_kg=1\nshape={kind='blob',diameter_m=1}", "shape.kind"),
        ("name='a'\nmass_kg=1\nshape={kind='disc',diameter_mm=40}", "shape.diameter_mm"),
        ("name='a'\nmass_kg=1\nshape={kind='rectangle',width_m=0.04}", "shape.depth_m"),
        ("name='a'\nmass_kg=1\nshape={kind='polygon',vertices_m=[[0,0],[1,0]]}", "shape.vertices_m"),
        ("name='a'\nmass_kg=1\nshape={kind='polygon',vertices_m=[[0,0,0],[1,0],[0,1]]}", "shape.vertices_m[0]"),
        (
            "name='a'\nmass_kg=1\nshape={kind='polygon',vertices_m=[[-0.01,-0.01],[-0.01,0.02],[0.02,-0.01]]}",
            "shape.vertices_m",
        ),
        ("name='a'\nmass_kg=1\nshape={kind='curve',support_cos_m=[]}", "shape.support_cos_m"),
        ("name='a'\nmass_kg=1\nshape={kind='curve',support_cos_m=[0.02,nan]}", "shape.support_cos_m[1]"),
        ("name='a'\nmass_kg=1\nshape={kind='curve',support_cos_m=[0.02,0,0.01]}", "shape.support_cos_m"),
        ("name='a'\nmass_kg=nan\nshape={kind='disc',diameter_m=0.04}", "mass_kg"),
        ("name='a'\nmass_kg=1\nshape={kind='disc',diameter_m=0.04}\n[support]\nfriction=-1", "support.friction"),
        ("mass_kg=1\nshape={kind='disc',diameter_m=0.04}", "name"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, text: str, key: str) -> None:
    """Shape, mass and support are checked like everything else: the error names the key."""
    path = tmp_path / "thing.toml"
    path.write_text(text)
    with pytest.raises(ConfigurationError) as caught:
        load_object(path)
    assert caught.value.key == key
