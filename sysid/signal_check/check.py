"""Before an estimation: no signal is in the wrong unit, sign or axis, and every signal is where it belongs in time."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass

import numpy as np

from sim_vehicle.constants import SEA_LEVEL_DENSITY, STANDARD_GRAVITY
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.errors import SignalError
from sysid.signal_check.fault import Mistake, delay_mistake
from sysid.signal_check.fault_hypotheses import SPEED
from sysid.signal_check.fault_search import DELAY_LEAST_S, find_mistakes
from sysid.signal_check.remedies import named_cures
from sysid.signals.delay import Delay, delay_sentence, prepared_in_time
from sysid.signals.flight import FlightData
from sysid.signals.preparation import Prepared
from sysid.signals.sensor_groups import GROUND

# What air can weigh between sea level in the cold and 10 km, kg/m^3.
_DENSITIES = (0.3, 1.7)
# Thrust over weight beyond which no small aircraft goes.
_THRUST_TO_WEIGHT = 5.0
_GRAM_FORCE = STANDARD_GRAVITY / 1000.0
# Wind in which no small aircraft flies, m/s: from here on Beaufort's scale calls it a hurricane. Larger ones meet half
# their own airspeed at height.
_HURRICANE = 32.7
# Lift coefficients between which aircraft fly straight, from fast to nearly stalled.
_LIFTS = (0.05, 2.0)


@dataclass(frozen=True)
class SignalCheck:
    """What was found: delays, for which the data are corrected, and other mistakes that only warn."""

    delays: tuple[Delay, ...] = ()
    mistakes: tuple[Mistake, ...] = ()

    def findings(self) -> list[Mistake]:
        """All mistakes, the delays with their last estimates; one that the estimate has taken back is none."""
        late = (one for one in self.delays if abs(one.value) > max(DELAY_LEAST_S, 2.0 * one.std))
        return [*self.mistakes, *map(delay_mistake, late)]


def check_signals(prepared: Sequence[Prepared], vehicle: Vehicle, as_recorded: Collection[str] = ()) -> SignalCheck:
    """Look for mistakes in the signals of flights, but for those taken as recorded.

    Raises SignalError where the data cannot be used as they are.
    """
    found = suspected(prepared, vehicle, as_recorded)
    stop_at_unusable(found, flights_named(prepared))
    delays = tuple(Delay(one.signals, one.found, one.std) for one in found if one.kind == "delay")
    return SignalCheck(delays, tuple(one for one in found if one.kind != "delay"))


def told_mistakes(prepared: Sequence[Prepared], vehicle: Vehicle, as_recorded: Collection[str] = ()) -> list[str]:
    """What is said of flights whose delays stay as they are, since a sensor's lag may be the effect that is looked for.

    Vanes that lag, or are not moved to the centre of gravity, can make the sign of a single signal look wrong, and an
    attitude that lags the scale of the rates: that is told and does not stop. Raises SignalError where the data cannot
    be used.
    """
    found = suspected(prepared, vehicle, as_recorded)
    doubtful = [one for one in found if one.kind in ("sign", "scale") and len(one.signals) == 1]
    stop_at_unusable([one for one in found if one not in doubtful], flights_named(prepared))
    late = [Delay(one.signals, one.found, one.std) for one in found if one.kind == "delay"]
    told = [one.sentence for one in found if one.kind != "delay" and one not in doubtful]
    told += [f"perhaps {one.sentence}" for one in doubtful]
    return [*told, *(delay_sentence(one, False) for one in late)]


def suspected(prepared: Sequence[Prepared], vehicle: Vehicle, as_recorded: Collection[str] = ()) -> list[Mistake]:
    """Whatever seems wrong with signals of flights, but for those taken as recorded, here or by the vehicle file."""
    kept = {*as_recorded, *vehicle.as_recorded}
    parts = [stretch.data for flight in prepared for stretch in flight.stretches]
    found = [*impossible_values(prepared, vehicle), *find_mistakes(parts, prepared[0].layout)]
    found += _impossible_winds(parts, {name for one in found if one.kind != "delay" for name in one.signals})
    found = [one for one in found if not kept.intersection(one.signals) and not _unflyable(one, prepared, vehicle)]
    return named_cures(found, prepared, vehicle)


def in_time(prepared: Sequence[Prepared], vehicle: Vehicle, check: SignalCheck) -> list[Prepared]:
    """The flights corrected for the delays."""
    return prepared_in_time(prepared, vehicle, check.delays)


def flights_named(prepared: Sequence[Prepared]) -> str:
    """Names of flights in one line."""
    return ", ".join(dict.fromkeys(flight.data.name for flight in prepared))


def stop_at_unusable(found: Sequence[Mistake], name: str) -> None:
    """Raise SignalError for mistakes that leave nothing to estimate from."""
    wrong = [one for one in found if not one.usable]
    if wrong:
        raise SignalError(f"{name}: {'; '.join(one.sentence for one in wrong)}")


def _unflyable(mistake: Mistake, prepared: Sequence[Prepared], vehicle: Vehicle) -> bool:
    """Whether a cure of the airspeed would make an aircraft that flies as read need a lift that no wing has.

    In gusts a multiple of the airspeed can look likelier than the airspeed itself, for what the gusts do to it.
    """
    if mistake.kind not in ("unit", "scale") or "airspeed" not in mistake.signals:
        return False
    read = np.concatenate([stretch.data["airspeed"] for flight in prepared for stretch in flight.stretches])
    load = np.concatenate([np.abs(stretch.data["az"]) for flight in prepared for stretch in flight.stretches])
    pressure = 0.5 * SEA_LEVEL_DENSITY * float(np.nanmedian(read)) ** 2
    lift = vehicle.mass.mass * float(np.nanmedian(load)) / max(pressure * vehicle.geometry.S, 1e-12)
    low, high = _LIFTS
    return low < lift < high and not 0.5 * low < lift / mistake.found**2 < 1.5 * high


def _impossible_winds(parts: Sequence[FlightData], doubted: AbstractSet[str]) -> list[Mistake]:
    """Velocities over ground that airspeed and heading would need a wind for that this aircraft would not fly in.

    Kinematics compare motions quicker than 0.15 Hz, and along a heading that is kept there may be none above the noise.
    doubted: signals with another mistake, which say nothing against these.
    """
    if doubted & {"airspeed", "theta", "psi"}:
        return []
    found = []
    for name in [n for n in GROUND if n not in doubted]:
        told = [part for part in parts if name in part and "psi" in part]
        air = np.concatenate([_along(part, name) for part in told]) if told else np.zeros(0)
        read = np.concatenate([part[name] for part in told]) if told else np.zeros(0)
        if not np.isfinite(read + air).any():
            continue
        here = np.isfinite(read + air)
        typical, flown = float(np.median(read[here])), float(np.median(air[here]))
        # Where the reading is no larger, it is the airspeed or the heading that may be wrong.
        greatest = max(_HURRICANE, 0.5 * float(np.nanmedian(np.concatenate([part["airspeed"] for part in told]))))
        if abs(typical) - abs(flown) <= greatest:
            continue
        unit, factor = min(SPEED.items(), key=lambda entry: abs(typical * entry[1] - flown))
        fits = abs(typical * factor - flown) < greatest
        cure = f"and looks like {unit}: scale it by {factor:.4g} in [signals] of the vehicle file"
        other = (
            "which this aircraft would not fly in: give its unit by scale and offset in [signals] of the vehicle file"
        )
        text = f"{name} would be a wind of {abs(typical - flown):.0f} m/s {cure if fits else other}"
        found.append(Mistake(name, "unit", factor if fits else float("nan"), float("nan"), unit, text, (name,), False))
    return found


def _along(part: FlightData, name: str) -> Array:
    """(N,) m/s, airspeed along north, east or down, on the way that the aircraft points."""
    theta, psi = part["theta"], part["psi"]
    shares = {"vn": np.cos(theta) * np.cos(psi), "ve": np.cos(theta) * np.sin(psi), "vd": -np.sin(theta)}
    return np.asarray(part["airspeed"] * shares[name])


def _too_strong(ratio: float) -> Mistake:
    """A thrust that is so many times the weight."""
    if ratio * _GRAM_FORCE > _THRUST_TO_WEIGHT:
        text = (
            f"thrust is {ratio:.0f} times the weight: check mass.mass in the vehicle file, and the unit of the thrust"
        )
        return Mistake("thrust", "unit", float("nan"), 0.0, "N", text, ("thrust",), False)
    text = (
        f"thrust is {ratio:.0f} times the weight and looks like gram-force: scale it by {_GRAM_FORCE:.4g} in"
        " [signals] of the vehicle file"
    )
    return Mistake("thrust", "unit", _GRAM_FORCE, 0.0, "gf", text, ("thrust",), False)


def impossible_values(prepared: Sequence[Prepared], vehicle: Vehicle) -> list[Mistake]:
    """Signals that no other one tells, against what is possible at all."""
    found = []
    density = np.concatenate([stretch.record.rho for flight in prepared for stretch in flight.stretches])
    typical = float(np.median(density))
    if not _DENSITIES[0] < typical < _DENSITIES[1]:
        text = (
            f"air density is {typical:.3g} kg/m^3, which no air has: give static pressure in Pa and temperature in K"
            " by their scale and offset in [signals], or environment.air_density"
        )
        found.append(Mistake("air_density", "unit", typical, 0.0, "kg/m^3", text, ("air_density",), False))
    thrust = [s.data["thrust"] for flight in prepared for s in flight.stretches if "thrust" in s.data]
    if thrust:
        ratio = float(np.nanmedian(np.abs(np.concatenate(thrust)))) / (vehicle.mass.mass * vehicle.environment.gravity)
        if ratio > _THRUST_TO_WEIGHT:
            found.append(_too_strong(ratio))
    return found
