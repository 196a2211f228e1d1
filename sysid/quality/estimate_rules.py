"""What an identification is worth: which derivatives it determined and how well, and whether they are an aircraft's."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from sim_vehicle.model.aerodynamic_terms import AXES, parse_term
from sim_vehicle.model.model_file import Coefficient, Model
from sysid.compatibility.selection import Refusal
from sysid.problem.model_structure import usual_size
from sysid.quality.flight_quality import CARE, LATERAL, LONGITUDINAL, POOR, Quality, Reason, once
from sysid.quality.thresholds import LIMITS_OF_QUALITY as LIMITS
from sysid.uncertainty.inertia import inertia_shares
from sysid.uncertainty.travel import travel_shares
from sysid.validation.statistics import Validation

# The derivatives that an axis is flown for.
_MAIN = {
    "CL": ("CL_alpha",), "CD": ("CD_0",), "Cm": ("Cm_alpha", "Cm_q", "Cm_de"), "CY": ("CY_beta",),
    "Cl": ("Cl_beta", "Cl_p", "Cl_da"), "Cn": ("Cn_beta", "Cn_r", "Cn_dr"),
}  # fmt: skip
# Dampings: below zero on every aircraft that is not stalled.
_NEGATIVE = ("Cm_q", "Cl_p", "Cn_r")
_OF_GROUP = {"longitudinal": LONGITUDINAL, "lateral": LATERAL}
_OTHER_AIRCRAFT = "look at the vane, the mass and the airspeed: is it the vehicle file of another aircraft?"


@dataclass(frozen=True)
class SeenEstimate:
    """An identification as the rules see it.

    feedback: by group ("longitudinal", "lateral"), share of the commands that answers gusts, where the method estimates
    it.
    misfit: what the structure does not hold, in words. left_over: what the method has not explained. mistakes: what was
    found wrong with the signals, in sentences.
    """

    model: Model
    refused: Sequence[Refusal]
    validation: Validation | None
    feedback: Mapping[str, float]
    misfit: str
    left_over: str
    mistakes: Sequence[str]

    def main(self, axis: str) -> dict[str, Coefficient]:
        """The main derivatives of an axis that the model has."""
        return {name: self.model.coefficients[name] for name in _MAIN[axis] if name in self.model.coefficients}


def with_estimate(before: Quality, seen: SeenEstimate) -> Quality:
    """The verdict of the flight with what was estimated from it. before: that of the flight alone."""
    axes = tuple(axis for axis in AXES if any(parse_term(name).axis == axis for name in seen.model.coefficients))
    lost = {axis for one in before.not_flown for axis in one.axes}
    # Of axes without numbers the flight has said why; what was refused for it, and was made of it, says no more.
    silent = {axis for axis in axes if before.refusal(axis)}
    found = [one for rule in RULES for one in rule(seen) if not one.axes or set(one.axes) - silent]
    kept = [one for one in (*before.reasons, *found) if not one.axes or set(one.axes) & set(axes) - lost]
    return replace(before, reasons=once(kept), axes=axes)


def _refused(seen: SeenEstimate) -> Iterator[Reason]:
    why = {one.name: one for one in seen.refused}
    for axis in AXES:
        main = seen.main(axis)
        lost = [name for name, entry in main.items() if entry.value is None]
        if not lost:
            continue
        first = why.get(lost[0])
        text = f"{', '.join(lost)} {'is' if len(lost) == 1 else 'are'} refused"
        if first is not None:
            text += f" ({first.reason})"
        advice = f"fly the manoeuvre {first.manoeuvre}" if first is not None and first.manoeuvre else ""
        yield Reason(POOR if len(lost) == len(main) else CARE, text, advice, (axis,))


def _loose(seen: SeenEstimate) -> Iterator[Reason]:
    for axis in AXES:
        wide: list[str] = []
        guessed: list[str] = []
        travelled: list[str] = []
        for name, entry in seen.main(axis).items():
            if entry.value and entry.std and entry.std > LIMITS.loose * max(abs(entry.value), 0.5 * usual_size(name)):
                moved = {"": entry.extra.get("systematic", {})}
                of_inertia, of_travel = (
                    (one[""] / entry.std) ** 2 for one in (inertia_shares(moved), travel_shares(moved))
                )
                mine = guessed if of_inertia > 0.5 else travelled if of_travel > 0.5 else wide
                mine.append(f"{name} to ±{entry.std:.2g}")
        if wide:
            yield Reason(CARE, f"poorly known: {', '.join(wide)}", "longer or larger test inputs", (axis,))
        if guessed:
            text = f"poorly known: {', '.join(guessed)}, since the moments of inertia are"
            yield Reason(CARE, text, "swing the aircraft as a pendulum", (axis,))
        if travelled:
            text = f"poorly known: {', '.join(travelled)}, since the travel of the surface is"
            yield Reason(CARE, text, "measure it and write it to [controls]", (axis,))


def with_no_aircraft(flown: Quality, model: Model) -> Quality:
    """The verdict of the flight alone, and what of its estimates no aircraft has: of such axes nothing is reported, for
    what made one of their derivatives impossible is in all of them, and in none of their bars.
    """
    return replace(flown, reasons=once([*flown.reasons, *_no_aircraft(model)]))


def _no_aircraft(model: Model) -> Iterator[Reason]:
    for axis in AXES:
        for name in _MAIN[axis]:
            entry = model.coefficients.get(name)
            if entry is None or entry.value is None or not entry.std:
                continue
            away = LIMITS.signs * entry.std
            if name in _NEGATIVE and entry.value > away:
                text, advice = f"{name} is above zero, which no damping is", "look for a sign or a unit that is wrong"
                yield Reason(POOR, text, advice, (axis,), no_numbers=True)
            if name == "CD_0" and entry.value < -away:
                yield Reason(POOR, "CD_0 is below zero", "look at thrust and its unit", (axis,), no_numbers=True)
            low, high = LIMITS.lift_slope
            if name == "CL_alpha" and not low - away < entry.value < high + away:
                text = f"CL_alpha of {entry.value:.2g} is that of no wing ({low:g} to {high:g})"
                yield Reason(POOR, text, _OTHER_AIRCRAFT, LONGITUDINAL, no_numbers=True)


def _structure(seen: SeenEstimate) -> Iterator[Reason]:
    if seen.misfit:
        yield Reason(CARE, seen.misfit)
    for group, share in seen.feedback.items():
        if share > 0.0:
            text = f"{share:.0%} of the commands answers what the model leaves (an autopilot or pilot in the loop)"
            yield Reason(CARE, text, "fly test inputs that answer nothing", _OF_GROUP[group])
    if seen.left_over:
        yield Reason(POOR, seen.left_over)
    for sentence in seen.mistakes:
        yield Reason(CARE, sentence)


def _validated(seen: SeenEstimate) -> Iterator[Reason]:
    if seen.validation is None or seen.validation.acceptable:
        return
    for name, output in seen.validation.outputs.items():
        if output.tic > seen.validation.limit and not (output.rms_over_noise or 9.0) <= 2.0:
            axis = (name,) if name in AXES else ()
            verdict = POOR if axis and output.tic > LIMITS.tic * seen.validation.limit else CARE
            yield Reason(
                verdict, f"on the flight held out {name} is not predicted (TIC {output.tic:.2f})", "fly again", axis
            )


RULES: tuple[Callable[[SeenEstimate], Iterator[Reason]], ...] = (
    _refused, _loose, _structure, _validated,
)  # fmt: skip
