"""Objects: outlines (`shapes`), files (`parameters`), and the paper's objects as TOML."""

from calibration.objects.parameters import GraspObject, Support, load_object
from calibration.objects.shapes import Disc, Shape

__all__ = ["Disc", "GraspObject", "Shape", "Support", "load_object"]
