"""Identification by the posterior with an estimated noise spectrum (`--method map`): from signals to a model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_vehicle.effects.thrust_line_offset import THRUST_LINE_OFFSET
from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.model.model_file import Coefficient, Model, ModelEffect
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.compatibility.reconstruction import CompatibilityResult, Refusal, check_compatibility
from sysid.equation_error.coefficients import body_of
from sysid.equation_error.dead_surfaces import frozen_commands, part_of
from sysid.errors import SignalError, SysidError
from sysid.identification.repaired_flight import RepairedFlight, missing_inertial
from sysid.identification.request import Request
from sysid.identification.result_model import with_extra
from sysid.numerics.gaussian import Gaussian
from sysid.numerics.statistics import without
from sysid.posterior.analysis import estimate
from sysid.posterior.estimates import UNINFORMED_RATIO, NuisanceEstimate, PosteriorEstimate
from sysid.posterior.flight_part import FlightPart, make_part
from sysid.posterior.nuisance_priors import MOVING_MASS, PRODUCT_INERTIA, THRUST_ARM
from sysid.posterior.stated_priors import is_line_given, unused_timing
from sysid.problem.coefficient_residuals import moment_noise
from sysid.problem.estimation_problem import coefficient_entries, flying
from sysid.problem.formulation import corrected_parts, known_before
from sysid.problem.model_structure import default_structure, helpful_manoeuvre, not_believed, not_identified
from sysid.signals.flight import FlightSignals, moved_controls, standing_controls
from sysid.signals.preparation import Prepared
from sysid.signals.record import SURFACES
from sysid.signals.sensor_groups import ACCEL
from sysid.uncertainty.inertia import inertia_shares
from sysid.uncertainty.travel import travel_shares

# Parameter of the effect that a thrust line off the centre of gravity is.
_HEIGHT = THRUST_LINE_OFFSET.parameters[0].name
# Standard error over that of the prior model from which on a value is the prior's: the flight adds a twentieth at most.
_AS_KNOWN = 0.975
# Terms whose usual size holds for any aircraft; rates and surfaces go with its tailplane's lever and its chords.
_STATIC = frozenset(("alpha", "beta"))
# Standard errors from which on the thrust's moment is another one than the vehicle file's, and what of it is no moment,
# mean chords.
_SEEN, _NO_ARM = 3.0, 0.01
# A part of the flight is at most so long, s.
_LONGEST_S = 120.0
# Quiet flight of up to so long between two excited stretches stays in their part, s: it determines the noise.
_JOINED_S = 15.0


@dataclass(frozen=True)
class PosteriorIdentification:
    """What an identification by the posterior found. signals: as the sensors meant them."""

    signals: tuple[FlightSignals, ...]
    prepared: tuple[Prepared, ...]
    compatible: CompatibilityResult
    model: Model
    refused: tuple[Refusal, ...]
    estimate: PosteriorEstimate
    warnings: tuple[str, ...]


def reconstructed(read: Sequence[RepairedFlight]) -> CompatibilityResult | None:
    """What kinematics say of the flights; None where they cannot be asked."""
    if any(missing_inertial(one.signals) for one in read):
        return None
    try:
        return check_compatibility([one.prepared for one in read])
    except SysidError:
        return None


def identify_by_posterior(
    read: Sequence[RepairedFlight], asked: Request, known: CompatibilityResult | None = None
) -> PosteriorIdentification:
    """Estimate a model from one or more flights.

    read: what is asked, as its sensors meant it. known: `reconstructed` of that, if at hand. Raises SysidError where no
    flight has what is needed.
    """
    try:
        return _identified(read, asked, known)
    except SysidError as error:
        raise next((one.doubt for one in read if one.doubt is not None), error) from error


def _identified(
    read: Sequence[RepairedFlight], asked: Request, known: CompatibilityResult | None
) -> PosteriorIdentification:
    vehicle, structure, progress = asked.vehicle, asked.structure, asked.progress
    progress(0.15, "data compatibility")
    seen = flown(read, vehicle, known)
    prepared, compatible, parts, warnings = seen.prepared, seen.compatible, seen.parts, list(seen.warnings)
    surfaces = [name for name in SURFACES if any(name in part.inputs for part in parts)]
    settings = [{name: part.inputs[name].values for name in part.named} for part in parts]
    named = moved_controls(vehicle.named_controls, settings)
    warnings += standing_controls(vehicle.named_controls, settings)
    if structure is None:
        structure = Model(vehicle.name, {name: Coefficient(0.0) for name in default_structure(surfaces, named)})
    before = known_before(asked.prior, structure, warnings)
    effects = [(e.name, key) for e in structure.effects for key, entry in e.parameters.items() if entry.std]
    dead = _dead_surfaces(prepared, vehicle, compatible, surfaces)
    found = estimate(
        parts, vehicle, structure, effects, before, asked.systematic, dead, asked.within(0.3, 0.8).progress
    )
    given = {} if before is None else before.entries()
    refused = refusals_of(found, structure, thrust_known(parts, vehicle), tuple(given))
    # What the flights do not move stays as it was known.
    joint = found.joint if before is None else before.updated(found.joint)
    model = with_extra(_model(structure, vehicle.name, joint, refused, parts), "systematic", found.systematic())
    model = with_thrust_line(model, found, vehicle)
    words = [
        *_product_words(vehicle, found), *_moving_words(found), *_wash_words(vehicle, found),
        *_prior_words(joint, given),
    ]  # fmt: skip
    every_warning = tuple(dict.fromkeys((*warnings, *found.warnings, *words)))
    return PosteriorIdentification(
        tuple(one.signals for one in read), tuple(prepared), compatible, model, tuple(refused), found, every_warning
    )


def _nuisance(found: PosteriorEstimate, name: str) -> NuisanceEstimate | None:
    return next((one for one in found.nuisances if one.name == name), None)


def with_thrust_line(model: Model, found: PosteriorEstimate, vehicle: Vehicle) -> Model:
    """The model with the height of the thrust line, where nobody gave it or thrust turns otherwise than as was given:
    without it the coefficients fly otherwise.
    """
    arm = _nuisance(found, THRUST_ARM)
    if arm is None or model.effect(THRUST_LINE_OFFSET.name) is not None:
        return model
    if is_line_given(vehicle) and abs(arm.value) < _NO_ARM * vehicle.geometry.c:
        return model
    return model.with_effect(THRUST_LINE_OFFSET, {_HEIGHT: arm.value}, {_HEIGHT: arm.std})


def _wash_words(vehicle: Vehicle, found: PosteriorEstimate) -> list[str]:
    """What the thrust turns otherwise than by the line that the vehicle file gives."""
    arm = _nuisance(found, THRUST_ARM)
    if arm is None or not is_line_given(vehicle) or abs(arm.value) < _SEEN * arm.std:
        return []
    return [
        f"the thrust turns the nose as if its line passed {1e3 * abs(arm.value):.0f} ± {1e3 * arm.std:.0f} mm"
        f" {'lower' if arm.value > 0.0 else 'higher'} than the vehicle file has it: the propeller's wash over the tail,"
        " or a line that is given wrongly; the model has it as thrust_line_offset"
    ]


def _product_words(vehicle: Vehicle, found: PosteriorEstimate) -> list[str]:
    """What the flight knows of the product of inertia, which belongs into the vehicle file."""
    one = _nuisance(found, PRODUCT_INERTIA)
    if one is None or one.std > UNINFORMED_RATIO * one.prior_std:
        return []
    return [
        f"the flight gives a product of inertia Ixz of {vehicle.mass.Ixz + one.value:.3g} ± {one.std:.2g} kg m^2: put"
        " it into the vehicle file, with Ixz_std"
    ]


def _moving_words(found: PosteriorEstimate) -> list[str]:
    """What the flight knows of the mass on the thrust sensor, which belongs into the vehicle file."""
    one = _nuisance(found, MOVING_MASS)
    if one is None:
        return []
    grams, std = 1e3 * one.value, 1e3 * one.std
    if one.std > UNINFORMED_RATIO * one.prior_std:
        return [
            f"what hangs on the thrust sensor is not given (0 ± {std:.0f} g is taken), and drag is known no better:"
            " weigh motor and propeller, and put them into the vehicle file as [propulsion] moving_mass"
        ]
    return [
        f"the flight says that {grams:.0f} ± {std:.0f} g hang on the thrust sensor: weigh motor and propeller, and put"
        " them into the vehicle file as [propulsion] moving_mass"
    ]


def _prior_words(joint: Gaussian, given: Mapping[str, tuple[float, float]]) -> list[str]:
    """Which coefficients are the prior model's and not the flight's. given: value and standard error of each there."""
    now = joint.entries()
    kept = [name for name, (_, std) in given.items() if name in now and now[name][1] > _AS_KNOWN * std]
    return [f"{', '.join(kept)}: as the prior model has them, the flight adds nothing"] if kept else []


@dataclass(frozen=True)
class Flown:
    """Flights as the estimator takes them."""

    prepared: Sequence[Prepared]
    compatible: CompatibilityResult
    parts: Sequence[FlightPart]
    warnings: Sequence[str]


def flown(read: Sequence[RepairedFlight], vehicle: Vehicle, known: CompatibilityResult | None = None) -> Flown:
    """Parts of the flights. known: `reconstructed` of them, if at hand. Raises SysidError where none has what is
    needed.
    """
    flights, prepared = [one.signals for one in read], [one.prepared for one in read]
    warnings: list[str] = []
    compatible = known
    if compatible is None:
        compatible, warnings = _compatible(prepared, any(missing_inertial(flight) for flight in flights))
    warnings = [w for flight in prepared for w in flight.warnings] + warnings + list(compatible.warnings)
    parts = _parts(flights, prepared, vehicle, compatible, warnings)
    _require_plausible(parts, vehicle)
    warnings += unused_timing(vehicle, {name: one for part in parts for name, one in part.messages.items()})
    return Flown(prepared, compatible, parts, warnings)


def _dead_surfaces(
    prepared: Sequence[Prepared], vehicle: Vehicle, compatible: CompatibilityResult, recorded: Sequence[str]
) -> dict[str, str]:
    """Group of axes -> what to say of a surface that stands still in the recording alone; in calm air, and where the
    kinematics hold.
    """
    if compatible.gust_sigma > 0.0 or not compatible.parameters:
        return {}
    noise = [moment_noise(stretch.record, vehicle) for flight in prepared for stretch in flight.stretches]
    parts = corrected_parts(prepared, vehicle, compatible)
    frozen = frozen_commands(parts, body_of(vehicle), noise, recorded)
    return {part_of(name): sentence for name, sentence in frozen.items()}


def refusals_of(
    found: PosteriorEstimate,
    structure: Model,
    thrust: bool,
    given: Sequence[str] = (),
) -> list[Refusal]:
    """Coefficients that the flights cannot identify, each with the reason. given: those that a prior model holds, whose
    values are knowledge even where these flights add little to them.
    """
    refused = [
        Refusal(name, "the surfaces that would excite it did not move", helpful_manoeuvre(name))
        for name in found.unexcited
        if name not in given
    ]
    joint, identified = found.joint, set(found.joint.names)
    # What is not known of the inertia moves all moment coefficients of an axis together: their ratios, and the modes,
    # are known all the same, and the bars say the rest.
    moved = found.systematic()
    shared = inertia_shares(moved)
    # So are ratios of what one surface does, whatever its travel.
    travel = travel_shares(moved)
    for i, name in enumerate(joint.names):
        if name not in structure.coefficients:
            continue
        value, std = float(joint.mean[i]), float(np.sqrt(joint.covariance[i, i]))
        both = math.hypot(shared.get(name, 0.0), travel.get(name, 0.0))
        wide = not_identified(name, value, std, both)
        beyond = not_believed(name, value) if set(parse_term(name).factors) <= _STATIC else None
        if name.startswith("CD") and not thrust:
            reason = "drag needs thrust: measure it, or give [propulsion] for rpm or throttle"
        elif name in found.not_believed:
            reason = found.not_believed[name]
        elif beyond is not None:
            reason = beyond
        elif wide is not None:
            reason = wide
        elif name not in given and without(std, both) > UNINFORMED_RATIO * found.prior_std[name]:
            reason = "the flight adds nothing to what was known before"
        else:
            continue
        # What no aircraft has flies nowhere, and a drag without thrust is none.
        flies = beyond is None and not (name.startswith("CD") and not thrust)
        refused.append(Refusal(name, reason, helpful_manoeuvre(name), flies))
    lost = [name for name in structure.coefficients if name not in {*identified, *found.unexcited, *given}]
    why = "; ".join(found.left_out.values()) or "the measurement that shows it is missing"
    return refused + [Refusal(name, why, helpful_manoeuvre(name)) for name in lost]


def _compatible(prepared: Sequence[Prepared], dead: bool) -> tuple[CompatibilityResult, list[str]]:
    """The kinematic reconstruction; where it fails, the measured motion, with a warning. dead: an IMU channel is."""
    try:
        if dead:
            raise SignalError("it needs all accelerometers and gyros")
        return check_compatibility(prepared), []
    except SysidError as error:
        states = []
        for flight in prepared:
            for stretch in flight.stretches:
                data = stretch.data
                zero = np.zeros(stretch.record.length)
                columns = {name: data.columns.get(name, zero) for name in ("alpha", "beta", "phi", "theta", "psi")}
                V = data["airspeed"] * flight.layout.airspeed_factor
                alpha, beta = np.nan_to_num(columns["alpha"]), np.nan_to_num(columns["beta"])
                states.append(
                    {
                        **columns, **{name: data[name] for name in ("p", "q", "r", "ax", "ay", "az")}, "V": V,
                        "alpha": alpha, "beta": beta, "u": V * np.cos(alpha) * np.cos(beta), "v": V * np.sin(beta),
                        "w": V * np.sin(alpha) * np.cos(beta),
                    }
                )  # fmt: skip
        nothing = CompatibilityResult(
            {}, np.zeros((0, 0)), [], {}, {}, False, [], states, {}, 0.0, prepared[0].layout, False
        )
        return nothing, [f"data compatibility could not be checked: {error}"]


def _parts(
    flights: Sequence[FlightSignals],
    prepared: Sequence[Prepared],
    vehicle: Vehicle,
    compatible: CompatibilityResult,
    warnings: list[str],
) -> list[FlightPart]:
    """Parts of all flights, stretches that follow one another joined."""
    parts: list[FlightPart] = []
    problems: list[SysidError] = []
    index = 0
    for flight, found in zip(flights, prepared, strict=True):
        spans: list[list[float]] = []
        path: dict[str, tuple[list[Array], list[Array]]] = {"alpha": ([], []), "beta": ([], [])}
        for stretch in found.stretches:
            begin, end = float(stretch.record.time_s[0]), float(stretch.record.time_s[-1])
            for name, (stamps, values) in path.items():
                stamps.append(stretch.record.time_s)
                values.append(compatible.states[index][name])
            index += 1
            if spans and begin - spans[-1][1] < _JOINED_S and end - spans[-1][0] <= _LONGEST_S:
                spans[-1][1] = end
            else:
                spans.append([begin, end])
        by_kinematics = {name: (np.concatenate(t), np.concatenate(v)) for name, (t, v) in path.items()}
        for begin, end in spans:
            try:
                parts.append(make_part(flight, vehicle, begin, end, by_kinematics))
            except SysidError as error:
                problems.append(error)
                warnings.append(str(error))
    if not parts:
        raise problems[0] if problems else SignalError(f"{flights[0].name}: no part of the flight is long enough")
    return parts


def _require_plausible(parts: Sequence[FlightPart], vehicle: Vehicle) -> None:
    """Raise SignalError where the level of a signal is one that no flight has, whatever the model."""
    felt_forces = [np.linalg.norm([part.motion[n] for n in ACCEL], axis=0) for part in parts]
    force = float(np.median(np.concatenate(felt_forces)))
    if (
        all(set(ACCEL) <= part.channels.keys() for part in parts)
        and not 0.5 < force / vehicle.environment.gravity < 1.6
    ):
        raise SignalError(
            f"{parts[0].flight}: the accelerometers feel {force:.3g} m/s^2 in the median, where flight has about"
            f" {vehicle.environment.gravity:.1f}: wrong unit (g, milli-g?), or accelerations without gravity; scale"
            " them in [signals]"
        )
    for name in ("phi", "theta", "alpha", "beta"):
        widest = max(float(np.percentile(np.abs(part.motion[name]), 90)) for part in parts)
        if widest > 2.0 * np.pi:
            raise SignalError(f"{parts[0].flight}: {name} reaches {widest:.3g} rad: degrees? scale it in [signals]")
    for rate, angle in (("p", "phi"), ("q", "theta")):
        turned = np.concatenate([np.gradient(part.motion[angle], part.grid) for part in parts])
        felt = np.concatenate([part.motion[rate] for part in parts])
        gain = float(felt @ turned / max(felt @ felt, 1e-12))
        match = float(felt @ turned / max(np.linalg.norm(felt) * np.linalg.norm(turned), 1e-12))
        if abs(match) > 0.9 and not 0.3 < gain < 3.0:
            raise SignalError(
                f"{parts[0].flight}: {angle} turns {gain:.3g} times as fast as {rate} says: wrong unit or sign of one"
                " of them; scale it in [signals]"
            )


def thrust_known(parts: Sequence[FlightPart], vehicle: Vehicle) -> bool:
    """Whether a part has thrust: one that is measured as 0 throughout is known where the file has a propulsion."""
    return any(np.any(part.thrust != 0.0) or (vehicle.propulsion and part.thrust_from) for part in parts)


def _model(
    structure: Model, name: str, known: Gaussian, refused: Sequence[Refusal], parts: Sequence[FlightPart]
) -> Model:
    """Model file of the estimate. known: of coefficients and effect parameters, after the flights."""
    joint = flying(known, refused)
    entries = {} if joint is None else joint.entries()
    coefficients = coefficient_entries(structure.coefficients, entries, refused)
    return Model(
        name,
        coefficients,
        effects_with(structure.effects, entries),
        _validity(parts),
        None if joint is None else joint.correlation(),
    )


def effects_with(effects: Sequence[ModelEffect], found: Mapping[str, tuple[float, float]]) -> tuple[ModelEffect, ...]:
    """Effects of a model with values and standard errors by "effect.parameter"; what is not among them stays."""
    return tuple(
        replace(
            effect,
            parameters={
                key: Coefficient(*found[f"{effect.name}.{key}"]) if f"{effect.name}.{key}" in found else entry
                for key, entry in effect.parameters.items()
            },
        )
        for effect in effects
    )


def _validity(parts: Sequence[FlightPart]) -> Mapping[str, tuple[float, float]]:
    """Range of angle of attack and airspeed that the parts covered (1st to 99th percentile)."""
    alpha = np.concatenate([part.motion["alpha"] for part in parts])
    speed = np.concatenate([part.airspeed.values for part in parts])
    return {
        "alpha": (round(float(np.percentile(alpha, 1)), 4), round(float(np.percentile(alpha, 99)), 4)),
        "airspeed": (round(float(np.percentile(speed, 1)), 2), round(float(np.percentile(speed, 99)), 2)),
    }
