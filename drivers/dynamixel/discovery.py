"""Which motors are on a line: the ones that are wanted, or, in a scan, all of them at every usual baud rate.

Pure questions: nothing is written. Source: dynamixel reference 1.2, 2.1, 5.5, 8.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from drivers.clock import Clock, MonotonicClock
from drivers.dynamixel.bus import ATTEMPTS, MotorBus, PingAnswer, motor_name, persistently
from drivers.dynamixel.byte_line import ByteLine, SerialLine
from drivers.dynamixel.control_tables import MODELS, MotorModel, model_by_number
from drivers.dynamixel.motor import TendonMotor, is_alone
from drivers.dynamixel.port import WaitingPort
from drivers.dynamixel.protocol1_bus import Protocol1Bus
from drivers.dynamixel.protocol2_bus import Protocol2Bus
from drivers.dynamixel.settings import MotorSettings
from drivers.errors import BusError, DeviceError, InputError, NoReplyError, ProtocolError

SCAN_BAUDS = (57_600, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 115_200)
PROTOCOLS = (2, 1)
SCAN_ATTEMPTS = 2
"""Nearly every question of a scan meets silence, and each costs two margins."""
SCAN_ADVICE = (
    "Check power and cable; `stillgrasp calibrate motors --scan` looks for motors of other ids and baud rates."
)


@dataclass(frozen=True, slots=True)
class FoundMotor:
    """One motor that answered a scan."""

    baud: int
    protocol: int
    motor_id: int
    model_number: int | None
    """None if no intact answer came: two motors with one id, or the wrong baud rate."""
    model_name: str
    firmware: int | None
    alert: bool
    shared_id: bool
    """More than one motor seems to answer to this id."""


@dataclass(frozen=True, slots=True)
class FoundPair:
    """The bus on which both wanted motors answer, and their one model."""

    bus: MotorBus
    model: MotorModel


def motor_bus(protocol: int, port: WaitingPort) -> MotorBus:
    """A bus of protocol 1 or 2 on this port. InputError."""
    if protocol not in PROTOCOLS:
        raise InputError(f"protocol = {protocol}; expected 1 or 2.")
    return Protocol2Bus(port) if protocol == 2 else Protocol1Bus(port)


def reply_margin_s(latency_timer_ms: int | None) -> float:
    """How much later than the wire allows an answer may come: what the adapter keeps it back, and 3 ms."""
    return 1e-3 * (3 + max(1, latency_timer_ms or 1))


def find_pair(port: WaitingPort, settings: tuple[MotorSettings, MotorSettings]) -> FoundPair:
    """Find both motors. DeviceError that says which is missing, of which model, or of which protocol."""
    expected = [motor.expected_model for motor in settings]
    if expected[0] is not None and expected[1] is not None and expected[0] is not expected[1]:
        raise InputError(
            f"tendon motors are said to be a {expected[0].name} and a {expected[1].name}; expected two of one model."
        )
    wanted = expected[0] or expected[1]
    order = PROTOCOLS if wanted is None or wanted.protocol == 2 else PROTOCOLS[::-1]
    for protocol in order:
        bus = motor_bus(protocol, port)
        found = [_ask(bus, motor.motor_id) for motor in settings]
        if any(found):
            break
    else:
        ids = " and ".join(str(motor.motor_id) for motor in settings)
        raise NoReplyError(
            f"tendon motors {ids}", f"no reply at {port.getBaudRate()} bit/s, in either protocol.", help=SCAN_ADVICE
        )
    for answer, motor in zip(found, settings, strict=True):
        if answer is None:
            raise _missing(motor.motor_id, bus, port)
    models = [_model(answer, motor) for answer, motor in zip(found, settings, strict=True) if answer is not None]
    for model, motor in zip(models, settings, strict=True):
        if wanted is not None and model is not wanted:
            raise DeviceError(
                motor_name(motor.motor_id),
                f"is a {model.name}; expected a {wanted.name}, as it was calibrated.",
                help="Fit that model, or calibrate this one: `stillgrasp calibrate motors`.",
            )
    if models[0] is not models[1]:
        raise DeviceError(
            "tendon motors",
            f"are a {models[0].name} and a {models[1].name}; expected two of one model.",
            help="A group read needs the same registers in both: fit two motors of one model.",
        )
    return FoundPair(bus, models[0])


def scan(
    port_path: str,
    *,
    bauds: Iterable[int] = SCAN_BAUDS,
    protocols: Iterable[int] = PROTOCOLS,
    motor_ids: Iterable[int] = range(254),
    clock: Clock | None = None,
    open_line: Callable[[str, int], ByteLine] = SerialLine,
    progress: Callable[[int, int], None] = lambda baud, protocol: None,
) -> list[FoundMotor]:
    """Ask every id in both protocols at every baud rate; `progress(baud, protocol)` is called before each round.

    About a minute for all of it. Raises BusError if the port cannot be opened, InputError.
    """
    protocols, motor_ids = tuple(protocols), tuple(motor_ids)
    clock = clock or MonotonicClock()
    found: list[FoundMotor] = []
    for baud in bauds:
        line = open_line(port_path, baud)
        try:
            latency_ms = line.latency_timer_ms if isinstance(line, SerialLine) else None
            port = WaitingPort(line, clock, baud=baud, reply_margin_s=reply_margin_s(latency_ms))
            for protocol in protocols:
                progress(baud, protocol)
                bus = motor_bus(protocol, port)
                for motor_id in motor_ids:
                    if motor_id <= bus.maximum_id and (motor := _found(bus, motor_id, baud)) is not None:
                        found.append(motor)
        finally:
            line.close()
    return found


def reboot(port: WaitingPort, clock: Clock, motor_id: int) -> MotorModel:
    """Clear the hardware error of the motor with this id, whatever its protocol; it lets go. Its model. DeviceError."""
    for protocol in PROTOCOLS:
        bus = motor_bus(protocol, port)
        if (answer := _ask(bus, motor_id)) is not None:
            settings = MotorSettings(motor_id, tightening_sign=1, zero_ticks=0)
            motor = TendonMotor(bus, settings, _model(answer, settings))
            motor.reboot(clock)
            return motor.model
    raise NoReplyError(motor_name(motor_id), f"no reply at {port.getBaudRate()} bit/s.", help=SCAN_ADVICE)


def _ask(bus: MotorBus, motor_id: int, attempts: int = ATTEMPTS) -> PingAnswer | None:
    """A ping; None if there is silence. ProtocolError for damage that comes again."""
    if motor_id > bus.maximum_id:
        return None
    try:
        return persistently(lambda: bus.ping(motor_id), attempts)
    except NoReplyError:
        return None
    except ProtocolError as error:
        raise ProtocolError(
            error.device,
            error.message.split(": ", 1)[-1],
            help="Two motors may have this id, or the cable is bad: connect one motor at a time.",
        ) from error


def _missing(motor_id: int, bus: MotorBus, port: WaitingPort) -> DeviceError:
    """Why one of two is missing: the other protocol, or nothing at all."""
    other = motor_bus(3 - bus.protocol, port)
    if _ask(other, motor_id) is not None:
        return DeviceError(
            motor_name(motor_id),
            f"speaks protocol {other.protocol}.0, and the other motor protocol {bus.protocol}.0.",
            help="Fit two motors of one model and protocol.",
        )
    return NoReplyError(
        motor_name(motor_id),
        f"no reply at {port.getBaudRate()} bit/s, protocol {bus.protocol}.0; the other motor answers.",
        help=SCAN_ADVICE,
    )


def _model(answer: PingAnswer, motor: MotorSettings) -> MotorModel:
    try:
        return model_by_number(answer.model_number)
    except InputError as error:
        raise DeviceError(motor_name(motor.motor_id), error.message, help=error.help) from error


def _found(bus: MotorBus, motor_id: int, baud: int) -> FoundMotor | None:
    try:
        answer = _ask(bus, motor_id, SCAN_ATTEMPTS)
    except BusError:
        raise
    except ProtocolError:
        return FoundMotor(baud, bus.protocol, motor_id, None, "damaged answers", None, alert=False, shared_id=True)
    if answer is None:
        return None
    model = MODELS.get(answer.model_number)
    name = f"model {answer.model_number}" if model is None else model.name
    shared = bool(bus.surplus()) or (model is not None and not is_alone(bus, motor_id, model))
    return FoundMotor(
        baud, bus.protocol, motor_id, answer.model_number, name, answer.firmware, answer.alert, shared_id=shared
    )
