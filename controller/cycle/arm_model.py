"""The arm as the cycle knows it: where the wrist is, how it moves, and which torques hold and move it.

Kinematics and dynamics of `drivers/wam/wam7.urdf` by Pinocchio, with the base as it is mounted, the hand's body and,
from the moment it is lifted, the object. The wrist frame W is the tool plate. The world has z up; without a base pose
it is DH frame 0 (WAM reference 6.1). Angles in rad, torques in N·m, poses as 4×4 homogeneous matrices in metres;
velocities of the wrist are taken at its origin in world axes, linear part first.

Rotor inertias are part of the mass matrix (WAM reference 6.5): they are as large as the links' own. The arm's own
gravity comes from its masses or, where they were identified, from gravity vectors (`gravity_vectors.py`); the hand's
and the object's always from masses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from math import isfinite
from typing import Any, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt
import pinocchio

from controller.cycle.gravity_vectors import GravityDifference, checked_mu, mu_of_masses
from drivers.errors import InputError
from drivers.wam.parameters import WamParameters, load_wam_parameters

FloatArray: TypeAlias = npt.NDArray[np.float64]

JOINTS = 7
GRAVITY_M_S2 = 9.81
WRIST_FRAME = "tool"


class RigidBody(Protocol):
    """Mass properties in hand axes, about the hand frame's origin: the hand's body, or an object in it."""

    @property
    def mass_kg(self) -> float: ...

    @property
    def com_m(self) -> Sequence[float] | FloatArray: ...

    @property
    def inertia_kgm2(self) -> Sequence[float] | FloatArray:
        """About the centre of mass: xx, yy, zz, xy, xz, yz, tensor signs."""
        ...


@dataclass(frozen=True)
class Payload:
    """An object in the hand: mass, centre of mass in the hand frame, inertia about it (xx, yy, zz, xy, xz, yz)."""

    mass_kg: float
    com_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertia_kgm2: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class ArmFriction:
    """Joint friction: viscous (7, N·m·s/rad) and Coulomb (7, N·m) coefficients, none by default.

    The Coulomb torque keeps its sign at rest and turns over within about `turnover_rad` (`joint_friction.py`).
    """

    viscous_Nms_per_rad: tuple[float, ...] = (0.0,) * JOINTS
    coulomb_Nm: tuple[float, ...] = (0.0,) * JOINTS
    turnover_rad: float = 2e-4

    def __post_init__(self) -> None:
        for name in ("viscous_Nms_per_rad", "coulomb_Nm"):
            values = getattr(self, name)
            if len(values) != JOINTS or not all(isfinite(value) and value >= 0.0 for value in values):
                raise InputError(f"arm friction {name} is {values}; expected {JOINTS} finite values, none negative.")
        if not (isfinite(self.turnover_rad) and self.turnover_rad > 0.0):
            raise InputError(f"arm friction turnover_rad is {self.turnover_rad}; expected a positive angle.")


class ArmModel:
    """Kinematics and dynamics of arm, hand and payload. `ArmModel()` is the bare arm on a level base.

    hand          mass properties of the hand in its own frame, or None
    T_wrist_hand  (4×4) the hand frame in the wrist frame: where hand and payload are mounted
    T_world_base  (4×4) DH frame 0 in the world; gravity acts along −z of the world
    payload       the object; it weighs nothing until `set_payload_fraction`
    parameters    rotor inertias, and gravity vectors of the bare arm where there are any; by default those of
                  `drivers/wam/wam7.toml`
    friction      coefficients of `friction(v)`

    Every method takes joint angles, velocities and accelerations as (7) arrays and raises InputError when one has
    another shape or is not finite. Returned arrays belong to the caller.
    """

    def __init__(
        self,
        *,
        hand: RigidBody | None = None,
        T_wrist_hand: npt.ArrayLike | None = None,
        T_world_base: npt.ArrayLike | None = None,
        payload: RigidBody | None = None,
        parameters: WamParameters | None = None,
        friction: ArmFriction | None = None,
    ) -> None:
        parameters = parameters if parameters is not None else load_wam_parameters()
        friction = friction if friction is not None else ArmFriction()
        self.T_world_base = checked_pose(T_world_base, "T_world_base")
        self.T_wrist_hand = checked_pose(T_wrist_hand, "T_wrist_hand")

        self._model = _load_urdf(self.T_world_base, np.asarray(parameters.rotor_inertia_kgm2, dtype=np.float64))
        self._wrist = _frame_id(self._model, WRIST_FRAME)
        self._last_joint = self._model.frames[self._wrist].parentJoint
        wrist = self._model.frames[self._wrist].placement
        self._T_last_joint_hand = wrist * _se3(self.T_wrist_hand)
        self._mu = mu_of_masses(self._model, wrist)
        self._gravity_difference: GravityDifference | None = None
        if parameters.gravity_mu_kg_m is not None:
            identified = checked_mu(parameters.gravity_mu_kg_m, JOINTS)
            self._gravity_difference = GravityDifference(self._model, wrist, identified - self._mu)
            self._mu = identified
        self._empty_inertia = self._model.inertias[self._last_joint].copy()
        if hand is not None:
            self._empty_inertia = self._empty_inertia + self._at_last_joint(*_checked_body(hand))
        self.set_payload(payload)

        # Data must be made after the last frame (real-time reference 6): earlier ones are too short.
        self._data = self._model.createData()
        self._oMf = self._data.oMf
        self._viscous = friction.viscous_Nms_per_rad
        self._coulomb = friction.coulomb_Nm
        self.friction_turnover_rad = friction.turnover_rad
        self._rest = np.zeros(JOINTS)
        self.pose: FloatArray = np.eye(4)
        self.jacobian_now: FloatArray = np.zeros((6, JOINTS))
        self.update(self._rest)

    def update(self, q: FloatArray) -> None:
        """Work out `pose` (T_world_wrist, 4×4) and `jacobian_now` (6×7) once, for all who need them in this cycle."""
        q = checked_joints(q, "joint angles")
        self.jacobian_now = pinocchio.computeFrameJacobian(
            self._model, self._data, q, self._wrist, pinocchio.LOCAL_WORLD_ALIGNED
        )
        self.pose = self._oMf[self._wrist].homogeneous

    def wrist_pose(self, q: npt.ArrayLike) -> FloatArray:
        """T_world_wrist (4×4); for the default base the tool in DH frame 0 (WAM reference 6.1)."""
        q = checked_joints(q, "joint angles")
        pinocchio.framesForwardKinematics(self._model, self._data, q)
        pose: FloatArray = np.array(self._oMf[self._wrist].homogeneous)
        return pose

    def jacobian(self, q: npt.ArrayLike) -> FloatArray:
        """Wrist twist per joint velocity (6×7): world axes at the wrist's origin, linear rows first."""
        q = checked_joints(q, "joint angles")
        return np.array(
            pinocchio.computeFrameJacobian(self._model, self._data, q, self._wrist, pinocchio.LOCAL_WORLD_ALIGNED)
        )

    def gravity(self, q: npt.ArrayLike) -> FloatArray:
        """Torques (7, N·m) that hold the arm still against gravity."""
        q = checked_joints(q, "joint angles")
        return self._with_difference(pinocchio.computeGeneralizedGravity(self._model, self._data, q), q)

    @property
    def gravity_mu_kg_m(self) -> FloatArray:
        """Gravity vectors (7, 3) of the bare arm, in DH frames: those in use, identified or worked out from masses."""
        return self._mu.copy()

    def inverse_dynamics(self, q: npt.ArrayLike, v: npt.ArrayLike, a: npt.ArrayLike) -> FloatArray:
        """Torques (7, N·m) for joint velocity `v` (rad/s) and acceleration `a` (rad/s²).

        Gravity, Coriolis and inertia of links, hand, payload and rotors; friction is apart, in `friction`.
        """
        if not _are_joints(q, v, a):
            q = checked_joints(q, "joint angles")
            v = checked_joints(v, "joint velocities")
            a = checked_joints(a, "joint accelerations")
        return self._with_difference(pinocchio.rnea(self._model, self._data, q, v, a), np.asarray(q))

    def _with_difference(self, torque: FloatArray, q: FloatArray) -> FloatArray:
        """A torque of the masses, as the caller's own array, with their gravity replaced by what was identified."""
        if self._gravity_difference is None:
            return np.array(torque)
        return torque + self._gravity_difference.torque(q)

    def mass_matrix(self, q: npt.ArrayLike) -> FloatArray:
        """Joint-space mass matrix (7×7, kg·m²), rotors included."""
        q = checked_joints(q, "joint angles")
        return np.array(pinocchio.crba(self._model, self._data, q, pinocchio.Convention.WORLD))

    def torque_of(self, q: FloatArray, accelerations: FloatArray) -> FloatArray:
        """Torques (7, k) that accelerate the arm from rest without gravity by each column of `accelerations` (7, k,
        rad/s²): the mass matrix times them. For the cycle: `q` is not checked."""
        torque: FloatArray = pinocchio.crba(self._model, self._data, q, pinocchio.Convention.WORLD).dot(accelerations)
        return torque

    def friction(self, v: npt.ArrayLike, direction: Sequence[float]) -> FloatArray:
        """Torques (7, N·m) that overcome joint friction at joint velocity `v` (7, rad/s); `direction` (7), −1 to 1, is
        that of Coulomb friction."""
        return self._friction(checked_joints(v, "joint velocities"), direction)

    def feed_forward(
        self, q: npt.ArrayLike, v: npt.ArrayLike, a: npt.ArrayLike, direction: Sequence[float]
    ) -> FloatArray:
        """Torques (7, N·m) of a commanded motion: inverse dynamics and friction."""
        torque = self.inverse_dynamics(q, v, a)
        torque += self._friction(np.asarray(v, np.float64), direction)
        return torque

    def _friction(self, v: FloatArray, direction: Sequence[float]) -> FloatArray:
        return np.array(
            [
                viscous * speed + coulomb * sign
                for speed, sign, viscous, coulomb in zip(
                    v.tolist(), direction, self._viscous, self._coulomb, strict=True
                )
            ]
        )

    @property
    def payload_fraction(self) -> float:
        """The part of the payload that the arm carries now, 0 to 1."""
        return self._payload_fraction

    def set_payload(self, payload: RigidBody | None) -> None:
        """Take another object into account, from fraction 0. InputError: nothing changes."""
        self._payload = None if payload is None else _checked_body(payload)
        self._set_last_inertia(0.0)

    def set_payload_fraction(self, fraction: float) -> None:
        """Let the arm carry this part (0 to 1) of the payload; ramped by the caller so that torques do not jump."""
        if not 0.0 <= fraction <= 1.0:
            raise InputError(f"payload fraction is {fraction}; expected 0 to 1.")
        if fraction != self._payload_fraction:
            self._set_last_inertia(fraction)

    def _set_last_inertia(self, fraction: float) -> None:
        inertia = self._empty_inertia
        if self._payload is not None and fraction > 0.0:
            mass_kg, com_m, tensor_kgm2 = self._payload
            inertia = inertia + self._at_last_joint(fraction * mass_kg, com_m, fraction * tensor_kgm2)
        self._model.inertias[self._last_joint] = inertia
        self._payload_fraction = fraction

    def _at_last_joint(self, mass_kg: float, com_m: FloatArray, tensor_kgm2: FloatArray) -> Any:
        """Spatial inertia of a body in hand axes, seen from the frame of the last joint."""
        return self._T_last_joint_hand.act(pinocchio.Inertia(mass_kg, com_m, tensor_kgm2))


