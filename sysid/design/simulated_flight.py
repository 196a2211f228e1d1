"""A planned flight flown in the simulator with the sensors of the vehicle file, as the estimators get it."""

from __future__ import annotations

from collections.abc import Collection, Iterable

import numpy as np

from sim_vehicle.constants import GAS_CONSTANT
from sim_vehicle.effects import EFFECTS
from sim_vehicle.flight.flight_log import FlownFlight
from sim_vehicle.flight.flight_loop import fly, wind_of
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.sensor_suite import RATES_HZ, TABLE_II, SensorSuite
from sim_vehicle.manoeuvres.plan import Plan
from sim_vehicle.manoeuvres.shapes import CONTROLS
from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.controls import signal_of
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.errors import EstimationError
from sysid.signals.flight import FlightSignals, Signal
from sysid.signals.record import STATES, Record

RATE_HZ = 50.0  # at which a planned flight is recorded, as the reference paper's board does
# Key under [sensors] of the vehicle file -> the channels whose noise it states.
CHANNELS_OF = {
    "accelerometer": ("ax", "ay", "az"),
    "gyro": ("p", "q", "r"),
    "attitude": ("phi", "theta", "psi"),
    "alpha_vane": ("alpha",),
    "beta_vane": ("beta",),
    "airspeed": ("airspeed",),
    "thrust": ("thrust",),
    "gps": ("vn", "ve", "vd"),
}
# What an aircraft may lack, and the signals that go with it.
ABSENT = {
    "alpha": ("alpha",),
    "beta": ("beta",),
    "thrust": ("thrust",),
    "gps": ("lat", "lon", "gps_altitude", "gps_north", "gps_east", "vn", "ve", "vd"),
}


def channel_noise(vehicle: Vehicle) -> dict[str, float]:
    """Noise of one sample of every channel, 1 sigma, SI: the vehicle file's, else the simulator's Table II.

    Rounding to the step of a Table II sensor counts as noise of step / sqrt(12).
    """
    noise = {name: float(np.hypot(row.noise, row.quantum / np.sqrt(12.0))) for name, row in TABLE_II.items()}
    for sensor, channels in CHANNELS_OF.items():
        stated = vehicle.sensors[sensor].noise
        if stated is not None:
            noise |= dict.fromkeys(channels, stated)
    return noise


def rehearse(
    vehicle: Vehicle,
    model: Model,
    plan: Plan,
    *,
    seed: int,
    rate_hz: float = RATE_HZ,
    gusts: float = 0.0,
    without: Collection[str] = (),
    noise: str = "table2",
    max_step: float = 0.01,
) -> tuple[FlightSignals, FlownFlight]:
    """Fly `plan` once; what the sensors read, and the truth.

    seed: of sensor noise and gusts. rate_hz: samples and commands per second. gusts: Dryden turbulence, 1 sigma, m/s.
    without: keys of ABSENT that the aircraft does not carry. noise: "table2", with the vehicle file's noise where it
    states some, or "none". max_step: of the integration, s. Raises SimVehicleError for what cannot be flown,
    EstimationError for an unknown key.
    """
    unknown = sorted(set(without) - set(ABSENT))
    if unknown:
        raise EstimationError(f"no sensor {unknown[0]!r} to leave out; there are {', '.join(ABSENT)}")
    if gusts > 0.0:
        model = model.with_effect(EFFECTS["turbulence"], {"sigma": gusts})
    plant = Plant(vehicle, model, max_step=max_step)
    sensor_seed, gust_seed = np.random.SeedSequence(seed).spawn(2)
    stated = channel_noise(vehicle)
    changes = {f"{name}.noise": stated[name] for name in _stated(vehicle)} if noise == "table2" else {}
    suite = SensorSuite(
        vehicle,
        noise=noise,
        generator=np.random.default_rng(sensor_seed),
        dt=1.0 / rate_hz,
        changes=changes,
        rates_hz={group: rate_hz for group in RATES_HZ if group != "gps"},
    )
    flown = fly(
        plant,
        plan,
        suite=suite,
        generator=np.random.default_rng(gust_seed),
        wind=wind_of(plant),
        dt=1.0 / rate_hz,
    )
    left_out = {name for key in without for name in ABSENT[key]}
    return signals_of(flown, vehicle, f"rehearsal {seed}", left_out), flown


def _stated(vehicle: Vehicle) -> list[str]:
    """Channels whose noise the vehicle file states."""
    return [
        channel
        for key, channels in CHANNELS_OF.items()
        if vehicle.sensors[key].noise is not None
        for channel in channels
    ]


def signals_of(flown: FlownFlight, vehicle: Vehicle, name: str, left_out: Collection[str] = ()) -> FlightSignals:
    """What a recording of the flight carries: sensors on their stamps, surfaces from the servo pulses."""
    measured = {key: pair for key, pair in flown.measured.items() if key not in left_out}
    signals = {key: Signal(time_s, values, "SI", "simulator") for key, (time_s, values) in measured.items()}
    pressure, temperature = signals["static_pressure"], signals["temperature"]
    warmth = np.interp(pressure.time_s, temperature.time_s, temperature.values)
    density = pressure.values / (GAS_CONSTANT * warmth)
    signals["air_density"] = Signal(pressure.time_s, density, "kg/m^3", "simulator")
    for control in vehicle.controls.values():
        if control.servos:
            pulses = [np.asarray(flown.servos[servo], dtype=np.float64) for servo in control.servos]
            deflection = control.deflection_from_pwm(*pulses)
        else:
            deflection = flown.command[:, (*CONTROLS, *vehicle.named_controls).index(control.name)]
        signals[signal_of(control.name)] = Signal(flown.time_s, deflection, "rad", "simulator")
    return FlightSignals(name, signals)


def true_starts(records: Iterable[Record], flown: FlownFlight) -> tuple[Array, ...]:
    """The nine true states u v w p q r phi theta psi, relative to the air, at the first sample of each record."""
    truth = flown.truth
    speed, alpha, beta = truth["V"], truth["alpha"], truth["beta"]
    air = {
        "u": speed * np.cos(beta) * np.cos(alpha),
        "v": speed * np.sin(beta),
        "w": speed * np.cos(beta) * np.sin(alpha),
    }
    path = np.stack([(truth | air)[name] for name in STATES], axis=1)
    starts = [int(np.argmin(np.abs(flown.time_s - record.time_s[0]))) for record in records]
    return tuple(path[start].copy() for start in starts)
