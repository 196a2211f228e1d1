"""What a planned flight will determine: standard errors predicted from a prior model before the flight.

The plan is flown in the simulator with the prior model; what the sensors would read goes through the same search for
excited parts, data compatibility check and division into runs as a real flight. There the information of the
output-error estimate is taken at the prior model's own values, every coefficient, sensor error and initial state
estimated together (Maine & Iliff, NASA RP-1168, section 3.3; Klein & Morelli, 2nd ed., 9.2):

    M = sum over samples and outputs of (dy/dtheta)' (dy/dtheta) / sigma^2,     std = sqrt(diag(M^-1))
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_vehicle.flight.flight_log import FlownFlight
from sim_vehicle.flight.plant import Plant
from sim_vehicle.manoeuvres.plan import Plan
from sim_vehicle.manoeuvres.shapes import CONTROLS
from sim_vehicle.model.model_file import Model
from sim_vehicle.physics.layout import CHANNELS
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.compatibility.reconstruction import CompatibilityResult, check_compatibility
from sysid.compatibility.selection import Refusal
from sysid.design.gust_information import GustyPath, gusty_path
from sysid.design.simulated_flight import RATE_HZ, channel_noise, rehearse, true_starts
from sysid.numerics.normal_equations import inverse
from sysid.numerics.threads import single_threaded
from sysid.output_error.estimator import OutputError
from sysid.output_error.from_problem import build
from sysid.problem.estimation_problem import Problem, free_coefficients, refusals
from sysid.problem.formulation import make_problem, with_unclear_sensors
from sysid.problem.model_structure import default_structure, helpful_manoeuvre, usual_size
from sysid.problem.predictor import Predictor
from sysid.signals.flight import FlightSignals
from sysid.signals.preparation import prepare
from sysid.signals.record import OUTPUTS
from sysid.signals.sensor_errors import SENSOR_ERRORS

_THRUST_STEP = 1e-4  # N, for a difference quotient
_CORRELATED = 0.9  # beyond which two estimates are reported as correlated
_EXCURSIONS = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "az", "down")
_NO_SAMPLE = 1e6  # noise, SI, of an output where it has none
_STOP = 1e-3  # rad from a linkage's end


@dataclass(frozen=True)
class Expected:
    """One quantity that the flight is to determine: the prior's value and the standard error predicted, in `unit`.

    partner: the estimate it hangs together with most and their correlation, where that is above 0.9.
    """

    name: str
    value: float
    std: float
    unit: str
    partner: tuple[str, float] | None = None

    @property
    def percent(self) -> float | None:
        """Standard error in percent of the value; None where that is 0."""
        return 100.0 * self.std / abs(self.value) if self.value else None


@dataclass(frozen=True)
class Prediction:
    """What a plan will determine.

    coefficients, sensor_errors: those that it determines. refused: those that it does not, with the manoeuvre that
    would.
    missing: the coefficients among them. excursions: signal -> smallest and largest value flown, SI. trim: the same in
    trim. density: kg/m^3. covariance: (P, P) of `names`, all that is estimated. gusts: turbulence, m/s.
    """

    duration_s: float
    coefficients: tuple[Expected, ...]
    sensor_errors: tuple[Expected, ...]
    refused: tuple[Refusal, ...]
    missing: tuple[str, ...]
    excursions: Mapping[str, tuple[float, float]]
    trim: Mapping[str, float]
    density: float
    names: tuple[str, ...]
    covariance: Array
    gusts: float
    warnings: tuple[str, ...]

    def std(self, name: str) -> float:
        """Predicted standard error of an estimate, reported or refused."""
        place = self.names.index(name)
        return math.sqrt(float(self.covariance[place, place]))

    @property
    def score(self) -> float:
        """Geometric mean of standard errors over usual sizes, over all coefficients; 1 for one that is refused."""
        logs = [math.log(min(entry.std / usual_size(entry.name), 1.0)) for entry in self.coefficients]
        return math.exp(math.fsum(logs) / max(1, len(logs) + len(self.missing)))


@dataclass(frozen=True)
class _Bounds:
    """Values and standard errors of all estimates, as `refusals` asks for them."""

    values: Mapping[str, float]
    errors: Mapping[str, float]

    def value(self, name: str) -> float:
        return self.values[name]

    def std(self, name: str) -> float:
        return self.errors[name]


def structure_of(vehicle: Vehicle, structure: Model | None) -> list[str]:
    """Names of the coefficients that `identify` estimates of such a vehicle."""
    if structure is not None:
        return list(structure.coefficients)
    present = {"elevator": "de", "aileron": "da", "rudder": "dr"}
    surfaces = [signal for name, signal in present.items() if name in vehicle.controls]
    return list(default_structure(surfaces, vehicle.named_controls))


@single_threaded
def predict(
    vehicle: Vehicle,
    model: Model,
    plan: Plan,
    *,
    structure: Model | None = None,
    rate_hz: float = RATE_HZ,
    without: Collection[str] = (),
    gusts: float = 0.0,
    seed: int = 0,
    rehearsals: int = 3,
) -> Prediction:
    """Predict what `plan` will determine of `vehicle` if it flies as `model` says.

    structure: a model whose coefficients are to be estimated; None takes what `identify` takes. A coefficient that
    `model` lacks counts as 0. rate_hz: sample rate. gusts: turbulence, 1 sigma, m/s; the bound is then that of an
    estimator that knows the turbulence. without: sensors the aircraft does not carry (rehearsal.ABSENT).
    seed: of the sensor noise. rehearsals: how many are flown; where the noise decides which sensor errors are
    estimated, the rehearsal with the middle number of them counts.
    Raises SimVehicleError for what cannot be flown and SysidError for a plan from which nothing can be estimated.
    """
    names = structure_of(vehicle, structure)
    whole = model
    for name in names:
        if name not in whole.coefficients:
            whole = whole.with_coefficient(name, 0.0)
    seeds = [int(number) for number in np.random.SeedSequence(seed).generate_state(rehearsals)]
    flights = [_rehearsal(vehicle, whole, plan, one, rate_hz, without, gusts) for one in seeds]
    flights.sort(key=lambda flight: len(flight[0].sensors))
    problem, compatible, flown = flights[rehearsals // 2]
    free = free_coefficients(names, problem.motion)
    if gusts == 0.0:
        problem = with_unclear_sensors(problem, [refusal.name for refusal in compatible.refused])
    oe = build(problem, whole, free, sigma=_sigma(vehicle))
    motion = gusty_path(Plant(vehicle, whole), flown, gusts) if gusts > 0.0 else None
    values = {**whole.values(), **problem.sensors}
    covariance = inverse(_information(oe, values, _thrust_noise(problem, vehicle), motion))
    known = tuple(parameter.name for parameter in oe.predictor.parameters)
    covariance = covariance[: len(known), : len(known)]
    quiet = [
        Refusal(name, "the surfaces that would excite it do not move", helpful_manoeuvre(name))
        for name in names
        if name not in free
    ]
    errors = dict(zip(known, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    refused = refusals(_Bounds(whole.values(), errors), free, {})
    return Prediction(
        plan.duration,
        _expected([n for n in free if n not in {r.name for r in refused}], whole.values(), known, covariance, {}),
        _sensors(problem, compatible, known, covariance),
        (*quiet, *refused, *(entry for entry in compatible.refused if entry.name not in problem.sensors)),
        tuple(entry.name for entry in (*quiet, *refused)),
        {name: (float(flown.truth[name].min()), float(flown.truth[name].max())) for name in _EXCURSIONS},
        {name: float(flown.truth[name][0]) for name in _EXCURSIONS},
        float(flown.truth["rho"][0]),
        known,
        covariance,
        gusts,
        tuple(_warnings(vehicle, model, names, flown, gusts)),
    )


def _rehearsal(
    vehicle: Vehicle, model: Model, plan: Plan, seed: int, rate_hz: float, without: Collection[str], gusts: float
) -> tuple[Problem, CompatibilityResult, FlownFlight]:
    """One flight of the plan in calm air: the problem that `identify` makes of it, at the truth.

    Turbulence only decides which sensor errors are estimated. The motion is the plan's own, or the commands with which
    the autopilot answered the gusts would count as excitation.
    """
    signals, flown = rehearse(vehicle, model, plan, seed=seed, rate_hz=rate_hz, without=without)
    problem, compatible = _problem(signals, vehicle, ground=gusts == 0.0)
    if gusts > 0.0:
        rough, _ = rehearse(vehicle, model, plan, seed=seed, rate_hz=rate_hz, without=without, gusts=gusts)
        shaken, compatible = _problem(rough, vehicle, ground=False)
        measured = problem.motion.outputs
        chosen = {name: value for name, value in shaken.sensors.items() if SENSOR_ERRORS[name][0] in measured}
        problem = replace(problem, sensors=chosen, priors=shaken.priors)
    return _at_the_truth(problem, flown), compatible, flown


def _problem(signals: FlightSignals, vehicle: Vehicle, ground: bool) -> tuple[Problem, CompatibilityResult]:
    """What `identify` makes of a flight's signals before it estimates; ground: as for make_problem, in calm air."""
    prepared = [prepare(signals, vehicle)]
    compatible = check_compatibility(prepared)
    return make_problem(prepared, vehicle, compatible, ground=ground and compatible.gust_sigma == 0.0), compatible


