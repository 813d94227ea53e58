"""One simulated motor of any model: its control table, what it goes through, and torque for its gear.

What the host reads is quantised: position to ticks (floor), speed, current or load to the model's units. Hardware
errors, restarts and the watchdog: dynamixel reference 6.2, 6.3. Positive = counter-clockwise, like the registers. Loop:
`dynamixel_drive.py`; effort: `dynamixel_effort.py`; heat: `dynamixel_stress.py`, `dynamixel_electrics.py`.
"""

from __future__ import annotations

import math

from drivers.dynamixel.control_tables import XM430_W350, MotorModel, Register
from drivers.errors import InputError
from drivers.simulated.dynamixel_drive import Drive, InnerLoop, Order
from drivers.simulated.dynamixel_effort import NO_ERRORS, EffortErrors, EffortSense
from drivers.simulated.dynamixel_electrics import electrics_of
from drivers.simulated.dynamixel_encoder import Encoder
from drivers.simulated.dynamixel_orders import (
    POSITION_MODE,
    REVERSE,
    TIME_BASED,
    TORQUE_BY_GOAL,
    is_multi_turn,
    order_of_protocol_1,
    order_of_protocol_2,
    time_based_profile,
)
from drivers.simulated.dynamixel_rules import baud_code, ram_after_power_up, refusal
from drivers.simulated.dynamixel_stress import MotorStress
from drivers.simulated.dynamixel_table import ControlTable, Refusal

REBOOT_NS = 300_000_000
BROWN_OUT_V = 5.5
"""Below, a motor is off and starts anew afterwards [assumed]."""
RATE_TOLERANCE = 0.03
"""Two ends of a serial line understand each other within this."""
VOLTAGE, OVERHEATING, OVERLOAD = 0x01, 0x04, 0x20
_CHECK_S = 0.01
_LONGEST_STEP_S = 1.0
_WARMER_K = 0.1


