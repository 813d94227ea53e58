"""Puts the parts together from the configuration: the same for the processes and for virtual time."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from calibration.hand.parameters import Hand, load_hand
from controller.config import FASTEST_CLOSING_M_S, RobotConfig, TendonMotor, Tendons
from controller.cycle.arm_model import ArmFriction, ArmModel, RigidBody
from controller.cycle.arm_motion import ArmMotion, ArmMotionLimits
from controller.cycle.compensation import OffsetLimits, OffsetSmoother, WristOffset
from controller.cycle.contact_search import SearchSettings
from controller.cycle.cycle import CycleSettings, Parts
from controller.cycle.grasping import Grasping, GraspSettings
from controller.cycle.inverse_kinematics import DifferentialInverseKinematics
from controller.cycle.joint_bounds import JointLimits
from controller.cycle.joint_control import JointControl
from controller.cycle.joint_gains import TorqueLimits, preset_gains
from controller.cycle.motion_index import IndexSettings
from controller.cycle.motor_drive import MotorDrive
from controller.cycle.orders import Orders
from controller.cycle.safety import SafetyLimits, SafetyMonitor
from controller.cycle.soft_limits import SoftLimits
from controller.cycle.winding import WindingLimits
from controller.messages import CompensationIndex
from controller.service.hand import HandSettings
from drivers.clock import Clock
from drivers.dynamixel.control_tables import XM430_W350, model_by_name
from drivers.dynamixel.load_law import LoadLaw, current_law, nominal_law
from drivers.dynamixel.position_loop import position_loop
from drivers.dynamixel.settings import MotorSettings
from drivers.errors import ConfigurationError
from drivers.wam.arm import Arm
from drivers.wam.bus import CanBus
from drivers.wam.parameters import WamParameters, load_wam_parameters

SILENT_OF_AGE = 0.7
COARSE_TICK_M = 3e-5
"""Between the RX-28's ticks on a T42's spool, 54 µm, and all others', 16 µm."""
INDEX_NAMES = {
    "excursion": CompensationIndex.EXCURSION,
    "load": CompensationIndex.LOAD,
    "fused": CompensationIndex.FUSED,
}

CONTACT_DEVIATION_M = 5e-5
"""Standard deviation of the contact that is found, beside the motor's tick."""
ONSET_DEVIATION_N = 1.5
"""Of the load that is taken for contact's, beside what the motor's tick is worth: a support's drag comes and goes."""
LEAST_NOISE_N = 1.0
"""Of one sample of the load."""
SPRINGS_DEVIATION = 0.1
"""Relative, of the finger springs' stiffness, as far as it is not yet in the load law's."""


def configured_hand(config: RobotConfig) -> Hand:
    """The hand that the installation names."""
    return load_hand(config.hand.source, preset=config.hand.preset)


def arm_parameters(config: RobotConfig) -> WamParameters:
    """The arm's numbers, with what was measured on this one. ConfigurationError."""
    own_file = config.arm.own_file
    return load_wam_parameters(own=None if own_file is None else Path(own_file))


def arm_model(config: RobotConfig, hand: Hand) -> ArmModel:
    """The arm as mounted, with the hand's body on it."""
    parameters = arm_parameters(config)
    friction = config.arm.friction
    viscous = friction.viscous_Nms_per_rad or tuple(float(v) for v in parameters.viscous_friction_Nms_per_rad)
    body: RigidBody = hand.body
    return ArmModel(
        hand=body,
        T_wrist_hand=config.T_wrist_hand,
        T_world_base=config.T_world_base,
        parameters=parameters,
        friction=ArmFriction(viscous, friction.coulomb_Nm, friction.turnover_rad),
    )


def joint_limits(config: RobotConfig, parameters: WamParameters) -> JointLimits:
    """Limits of the commanded motion: the installation's, else the arm's own."""
    limits = config.arm.limits
    return JointLimits(
        np.array(limits.lower_rad or parameters.joint_lower_rad),
        np.array(limits.upper_rad or parameters.joint_upper_rad),
        np.array(limits.velocity_rad_s),
        np.array(limits.acceleration_rad_s2),
    )


def torque_limits(config: RobotConfig, parameters: WamParameters) -> TorqueLimits:
    """Limits of the joint torques: the arm's own, or lower ones of the installation."""
    limits = config.arm.limits
    return TorqueLimits.from_parameters(
        parameters, torque_Nm=limits.torque_Nm, rate_Nm_per_s=limits.torque_rate_Nm_per_s
    )


