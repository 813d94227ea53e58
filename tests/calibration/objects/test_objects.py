"""Object files."""

from pathlib import Path

import pytest

from calibration.objects import Disc, Support, load_object
from drivers.errors import ConfigurationError


@pytest.mark.parametrize(("name", "diameter_m"), [("cylinder30", 0.030), ("cylinder40", 0.040), ("cylinder45", 0.045)])
def test_packaged_cylinders(name: str, diameter_m: float) -> None:
    """The paper's cylinders stand on a table of friction 0.3 and weigh 100 g."""
    found = load_object(name)
    assert (found.shape, found.mass_kg, found.support) == (Disc(diameter_m), 0.1, Support(0.3))


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("name='a'\nmass_kg=1\nshape={kind='disc',diameter_m=-1}", "shape.diameter_m"),
        ("name='a'\nmass_kg=1\nshape={kind='blob',diameter_m=1}", "shape.kind"),
        ("name='a'\nmass_kg=1\nshape={kind='disc',diameter_mm=40}", "shape.diameter_mm"),
        ("name='a'\nmass_kg=nan\nshape={kind='disc',diameter_m=0.04}", "mass_kg"),
        ("name='a'\nmass_kg=1\nshape={kind='disc',diameter_m=0.04}\n[support]\nfriction=-1", "support.friction"),
        ("mass_kg=1\nshape={kind='disc',diameter_m=0.04}", "name"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, text: str, key: str) -> None:
    """Shape, mass and support are checked like everything else."""
    path = tmp_path / "thing.toml"
    path.write_text(text)
    with pytest.raises(ConfigurationError) as caught:
        load_object(path)
    assert caught.value.key == key
