"""Flights as the field has them, of an aircraft with an effect that the model handed in lacks, or with none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from field_flight import plan_of, told
from field_inputs import inputs_of
from field_plant import fly_field
from field_sensors import sense
from jsbsim_effects import NAMES, hidden
from jsbsim_flight import linear_aircraft, table_aircraft

from sim_vehicle.model.model_file import Coefficient, Model
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.signals.flight import FlightSignals

# Nothing hidden; and nothing that the catalogue holds: an aircraft of tables beside a linear model.
CLEAN, TABLES = "none", "tables"
# Lags are left out: JSBSim's follow the motion over ground, and lift has to lag the gusts as well.
LAGS = ("unsteady_lift", "actuator_lag")
ALL = (CLEAN, *(name for name in NAMES if name not in LAGS))


@dataclass(frozen=True)
class HiddenFlight:
    """A flight with its vehicle file and the model handed in. parameters: of what is hidden, as flown."""

    signals: FlightSignals
    vehicle: Vehicle
    model: Model
    parameters: Mapping[str, float]


def hidden_flight(name: str, family: str, seed: int, folder: Path, off: float = 0.0, size: float = 1.0) -> HiddenFlight:
    """Fly the effect of that name (of `ALL`) with the servos, air and sensors that a family draws.

    off: share by which every coefficient handed in may be wrong. size: of the effect, as a share of its usual one.
    """
    base = linear_aircraft()
    flown, vehicle, model, parameters = base, base.vehicle, base.model, dict[str, float]()
    if name == TABLES:
        flown = table_aircraft()
    elif name != CLEAN:
        effect = hidden(name, size)
        flown, vehicle, model, parameters = effect.flown, effect.vehicle, effect.model, dict(effect.parameters)
    plan = plan_of(family, seed)
    generator = np.random.default_rng([seed, 23])
    inputs = inputs_of(plan.kind, plan.seconds, generator, plan.surfaces, plan.size)
    log = fly_field(folder, flown, inputs, seed, servo=plan.servo, air=plan.air, hold=plan.hold)
    signals = sense(log, flown.vehicle, plan.field, seed, f"{name}-{family}-{seed}")
    wrong = np.random.default_rng([seed, 3])
    values = {key: value * (1.0 + off * wrong.uniform(-1.0, 1.0)) for key, value in model.values().items()}
    given = replace(model, coefficients={key: Coefficient(value) for key, value in values.items()})
    return HiddenFlight(signals, told(vehicle, plan.wrong, seed), given, parameters)
