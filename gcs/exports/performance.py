"""The performance of an identified aircraft: polar, glide, climb, turn, each with what the model's errors leave open.

Points of steady level flight are trimmed with the model as it flies, effects included; what follows from the polar is
by the usual formulas (Anderson, Aircraft Performance and Design, ch. 5). Errors are those of models drawn from the
joint error of the estimates, each with the mass that goes with it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from gcs.errors import ExportError, SettingsError
from gcs.exports.electric_flight import UNITS as _ELECTRIC
from gcs.exports.electric_flight import LevelFlight, PowerBalance, balance_of, electric_figures
from gcs.exports.exported import Exported
from gcs.exports.samples import drawn
from gcs.text.performance_words import WORDS
from sim_vehicle.constants import GAS_CONSTANT, STANDARD_GRAVITY
from sim_vehicle.errors import SimVehicleError
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.state import Trim
from sim_vehicle.flight.trim import solve_trim
from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.physics.atmosphere import pressure
from sim_vehicle.physics.atmosphere import temperature as standard_temperature
from sim_vehicle.physics.propeller import throttle_thrust
from sim_vehicle.vehicle.packed_model import flatten_vehicle
from sim_vehicle.vehicle.propulsion import Propulsion
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.signals.thrust.electric import printed_propeller

SAMPLES, SPEEDS = 100, 24
# Range of speeds over those that were flown, and over the usual one where the model does not say.
_BEYOND, _ABOUT = (0.75, 1.25), (0.6, 1.7)
_FINE = 400
# A climb of less is none: the service ceiling of a light aircraft, m/s; heights are looked at up to here, m.
_LEAST_CLIMB, _HIGHEST = 0.5, 8000.0
# Temperatures at which aircraft fly, degrees Celsius, and the zero of that scale, K.
_LOWEST, _COLDEST, _HOTTEST, ZERO_CELSIUS = -500.0, -60.0, 60.0, 273.15
# Thrust that no sensor measured, as the vehicle file has it, is known to this share.
_THRUST_STD = 0.05
_SLOW = "lies at or below the slowest speed of the table, beyond which the model is not asked"
_FAST = "lies at or above the fastest speed of the table, beyond which the model is not asked"
_NEVER = "full throttle does not hold level flight at any speed of the table"
_NO_STALL = "the angle of attack of the stall is not reached at the slowest speed of the table"
_OF_THRUST = ("max_climb", "max_climb_speed", "max_speed", "ceiling", "min_turn_radius")
# Times the weight, of a thrust that holds any level flight.
_ENOUGH = 100.0
# Share of the models drawn that must have a figure, else its interval would be that of those that do.
_MOST_DRAWN = 0.95
_UNITS = {
    "best_glide_ratio": "1", "best_glide_speed": "m/s", "min_sink": "m/s", "min_sink_speed": "m/s",
    "max_climb": "m/s", "max_climb_speed": "m/s", "max_speed": "m/s", "ceiling": "m", "min_turn_radius": "m",
    "stall_speed": "m/s", **_ELECTRIC,
}  # fmt: skip


@dataclass(frozen=True)
class _Polar:
    """Trimmed level flight of one model at the same speeds: (N,) angle of attack, rad, and coefficients."""

    speed: Array
    alpha: Array
    CL: Array
    CD: Array
    weight: float
    area: float

    def flown(self, count: int = _FINE) -> tuple[Array, Array, Array]:
        """(count,) lift and drag coefficient and angle of attack between the ends, finely."""
        order = np.argsort(self.CL)
        # Evenly in speed, which goes with the root of the inverse.
        fine = np.linspace(self.CL[order[0]] ** -0.5, self.CL[order[-1]] ** -0.5, count) ** -2.0
        along = [PchipInterpolator(self.CL[order], values[order])(fine) for values in (self.CD, self.alpha)]
        return fine, along[0], along[1]


def performance(
    model: Exported,
    mass: float | None = None,
    altitude: float = 0.0,
    temperature: float | None = None,
    progress: Callable[[float, str], None] = lambda share, text: None,
    powered: Mapping[str, Any] | None = None,
    battery: float | None = None,
) -> dict[str, Any]:
    """The sheet; the JSON of schema performance/1.

    mass: kg, the vehicle file's without it. altitude: m. temperature: degrees Celsius there, the standard atmosphere's
    without it. powered: what a result says of its battery. battery: what another holds, Wh. Raises SettingsError for
    what no aircraft has, ExportError or SimVehicleError where the model cannot be trimmed.
    """
    if mass is not None and not 0.0 < mass < math.inf:
        raise SettingsError(f"mass {mass:g}: give the mass in kg")
    if battery is not None and not 0.0 < battery < math.inf:
        raise SettingsError(f"battery {battery:g}: give the energy that it holds in Wh")
    if not _LOWEST <= altitude <= _HIGHEST:
        raise SettingsError(f"altitude {altitude:g}: give the height in m, {_LOWEST:g} to {_HIGHEST:g}")
    warmer = 0.0
    if temperature is not None:
        if not _COLDEST <= temperature <= _HOTTEST:
            raise SettingsError(
                f"temperature {temperature:g}: give the temperature in degrees Celsius, {_COLDEST:g} to {_HOTTEST:g}"
            )
        warmer = temperature + ZERO_CELSIUS - float(standard_temperature(altitude))
    _require_drag(model)
    rho = float(_density(np.array(altitude), warmer))
    speeds = _speeds(model)
    best = _polar(model, speeds, rho, mass)
    warnings = []
    others: list[tuple[_Polar, float, dict[str, _Figure]]] = []
    balance = balance_of(powered, printed_propeller(model.vehicle))
    random = np.random.default_rng(1)
    try:
        samples = drawn(model, SAMPLES)
    except ExportError as error:
        samples, warnings = [], [f"no intervals: {error}"]
    for number, one in enumerate(samples):
        progress((number + 1.0) / len(samples), "models drawn from the errors")
        try:
            polar = _polar(one, best.speed, rho, mass)
        except SimVehicleError:
            continue
        stronger, *luck = random.standard_normal(3).tolist()
        electric = {} if isinstance(balance, str) else _electric(one, polar, balance, rho, (luck[0], luck[1]), battery)
        others.append((polar, 1.0 + _THRUST_STD * stronger, electric))
    if samples and len(others) < 0.9 * len(samples):
        warnings.append(f"{len(samples) - len(others)} of {len(samples)} models drawn cannot fly level at these speeds")
    limits = model.model.validity
    if not limits:
        warnings.append("the model does not say at which speeds it was flown: what is extrapolated is not known")
    doubtful = [one for one in model.model.not_identified() if parse_term(one).axis in ("CL", "CD", "Cm")]
    if doubtful:
        warnings.append(f"not identified, and flown by the mean of a refused estimate: {', '.join(doubtful)}")
    found = {
        name: _with_errors(name, value, [_figures(model, p, rho, t, warmer) for p, t, _ in others], limits)
        for name, value in _figures(model, best, rho, 1.0, warmer).items()
    }
    if isinstance(balance, str):
        found |= {name: {"refused": balance} for name in _ELECTRIC}
    else:
        drawn_ones = [one for _, _, one in others]
        for name, value in _electric(model, best, balance, rho, (0.0, 0.0), battery).items():
            found[name] = _with_errors(name, value, drawn_ones, limits)
    if "stall" not in {effect.name for effect in model.model.effects}:
        found["stall_speed"] = {"refused": "no stall was approached: fly one, and let gcs discrepancy find it"}
    if _thrust(model.vehicle, best.speed, rho) is None:
        why = "thrust at full throttle is not known: give [propulsion] max_thrust, or CT and max_rpm"
        found |= {name: {"refused": why} for name in _OF_THRUST}
    return {
        "schema": "performance/1", "model": model.model.name, "vehicle": model.vehicle.name,
        "mass": mass or model.vehicle.mass.mass, "altitude": altitude, "temperature": temperature,
        "air_density": rho, "battery": battery, "figures": found,
        "speeds": _curves(model, best, [polar for polar, _, _ in others], rho), "warnings": warnings,
    }  # fmt: skip


def _density(altitude: Array, warmer: float) -> Array:
    """(N,) kg/m^3 at heights, (N,) m, in an atmosphere that is so much warmer than the standard one, K."""
    return np.asarray(pressure(altitude) / (GAS_CONSTANT * (standard_temperature(altitude) + warmer)))


def _require_drag(model: Exported) -> None:
    """Raise ExportError where the model does not say what an aircraft glides by."""
    known = {parse_term(name).axis for name in model.model.values()}
    for axis, what in (("CL", "lift"), ("CD", "drag"), ("Cm", "pitching moment")):
        if axis not in known:
            raise ExportError(f"{model.model.name}: it has no {what} that was identified ({axis}), and nothing follows")


def _speeds(model: Exported) -> Array:
    """(N,) m/s, about those that were flown."""
    flown = model.model.validity.get("airspeed")
    usual = model.vehicle.flight.airspeed
    low, high = (_BEYOND[0] * min(flown), _BEYOND[1] * max(flown)) if flown else (_ABOUT[0] * usual, _ABOUT[1] * usual)
    return np.linspace(max(low, 0.1 * high), high, SPEEDS)


def _polar(model: Exported, speeds: Array, rho: float, mass: float | None) -> _Polar:
    """Level flight at every speed at which the model can; SimVehicleError where that is hardly one."""
    vehicle = model.vehicle
    scale = 1.0 if mass is None else mass / model.vehicle.mass.mass
    weight = scale * vehicle.mass.mass * STANDARD_GRAVITY
    enough = Propulsion(max_thrust=_ENOUGH * weight)
    if vehicle.propulsion is not None:
        enough = replace(vehicle.propulsion, max_thrust=_ENOUGH * weight, CT=(), CQ=())
    there = replace(
        vehicle, environment=replace(vehicle.environment, air_density=rho), propulsion=enough,
        mass=replace(vehicle.mass, mass=scale * vehicle.mass.mass),
    )  # fmt: skip
    plant = Plant(there, model.model)
    rows, near, problem = [], None, None
    for speed in speeds[::-1]:
        try:
            near = trim = solve_trim(plant, float(speed), 0.0, near=near)
        except SimVehicleError as error:
            problem = error
            continue
        rows.append((float(speed), *_point(plant, trim, float(speed), rho, weight, there)))
    if len(rows) < SPEEDS // 3 and problem is not None:
        raise problem
    speed, alpha, CL, CD = np.array(rows[::-1]).T
    return _Polar(speed, alpha, CL, CD, weight, vehicle.geometry.S)


def _point(
    plant: Plant, trim: Trim, speed: float, rho: float, weight: float, vehicle: Vehicle
) -> tuple[float, float, float]:
    """Angle of attack and the coefficients that carry the weight against the thrust."""
    alpha = float(plant.outputs(trim.state)[1])
    thrust = float(trim.command[3] * (vehicle.propulsion.max_thrust or 0.0)) if vehicle.propulsion else 0.0
    inclined = alpha + (vehicle.propulsion.inclination if vehicle.propulsion else 0.0)
    pressure = 0.5 * rho * speed**2 * vehicle.geometry.S
    return alpha, (weight - thrust * math.sin(inclined)) / pressure, thrust * math.cos(inclined) / pressure


def _thrust(vehicle: Vehicle, speeds: Array, rho: float) -> Array | None:
    """(N,) at full throttle, N; None where the vehicle file does not say."""
    if vehicle.propulsion is None or not vehicle.propulsion.by_throttle:
        return None
    constants = flatten_vehicle(vehicle)
    return np.array([throttle_thrust(1.0, float(speed), rho, constants) for speed in speeds])


_Figure = tuple[float | str, float, float]
# What is refused of it says why; without a battery's energy nothing is said of how long it lasts.
_NO_DRAG = "the battery gave less than this model's drag takes: one of both is wrong"
_NO_BATTERY = "give what the battery holds in Wh"


def _electric(
    model: Exported, polar: _Polar, balance: PowerBalance, rho: float, luck: tuple[float, float], battery: float | None
) -> dict[str, _Figure]:
    """What level flight costs the battery: as `_figures`."""
    speed = np.linspace(polar.speed[0], polar.speed[-1], _FINE)
    CD, alpha = (PchipInterpolator(polar.speed, values)(speed) for values in (polar.CD, polar.alpha))
    motor = model.vehicle.propulsion
    drag = 0.5 * rho * speed**2 * polar.area * CD
    thrust = drag / np.cos(alpha + (0.0 if motor is None else motor.inclination))
    flown = model.vehicle.mass.mass * STANDARD_GRAVITY
    found = electric_figures(balance, LevelFlight(speed, thrust, polar.weight, flown, rho), luck, battery)
    figures: dict[str, _Figure] = dict.fromkeys(_ELECTRIC, (_NO_DRAG, 0.0, 0.0))
    if battery is None:
        figures |= dict.fromkeys(("endurance", "range"), (_NO_BATTERY, 0.0, 0.0))
    for name, (value, at) in found.items():
        beyond = _SLOW if at == 0 else _FAST if at == speed.size - 1 else ""
        known = name == "drive_efficiency"
        figures[name] = (value if known else beyond or value, float(speed[at]), float(alpha[at]))
    return figures


def _figures(model: Exported, polar: _Polar, rho: float, stronger: float, warmer: float) -> dict[str, _Figure]:
    """Name -> value, or why there is none, and the speed and angle of attack that it is flown at."""
    CL, CD, alpha = polar.flown()
    loading = 2.0 * polar.weight / (rho * polar.area)
    speed = np.sqrt(loading / CL)

    def at(i: int, value: float) -> _Figure:
        # What lies at an end of the polar may lie beyond it: the last has the most lift.
        beyond = _SLOW if i == CL.size - 1 else _FAST if i == 0 else ""
        return beyond or float(value), float(speed[i]), float(alpha[i])

    # In a glide lift and drag together carry the weight.
    air = np.sqrt(loading / np.hypot(CL, CD))
    sink = air * CD / np.hypot(CL, CD)
    glide, slow = int(np.argmax(CL / CD)), int(np.argmin(sink))
    found = {
        "best_glide_ratio": at(glide, CL[glide] / CD[glide]), "best_glide_speed": at(glide, air[glide]),
        "min_sink": at(slow, sink[slow]), "min_sink_speed": at(slow, air[slow]),
    }  # fmt: skip
    thrust = _thrust(model.vehicle, speed, rho)
    if thrust is not None:
        thrust = stronger * thrust
        climb = (thrust - 0.5 * rho * speed**2 * polar.area * CD) * speed / polar.weight
        top, level = int(np.argmax(climb)), np.flatnonzero(climb >= 0.0)
        found["max_climb"], found["max_climb_speed"] = at(top, climb[top]), at(top, speed[top])
        found["ceiling"] = (_ceiling(model, polar, stronger, warmer), float(speed[top]), float(alpha[top]))
        nowhere: _Figure = (_NEVER, 0.0, 0.0)
        fast = int(level[0]) if level.size else 0
        found["max_speed"] = at(fast, speed[fast]) if level.size else nowhere
        found["min_turn_radius"] = _turn(polar, rho, thrust) if level.size else nowhere
    stall = model.model.effect("stall")
    if stall is not None:
        near = int(np.argmin(np.abs(alpha - stall["alpha_stall"])))
        reached = float(np.max(alpha)) >= stall["alpha_stall"]
        found["stall_speed"] = (float(speed[near]) if reached else _NO_STALL, float(speed[near]), float(alpha[near]))
    return found


def _turn(polar: _Polar, rho: float, thrust: Array) -> _Figure:
    """The tightest turn that thrust sustains at lift that was flown. thrust: (N,) N, at the speeds of level flight."""
    CL, CD, alpha = polar.flown()
    speed = np.sqrt(2.0 * polar.weight / (rho * polar.area * CL))
    best: _Figure = (_NEVER, 0.0, 0.0)
    tightest = math.inf
    for i in range(CL.size):
        # At that lift drag goes with the pressure: the fastest flight in which thrust holds it.
        drag = 0.5 * rho * speed**2 * polar.area * CD[i]
        held = np.flatnonzero(thrust >= drag)
        if not held.size:
            continue
        fast = float(speed[held[0]])
        load = 0.5 * rho * fast**2 * polar.area * float(CL[i]) / polar.weight
        if load <= 1.0:
            continue
        radius = fast**2 / (STANDARD_GRAVITY * math.sqrt(load**2 - 1.0))
        if radius < tightest:
            tightest = radius
            best = (_SLOW if i == CL.size - 1 else radius, fast, float(alpha[i]))
    return best


def _ceiling(model: Exported, polar: _Polar, stronger: float, warmer: float) -> float | str:
    """Height, m, where the climb falls below what counts as one, or why there is none."""
    CL, CD, _ = polar.flown(60)
    heights = np.linspace(0.0, _HIGHEST, 41)
    climbs = []
    for rho in _density(heights, warmer):
        speed = np.sqrt(2.0 * polar.weight / (rho * polar.area * CL))
        thrust = _thrust(model.vehicle, speed, float(rho))
        assert thrust is not None  # asked where there is one
        drag = polar.weight * CD / CL
        climbs.append(float(np.max((stronger * thrust - drag) * speed / polar.weight)))
    above = np.array(climbs) >= _LEAST_CLIMB
    if above.all():
        return f"it still climbs at {_HIGHEST:g} m"
    if not above[0]:
        return f"it climbs by less than {_LEAST_CLIMB:g} m/s at 0 m already"
    last = int(np.flatnonzero(above)[-1])
    return float(np.interp(-_LEAST_CLIMB, [-climbs[last], -climbs[last + 1]], heights[last : last + 2]))


def _with_errors(
    name: str,
    found: _Figure,
    others: list[dict[str, _Figure]],
    limits: Mapping[str, tuple[float, float]],
) -> dict[str, Any]:
    """The entry of a figure: value, standard error and 95 % interval of the models drawn, whether it was flown."""
    value, speed, alpha = found
    if isinstance(value, str):
        return {"refused": value}
    entry: dict[str, Any] = {"value": value, "unit": _UNITS[name]}
    drawn_values = np.array([one[name][0] for one in others if name in one and not isinstance(one[name][0], str)])
    if others and drawn_values.size >= _MOST_DRAWN * len(others):
        low, high = np.percentile(drawn_values, (2.5, 97.5))
        entry |= {"std": float(np.std(drawn_values)), "interval": [float(low), float(high)]}
    inside = [
        low <= at <= high
        for key, at in (("airspeed", speed), ("alpha", alpha))
        if key in limits
        for low, high in (limits[key],)
    ]
    return {**entry, "extrapolated": not all(inside) if inside else None}


def _curves(model: Exported, best: _Polar, others: list[_Polar], rho: float) -> list[dict[str, Any]]:
    """At every speed the polar, drag, power and climb, with 95 % of the models drawn."""
    thrust = _thrust(model.vehicle, best.speed, rho)
    limits = model.model.validity
    rows = []
    for i, speed in enumerate(best.speed):
        at = [one for one in others if np.any(np.isclose(one.speed, speed))]
        drags = [0.5 * rho * speed**2 * one.area * float(one.CD[np.argmin(np.abs(one.speed - speed))]) for one in at]
        drag = 0.5 * rho * speed**2 * best.area * best.CD[i]
        inside = None if "airspeed" not in limits else min(limits["airspeed"]) <= speed <= max(limits["airspeed"])
        row: dict[str, Any] = {
            "speed": float(speed), "alpha": float(best.alpha[i]), "CL": float(best.CL[i]), "CD": float(best.CD[i]),
            "drag": float(drag), "power_required": float(drag * speed),
            "extrapolated": None if inside is None else not inside,
        }  # fmt: skip
        if drags:
            row["drag_interval"] = [float(one) for one in np.percentile(drags, (2.5, 97.5))]
        if thrust is not None:
            row |= {
                "thrust_available": float(thrust[i]), "climb": float((thrust[i] - drag) * speed / best.weight),
            }  # fmt: skip
        rows.append(row)
    return rows


def performance_text(found: Mapping[str, Any]) -> str:
    """The sheet as lines."""
    lines = [
        f"{found['vehicle']}, model {found['model']}: {found['mass']:.4g} kg at {found['altitude']:.0f} m"
        f" ({found['air_density']:.3f} kg/m^3)",
        f"  {'figure':<32}{'value':>9}  {'95 % interval':<20}",
    ]
    for name, entry in found["figures"].items():
        if "refused" in entry:
            lines.append(f"  {WORDS[name]:<32}{'-':>9}  {entry['refused']}")
            continue
        unit = "" if entry["unit"] == "1" else f" {entry['unit']}"
        ends = entry.get("interval")
        between = "" if ends is None else f"{ends[0]:.3g} … {ends[1]:.3g}{unit}"
        beyond = "  beyond what was flown" if entry["extrapolated"] else ""
        lines.append(f"  {WORDS[name]:<32}{entry['value']:>9.3g}  {between:<20}{beyond}".rstrip())
    lines += [
        "",
        f"  {'V, m/s':>7}{'alpha, deg':>12}{'CL':>8}{'CD':>9}{'drag, N':>10}{'power, W':>10}{'climb, m/s':>12}",
    ]
    for row in found["speeds"]:
        climb = f"{row['climb']:.2f}" if "climb" in row else "-"
        lines.append(
            f"  {row['speed']:>7.1f}{math.degrees(row['alpha']):>12.1f}{row['CL']:>8.3f}{row['CD']:>9.4f}"
            f"{row['drag']:>10.3f}{row['power_required']:>10.1f}{climb:>12}{'  beyond' if row['extrapolated'] else ''}"
        )
    return "\n".join([*lines, *(f"warning: {one}" for one in found["warnings"])])
