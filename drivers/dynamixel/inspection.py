"""How a tendon motor is before it is driven: what is read of it, and whether it may serve. Nothing is written.

What has to be so is in `startup_checks.py`. A motor that does not hold is refused for what is wrong with it; one that
holds already is taken over with warnings, or, where the driver does not know which way it would turn it, left as it is
(`MotorIdentity.refusal`). Source: dynamixel reference 2.2, 2.3, 6.2, 8; design 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from drivers.dynamixel.bus import ATTEMPTS, MotorBus, persistently
from drivers.dynamixel.control_tables import (
    EXTENDED_POSITION_MODE,
    POSITION_MODE,
    MotorModel,
    model_by_number,
)
from drivers.dynamixel.motor_access import MotorAccess
from drivers.dynamixel.settings import MotorSettings
from drivers.dynamixel.startup_checks import (
    TORQUE_BY_GOAL,
    Consequence,
    Finding,
    check_calibration,
    check_drive_mode,
    check_return_delay,
    check_secondary_id,
    check_shutdown,
    check_temperature_limit,
    check_travel,
    check_zero,
    error_names,
    shutdown_to_be,
    shuts_down_on,
)
from drivers.errors import NoReplyError, ProtocolError

_CLEAN_READS = 4


@dataclass(frozen=True, slots=True)
class MotorIdentity:
    """What answered: for the log and for the calibration's provenance."""

    motor_id: int
    model_number: int
    model_name: str
    protocol: int
    firmware: int
    adopted: bool
    """True if it held already when it was found."""
    refusal: str = ""
    """Why it takes no set-points, though it holds: its mode winds no tendon, or its sign or zero are not known."""
    warnings: tuple[str, ...] = ()
    """What the operator should know; each reads after the motor's name."""
    shuts_down_on: str = ""
    """For which hardware errors it lets go."""


@dataclass(frozen=True, slots=True)
class Inspection:
    """What `inspect` found; nothing was written."""

    identity: MotorIdentity
    position_ticks: int
    ceiling_limit: int
    """Highest value of the ceiling register, counts."""
    goal_range: tuple[int, int]
    """Goal positions that the motor takes."""
    may_pay_out: bool
    """It follows goals; a motor with a refusal may at least be loosened."""
    supply_V: float = 12.0
    goal_switches_on: bool = False
    """A goal that is written to it switches its torque on."""
    wraps_ticks: int = 0
    """Its position begins anew after so many; 0: never."""
    watchdog_s: float = 0.0
    """Bus silence after which it shall stop and hold; 0 = never, or it cannot."""


def inspect(motor: MotorAccess, settings: MotorSettings) -> Inspection:
    """Read how the motor is. DeviceError if it cannot serve as a tendon motor; writes nothing."""
    answer = persistently(lambda: motor.bus.ping(motor.motor_id))
    _check_model(motor, answer.model_number)
    _check_alone(motor)
    holds = motor.read("torque_enable") == 1
    check_hardware(motor, holds)
    model, shutdown = motor.model, motor.read("shutdown")
    findings = check_shutdown(model, shutdown, holds)
    findings += check_return_delay(model, motor.read("return_delay_time"), holds)
    findings += check_temperature_limit(settings, model, motor.read("temperature_limit"))
    goal_switches_on = model.protocol == 1
    wraps_ticks, watchdog_s = 0, 0.0
    if model.protocol == 2:
        drive_mode = motor.read("drive_mode")
        findings += check_drive_mode(drive_mode, holds)
        findings += check_secondary_id(motor.read("secondary_id"), holds)
        unwatched = _check_watchdog(motor, settings, answer.firmware)
        findings += unwatched
        watchdog_s = 0.0 if unwatched else settings.watchdog_s
        goal_switches_on = holds and bool(drive_mode & TORQUE_BY_GOAL)
        refusal, goal_range, may_pay_out = _mode(motor, holds)
        limit = motor.read("current_limit" if model.has_current_modes else "pwm_limit")
    else:
        refusal, goal_range, may_pay_out = _angle_mode(motor, holds)
        limit = motor.read("max_torque")
        if "multi_turn_offset" in model.registers and goal_range[0] >= 0:
            wraps_ticks = model.ticks_per_revolution
    identity = MotorIdentity(
        motor.motor_id,
        model.number,
        model.name,
        model.protocol,
        answer.firmware,
        holds,
        refusal,
        shuts_down_on=shuts_down_on(model, shutdown if holds else shutdown_to_be(model, shutdown)),
    )
    found = Inspection(
        identity,
        motor.steady_position(),
        limit,
        goal_range,
        may_pay_out,
        motor.read("present_input_voltage") * model.voltage_unit_V,
        goal_switches_on,
        wraps_ticks,
        watchdog_s,
    )
    return _admitted(motor, found, findings)


def check_mounting(motor: MotorAccess, settings: MotorSettings, found: Inspection) -> Inspection:
    """Whether zero, travel and load law are this motor's; with what was found in `refusal` and `warnings`.

    DeviceError for a motor that does not hold yet.
    """
    model = motor.model
    findings = check_zero(settings, model, found.position_ticks)
    if not findings:
        findings = check_travel(settings, model, found.goal_range)
    findings += check_calibration(settings, model, found.identity.firmware, found.supply_V)
    return _admitted(motor, found, findings)