def _checked_body(body: RigidBody) -> tuple[float, FloatArray, FloatArray]:
    """Mass, centre of mass (3) and inertia about it (3×3) of a body. InputError for what no body has."""
    values = np.array([body.mass_kg, *body.com_m, *body.inertia_kgm2], dtype=np.float64)
    if values.shape != (10,) or not np.isfinite(values).all() or values[0] < 0.0:
        raise InputError(
            f"body has mass, centre of mass and inertia {values.tolist()}; expected a mass ≥ 0 kg, three "
            "coordinates in m and xx yy zz xy xz yz in kg·m², all finite."
        )
    xx, yy, zz, xy, xz, yz = values[4:]
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if np.linalg.eigvalsh(tensor)[0] < -1e-9:
        raise InputError(
            f"body inertia {values[4:].tolist()} is not positive; expected xx yy zz xy xz yz about the centre of "
            "mass with tensor signs. Negate published products of inertia."
        )
    return float(values[0]), values[1:4], tensor


def checked_joints(values: npt.ArrayLike, what: str) -> FloatArray:
    """`values` as a (7) float array; raises InputError on another shape, NaN or infinity."""
    array = values if isinstance(values, np.ndarray) and values.dtype == np.float64 else np.asarray(values, np.float64)
    # A dot product with itself is not finite when an entry is not, at half the cost of isfinite().all().
    if array.shape != (JOINTS,) or not isfinite(array.dot(array)):
        raise InputError(f"{what} are {array.tolist()}; expected {JOINTS} finite values.")
    return array