class SimulatedMotor:
    """Registers and inner loop of one motor. `seed` draws the noise of what it tells of its effort.

    InputError for a baud rate that the model does not have.
    """

    def __init__(
        self,
        motor_id: int,
        model: MotorModel = XM430_W350,
        *,
        baud: int = 1_000_000,
        firmware: int | None = None,
        effort: EffortErrors = NO_ERRORS,
        seed: int = 0,
    ) -> None:
        self.model = model
        self.electrics = electrics_of(model)
        self.supply_V = 12.0
        self.stress = MotorStress(self.electrics.stall_current_A, model.no_load_speed_rad_s)
        self.silent_until_ns = -1
        self.mute = False
        """It hears and obeys, and does not answer."""
        self.cut_off = False
        """Its plug is out: no supply, no bus."""
        self.last_instruction_ns = 0
        self.current_A = 0.0
        self.events: list[str] = []
        """What happened since somebody last looked: names that fault scripts can wait for."""
        self._table = ControlTable(model)
        self._values = self._table.values
        self._values["id"] = motor_id
        self._values["baud_rate"] = baud_code(model, baud)
        if firmware is not None:
            self._values["firmware"] = firmware
        self._position_range = _range(model, "present_position")
        self._velocity_range = _range(model, "present_velocity")
        self._loop = InnerLoop(self.electrics, float(model.full_pwm))
        self._loop_C = self.stress.temperature_C
        self.encoder = Encoder(model.tick_rad, f"{seed}/{motor_id}")
        self.effort = EffortSense(model, effort, f"{seed}/{motor_id}")
        self._angle_rad = 0.0
        self._turn_offset_ticks = 0
        self._held_ticks: int | None = None
        self._timed: tuple[float, float] | None = None
        self._alarms = 0
        self._last_ns: int | None = None
        self._unchecked_s = 0.0
        self._prepare()

    @property
    def motor_id(self) -> int:
        """The id it answers to."""
        return self._values["id"]

    @property
    def protocol(self) -> int:
        """The protocol that it listens to now: a motor of protocol 2.0 can be switched to 1.0."""
        return self._values.get("protocol_type", self.model.protocol)

    @property
    def alert(self) -> int:
        """Protocol 2.0: 0x80 while a hardware error is reported, else 0: the top bit of every status."""
        return 0x80 if self._values.get("hardware_error_status", 0) else 0

    @property
    def alarms(self) -> int:
        """What protocol 1.0's error byte tells of the motor's state."""
        return self._alarms if self.model.protocol == 1 else self._values["hardware_error_status"] & 0x7F

    @property
    def powered(self) -> bool:
        """Whether it has a supply that it can run on."""
        return self.supply_V >= BROWN_OUT_V and not self.cut_off

    def hears(self, now_ns: int, baud: int | None) -> bool:
        """Whether it is up and understands bytes at this rate (None: at any)."""
        if now_ns < self.silent_until_ns or not self.powered:
            return False
        own = self.model.bauds.get(self._values["baud_rate"], 2_000_000 / (self._values["baud_rate"] + 1))
        return baud is None or abs(baud - own) <= RATE_TOLERANCE * own

    def value(self, name: str) -> int:
        """A register's value, for tests and reports."""
        return self._values[name]

    def put(self, name: str, value: int) -> None:
        """Have another value all at once, read-only registers too: a fault. InputError for an unknown name or range."""
        register = self.model.registers.get(name)
        if register is None or not register.minimum <= value <= register.maximum:
            raise InputError(f"a {self.model.name} has no register {name!r} that can be {value}.")
        self._values[name] = value
        self._prepare()

    # the host's side

    def read(self, address: int, length: int) -> tuple[int, bytes]:
        """Error number of protocol 2.0 and data; addresses between registers read 0."""
        return self._table.read(address, length)

    def write(self, address: int, data: bytes) -> int:
        """Write whole registers; the error number. Nothing is written unless all of it is acceptable."""
        error, changes = self._table.changes(address, data)
        if error:
            return error
        for register, value in changes:
            if error := refusal(self.model, self._values, register, value):
                return error
        for register, value in changes:
            self._set(register, value)
        self._prepare()
        return Refusal.NONE

    def power_up(self) -> None:
        """As after switching on: RAM as delivered, the goal here, position within one turn, no error, no torque."""
        values = self._values
        values.update(ram_after_power_up(self.model, values))
        self._to_one_turn()
        self._held_ticks = self._timed = None
        self._alarms = 0
        self.stress.forget_overload()
        self._measure(self._angle_rad, 0.0)
        self._check_alarms()
        values["goal_position"] = self._clipped_goal()
        self._loop.reset(self._loop_ticks())
        self._prepare()

    def reboot(self, now_ns: int) -> None:
        """Start anew; it answers again after 0.3 s."""
        self.power_up()
        self.silent_until_ns = now_ns + REBOOT_NS
        self.events.append("rebooted")

    def factory_reset(self, now_ns: int, keep: tuple[str, ...] = ()) -> bool:
        """All registers as delivered but those to `keep`, then a restart. False, nothing done, while torque is on."""
        if self._values["torque_enable"]:
            return False
        fixed = ("model_number", "model_information", "firmware", *keep)
        for name, register in self.model.registers.items():
            if name not in fixed:
                self._values[name] = register.default
        self.reboot(now_ns)
        return True

    def clear_turns(self) -> bool:
        """Reduce the position to one turn; False, and nothing done, while the shaft turns."""
        if self._values["moving"]:
            return False
        self._to_one_turn()
        self._measure(self._angle_rad, 0.0)
        return True

    def trip(self, error_bits: int) -> None:
        """A hardware error: told from now on, and no torque where the Shutdown mask says so."""
        values = self._values
        shuts = bool(error_bits & values["shutdown"])
        if self.model.protocol == 2:
            values["hardware_error_status"] |= error_bits
            if shuts:
                values["torque_enable"] = 0
        else:
            self._alarms |= error_bits
            if shuts:
                values["torque_limit"] = 0
        if shuts:
            self.events.append("shutdown")
        self._prepare()

    def trip_watchdog(self) -> None:
        """The bus was silent too long: stop, hold here, take no goals until the watchdog is written 0."""
        self._values["bus_watchdog"] = -1
        self._held_ticks = self._values["present_position"]
        self.events.append("watchdog")
        self._prepare()

    @property
    def watchdog_ns(self) -> int:
        """Longest bus silence while torque is on, ns; 0 = does not matter."""
        steps = self._values.get("bus_watchdog", 0)
        return round(steps * self.model.watchdog_unit_s * 1e9) if steps > 0 and self._values["torque_enable"] else 0

    # the plant's side

    def measure(self, angle_rad: float) -> None:
        """The shaft stands here when all begins; the registers are as after switching on, but no turn is lost."""
        self._measure(angle_rad, 0.0)
        self._values["present_input_voltage"] = round(self.supply_V / self.model.voltage_unit_V)
        self._values["goal_position"] = self._clipped_goal()

    def control(self, now_ns: int, angle_rad: float, velocity_rad_s: float) -> float:
        """Measure, close the inner loop; torque on the gear's output, N·m."""
        period_s = 0.0 if self._last_ns is None else min(_LONGEST_STEP_S, (now_ns - self._last_ns) * 1e-9)
        self._last_ns = now_ns
        values, sign = self._values, self._sign
        shaft_rad_s = sign * velocity_rad_s
        self._measure(sign * angle_rad, shaft_rad_s)
        if "realtime_tick" in values:
            values["realtime_tick"] = now_ns // 1_000_000 % 32768
        order = self._order if self.powered else None
        if order is None:
            self.current_A = output = demand = 0.0
        else:
            velocity_counts = shaft_rad_s / self.model.velocity_unit_rad_s
            outcome = self._loop.step(
                order,
                self._loop_ticks(),
                velocity_counts,
                shaft_rad_s,
                self.supply_V,
                period_s,
                self.effort.current_error_A,
            )
            self.current_A, output, demand = outcome.current_A, outcome.output, outcome.demand
        self.effort.pass_time(period_s)
        self._tell_effort(output)
        self.stress.step(period_s, self.current_A, demand, shaft_rad_s)
        self._unchecked_s += period_s
        if self._unchecked_s >= _CHECK_S:
            self._unchecked_s = 0.0
            self._check_alarms()
        return sign * self._loop.electrics.torque_constant_Nm_per_A * self.current_A if order is not None else 0.0

    def _tell_effort(self, output: float) -> None:
        values, model = self._values, self.model
        values[model.effort_register] = self.effort.counts(self.current_A, output, self.powered)
        if "present_pwm" in values:
            values["present_pwm"] = round(output)
            trajectory = self._loop.trajectory
            positioned = self._order is not None and self._order.drive is Drive.POSITION
            values["position_trajectory"] = round(trajectory.position) if positioned else values["present_position"]
            values["velocity_trajectory"] = round(trajectory.velocity * model.tick_rad / model.velocity_unit_rad_s)

    def _check_alarms(self) -> None:
        """Voltage, temperature and overload against their limits; the loop becomes as warm as the motor."""
        values, unit_V, temperature_C = self._values, self.model.voltage_unit_V, self.stress.temperature_C
        if abs(temperature_C - self._loop_C) >= _WARMER_K:
            self._loop_C, self._loop.electrics = temperature_C, self.electrics.at(temperature_C)
        values["present_input_voltage"] = round(self.supply_V / unit_V)
        values["present_temperature"] = max(0, math.floor(temperature_C))
        live = 0
        if not values["min_voltage_limit"] <= values["present_input_voltage"] <= values["max_voltage_limit"]:
            live |= VOLTAGE
        if values["present_temperature"] > values["temperature_limit"]:
            live |= OVERHEATING
        if self.stress.overloaded:
            live |= OVERLOAD
        if self.model.protocol == 2:
            new = live & ~values["hardware_error_status"]
        else:
            # alarms of protocol 1.0 end with their cause, but those that took the torque stay until it is given back
            self._alarms = live | (self._alarms if values["torque_limit"] == 0 else 0)
            new = live if values["torque_limit"] and live & values["shutdown"] else 0
        if new:
            self.trip(new)

    def _position_ticks(self) -> int:
        return self.encoder.ticks + self._turn_offset_ticks + self._values.get("homing_offset", 0)

    def _loop_ticks(self) -> int:
        """Position in which the loop is closed: what the host reads, but all ticks of a divided multi-turn position."""
        if self.model.protocol == 1 and not is_multi_turn(self.model, self._values):
            return self._values["present_position"]
        return self._position_ticks()

    def _to_one_turn(self) -> None:
        turn = self.model.ticks_per_revolution
        if "cw_compliance_slope" not in self._values:  # an RX-28's potentiometer knows no turns
            self._turn_offset_ticks = -(self.encoder.ticks // turn) * turn

    def _measure(self, angle_rad: float, velocity_rad_s: float) -> None:
        self._angle_rad = angle_rad
        self.encoder.measure(angle_rad)
        values, model = self._values, self.model
        position = self._position_ticks()
        if model.protocol == 1:
            if is_multi_turn(model, values):
                position = position // values["resolution_divider"] + values["multi_turn_offset"]
            elif "multi_turn_offset" in values:
                position %= model.ticks_per_revolution
            lowest, highest = self._position_range
            position = max(lowest, min(highest, position))
        values["present_position"] = position
        velocity = 0 if self.encoder.stuck else round(velocity_rad_s / model.velocity_unit_rad_s)
        lowest, highest = self._velocity_range
        values["present_velocity"] = max(lowest, min(highest, velocity))
        values["moving"] = 1 if abs(velocity) > self._moving_threshold else 0

    def _clipped_goal(self) -> int:
        register = self.model.registers["goal_position"]
        return max(register.minimum, min(register.maximum, self._values["present_position"]))

    def _set(self, register: Register, value: int) -> None:
        values, name = self._values, register.name
        before, values[name] = values[name], value
        if name == "torque_enable":
            self._torque_switched(before, value)
        elif name == "goal_position":
            self._goal_set(value)
        elif name == "torque_limit" and value:
            self._alarms = 0
            self.stress.forget_overload()
        elif name == "operating_mode":
            registers = self.model.registers
            for gain in ("velocity_i_gain", "velocity_p_gain", "position_d_gain", "position_i_gain", "position_p_gain"):
                values[gain] = registers[gain].default
            values["profile_acceleration"] = values["profile_velocity"] = 0
            values["goal_pwm"] = values["pwm_limit"]
            if "goal_current" in values:
                values["goal_current"] = values["current_limit"]
            if value == POSITION_MODE and before != POSITION_MODE:
                self._to_one_turn()
        elif name == "bus_watchdog" and value == 0:
            self._held_ticks = None

    def _torque_switched(self, before: int, value: int) -> None:
        if value == before:
            return
        self.events.append("torque_on" if value else "torque_off")
        if value:
            self._loop.reset(self._loop_ticks())

    def _goal_set(self, goal: int) -> None:
        values = self._values
        self.events.append("goal")
        by_goal = self.model.protocol == 1 or values["drive_mode"] & TORQUE_BY_GOAL
        if by_goal and not values["torque_enable"] and not self.alert:
            values["torque_enable"] = 1
            self._torque_switched(0, 1)
        if self.model.protocol == 2 and values["drive_mode"] & TIME_BASED:
            start = self._loop.trajectory.position if values["torque_enable"] else values["present_position"]
            self._timed = time_based_profile(values, goal - start)
        else:
            self._timed = None

    def _prepare(self) -> None:
        """Work out once per change what the inner loop needs at every step."""
        values, model = self._values, self.model
        self._sign = -1 if values.get("drive_mode", 0) & REVERSE else 1
        self._moving_threshold = values.get("moving_threshold", 0)
        self._order: Order | None = None
        if model.protocol == 2:
            if values["torque_enable"]:
                self._order = order_of_protocol_2(model, values, self._held_ticks, self._timed)
        elif values["torque_enable"] and values["torque_limit"]:
            self._order = order_of_protocol_1(model, values)


def _range(model: MotorModel, name: str) -> tuple[int, int]:
    register = model.registers[name]
    return register.minimum, register.maximum
