"""Predictions of a planned flight: against flights identified afterwards, scaling laws and optimality conditions."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from own_bars import own_bar

from sim_vehicle.manoeuvres.plan import Plan, plan_from_json, plan_of
from sim_vehicle.manoeuvres.shapes import CONTROLS, manoeuvre
from sim_vehicle.model.model_file import Model, read_model
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.design import Prediction, predict, structure_of
from sysid.design.manoeuvre_sizing import band_harmonics, mode_frequencies, multisine, peak_factors, timed, tuned_plan
from sysid.design.multisine_spectrum import GROUPS, Limits, costs, optimal_amplitudes, prior_linear, responses
from sysid.design.simulated_flight import CHANNELS_OF, channel_noise, rehearse
from sysid.errors import EstimationError
from sysid.identification.linear_model import OUTPUTS, LinearModel, linearise
from sysid.identify import identify

VEHICLE = load_vehicle("iitb-mav")
MODEL = read_model("iitb-mav")
DENSITY = 1.2


@pytest.fixture(scope="module")
def linear() -> LinearModel:
    return prior_linear(VEHICLE, MODEL, structure_of(VEHICLE, None), 15.0, DENSITY)


@pytest.fixture(scope="module")
def elevator_plan() -> Plan:
    return tuned_plan(VEHICLE, MODEL, ["elevator-3211"])


@pytest.fixture(scope="module")
def elevator(elevator_plan: Plan) -> Prediction:
    return predict(VEHICLE, MODEL, elevator_plan, rehearsals=1)


@pytest.mark.whole_flight
def test_flights_made_afterwards_scatter_and_report_as_predicted(elevator_plan: Plan, elevator: Prediction) -> None:
    truth = MODEL.values()
    misses, ratios = [], []
    for seed in (31, 32):
        signals, _ = rehearse(VEHICLE, MODEL, elevator_plan, seed=seed, max_step=0.0021)
        found = identify([signals], VEHICLE).model.coefficients
        for name in (entry.name for entry in elevator.coefficients):
            value, std = found[name].value, own_bar(found[name])
            assert value is not None, name
            assert std is not None
            misses.append((value - truth.get(name, 0.0)) / elevator.std(name))
            ratios.append(std / elevator.std(name))
    assert np.median(ratios) == pytest.approx(1.0, abs=0.1)
    assert np.percentile(ratios, [5.0, 95.0]) == pytest.approx([1.0, 1.0], abs=0.3)
    # Ten coefficients of two flights, correlated among themselves: as good as some eight independent ones.
    assert 0.4 < np.sqrt(np.mean(np.square(misses))) < 1.7


def test_what_is_not_excited_is_refused_with_a_manoeuvre_that_would(elevator: Prediction) -> None:
    refused = {refusal.name: refusal for refusal in elevator.refused}
    assert refused["Cl_da"].manoeuvre == "aileron-multisine"
    assert refused["Cn_dr"].manoeuvre == "rudder-multisine"
    assert "do not move" in refused["Cl_da"].reason
    assert not refused.keys() & {entry.name for entry in elevator.coefficients}
    assert {"CL_alpha", "Cm_de"} <= {entry.name for entry in elevator.coefficients}
    assert 0.0 < elevator.score < 1.0


def test_a_timid_flight_is_told_to_tell_less(elevator_plan: Plan) -> None:
    timid = elevator_plan.with_settings({"amplitude": math.radians(0.35)})
    noisy = replace(VEHICLE, sensors=replace(VEHICLE.sensors, gyro=replace(VEHICLE.sensors.gyro, noise=0.05),
                    accelerometer=replace(VEHICLE.sensors.accelerometer, noise=2.0)))  # fmt: skip
    prediction = predict(noisy, MODEL, timid, rehearsals=1)
    refused = {refusal.name: refusal for refusal in prediction.refused}
    assert "not identified" in refused["CL_de"].reason
    assert refused["CL_de"].manoeuvre == "elevator-multisine"


def test_errors_are_proportional_to_the_noise(elevator_plan: Plan, elevator: Prediction) -> None:
    """Closed form: information is a sum of squares over the squared noise."""
    sensors = {key: getattr(VEHICLE.sensors, key) for key in CHANNELS_OF}
    quiet = {key: replace(entry, noise=0.9 * entry.noise) for key, entry in sensors.items() if entry.noise is not None}
    better = predict(replace(VEHICLE, sensors=replace(VEHICLE.sensors, **quiet)), MODEL, elevator_plan, rehearsals=1)
    assert {entry.name for entry in better.sensor_errors} == {entry.name for entry in elevator.sensor_errors}
    for name in ("CL_alpha", "CL_de", "CL_q", "Cm_alpha", "Cm_de", "Cm_q"):
        assert better.std(name) == pytest.approx(0.9 * elevator.std(name), rel=0.02), name


def test_every_sensor_takes_the_noise_of_the_vehicle_file() -> None:
    louder = replace(VEHICLE, sensors=replace(VEHICLE.sensors, gyro=replace(VEHICLE.sensors.gyro, noise=0.01)))
    assert channel_noise(louder)["q"] == 0.01
    assert channel_noise(louder)["az"] == channel_noise(VEHICLE)["az"]
    signals, flown = rehearse(louder, MODEL, plan_of(["cruise"]), seed=3)
    noise = np.std(signals.signals["q"].values - flown.truth["q"])
    assert noise == pytest.approx(0.01, rel=0.1)


def test_slopes_of_the_responses_are_those_of_python_control(linear: LinearModel) -> None:
    import control

    frequencies = np.array([0.3, 1.2, 3.0])
    for axis, column in (("elevator", 0), ("rudder", 2)):
        gains, slopes = responses(linear, axis, frequencies)
        for name in ("Cm_alpha", "CL_de", "Cn_beta", "Cl_p"):
            step = 1e-4
            moved = []
            for sign in (1.0, -1.0):
                shifted = MODEL.with_coefficient(name, MODEL.values()[name] + sign * step)
                system = linearise(VEHICLE, shifted, 15.0, DENSITY).system
                space = control.ss(system.A, system.B[:, [column]], system.C, system.D[:, [column]])
                moved.append(space(2j * np.pi * frequencies)[:, 0, :])
            expected = ((moved[0] - moved[1]) / (2.0 * step)).T
            own = slopes[linear.names.index(name)]
            assert np.abs(own - expected).max() < 2e-3 * max(np.abs(expected).max(), 1e-3), (axis, name)
        space = control.ss(linear.system.A, linear.system.B[:, [column]], linear.system.C, linear.system.D[:, [column]])
        assert np.abs(gains - space(2j * np.pi * frequencies)[:, 0, :].T).max() < 1e-6


def information(linear: LinearModel, powers: dict[str, np.ndarray], harmonics: dict[str, tuple[int, ...]],
                length: float, samples: int) -> np.ndarray:  # fmt: skip
    """Information of harmonics of these squared amplitudes, coefficients in usual sizes, priors included."""
    from sysid.problem.model_structure import usual_size

    noise = channel_noise(VEHICLE)
    sigma = np.array([noise["airspeed" if name == "V" else name] for name in OUTPUTS])
    size = np.array([usual_size(name) for name in linear.names])
    total = np.eye(size.size)
    for axis, numbers in harmonics.items():
        _, slopes = responses(linear, axis, np.asarray(numbers) / length)
        scaled = slopes * size[:, None, None] / sigma
        for f, power in enumerate(powers[axis]):
            total += 0.5 * samples * power * np.real(scaled[:, f] @ scaled[:, f].conj().T)
    return total


def test_the_d_optimal_spectrum_beats_every_other_of_the_same_cost(linear: LinearModel) -> None:
    length, samples, limits = 18.0, 900, Limits()
    harmonics = band_harmonics(["elevator", "aileron", "rudder"], linear, length)
    best = optimal_amplitudes(linear, harmonics, length, limits, channel_noise(VEHICLE), samples, flat_share=0.0)
    price = {axis: costs(linear, axis, np.asarray(numbers) / length, limits) for axis, numbers in harmonics.items()}
    spent: dict[tuple[str, ...], float] = {}
    for axis, amplitudes in best.items():
        spent[GROUPS[axis]] = spent.get(GROUPS[axis], 0.0) + float(price[axis] @ amplitudes**2)
    assert list(spent.values()) == pytest.approx([1.0] * len(spent), rel=1e-9)
    top = np.linalg.slogdet(information(linear, {a: v**2 for a, v in best.items()}, harmonics, length, samples))[1]
    generator = np.random.default_rng(4)
    for _ in range(20):
        share = {axis: generator.exponential(size=len(numbers)) for axis, numbers in harmonics.items()}
        sums = {group: sum(float(share[a].sum()) for a in harmonics if GROUPS[a] == group) for group in spent}
        powers = {axis: share[axis] / sums[GROUPS[axis]] / price[axis] for axis in harmonics}
        assert np.linalg.slogdet(information(linear, powers, harmonics, length, samples))[1] < top
    # Kiefer and Wolfowitz: nowhere would a little more power of the same cost tell more than what is there tells.
    covariance = np.linalg.inv(information(linear, {a: v**2 for a, v in best.items()}, harmonics, length, samples))
    for group in spent:
        gains, weights = [], []
        for axis in (a for a in harmonics if GROUPS[a] == group):
            for f, cost in enumerate(price[axis]):
                unit = {a: np.zeros(len(n)) for a, n in harmonics.items()}
                unit[axis][f] = 1.0 / cost
                more = information(linear, unit, harmonics, length, samples) - np.eye(covariance.shape[0])
                gains.append(float(np.trace(covariance @ more)))
                weights.append(cost * best[axis][f] ** 2)
        assert max(gains) < 1.05 * np.average(gains, weights=weights)


@pytest.mark.parametrize(("name", "axis"), [("elevator-doublet", "elevator"), ("rudder-doublet", "rudder")])
def test_a_timed_doublet_has_its_spectrum_on_the_mode(linear: LinearModel, name: str, axis: str) -> None:
    segment = timed(manoeuvre(name), linear)
    time = np.arange(0.0, 200.0, 0.02)
    power = np.abs(np.fft.rfft(segment.increments(time)[:, CONTROLS.index(axis)])) ** 2
    frequency = np.fft.rfftfreq(time.size, 0.02)
    assert 2.0 * np.pi * frequency[np.argmax(power)] == pytest.approx(mode_frequencies(linear)[axis], rel=0.1)


def test_a_timed_3211_has_the_centre_of_its_energy_on_the_mode(linear: LinearModel) -> None:
    segment = timed(manoeuvre("rudder-3211"), linear)
    time = np.arange(0.0, 200.0, 0.02)
    power = np.abs(np.fft.rfft(segment.increments(time)[:, 2])) ** 2
    frequency = np.fft.rfftfreq(time.size, 0.02)
    low = frequency < 6.0 / (2.0 * np.pi * segment.width)
    centre = 2.0 * np.pi * float((frequency * power)[low].sum() / power[low].sum())
    assert centre == pytest.approx(mode_frequencies(linear)["rudder"], rel=0.1)


@pytest.mark.whole_flight
def test_a_tuned_multisine_keeps_within_the_limits_and_uses_them() -> None:
    vehicle, model = load_vehicle("ultrastick25e"), read_model("ultrastick25e")
    limits = Limits(alpha=math.radians(4.0), surface=math.radians(5.0))
    plan = tuned_plan(vehicle, model, ["multisine"], limits=limits)
    (segment,) = plan.segments
    assert max(peak_factors(plan).values()) <= 1.2
    values = segment.increments(np.arange(0.0, segment.duration, 0.02))[:, :3]
    inner = values.T @ values / np.sqrt(np.outer(np.sum(values**2, axis=0), np.sum(values**2, axis=0)))
    assert np.abs(inner - np.eye(3)).max() < 1e-9
    _, flown = rehearse(vehicle, model, plan, seed=9, noise="none", max_step=0.003)
    allowed = limits.of_outputs(float(flown.truth["V"][0]))
    used = {name: np.max(np.abs(flown.truth[name] - flown.truth[name][0])) / limit for name, limit in allowed.items()}
    assert max(used.values()) < 1.02
    peaks = segment.amplitudes
    assert max(peaks.values()) <= limits.surface + 1e-12
    assert max(used["alpha"], used["V"], used["theta"], peaks["elevator"] / limits.surface) > 0.85
    assert max(used["beta"], used["phi"], *(peaks[axis] / limits.surface for axis in ("aileron", "rudder"))) > 0.85
    again = plan_from_json(plan.to_json())
    assert again.segments[0].increments(np.arange(0.0, 20.0, 0.02)) == pytest.approx(
        segment.increments(np.arange(0.0, 20.0, 0.02)), abs=1e-12
    )


def test_a_weighted_multisine_flies_the_weights_of_its_plan_file(linear: LinearModel) -> None:
    designed = multisine(VEHICLE, linear, manoeuvre("rudder-multisine"), 18.0, Limits(), "d-optimal")
    (segment,) = plan_from_json(Plan((designed,)).to_json()).segments
    values = segment.increments(segment.start + np.arange(900) * 0.02)[:, 2]
    size = np.abs(np.fft.rfft(values))[list(segment.harmonics["rudder"])]
    assert size / size.max() == pytest.approx(segment.weights["rudder"], rel=1e-6)
    assert np.ptp(segment.weights["rudder"]) > 0.3


@pytest.mark.parametrize(
    ("vehicle", "names", "options", "words"),
    [
        (VEHICLE, ["multisine"], {"spectrum": "pink"}, "there are flat, d-optimal"),
        (VEHICLE, ["multisine"], {"duration": 4.0}, "longer --duration"),
        (replace(VEHICLE, controls={"throttle": VEHICLE.controls["throttle"]}), ["multisine"], {}, "no surface"),
    ],
)
def test_what_cannot_be_designed_is_told_in_one_line(
    vehicle: Vehicle, names: list[str], options: dict[str, object], words: str
) -> None:
    with pytest.raises(EstimationError, match=words) as told:
        tuned_plan(vehicle, MODEL, names, **options)  # type: ignore[arg-type]
    assert "\n" not in str(told.value)


def test_a_sensor_that_is_not_carried_is_not_predicted_for(elevator_plan: Plan) -> None:
    signals, _ = rehearse(VEHICLE, MODEL, elevator_plan, seed=1, without=("beta", "gps"))
    assert not {"beta", "vn", "lat"} & set(signals.signals)
    with pytest.raises(EstimationError, match="no sensor 'radar'"):
        rehearse(VEHICLE, MODEL, elevator_plan, seed=1, without=("radar",))


def test_the_structure_asked_for_is_what_is_predicted(elevator_plan: Plan) -> None:
    few = Model("few", {name: MODEL.coefficients[name] for name in ("CL_0", "CL_alpha", "Cm_alpha", "Cm_de")})
    prediction = predict(VEHICLE, MODEL, elevator_plan, structure=few, rehearsals=1)
    assert {entry.name for entry in prediction.coefficients} <= set(few.coefficients)
    assert any("is not estimated" in warning for warning in prediction.warnings)
