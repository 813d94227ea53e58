"""What is between a simulated motor's output stage and its gear's output: resistance, back-EMF, torque per ampere.

    voltage = output / full output × supply      current = (voltage − k_e × shaft speed) / R      torque = K × current

R is that of the stall point nearest to 12 V; k_e makes the no-load speed the manual's against the gear's friction,
which belongs to the plant: K × I0 against the motion. K: dynamixel reference 3.1. I0 of the XM430-W350: 0.13 A there;
of the others the same part of the stall current, an assumption, as nothing is published.

Heat: R grows like copper, 0.39 % a kelvin, so that the same output drives less current; K and k_e fall by 0.1 %, as the
magnets do (an assumption within the reference's "few percent"). The manual's numbers hold at 30 °C.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from drivers.dynamixel.control_tables import MX_28, MX_28_2, RX_28, XL430_W250, XM430_W210, XM430_W350, MotorModel

_TORQUE_CONSTANT_NM_PER_A = {
    RX_28.number: 1.95,
    MX_28.number: 1.79,
    MX_28_2.number: 1.79,
    XM430_W350.number: 1.79,
    XM430_W210.number: 1.30,
    XL430_W250.number: 1.07,
}
_FRICTION_PART_OF_STALL = 0.13 / 2.3
_NO_LOAD_SUPPLY_V = {RX_28.number: 18.5}
_ROTOR_INERTIA_KGM2 = 1e-7
REFERENCE_C = 30.0
RESISTANCE_PER_K = 0.0039
TORQUE_PER_K = -0.001


@dataclass(frozen=True, slots=True)
class Electrics:
    """Of one model, all at the output shaft."""

    resistance_ohm: float
    torque_constant_Nm_per_A: float
    back_emf_V_s: float
    stall_current_A: float
    friction_current_A: float
    inertia_kgm2: float
    """Of the rotor behind the gear [assumed: 1e-7 kg·m² at the rotor]."""

    @property
    def gear_friction_Nm(self) -> float:
        """Coulomb friction of the gear, for the plant."""
        return self.torque_constant_Nm_per_A * self.friction_current_A

    def at(self, temperature_C: float) -> Electrics:
        """The same motor at another temperature of its winding and magnets."""
        excess_K = temperature_C - REFERENCE_C
        weaker = 1.0 + TORQUE_PER_K * excess_K
        return replace(
            self,
            resistance_ohm=self.resistance_ohm * (1.0 + RESISTANCE_PER_K * excess_K),
            torque_constant_Nm_per_A=self.torque_constant_Nm_per_A * weaker,
            back_emf_V_s=self.back_emf_V_s * weaker,
        )


def electrics_of(model: MotorModel) -> Electrics:
    """The numbers of a model."""
    stall_V, _, stall_A = min(model.stall_points, key=lambda point: abs(point[0] - 12.0))
    resistance_ohm, friction_A = stall_V / stall_A, _FRICTION_PART_OF_STALL * stall_A
    no_load_V = _NO_LOAD_SUPPLY_V.get(model.number, 12.0)
    return Electrics(
        resistance_ohm=resistance_ohm,
        torque_constant_Nm_per_A=_TORQUE_CONSTANT_NM_PER_A[model.number],
        back_emf_V_s=(no_load_V - resistance_ohm * friction_A) / model.no_load_speed_rad_s,
        stall_current_A=stall_A,
        friction_current_A=friction_A,
        inertia_kgm2=_ROTOR_INERTIA_KGM2 * model.gear_ratio**2,
    )
