"""Objects: outlines (`shapes`, on `support` functions or the sides of a `polygon`), files (`parameters`), and the
paper's objects as TOML."""

from calibration.objects.parameters import GraspObject, Support, load_object
from calibration.objects.shapes import Curve, Disc, Polygon, Rectangle, Shape, Sphere

__all__ = [
    "Curve",
    "Disc",
    "GraspObject",
    "Polygon",
    "Rectangle",
    "Shape",
    "Sphere",
    "Support",
    "load_object",
]
