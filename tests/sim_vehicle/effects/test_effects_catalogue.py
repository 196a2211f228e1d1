"""What every effect of the catalogue promises: names, defaults, errors, files, units, and what it changes in flight."""

from __future__ import annotations

import json
import math
import random
from dataclasses import replace
from functools import cache

import hand_flight as hf
import numpy as np
import pytest
from effect_values import HEIGHTS, NEUTRAL, VALUES, WITHOUT_NEUTRAL
from numpy.typing import NDArray

from sim_vehicle.effects import EFFECTS, Stage, parse_effect
from sim_vehicle.effects.confusable_effects import CONFUSIONS
from sim_vehicle.errors import ModelFileError
from sim_vehicle.flight.flight_loop import wind_of
from sim_vehicle.flight.plant import Plant
from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.model.model_file import Model, model_from_json, read_model
from sim_vehicle.physics.layout import CHANNELS
from sim_vehicle.vehicle.packed_model import flatten
from sim_vehicle.vehicle.vehicle_file import Vehicle

Array = NDArray[np.float64]

DT, TICKS = 0.02, 60
NAMES = sorted(EFFECTS)
OWN_CODE = [name for name in NAMES if not EFFECTS[name].is_coefficient]
AIR = {"steady_wind", "turbulence", "wind_shear"}


def commands(ticks: int = TICKS) -> Array:
    """Steps on all four controls, large enough for rate limits and free play, and one too small for a dead band."""
    wanted = np.tile(hf.SURFACES, (ticks, 1))
    wanted[5:20, 0] += 0.08
    wanted[15:35, 1] -= 0.06
    wanted[25:45, 2] += 0.07
    wanted[10:, 3] += 0.2
    wanted[45:, 0] += 0.003
    return wanted


def motion(plant: Plant, height: float, ticks: int = TICKS) -> tuple[Array, Array]:
    """Readings (N, 19) and rigid-body states (N, 13) of a flight from the general state in the model's own air."""
    x = hf.body_state()
    x[2] = -height
    state = hf.state_of(plant, x)
    air = wind_of(plant)
    gusts = air.gusts(ticks, DT, hf.V, np.random.default_rng(7))
    read, states = np.empty((ticks, len(CHANNELS))), np.empty((ticks, 13))
    for k, command in enumerate(commands(ticks)):
        read[k], states[k] = state.reading, state.x[:13]
        plant.step(state, command, DT, air.at(float(-state.x[2])), gusts[k])
    return read, states


def plain_vehicle() -> Vehicle:
    """The hand-worked aircraft with the motor's lag that the packaged one has."""
    return hf.vehicle(tau=0.1)


def flown(effects: dict[str, dict[str, float]], height: float = 100.0) -> tuple[Array, Array]:
    return motion(Plant(plain_vehicle(), hf.model_with(effects)), height)


@cache
def baseline(height: float) -> tuple[Array, Array]:
    return flown({}, height)


def test_the_tables_of_these_tests_cover_the_catalogue() -> None:
    assert sorted(VALUES) == NAMES
    assert sorted({*NEUTRAL, *WITHOUT_NEUTRAL}) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_an_entry_is_complete(name: str) -> None:
    effect = EFFECTS[name]
    assert effect.name == name
    assert name == name.lower()
    assert effect.title
    assert effect.separated_by
    assert effect.parameters
    for parameter in effect.parameters:
        assert parameter.unit
        assert parameter.low < parameter.high
        assert all(parameter.low <= start <= parameter.high for start in parameter.starts)
        assert bool(parameter.starts) == parameter.fitted
        assert parameter.default is None or parameter.low <= parameter.default <= parameter.high
        assert parameter.low <= VALUES[name].get(parameter.name, parameter.low) <= parameter.high
    if effect.is_coefficient:
        assert all(parse_term(parameter.name).name == parameter.name for parameter in effect.parameters)


@pytest.mark.parametrize("name", NAMES)
def test_defaults_are_filled_in_and_what_has_none_is_asked_for(name: str) -> None:
    effect = EFFECTS[name]
    given = VALUES[name]
    assert effect.complete(given) == given
    if effect.is_coefficient:
        first = next(iter(given))
        assert effect.complete({first: given[first]}) == {first: given[first]}
        with pytest.raises(ModelFileError, match=f"{name} needs a value for"):
            effect.complete({})
        return
    needed = [parameter.name for parameter in effect.parameters if parameter.default is None]
    defaults = {parameter.name: parameter.default for parameter in effect.parameters if parameter.default is not None}
    assert effect.complete({key: given[key] for key in needed}) == {**{key: given[key] for key in needed}, **defaults}
    for key in needed:
        with pytest.raises(ModelFileError, match=f"effect {name} needs {key}"):
            effect.complete({other: value for other, value in given.items() if other != key})