def _check_model(motor: MotorAccess, number: int) -> None:
    if number != motor.model.number:
        found = model_by_number(number).name
        raise motor.error(
            f"is a {found}; expected a {motor.model.name}.",
            "Both motors must be of one model, and of the one that was calibrated: see tendons in robot.toml.",
        )


def _check_alone(motor: MotorAccess) -> None:
    if not is_alone(motor.bus, motor.motor_id, motor.model):
        raise motor.error(
            "does not seem to be alone: its answers are damaged, come twice, or too late.",
            "Two motors have this id, the cable is bad, or the adapter keeps answers back (its latency timer should be "
            "1 ms). Connect one motor at a time and give each its own id.",
        )


def check_hardware(motor: MotorAccess, holds: bool) -> None:
    """DeviceError for one that let go because of a hardware error."""
    if motor.model.protocol == 2:
        error, tripped = motor.read("hardware_error_status"), not holds
    else:
        status = motor.status("torque_limit")
        error, tripped = status.alarms, not any(status.parameters)
    if error and tripped:
        raise motor.error(
            f"reports a hardware error: {hardware_error_text(error)}. It lets go of its tendon.",
            "Remove the cause and secure the object; then `stillgrasp calibrate motors --reboot "
            f"{motor.motor_id}`, or switch its power off and on.",
        )


def _check_watchdog(motor: MotorAccess, settings: MotorSettings, firmware: int) -> list[Finding]:
    """Firmware without a watchdog, or with one that is no good: an adopted motor then goes without."""
    needed, findings = motor.model.watchdog_firmware, []
    if needed and firmware < needed and settings.watchdog_s > 0:
        text = f"has firmware {firmware}; the bus watchdog needs {needed}."
        findings.append(Finding(Consequence.REFUSED, text, "Update the firmware, or set the watchdog to 0."))
    if offset := motor.read("homing_offset"):
        text = f"has Homing Offset {offset}; expected 0 (a tripped watchdog misplaces the goal with it)."
        findings.append(Finding(Consequence.REFUSED, text, "Set it to 0 and calibrate zero_ticks again."))
    return findings


def _admitted(motor: MotorAccess, found: Inspection, findings: Sequence[Finding]) -> Inspection:
    """With the findings in the identity; DeviceError where the motor does not hold and may not be started."""
    identity, refusal, warnings = found.identity, found.identity.refusal, list(found.identity.warnings)
    may_pay_out = found.may_pay_out
    for finding in findings:
        if finding.consequence is not Consequence.WARNED and not identity.adopted:
            raise motor.error(finding.text, finding.help)
        if finding.consequence is Consequence.UNDRIVEN:
            refusal, may_pay_out = refusal or finding.sentence, False
        else:
            warnings.append(finding.sentence)
    identity = replace(identity, refusal=refusal, warnings=tuple(warnings))
    return replace(found, identity=identity, may_pay_out=may_pay_out)


def _mode(motor: MotorAccess, holds: bool) -> tuple[str, tuple[int, int], bool]:
    goal = motor.model.registers["goal_position"]
    mode, wanted = motor.read("operating_mode"), motor.model.position_modes
    whole = (goal.minimum, goal.maximum)
    if not holds:
        return "", whole, True
    if mode == POSITION_MODE:
        whole = (motor.read("min_position_limit"), motor.read("max_position_limit"))
    if mode in wanted:
        return "", whole, True
    refusal = (
        f"holds in operating mode {mode}, and tendons are wound in mode {wanted[0]}; changing it would let go of "
        "what is held. Open the hand or secure the object, switch the motors off and start again."
    )
    return refusal, whole, mode in (POSITION_MODE, EXTENDED_POSITION_MODE)


def _angle_mode(motor: MotorAccess, holds: bool) -> tuple[str, tuple[int, int], bool]:
    """Protocol 1.0 has no mode register: both limits 0 is a wheel, both at the end turns many times (MX)."""
    goal = motor.model.registers["goal_position"]
    lower, upper = motor.read("cw_angle_limit"), motor.read("ccw_angle_limit")
    full = motor.model.registers["ccw_angle_limit"].maximum
    if lower == upper == full and goal.minimum < 0:
        return "", (goal.minimum, goal.maximum), True
    if lower == upper == 0:
        if not holds:
            return "", (0, full), True
        refusal = (
            "holds as a wheel (both angle limits 0), and changing that would let go. Secure the object, switch the "
            "motors off and start again."
        )
        return refusal, (0, 0), False
    return "", (lower, upper), True


def is_alone(bus: MotorBus, motor_id: int, model: MotorModel) -> bool:
    """Whether one motor answers to this id. Two answer a ping alike, but a position into each other's words; or one
    after the other, if their delays differ. They do so always: what a pause of this machine made late comes in time
    when it is asked again. NoReplyError, BusError."""
    return any(_answers_cleanly(bus, motor_id, model) for _ in range(ATTEMPTS))


def _answers_cleanly(bus: MotorBus, motor_id: int, model: MotorModel) -> bool:
    register = model.registers["present_position"]
    damaged, silence = 0, []
    for _ in range(_CLEAN_READS):
        try:
            bus.read(motor_id, register.address, register.size)
        except NoReplyError as error:
            silence.append(error)
        except ProtocolError:
            damaged += 1
    if len(silence) == _CLEAN_READS:
        raise silence[0]
    return damaged <= 1 and not bus.surplus()


def hardware_error_text(bits: int) -> str:
    """Names of the error's bits."""
    return error_names(bits) or str(bits)