def cycle_parts(config: RobotConfig, bus: CanBus, clock: Clock) -> Parts:
    """Everything that runs in the cycle."""
    parameters = arm_parameters(config)
    hand = configured_hand(config)
    model = arm_model(config, hand)
    period_s = config.cycle.period_s
    arm_limits, compensation, squeeze = config.arm.limits, config.compensation, config.squeeze
    limits = joint_limits(config, parameters)
    chosen = config.arm.gains
    gains = preset_gains(
        chosen.preset,
        kp_Nm_per_rad=chosen.kp_Nm_per_rad,
        ki_Nm_per_rad_s=chosen.ki_Nm_per_rad_s,
        kd_Nms_per_rad=chosen.kd_Nms_per_rad,
    )
    kinematics = DifferentialInverseKinematics(model, limits, period_s, parameters.home_rad)
    path_limits = ArmMotionLimits(
        joint_velocity_rad_s=arm_limits.velocity_rad_s,
        joint_acceleration_rad_s2=tuple(0.8 * a for a in arm_limits.acceleration_rad_s2),
        joint_jerk_rad_s3=tuple(8.0 * a for a in arm_limits.acceleration_rad_s2),
    )
    motion = ArmMotion(model, kinematics, WristOffset(config.T_wrist_hand), period_s, path_limits)
    grasping = Grasping(
        period_s,
        GraspSettings(
            closing_rate_m_s=squeeze.closing_rate_m_s,
            load_cap_N=squeeze.load_cap_N,
            drives=motor_drives(config),
            search=SearchSettings(load_lag_s=config.tendons.effort_filter_s),
            index=index_settings(config),
            squeezing_rate_m_s=max(squeeze.closing_rate_m_s, squeeze.squeeze_rate_m_s),
            winding=WindingLimits(FASTEST_CLOSING_M_S, squeeze.acceleration_m_s2, squeeze.jerk_m_s3),
        ),
    )
    grasping.index_kind = INDEX_NAMES[index_name(config)]
    orders = Orders(motion, grasping)
    orders.compensation = compensation.enabled
    offset_limits = OffsetLimits(
        (compensation.velocity_m_s,) * 2 + (compensation.velocity_rad_s,),
        (compensation.acceleration_m_s2,) * 2 + (compensation.acceleration_rad_s2,),
        (compensation.jerk_m_s3,) * 2 + (compensation.jerk_rad_s3,),
    )
    return Parts(
        arm=Arm(bus, clock, parameters),
        model=model,
        motion=motion,
        control=JointControl(model, gains, torque_limits(config, parameters), SoftLimits(limits, period_s)),
        grasping=grasping,
        orders=orders,
        smoother=OffsetSmoother(period_s, offset_limits),
        safety=SafetyMonitor(safety_limits(config), period_s),
        settings=CycleSettings(period_s=period_s),
    )


def safety_limits(config: RobotConfig) -> SafetyLimits:
    """Beyond what the cycle stops."""
    return SafetyLimits(
        tracking_error_rad=config.safety.tracking_error_rad,
        torque_residual_Nm=config.safety.torque_residual_Nm,
        hand_age_s=config.safety.hand_age_s,
        offset_m=config.compensation.max_offset_m,
        offset_rad=config.compensation.max_offset_rad,
    )


def motor_drives(config: RobotConfig) -> tuple[MotorDrive, MotorDrive]:
    """How the position loops of both configured motors, right and left, give way: their model's, or as measured."""
    tendons = config.tendons
    return _motor_drive(tendons, tendons.right), _motor_drive(tendons, tendons.left)


def index_name(config: RobotConfig) -> str:
    """The index that the installation goes by. "auto": fused, as no hand file knows its tendons' stiffness well; but
    excursion with tendons that do not stretch, of which the load knows nothing better, and with motors whose ticks are
    so coarse that they beat against the samples and show a wrong load (docs/index.md)."""
    if config.compensation.index != "auto":
        return config.compensation.index
    elastic = any(math.isfinite(finger.tendon_stiffness_N_per_m) for finger in configured_hand(config).fingers)
    coarse = index_settings(config).tick_m > COARSE_TICK_M
    return "fused" if elastic and not coarse else "excursion"