def _at_the_truth(problem: Problem, flown: FlownFlight) -> Problem:
    """The problem with true initial states and sensor errors, where its information is to be taken."""
    # The rehearsal has no wind, which alone is no error of a sensor.
    sensors = {name: flown.sensor_errors.get(name, 0.0) for name in problem.sensors}
    return replace(problem, guesses=true_starts(problem.records, flown), sensors=sensors)


def _sigma(vehicle: Vehicle) -> Array:
    """Noise of each of OUTPUTS."""
    noise = channel_noise(vehicle)
    return np.array([noise[name] for name in OUTPUTS])


def _information(
    oe: OutputError, values: dict[str, float], thrust_noise: Sequence[float], motion: GustyPath | None
) -> Array:
    """Information matrix of parameters, initial states and the mean error of each run's measured thrust.

    thrust_noise: standard error of the mean thrust of each run, N; 0 where thrust is not measured. It is no parameter
    of the estimate, but it moves the drag all the same. motion: what turbulence does; None in calm air.
    """
    assert oe.known_sigma is not None
    theta = oe.start(values)
    predicted = oe.predict(theta)
    slopes, pushed = oe.sensitivities(theta, predicted), _pushed_by_thrust(oe, theta, predicted)
    sigma = oe.known_sigma[oe.columns]
    size = oe.predictor.size
    whole = np.diag(np.concatenate((np.zeros(size), np.ones(len(pushed)))))
    priors = oe.prior_information.shape[0]
    whole[:priors, :priors] = oe.prior_information
    for k, record in enumerate(oe.predictor.records):
        rows = np.concatenate((slopes[k], pushed[k][:, :, None] * (thrust_noise[k] > 0.0)), axis=2)[:, oe.columns]
        good = np.isfinite(record.z[:, oe.columns])
        if motion is None:
            white = np.where(good[:, :, None], rows, 0.0) / sigma[:, None]
        else:
            first = round(record.time_s[0] / record.interval_s)
            free, columns = oe.predictor.free_states[k], [CHANNELS.index(OUTPUTS[j]) for j in oe.columns]
            white = motion.whitened(rows, np.where(good, sigma, _NO_SAMPLE), first, free, columns)
        flat = white.reshape(-1, white.shape[2])
        places = np.append(oe.places(k), size + k)
        whole[np.ix_(places, places)] += flat.T @ flat
        if thrust_noise[k] > 0.0:
            whole[size + k, size + k] += thrust_noise[k] ** -2.0 - 1.0
    return whole