def _are_joints(*vectors: object) -> bool:
    """Whether all are (7) float arrays of finite numbers: three of them in the time that one takes by itself."""
    total = 0.0
    for vector in vectors:
        if not isinstance(vector, np.ndarray) or vector.dtype != np.float64 or vector.shape != (JOINTS,):
            return False
        total += vector.dot(vector)
    return isfinite(total)


def checked_pose(pose: npt.ArrayLike | None, what: str) -> FloatArray:
    """A copy of `pose` as a rigid 4×4 transform, identity for None; raises InputError when it is not one."""
    if pose is None:
        return np.eye(4)
    T = np.array(pose, dtype=np.float64)
    rigid = (
        T.shape == (4, 4)
        and bool(np.isfinite(T).all())
        and np.array_equal(T[3], (0.0, 0.0, 0.0, 1.0))
        and float(np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max()) < 1e-6
        and float(np.linalg.det(T[:3, :3])) > 0.0
    )
    if not rigid:
        raise InputError(f"{what} is {T.tolist()}; expected a 4×4 homogeneous transform with a proper rotation.")
    return T


def _se3(T: FloatArray) -> Any:
    return pinocchio.SE3(T[:3, :3], T[:3, 3])


def _load_urdf(T_world_base: FloatArray, rotor_inertia_kgm2: FloatArray) -> Any:
    """The Pinocchio model with its base placed in the world, so that poses come out in world axes."""
    model = pinocchio.buildModelFromXML((files("drivers.wam") / "wam7.urdf").read_text(encoding="utf-8"))
    if model.nq != JOINTS or rotor_inertia_kgm2.shape != (JOINTS,):
        raise InputError(
            f"arm model has {model.nq} joints, rotor inertias have shape {rotor_inertia_kgm2.shape}; expected {JOINTS}."
        )
    model.jointPlacements[1] = _se3(T_world_base) * model.jointPlacements[1]
    model.gravity.linear = np.array([0.0, 0.0, -GRAVITY_M_S2])
    model.armature = rotor_inertia_kgm2
    return model


def _frame_id(model: Any, name: str) -> int:
    # getFrameId answers an unknown name with an index past the end, which then corrupts memory.
    if not model.existFrame(name):
        raise InputError(f"arm model has no frame {name!r}; expected it as a link of drivers/wam/wam7.urdf.")
    return int(model.getFrameId(name))
