"""One simulated XM430: its control table, and the inner loop from goals to shaft torque.

Inner loop, at every physics step (dynamixel reference 2.3, 3.1):

    PWM counts = P gain / 128 × position error in ticks   (modes 3, 4, 5; P part only: other gains have no effect)
    voltage    = PWM / 885 × 12 V                         (PWM within Goal PWM and PWM Limit)
    current    = (voltage − k_e × shaft speed) / R        (R = 12 V / 2.3 A; inductance left out: below 1 ms)
    current    within ± Goal Current (mode 5); in mode 0 the current is the goal, as far as the voltage reaches
    torque     = K × current                              (the gear's friction, ± K × 0.13 A, belongs to the plant)

k_e makes the no-load speed 46 rpm at 12 V against that friction. What the host reads is quantised: position to ticks
(floor), speed to 0.229 rpm, current to 2.69 mA. Positive = counter-clockwise, like the registers.
"""

from __future__ import annotations

import math

from drivers.dynamixel.control_tables import EEPROM_END, XM430_W350, MotorModel, Register

TORQUE_CONSTANT_NM_PER_A = 1.79
FRICTION_CURRENT_A = 0.13
REBOOT_NS = 300_000_000

ERROR_NONE, ERROR_DATA_RANGE, ERROR_DATA_LENGTH, ERROR_DATA_LIMIT, ERROR_ACCESS = 0, 4, 5, 6, 7

CURRENT_MODE, POSITION_MODE, EXTENDED_MODE, CURRENT_BASED_POSITION, PWM_MODE = 0, 3, 4, 5, 16
MODES = (CURRENT_MODE, POSITION_MODE, EXTENDED_MODE, CURRENT_BASED_POSITION, PWM_MODE)
"""Modes that are simulated; velocity mode is refused with a data range error."""

_GOALS = ("goal_pwm", "goal_current", "goal_velocity", "goal_position")
_LIMIT_OF = {"goal_pwm": "pwm_limit", "goal_current": "current_limit", "goal_velocity": "velocity_limit"}