@pytest.mark.parametrize("name", NAMES)
def test_a_wrong_parameter_is_named_in_one_line(name: str) -> None:
    effect, key = EFFECTS[name], next(iter(VALUES[name]))
    for values, told in (
        ({**VALUES[name], "wibble": 1.0}, "no parameter wibble"),
        ({**VALUES[name], key: math.nan}, f"{key} must be a finite number"),
        ({**VALUES[name], key: math.inf}, f"{key} must be a finite number"),
    ):
        with pytest.raises(ModelFileError) as caught:
            effect.complete(values)
        assert str(caught.value).startswith(f"effect {name}")
        assert told in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("actuator_lag:tau=-0.02", "at least 0.001 s"),
        ("actuator_lag:tau=0", "at least 0.001 s"),
        ("actuator_delay:delay=-0.02", "at least 0 s"),
        ("actuator_backlash:width=-0.01", "at least 0 rad"),
        ("turbulence:sigma=-1", "at least 0 m/s"),
        ("turbulence:sigma=1,length=0", "at least 1 m"),
        ("stall:alpha_stall=-0.2", "at least 0.08 rad"),
        ("actuator_rate_limit:rate=0", "at least 0.05 rad/s"),
        ("unsteady_lift:tau=0", "at least 0.005 s"),
        ("mass_drop:fraction=-0.1,time=2", "at least 0 1"),
        ("mass_drop:fraction=0.1,time=2,duration=0", "at least 0.01 s"),
        ("sensor_time_skew:delay=-0.01,group=imu", "at least 0 s"),
        ("servo_deadband:width=-0.01", "at least 0 rad"),
    ],
)
def test_what_cannot_be_negative_or_nil_is_refused(text: str, told: str) -> None:
    with pytest.raises(ModelFileError, match=told) as caught:
        parse_effect(text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", NAMES)
def test_the_command_line_gives_the_same_effect(name: str) -> None:
    for separator in (",", ":"):
        shown = {key: EFFECTS[name].parameter(key).shown(value) for key, value in VALUES[name].items()}
        text = f"{name}:" + separator.join(f"{key}={value}" for key, value in shown.items())
        assert parse_effect(text) == (EFFECTS[name], VALUES[name])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "unknown effect"),
        ("stalling", "known are"),
        ("stall", "needs alpha_stall"),
        ("stall:alpha_stall", "KEY=NUMBER"),
        ("stall:alpha_stall=high", "KEY=NUMBER"),
        ("stall:alpha_stall=", "KEY=NUMBER"),
        ("stall:alpha=0.2", "no parameter alpha"),
        ("pitch_damping:Cm_r=1", "no parameter Cm_r"),
        ("vane_lag:tau=nan", "finite"),
        ("sensor_time_skew:delay=0.02", "needs group [one of vanes, air_data, imu, attitude]"),
        ("sensor_time_skew:delay=0.02,group=gps", "group must be one of vanes, air_data, imu, attitude, got 'gps'"),
        ("sensor_time_skew:delay=late,group=imu", "KEY=NUMBER"),
        ("configuration_step:dCL=0.2", "needs time"),
    ],
)
def test_a_wrong_effect_on_the_command_line_is_named_in_one_line(text: str, told: str) -> None:
    with pytest.raises(ModelFileError) as caught:
        parse_effect(text)
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", NAMES)
def test_a_model_file_carries_the_effect_there_and_back(name: str) -> None:
    stds = {key: abs(value) / 7.0 for key, value in VALUES[name].items()}
    model = read_model("iitb-mav").with_effect(EFFECTS[name], VALUES[name], stds)
    again = model_from_json(json.loads(json.dumps(model.to_json())))
    assert again == model
    if EFFECTS[name].is_coefficient:
        assert {key: again.values()[key] for key in VALUES[name]} == VALUES[name]
        assert {key: again.coefficients[key].std for key in stds} == stds
        assert again.effects == ()
    else:
        assert again.effect(name) == VALUES[name]
        assert {key: entry.std for key, entry in again.effects[0].parameters.items()} == stds
    vehicle = plain_vehicle()
    for a, b in zip(vars(flatten(vehicle, model)).values(), vars(flatten(vehicle, again)).values(), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", sorted(NEUTRAL))
def test_an_effect_of_nothing_changes_nothing(name: str) -> None:
    height = HEIGHTS.get(name, 100.0)
    read, states = flown({name: NEUTRAL[name]}, height)
    np.testing.assert_allclose(states, baseline(height)[1], atol=1e-9, rtol=1e-9)
    np.testing.assert_allclose(read, baseline(height)[0], atol=1e-8, rtol=1e-9)


SENSED = {
    "vane_lag": {"alpha", "beta"},
    "vane_upwash": {"alpha"},
    "vane_rate_error": {"alpha", "beta"},
    "airspeed_error": {"airspeed"},
    "pitot_lag": {"airspeed"},
    "accelerometer_misalignment": {"ax", "ay", "az"},
    "accelerometer_offset": {"ax", "ay", "az"},
    "imu_scale": {"p", "q", "r"},
    "attitude_lag": {"phi", "theta"},
    "sensor_time_skew": {"ax", "ay", "az", "p", "q", "r"},
    "thrust_sensor_hysteresis": {"thrust"},
}


@pytest.mark.parametrize("name", NAMES)
def test_an_effect_acts_where_the_catalogue_says(name: str) -> None:
    """A sensor effect changes its own readings and never the motion; every other one changes the motion."""
    height = HEIGHTS.get(name, 100.0)
    read, states = flown({name: VALUES[name]}, height)
    plain_read, plain_states = baseline(height)
    changed = {channel for j, channel in enumerate(CHANNELS) if np.abs(read - plain_read)[:, j].max() > 1e-6}
    if EFFECTS[name].stage is Stage.SENSOR:
        np.testing.assert_array_equal(states, plain_states)
        assert changed == SENSED[name]
    else:
        assert np.abs(states - plain_states).max() > 1e-4
        assert changed


@pytest.mark.parametrize("seed", range(4))
def test_the_order_of_effects_in_a_model_does_not_matter(seed: int) -> None:
    """All effects at once, in the order of the catalogue and shuffled."""
    shuffled = list(NAMES)
    random.Random(seed).shuffle(shuffled)
    runs = [flown({name: VALUES[name] for name in order}) for order in (NAMES, shuffled)]
    np.testing.assert_allclose(runs[1][0], runs[0][0], rtol=1e-9, atol=1e-9)
    assert np.isfinite(runs[0][0]).all()


# --- a change of units ---

LENGTH, TIME = 1.7, 0.6
# Mass as the cube of length: densities, and with them the standard one at sea level, keep their number.
MASS = LENGTH**3
FACTORS = {
    "1": 1.0, "1/rad": 1.0, "rad": 1.0, "s": TIME, "1/s": 1.0 / TIME, "rad/s": 1.0 / TIME, "m": LENGTH,
    "m/s": LENGTH / TIME, "1/rad2": 1.0, "N": MASS * LENGTH / TIME**2, "kg m2": MASS * LENGTH**2, "N s/m": MASS / TIME,
}  # fmt: skip
CHANNEL_FACTORS = np.array(
    [
        {
            "airspeed": LENGTH / TIME, "alpha": 1.0, "beta": 1.0, "p": 1.0 / TIME, "q": 1.0 / TIME, "r": 1.0 / TIME,
            "phi": 1.0, "theta": 1.0, "psi": 1.0, "thrust": MASS * LENGTH / TIME**2,
            "vn": LENGTH / TIME, "ve": LENGTH / TIME, "vd": LENGTH / TIME,
        }.get(name, LENGTH / TIME**2 if name.startswith("a") and name != "altitude" else LENGTH)
        for name in CHANNELS
    ]
)  # fmt: skip


def in_other_units(vehicle: Vehicle) -> Vehicle:
    """The same vehicle with length, time and mass counted in other units."""
    mass, geometry, motor = vehicle.mass, vehicle.geometry, vehicle.propulsion
    assert motor is not None
    assert motor.max_thrust is not None
    assert motor.max_rpm is not None
    assert motor.diameter is not None
    heavy = {name: getattr(mass, name) * MASS * LENGTH**2 for name in ("Ixx", "Iyy", "Izz", "Ixz")}
    return replace(
        vehicle,
        mass=replace(mass, mass=mass.mass * MASS, **heavy),
        geometry=replace(geometry, S=geometry.S * LENGTH**2, b=geometry.b * LENGTH, c=geometry.c * LENGTH),
        propulsion=replace(
            motor,
            line=(motor.line[0] * LENGTH, 0.0, 0.0),
            diameter=motor.diameter * LENGTH,
            max_thrust=motor.max_thrust * MASS * LENGTH / TIME**2,
            max_rpm=motor.max_rpm / TIME,
            tau=motor.tau * TIME,
            moving_mass=motor.moving_mass * MASS,
        ),
        environment=replace(vehicle.environment, gravity=vehicle.environment.gravity * LENGTH / TIME**2),
        flight=replace(vehicle.flight, airspeed=vehicle.flight.airspeed * LENGTH / TIME, altitude=100.0 * LENGTH),
    )


@pytest.mark.parametrize("name", OWN_CODE)
def test_an_effect_has_the_units_it_declares(name: str) -> None:
    """In other units of length, time and mass the same flight comes out, so no equation hides a number with a unit."""
    values = VALUES[name]
    units = {parameter.name: FACTORS[parameter.unit] for parameter in EFFECTS[name].parameters}
    scaled = {key: value * units[key] for key, value in values.items()}
    usual = Plant(plain_vehicle(), hf.model_with({name: values}))
    other = Plant(in_other_units(plain_vehicle()), hf.model_with({name: scaled}), max_step=0.005 * TIME)
    x, low = hf.body_state(), hf.body_state()
    x[2] = low[2] = -HEIGHTS.get(name, 100.0)
    x[:3] *= LENGTH
    x[3:6] *= LENGTH / TIME
    x[10:13] /= TIME
    states = [hf.state_of(usual, low), hf.state_of(other, x)]
    airs = [wind_of(plant) for plant in (usual, other)]
    gusts = [
        air.gusts(TICKS, step, speed, np.random.default_rng(7))
        for air, step, speed in zip(airs, (DT, DT * TIME), (hf.V, hf.V * LENGTH / TIME), strict=True)
    ]
    for k, command in enumerate(commands()):
        for plant, state, air, gust, step in zip((usual, other), states, airs, gusts, (DT, DT * TIME), strict=True):
            plant.step(state, command, step, air.at(float(-state.x[2])), gust[k])
        np.testing.assert_allclose(states[1].reading, states[0].reading * CHANNEL_FACTORS, rtol=1e-9, atol=1e-9)


def test_an_effect_of_the_air_is_left_to_the_air() -> None:
    """Wind is no property of the airframe: a plant alone flies as if it were calm."""
    for name in AIR:
        plant = Plant(plain_vehicle(), hf.model_with({name: VALUES[name]}))
        still = Plant(plain_vehicle(), Model("still", hf.model_with({}).coefficients))
        np.testing.assert_array_equal(plant.read(hf.state_of(plant)), still.read(hf.state_of(still)))


@pytest.mark.parametrize("name", NAMES)
def test_what_an_effect_is_confused_with_is_in_the_catalogue_and_a_manoeuvre_tells_them_apart(name: str) -> None:
    effect = EFFECTS[name]
    assert name in CONFUSIONS
    assert set(dict(effect.separations)) == set(CONFUSIONS[name]) <= set(NAMES) - {name}
    for other in NAMES:
        assert effect.manoeuvre_against(EFFECTS[other])


def test_the_manoeuvre_against_an_effect_is_the_pairs_own_seen_from_either_side() -> None:
    wash, tail, stall = EFFECTS["propwash_elevator"], EFFECTS["elastic_tail"], EFFECTS["stall"]
    assert wash.manoeuvre_against(tail) == tail.manoeuvre_against(wash) == dict(wash.separations)["elastic_tail"]
    lag, roll = EFFECTS["actuator_lag"], EFFECTS["roll_damping"]
    assert "roll_damping" not in dict(lag.separations)
    assert lag.manoeuvre_against(roll) == dict(roll.separations)["actuator_lag"]
    assert stall.manoeuvre_against(wash) == stall.separated_by


def test_a_model_file_holds_a_choice_by_its_name() -> None:
    """Written as a name; read as one with or without the braces of a value."""
    model = read_model("iitb-mav").with_effect(*parse_effect("sensor_time_skew:delay=0.02,group=attitude"))
    written = model.to_json()
    (effect,) = written["effects"]
    assert effect["parameters"] == {"delay": {"value": 0.02}, "group": {"value": "attitude"}}
    effect["parameters"]["group"] = "attitude"
    assert model_from_json(written) == model
    for wrong in ("gps", {"value": "gps"}, {"value": 7}, {"value": 1.5}):
        effect["parameters"]["group"] = wrong
        with pytest.raises(ModelFileError, match="group must be one of vanes, air_data, imu, attitude") as caught:
            model_from_json(written, "m.json")
        assert str(caught.value).startswith("m.json: ")