def _pushed_by_thrust(oe: OutputError, theta: Array, predicted: Sequence[Array]) -> list[Array]:
    """Derivatives (N, 12) of each run's outputs by its thrust, 1/N."""
    old = oe.predictor
    records = [replace(record, thrust=record.thrust + _THRUST_STEP) for record in old.records]
    predictor = Predictor(old.flat, old.parameters, records, sub_steps=old.sub_steps, command_first=old.command_first)
    moved = OutputError(predictor, oe.guesses, [OUTPUTS[j] for j in oe.columns]).predict(theta)
    return [(after - before) / _THRUST_STEP for after, before in zip(moved, predicted, strict=True)]


def _thrust_noise(problem: Problem, vehicle: Vehicle) -> list[float]:
    """Standard error of the mean of each run's measured thrust, N; 0 where it follows from the throttle."""
    noise = channel_noise(vehicle)
    found = []
    for record in problem.records:
        sample = math.hypot(noise["thrust"], record.moving_mass * noise["ax"])
        found.append(sample / math.sqrt(record.length) if np.isfinite(record.thrust).all() else 0.0)
    return found


def _expected(
    chosen: Sequence[str],
    values: Mapping[str, float],
    names: Sequence[str],
    covariance: Array,
    units: Mapping[str, str],
) -> tuple[Expected, ...]:
    std = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(std, std)
    np.fill_diagonal(correlation, 0.0)
    found = []
    for name in chosen:
        i = names.index(name)
        j = int(np.argmax(np.abs(correlation[i])))
        partner = (names[j], float(correlation[i, j])) if abs(correlation[i, j]) > _CORRELATED else None
        found.append(Expected(name, values.get(name, 0.0), float(std[i]), units.get(name, "1"), partner))
    return tuple(found)