class SimulatedMotor:
    """Registers and inner loop of one motor."""

    def __init__(self, motor_id: int, model: MotorModel = XM430_W350) -> None:
        self.model = model
        self._values = {name: register.default for name, register in model.registers.items()}
        self._values["id"] = motor_id
        self._registers_by_address = sorted(model.registers.values(), key=lambda register: register.address)
        self._table_end = max(r.address + r.size for r in self._registers_by_address)
        self._resistance_ohm = model.nominal_voltage_V / model.stall_current_A
        self._back_emf_V_s = (
            model.nominal_voltage_V - self._resistance_ohm * FRICTION_CURRENT_A
        ) / model.no_load_speed_rad_s
        self._angle_rad = 0.0
        self._turn_offset_ticks = 0
        self._held_ticks: int | None = None
        self.silent_until_ns = -1
        self.current_A = 0.0
        self._prepare()

    @property
    def motor_id(self) -> int:
        """The id it answers to."""
        return self._values["id"]

    @property
    def alert(self) -> int:
        """0x80 while a hardware error is reported, else 0: the top bit of every status."""
        return 0x80 if self._values["hardware_error_status"] else 0

    def value(self, name: str) -> int:
        """A register's value, for tests and reports."""
        return self._values[name]

    # the host's side

    def read(self, address: int, length: int) -> tuple[int, bytes]:
        """Error number and data; addresses between registers read 0."""
        if length == 0 or address + length > self._table_end:
            return ERROR_ACCESS, b""
        image = bytearray(length)
        found = False
        for register in self._registers_by_address:
            if register.address < address + length and address < register.address + register.size:
                found = True
                data = self._values[register.name] & ((1 << 8 * register.size) - 1)
                for index, byte in enumerate(data.to_bytes(register.size, "little"), register.address - address):
                    if 0 <= index < length:
                        image[index] = byte
        return (ERROR_NONE, bytes(image)) if found else (ERROR_ACCESS, b"")

    def write(self, address: int, data: bytes) -> int:
        """Write whole registers; the error number. Nothing is written unless all of it is acceptable."""
        changes: list[tuple[Register, int]] = []
        position = address
        while position < address + len(data):
            register = next((r for r in self._registers_by_address if r.address == position), None)
            if register is None or not register.writable:
                return ERROR_ACCESS
            if register.address < EEPROM_END and self._values["torque_enable"]:
                return ERROR_ACCESS
            content = data[position - address : position - address + register.size]
            if len(content) < register.size:
                return ERROR_DATA_LENGTH
            value = register.decode(content)
            if error := self._refusal(register, value):
                return error
            changes.append((register, value))
            position += register.size
        if not changes:
            return ERROR_DATA_LENGTH
        for register, value in changes:
            self._set(register.name, value)
        self._prepare()
        return ERROR_NONE

    def reboot(self, now_ns: int) -> None:
        """Lose all RAM, reduce the position to one turn, answer again after 0.3 s."""
        for register in self._registers_by_address:
            if register.address >= EEPROM_END:
                self._values[register.name] = register.default
        for goal, limit in _LIMIT_OF.items():
            self._values[goal] = 0 if goal == "goal_velocity" else self._values[limit]
        self._turn_offset_ticks = -(self._raw_ticks() // self.model.ticks_per_revolution) * (
            self.model.ticks_per_revolution
        )
        self._held_ticks = None
        self.silent_until_ns = now_ns + REBOOT_NS
        self._measure(self._angle_rad, 0.0)
        self._values["goal_position"] = self._values["present_position"]
        self._prepare()

    def trip(self, error_bits: int) -> None:
        """A hardware error: alert from now on, and torque off where the Shutdown mask says so, until a reboot."""
        self._values["hardware_error_status"] |= error_bits
        if error_bits & self._values["shutdown"]:
            self._values["torque_enable"] = 0
        self._prepare()

    def trip_watchdog(self) -> None:
        """The bus was silent too long: stop, hold here, take no goals until the watchdog is written 0."""
        self._values["bus_watchdog"] = -1
        self._held_ticks = self._values["present_position"]
        self._prepare()

    @property
    def watchdog_ns(self) -> int:
        """Longest bus silence while torque is on, ns; 0 = does not matter."""
        steps = self._values["bus_watchdog"]
        active = steps > 0 and self._values["torque_enable"]
        return round(steps * self.model.watchdog_unit_s * 1e9) if active else 0

    # the plant's side

    def control(self, now_ns: int, angle_rad: float, velocity_rad_s: float) -> float:
        """Measure, close the inner loop; torque on the gear's output, N·m."""
        self._measure(angle_rad, velocity_rad_s)
        values = self._values
        values["realtime_tick"] = now_ns // 1_000_000 % 32768
        if not self._torque_on:
            self.current_A = 0.0
            values["present_current"] = values["present_pwm"] = 0
            return 0.0
        back_emf_V = self._back_emf_V_s * velocity_rad_s
        if self._mode == CURRENT_MODE:
            wanted_A = 0.0 if self._held_ticks is not None else self._goal_current_A
            pwm = (wanted_A * self._resistance_ohm + back_emf_V) / self._volt_per_pwm
        elif self._mode == PWM_MODE:
            pwm = 0.0 if self._held_ticks is not None else float(values["goal_pwm"])
        else:
            target = self._goal_ticks if self._held_ticks is None else self._held_ticks
            pwm = self._pwm_per_tick * (target - values["present_position"])
        pwm = max(-self._pwm_cap, min(self._pwm_cap, pwm))
        current_A = (pwm * self._volt_per_pwm - back_emf_V) / self._resistance_ohm
        if self._mode == CURRENT_BASED_POSITION:
            clipped_A = max(-self._current_cap_A, min(self._current_cap_A, current_A))
            if clipped_A != current_A:
                current_A = clipped_A
                pwm = (current_A * self._resistance_ohm + back_emf_V) / self._volt_per_pwm
        self.current_A = current_A
        values["present_current"] = round(current_A / self.model.current_unit_A)
        values["present_pwm"] = round(pwm)
        return TORQUE_CONSTANT_NM_PER_A * current_A

    def _raw_ticks(self) -> int:
        return math.floor(self._angle_rad / self.model.tick_rad)

    def _measure(self, angle_rad: float, velocity_rad_s: float) -> None:
        self._angle_rad = angle_rad
        values = self._values
        values["present_position"] = self._raw_ticks() + self._turn_offset_ticks + values["homing_offset"]
        values["present_velocity"] = velocity = round(velocity_rad_s / self.model.velocity_unit_rad_s)
        values["moving"] = 1 if abs(velocity) > values["moving_threshold"] else 0

    def _refusal(self, register: Register, value: int) -> int:
        values = self._values
        if not register.minimum <= value <= register.maximum:
            return ERROR_DATA_RANGE
        name = register.name
        if name in _GOALS and values["bus_watchdog"] < 0:
            return ERROR_DATA_RANGE
        if name == "bus_watchdog" and (value < 0 or (value > 0 and values["bus_watchdog"] < 0)):
            return ERROR_DATA_RANGE
        if name == "operating_mode" and value not in MODES:
            return ERROR_DATA_RANGE
        if name == "torque_enable" and value and values["hardware_error_status"]:
            return ERROR_ACCESS
        if name in _LIMIT_OF and abs(value) > values[_LIMIT_OF[name]]:
            return ERROR_DATA_LIMIT
        if name == "goal_position" and values["operating_mode"] == POSITION_MODE:
            inside = values["min_position_limit"] <= value <= values["max_position_limit"]
            return ERROR_NONE if inside else ERROR_DATA_LIMIT
        return ERROR_NONE

    def _set(self, name: str, value: int) -> None:
        values = self._values
        values[name] = value
        if name == "operating_mode":
            registers = self.model.registers
            for gain in ("velocity_i_gain", "velocity_p_gain", "position_d_gain", "position_i_gain", "position_p_gain"):
                values[gain] = registers[gain].default
            values["profile_acceleration"] = values["profile_velocity"] = 0
            values["goal_pwm"], values["goal_current"] = values["pwm_limit"], values["current_limit"]
        elif name == "bus_watchdog" and value == 0:
            self._held_ticks = None

    def _prepare(self) -> None:
        """Work out once per change what the inner loop needs at every step."""
        values, model = self._values, self.model
        self._torque_on = bool(values["torque_enable"])
        self._mode = values["operating_mode"]
        self._goal_ticks = values["goal_position"]
        self._goal_current_A = values["goal_current"] * model.current_unit_A
        self._current_cap_A = abs(self._goal_current_A)
        self._pwm_cap = float(min(abs(values["goal_pwm"]), values["pwm_limit"]))
        self._pwm_per_tick = values["position_p_gain"] / model.position_gain_divisor
        self._volt_per_pwm = model.nominal_voltage_V / model.full_pwm
        # what the host sees of trajectories: profiles are 0, so the trajectory is the goal
        values["position_trajectory"] = values["goal_position"]
