"""The arm's URDF as bodies of the simulated world.

MuJoCo gets the same links, joints and inertias as the cycle's arm model, plus what a URDF cannot say: rotor inertia as
armature, viscous and Coulomb friction (WAM reference 6.5). Link frames are those of the URDF, joint axes their z. SI.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from drivers.errors import InputError
from drivers.wam.parameters import JOINTS, WamParameters

LIMIT_SLACK_RAD = 0.1
"""The arm's stops give: joint 4 lies 0.03 rad beyond its limit when the arm is at home (WAM reference 4.4)."""


@dataclass(frozen=True)
class ArmImperfections:
    """What sets the simulated arm apart from its nominal model."""

    coulomb_Nm: tuple[float, ...]
    """Coulomb friction at each joint, N·m, shape (7,)."""
    link_mass_factor: tuple[float, ...]
    """Mass and inertia of each link over their nominal values, shape (7,)."""
    viscous: bool
    """Whether the joints have the viscous friction of the parameters."""


def add_arm(
    base: ElementTree.Element,
    parameters: WamParameters,
    imperfections: ArmImperfections,
    welded_at_rad: NDArray[np.float64] | None = None,
) -> ElementTree.Element:
    """Append the chain of links to the body `base` (DH frame 0) and return the body of the tool plate.

    With `welded_at_rad`, shape (7,), the chain has no joints and stands at these angles. Raises InputError when the
    URDF is not a chain of seven revolute joints about z and one fixed tool plate.
    """
    urdf = ElementTree.fromstring(files("drivers.wam").joinpath("wam7.urdf").read_text())
    links = {link.get("name"): link for link in urdf.iter("link")}
    parent = base
    index = 0
    for joint in urdf.iter("joint"):
        name = _attribute(joint, "child", "link", "")
        xyz, rotation = _pose(joint)
        revolute = joint.get("type") == "revolute"
        if revolute and (_numbers(joint, "axis", "xyz", "1 0 0") != [0.0, 0.0, 1.0] or index >= JOINTS):
            raise InputError(f"wam7.urdf: joint {joint.get('name')} is not one of {JOINTS} revolute joints about z.")
        if revolute and welded_at_rad is not None:
            rotation = _product(rotation, _axis_quaternion(2, float(welded_at_rad[index])))
        parent = ElementTree.SubElement(parent, "body", name=name, pos=text(xyz), quat=text(rotation))
        if revolute:
            _add_inertial(parent, links[name], imperfections.link_mass_factor[index])
            if welded_at_rad is None:
                _add_joint(parent, index, parameters, imperfections)
            index += 1
    if index != JOINTS or parent.get("name") != "tool":
        raise InputError(f"wam7.urdf: expected {JOINTS} revolute joints and a tool plate, found {index} joints.")
    return parent


def text(values: Sequence[float] | NDArray[np.float64]) -> str:
    """Numbers as MJCF writes them, without loss."""
    return " ".join(repr(float(value)) for value in values)


def _add_joint(
    body: ElementTree.Element, index: int, parameters: WamParameters, imperfections: ArmImperfections
) -> None:
    lower = parameters.joint_lower_rad[index] - LIMIT_SLACK_RAD
    upper = parameters.joint_upper_rad[index] + LIMIT_SLACK_RAD
    ElementTree.SubElement(
        body,
        "joint",
        name=f"arm_{index + 1}",
        type="hinge",
        axis="0 0 1",
        range=text((lower, upper)),
        armature=repr(float(parameters.rotor_inertia_kgm2[index])),
        damping=repr(float(parameters.viscous_friction_Nms_per_rad[index]) * imperfections.viscous),
        frictionloss=repr(float(imperfections.coulomb_Nm[index])),
    )


def _add_inertial(body: ElementTree.Element, link: ElementTree.Element, factor: float) -> None:
    inertial = link.find("inertial")
    tensor = None if inertial is None else inertial.find("inertia")
    if inertial is None or tensor is None:
        raise InputError(f"wam7.urdf: link {link.get('name')} has no inertia.")
    xyz, rotation = _pose(inertial)
    if rotation != [1.0, 0.0, 0.0, 0.0]:
        raise InputError(f"wam7.urdf: the inertia of link {link.get('name')} is turned; expected link axes.")
    entries = [factor * float(tensor.get(key, "nan")) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")]
    mass_kg = factor * _numbers(inertial, "mass", "value", "nan")[0]
    ElementTree.SubElement(body, "inertial", pos=text(xyz), mass=repr(mass_kg), fullinertia=text(entries))


def _attribute(element: ElementTree.Element, child: str, key: str, default: str) -> str:
    found = element.find(child)
    return default if found is None else found.get(key, default)


def _numbers(element: ElementTree.Element, child: str, key: str, default: str) -> list[float]:
    return [float(word) for word in _attribute(element, child, key, default).split()]


def _pose(element: ElementTree.Element) -> tuple[list[float], list[float]]:
    """The `origin` of a URDF element: position, and Rz(yaw)·Ry(pitch)·Rx(roll) as a quaternion wxyz."""
    roll, pitch, yaw = _numbers(element, "origin", "rpy", "0 0 0")
    rotation = _product(_product(_axis_quaternion(2, yaw), _axis_quaternion(1, pitch)), _axis_quaternion(0, roll))
    return _numbers(element, "origin", "xyz", "0 0 0"), rotation


def _axis_quaternion(axis: int, angle_rad: float) -> list[float]:
    quaternion = [cos(angle_rad / 2), 0.0, 0.0, 0.0]
    quaternion[1 + axis] = sin(angle_rad / 2)
    return quaternion


def _product(a: list[float], b: list[float]) -> list[float]:
    return [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
