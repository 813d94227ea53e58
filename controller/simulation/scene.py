"""What stands in front of the simulated robot: which object, where, and how the arm stands when all begins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.hand.parameters import Hand
from calibration.objects.parameters import load_object
from calibration.tactile_file import SIDES
from controller.config import RobotConfig, Tactile
from controller.service.tactile_assembly import configured_cells
from controller.simulation.world import World
from controller.simulation.world_model import Imperfections
from drivers.dynamixel.control_tables import XM430_W350, model_by_name
from drivers.simulated.dynamixel import SimulatedMotors, SimulatedMotorSettings
from drivers.simulated.dynamixel_electrics import electrics_of
from drivers.simulated.faults import FaultScript
from drivers.simulated.serial_fault_actions import SerialAction
from drivers.simulated.takktile import SimulatedCell, SimulatedTakktile, uneven
from drivers.simulated.takktile_fault_actions import TakktileAction
from drivers.simulated.wam import SimulatedWam
from drivers.wam.parameters import load_wam_parameters

READY_RAD = (0.0, 0.1, 0.0, 2.3, 0.0, -0.8, 0.0)
"""A pose clear of everything, elbow up, from which the demo starts."""


@dataclass(frozen=True)
class Scene:
    """An object (name or file) whose section's centre stands at `object_xyz_m`, turned by `object_yaw_rad`, on its own
    support; its outline is turned by `outline_angle_rad` more, as first contact places it in the hand. The arm stands
    at `joint_rad` (7, rad). `seed` draws the arm's imperfections and the noise of the motors' current or load, of which
    `motor_noise_counts` is the standard deviation. `motor_effort_offset`: what right and left motor tell too much of
    their effort while they pull in, A (XM430) or part of full output; it grows by `motor_effort_drift_per_s`.
    `hand`: the hand as it truly is, where it is not as the installation believes. `spool_zero_error_m`: how much more
    than is wound in the right and left motor tell, to the next tick."""

    object: str = "cylinder40"
    object_xyz_m: tuple[float, float, float] = (0.80, 0.0, 0.55)
    object_yaw_rad: float = 0.0
    outline_angle_rad: float = 0.0
    joint_rad: tuple[float, ...] = READY_RAD
    seed: int = 0
    motor_noise_counts: float = 0.0
    motor_effort_offset: tuple[float, float] = (0.0, 0.0)
    motor_effort_drift_per_s: tuple[float, float] = (0.0, 0.0)
    hand: Hand | None = None
    spool_zero_error_m: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Devices:
    """A world with the simulated devices in front of it."""

    world: World
    wam: SimulatedWam
    motors: SimulatedMotors
    pads: SimulatedTakktile | None = None


def build_devices(
    config: RobotConfig,
    hand: Hand,
    scene: Scene,
    *,
    start_ns: int = 0,
    zeroed: bool = True,
    motor_faults: FaultScript[SerialAction] | None = None,
    pad_faults: FaultScript[TakktileAction] | None = None,
) -> Devices:
    """World, arm and tendon motors for one scene. `zeroed`: the pucks remember the arm's positions.

    The motors are those of `tendons.model`, without it XM430-W350; `motor_faults` is what goes wrong with them,
    `pad_faults` with the tactile pads, where there are some.
    """
    parameters = load_wam_parameters()
    model = XM430_W350 if config.tendons.model is None else model_by_name(config.tendons.model)
    cos, sin = np.cos(scene.object_yaw_rad), np.sin(scene.object_yaw_rad)
    T_world_object = np.array([[cos, -sin, 0, 0], [sin, cos, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], dtype=np.float64)
    T_world_object[:3, 3] = scene.object_xyz_m
    world = World(
        scene.hand or hand,
        load_object(scene.object),
        parameters,
        T_world_base=config.T_world_base,
        T_wrist_hand=config.T_wrist_hand,
        T_world_object=T_world_object,
        joint_rad=scene.joint_rad,
        seed=scene.seed,
        imperfections=Imperfections(gear_friction_Nm=round(electrics_of(model).gear_friction_Nm, 3)),
        outline_angle_rad=scene.outline_angle_rad,
        spool_radius_m=config.tendons.right.spool_radius_m,
        start_ns=start_ns,
    )
    motors = SimulatedMotors(
        world,
        [
            SimulatedMotorSettings(
                motor.id,
                motor.zero_ticks
                + motor.tightening_sign * round(zero_error_m / (motor.spool_radius_m * model.tick_rad)),
                motor.tightening_sign,
                model,
                effort_offset=offset,
                effort_drift_per_s=drift_per_s,
            )
            for motor, offset, drift_per_s, zero_error_m in zip(
                (config.tendons.right, config.tendons.left),
                scene.motor_effort_offset,
                scene.motor_effort_drift_per_s,
                scene.spool_zero_error_m,
                strict=True,
            )
        ],
        baud=config.tendons.baud,
        noise_counts=scene.motor_noise_counts,
        seed=scene.seed,
        faults=motor_faults,
        start_ns=start_ns,
    )
    period_s = world.physics_period_ns * 1e-9
    world.call_before_each_step(lambda now_ns: motors.control(now_ns, period_s))
    pads = None if config.tactile is None else _pads(config.tactile, world, scene.seed, pad_faults, start_ns)
    return Devices(world, SimulatedWam(world, parameters, zeroed=zeroed), motors, pads)


def _pads(
    tactile: Tactile, world: World, seed: int, faults: FaultScript[TakktileAction] | None, start_ns: int
) -> SimulatedTakktile:
    """The configured cells, no two alike, each bearing its share of its fingertip's force."""
    cells = [
        SimulatedCell(cell, finger, share=1.0 / len(mapped))
        for finger, mapped in enumerate(configured_cells(tactile, side) for side in SIDES)
        for cell in mapped
    ]
    return SimulatedTakktile(world.fingertip_force_N, uneven(cells, seed), seed=seed, faults=faults, start_ns=start_ns)