def _sensors(
    problem: Problem, compatible: CompatibilityResult, names: Sequence[str], covariance: Array
) -> tuple[Expected, ...]:
    """Sensor errors of the estimate, and those that the compatibility check alone estimates (the wind)."""
    units = {name: SENSOR_ERRORS[name][2] for name in problem.sensors}
    own = _expected(list(problem.sensors), {}, names, covariance, units)
    others = [
        Expected(name, 0.0, error.std, error.unit)
        for name, error in compatible.parameters.items()
        if name not in problem.sensors
    ]
    return (*own, *others)


def _warnings(vehicle: Vehicle, model: Model, names: Sequence[str], flown: FlownFlight, gusts: float) -> list[str]:
    found = [f"{name} of the prior model is not estimated; give --structure" for name in model.coefficients
             if name not in names]  # fmt: skip
    if gusts > 0.0:
        found.append(
            f"turbulence of {gusts:g} m/s: these are bounds of an estimator that knows it (filter error); plain output "
            "error is several times worse"
        )
    for signal, (low, high) in model.validity.items():
        values = flown.truth["V" if signal == "airspeed" else signal] if signal in ("alpha", "airspeed") else None
        if values is not None and (values.min() < low or values.max() > high):
            unit, factor = ("deg", math.degrees(1.0)) if signal == "alpha" else ("m/s", 1.0)
            reach = f"{factor * values.min():.3g} to {factor * values.max():.3g} {unit}"
            holds = f"{factor * low:.3g} to {factor * high:.3g} {unit}"
            found.append(f"{signal} goes from {reach}; the prior model holds from {holds}")
    for j, control in enumerate((*CONTROLS, *vehicle.named_controls)):
        if control in vehicle.controls and control != "throttle":
            low, high = vehicle.controls[control].limits
            moved = flown.command[:, j]
            if np.ptp(moved) > 0.0 and (moved.min() < low + _STOP or moved.max() > high - _STOP):
                stops = f"{low:.3g} to {high:.3g}"
                if control not in vehicle.named_controls:
                    stops = f"{math.degrees(low):.3g} to {math.degrees(high):.3g} deg"
                found.append(f"{control} reaches its stop ({stops}); make it smaller")
    return found