def index_settings(config: RobotConfig) -> IndexSettings:
    """How far excursion and load of the configured motors are trusted: the worse of both counts."""
    tendons = config.tendons
    motors = _motor(tendons, tendons.right), _motor(tendons, tendons.left)
    loops = [position_loop(settings, settings.expected_model or XM430_W350) for settings in motors]
    tick_m = max(loop.resolution_m for loop in loops)
    tick_N = max(loop.resolution_m / loop.compliance_m_per_N for loop in loops)  # the output's step from tick to tick
    slope = max(settings.load_law.slope_uncertainty for settings in motors)
    return IndexSettings(
        tick_m=tick_m,
        tension_lag_s=tendons.effort_filter_s,
        contact_deviation_m=math.hypot(CONTACT_DEVIATION_M, tick_m / math.sqrt(12.0)),
        stiffness_deviation=config.compensation.tendon_stiffness_uncertainty,
        scale_deviation=math.hypot(slope, SPRINGS_DEVIATION),
        onset_deviation_N=math.hypot(ONSET_DEVIATION_N, tick_N / math.sqrt(12.0)),
        noise_N=max(tick_N, LEAST_NOISE_N),
    )


def _motor_drive(tendons: Tendons, motor: TendonMotor) -> MotorDrive:
    settings = _motor(tendons, motor)
    loop = position_loop(settings, settings.expected_model or XM430_W350)
    return MotorDrive(
        loop.compliance_m_per_N if tendons.compliance_m_per_N is None else tendons.compliance_m_per_N,
        settings.load_law.friction_tension_N,
        loop.lag_s if tendons.lag_s is None else tendons.lag_s,
        loop.dead_m,
    )


def tendon_motors(config: RobotConfig) -> tuple[MotorSettings, MotorSettings]:
    """Settings of both tendon motors, right and left. ConfigurationError if they were not measured as the file says."""
    own_file = config.tendons.own_file
    if own_file is not None and not Path(own_file).exists():
        raise ConfigurationError(
            own_file, "file", "No such file", "what `stillgrasp calibrate motors` writes, or no tendons.own_file"
        )
    return _motor(config.tendons, config.tendons.right), _motor(config.tendons, config.tendons.left)


def hand_settings(config: RobotConfig) -> HandSettings:
    """How the hand process runs. It tells a silent motor before the cycle would miss its samples."""
    return HandSettings(
        period_s=config.tendons.poll_period_s,
        opening_rate_m_s=config.squeeze.closing_rate_m_s,
        silent_for_fault_s=SILENT_OF_AGE * config.safety.hand_age_s,
    )


def _motor(tendons: Tendons, motor: TendonMotor) -> MotorSettings:
    return MotorSettings(
        motor_id=motor.id,
        tightening_sign=motor.tightening_sign,
        zero_ticks=motor.zero_ticks,
        spool_radius_m=motor.spool_radius_m,
        load_law=_load_law(tendons, motor),
        model=tendons.model,
        travel_m=motor.travel_m,
        position_gain=motor.position_gain,
        holding_cap_N=tendons.holding_cap_N,
        watchdog_s=tendons.watchdog_s,
        derating_start_C=tendons.derating_start_C,
        derating_per_K=tendons.derating_per_K,
        stall_timeout_s=tendons.stall_timeout_s,
        calibrated=None if motor.calibrated is None else motor.calibrated.provenance(),
        effort_filter_s=tendons.effort_filter_s,
    )


def _load_law(tendons: Tendons, motor: TendonMotor) -> LoadLaw:
    """By current, or by load where the configured model tells that; narrower where it was calibrated."""
    model = XM430_W350 if tendons.model is None else model_by_name(tendons.model)
    if model.effort == "load":
        law = nominal_law(
            model,
            motor.spool_radius_m,
            stall_torque_Nm=motor.stall_torque_12V_Nm,
            friction_load=motor.friction_load,
        )
        if motor.back_emf_load_s_per_m is not None:
            law = replace(law, back_emf_effort_s_per_m=motor.back_emf_load_s_per_m)
    else:
        law = current_law(
            model,
            motor.spool_radius_m,
            torque_constant_Nm_per_A=motor.torque_constant_Nm_per_A,
            friction_current_A=motor.friction_current_A,
        )
    calibrated = motor.calibrated
    if calibrated is None:
        return law
    return replace(
        law,
        slope_uncertainty=calibrated.slope_uncertainty,
        friction_uncertainty=calibrated.friction_uncertainty_N * law.spool_radius_m / law.torque_per_effort_Nm,
        temperature_C=calibrated.temperature_C,
        scatter_N=calibrated.scatter_N,
    )
