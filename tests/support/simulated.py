"""Flights of the bundled simulator as the estimators get them, with no MAVLink between."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sim_vehicle.effects import parse_effect
from sim_vehicle.flight.flight_log import FlownFlight
from sim_vehicle.flight.flight_loop import fly
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.sensor_suite import SensorSuite
from sim_vehicle.manoeuvres.plan import plan_of
from sim_vehicle.model.model_file import Model, read_model
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.signals.flight import FlightSignals, Signal


def signals_of(flown: FlownFlight, vehicle: Vehicle, name: str) -> FlightSignals:
    """What a recording of the flight carries: sensors on their stamps, surfaces from the servo pulses."""
    signals = {key: Signal(time, values, "SI", "simulator") for key, (time, values) in flown.measured.items()}
    pressure, temperature = signals["static_pressure"], signals["temperature"]
    density = pressure.values / (287.05287 * np.interp(pressure.time_s, temperature.time_s, temperature.values))
    signals["air_density"] = Signal(pressure.time_s, density, "kg/m^3", "simulator")
    for control, signal in (("elevator", "de"), ("aileron", "da"), ("rudder", "dr"), ("throttle", "throttle")):
        pulses = [np.asarray(flown.servos[servo], dtype=np.float64) for servo in vehicle.controls[control].servos]
        deflection = vehicle.controls[control].deflection_from_pwm(*pulses)
        signals[signal] = Signal(flown.time_s, deflection, "rad", "simulator")
    return FlightSignals(name, signals)


def fly_mav(
    manoeuvres: str,
    seed: int,
    *,
    effects: tuple[str, ...] = (),
    model: Model | None = None,
    settings: Mapping[str, float] | None = None,
    duration: float | None = None,
    noise: str = "table2",
    vehicle: Vehicle | None = None,
    max_step: float = 0.0021,
) -> tuple[FlightSignals, FlownFlight]:
    """Fly the paper's aircraft (or another) and give its signals and its truth. max_step: s, not the estimator's."""
    vehicle = vehicle or load_vehicle("iitb-mav")
    flown_model = model or read_model("iitb-mav")
    for text in effects:
        flown_model = flown_model.with_effect(*parse_effect(text))
    plant = Plant(vehicle, flown_model, max_step=max_step)
    generator = np.random.default_rng(seed)
    suite = SensorSuite(vehicle, noise=noise, generator=generator)
    plan = plan_of(manoeuvres.split(",")).with_settings(settings or {})
    flown = fly(plant, plan, suite=suite, generator=generator, duration=duration)
    return signals_of(flown, vehicle, f"{manoeuvres}-{seed}"), flown
