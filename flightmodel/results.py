"""What the analyses give: results with tables, pictures and files."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flightmodel.aircraft import Aircraft
from flightmodel.errors import FlightModelError
from flightmodel.flight import Flight
from flightmodel.optional import library
from gcs.text.intervals import interval
from sim_vehicle.model.model_file import Model

if TYPE_CHECKING:
    from sysid.posterior.estimates import PosteriorEstimate

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Result(ABC):
    """A result as its file holds it (docs/reference/result-files.md)."""

    result: Mapping[str, Any] = field(repr=False)

    def save(self, path: str | Path) -> None:
        """Write the result file (JSON), as `gcs ... --json` prints it."""
        from gcs.text.files import write_whole
        from gcs.text.jsontext import dumps

        write_whole(Path(path), dumps(dict(self.result), indent=2) + "\n")

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is doubtful about it, one line each."""
        return tuple(self.result.get("warnings", ()))

    def report(self, path: str | Path) -> None:
        """Write the report, one page of HTML that needs nothing else."""
        from gcs.report.page import report
        from gcs.text.files import write_whole

        write_whole(Path(path), report(dict(self.result)))

    @abstractmethod
    def table(self) -> str:
        """The result as text, for a terminal."""

    def __str__(self) -> str:
        return self.table()


@dataclass(frozen=True)
class Identification(_Result):
    """A flight model with error bars.

    model: coefficients and effects, per radian, rates nondimensional. aircraft: whose it is. posterior: what "map"
    estimated of servos and sensors beside; None for the other methods.
    """

    model: Model
    aircraft: Aircraft
    posterior: PosteriorEstimate | None = field(default=None, repr=False)

    @property
    def verdict(self) -> str:
        """What the flight was worth: "good", "care" or "poor"."""
        return str(self.result["quality"]["verdict"])

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why, one line each."""
        return tuple(self.result["quality"]["reasons"])

    @property
    def values(self) -> dict[str, float]:
        """Coefficient -> estimate; what the flight does not determine is left out."""
        return self.model.values()

    @property
    def stds(self) -> dict[str, float]:
        """Coefficient -> standard error, of flight and vehicle file together."""
        return {name: one.std for name, one in self.model.coefficients.items() if one.std is not None}

    @property
    def refused(self) -> dict[str, str]:
        """Coefficient that the flight does not determine -> why."""
        return {name: one.refused for name, one in self.model.coefficients.items() if one.value is None}

    @property
    def modes(self) -> tuple[Mapping[str, Any], ...]:
        """Modes about the mean airspeed, as the result file has them; FlightModelError where there are none."""
        found = self.result["modes"]
        if isinstance(found, Mapping):
            raise FlightModelError(f"no modes: {found['refused']}")
        return tuple(found)

    @property
    def dimensional(self) -> Mapping[str, Any]:
        """Dimensional derivatives about the mean airspeed, M_alpha ...: value, std and unit, as the result file has
        them; they need neither mass nor moments of inertia.
        """
        return dict(self.result["dimensional"])

    @property
    def state_space(self) -> Mapping[str, Any]:
        """A, B, C, D of the linear model about the mean airspeed, with the names of states, inputs and outputs, SI and
        rad; FlightModelError where the model gives none.
        """
        if self.result["state_space"] is None:
            raise FlightModelError(f"no linear model: {self.result['modes']['refused']}")
        return dict(self.result["state_space"])

    @property
    def covariance(self) -> tuple[tuple[str, ...], Array]:
        """Names of P estimates, and the covariance (P, P) of their errors, in the units of the coefficients."""
        found, spread = self.model.correlation, self._spread()
        if found is None:
            raise FlightModelError("this method says nothing of how the errors of its estimates depend on each other")
        std = np.array([spread.get(name, np.nan) for name in found.names])
        return found.names, np.array(found.matrix, dtype=np.float64) * np.outer(std, std)

    def _spread(self) -> dict[str, float]:
        """Standard error of every coefficient that flies, and of each parameter of an effect as `effect.parameter`."""
        effects = {f"{one.name}.{key}": entry for one in self.model.effects for key, entry in one.parameters.items()}
        every = {**self.model.coefficients, **effects}
        return {name: entry.flown_std for name, entry in every.items() if entry.flown_std is not None}

    def __str__(self) -> str:
        """What a screen holds: verdict, coefficients with 95 % intervals, what was refused; `table()` has all."""
        lines = [repr(self), *(fill(one, 98, initial_indent="- ", subsequent_indent="  ") for one in self.reasons), ""]
        for name, entry in self.result["model"]["coefficients"].items():
            low, high = _interval(entry)
            if "value" in entry:
                lines.append(f"{name:<12}{entry['value']:>12.4g}{low:>13.4g} ...{high:>11.4g}")
        if self.refused:
            lines += ["", fill(f"not identified: {', '.join(self.refused)}", 98)]
        return "\n".join([*lines, "", "value and 95 % interval, per radian; table() has all, report(path) draws it"])

    def table(self) -> str:
        """The result as text: coefficients with intervals, sensors' errors, how well outputs are predicted."""
        from gcs.analysis.results import identification_text

        return identification_text(dict(self.result))

    def to_frame(self) -> Any:
        """A pandas frame: a row for each coefficient with value, std, low and high (95 %), refused."""
        pandas = library("pandas", "to_frame")
        rows = []
        for name, entry in self.result["model"]["coefficients"].items():
            low, high = _interval(entry)
            rows.append({
                "coefficient": name, "value": entry.get("value"), "std": entry.get("std"), "low": low, "high": high,
                "refused": entry.get("refused", ""),
            })  # fmt: skip
        return pandas.DataFrame(rows).set_index("coefficient")

    def plot(self) -> Any:
        """Estimates with 95 % intervals, and the coefficients measured along the flight beside the model's."""
        from flightmodel.figures import coefficients

        return coefficients(self.result)

    def save_model(self, path: str | Path) -> None:
        """Write the model file (JSON), for `sim-vehicle fly --model` and `gcs discrepancy`."""
        self.model.write(path)

    def __repr__(self) -> str:
        known, lost = len(self.values), len(self.refused)
        return f"Identification({self.model.name!r}, {self.verdict}, {known} coefficients, {lost} refused)"

    def _repr_html_(self) -> str:
        rows = []
        for name, entry in self.result["model"]["coefficients"].items():
            if "refused" in entry:
                rows.append(
                    f"<tr><th>{escape(name)}</th><td colspan=3>not identifiable: {escape(entry['refused'])}</td></tr>"
                )
                continue
            low, high = _interval(entry)
            interval = "" if entry.get("std") is None else f"{low:.4g} … {high:.4g}"
            std = "" if entry.get("std") is None else f"± {entry['std']:.2g}"
            rows.append(
                f"<tr><th>{escape(name)}</th><td>{entry['value']:.4g}</td><td>{std}</td><td>{interval}</td></tr>"
            )
        reasons = "".join(f"<li>{escape(one)}</li>" for one in (*self.reasons, *self.warnings))
        head = "<tr><th></th><th>value</th><th>std</th><th>95 % interval</th></tr>"
        caption = f"<caption>{escape(self.model.name)}: {escape(self.verdict)}</caption>"
        return f"<table>{caption}{head}{''.join(rows)}</table><ul>{reasons}</ul>"


@dataclass(frozen=True)
class Discrepancy(_Result):
    """Where simulation and measurement disagree, and which physical effect is missing.

    model: the baseline with the effect added.
    """

    model: Model

    @property
    def verdict(self) -> str:
        """ "effect", "parameter_error", "none" or "unexplained"."""
        return str(self.result["verdict"])

    @property
    def sentence(self) -> str:
        """What is missing, how sure and how large, in words."""
        return str(self.result["sentence"])

    @property
    def effects(self) -> dict[str, float]:
        """Name of each effect that was added -> its probability."""
        return {effect["name"]: float(effect["probability"]) for effect in self.result["effects"]}

    def table(self) -> str:
        """The result as text."""
        from gcs.analysis.results import discrepancy_text

        return discrepancy_text(dict(self.result))

    def plot(self) -> Any:
        """How far simulation strays from measurement before and after, on flights not fitted where there are any."""
        from flightmodel.figures import gaps

        return gaps(self.result)

    def __repr__(self) -> str:
        return f"Discrepancy({self.verdict}: {', '.join(self.effects) or 'no effect named'})"

    def _repr_html_(self) -> str:
        candidates = "".join(f"<li>{escape(name)}: {share:.0%}</li>" for name, share in self.effects.items())
        return f"<p><b>{escape(self.verdict)}</b>: {escape(self.sentence)}</p><ul>{candidates}</ul>"


@dataclass(frozen=True)
class Simulation:
    """A model flown with the inputs of a flight, beside what was measured.

    time_s: (N,). measured, simulated: output -> (N,) SI units; NaN where nothing was measured. units: of each.
    """

    name: str
    time_s: Array
    measured: Mapping[str, Array] = field(repr=False)
    simulated: Mapping[str, Array] = field(repr=False)
    units: Mapping[str, str] = field(repr=False)

    @property
    def rms(self) -> dict[str, float]:
        """Root mean square of measured minus simulated, SI units."""
        return {
            key: float(np.sqrt(np.nanmean((self.measured[key] - self.simulated[key]) ** 2))) for key in self.measured
        }

    @property
    def tic(self) -> dict[str, float]:
        """Theil's inequality coefficient: 0 for equal, 1 for unrelated (Jategaonkar 2015, eq. 11.5)."""
        found = {}
        for key, z in self.measured.items():
            y = np.where(np.isfinite(z), self.simulated[key], np.nan)
            size = np.sqrt(np.nanmean(z**2)) + np.sqrt(np.nanmean(y**2))
            found[key] = float(self.rms[key] / size) if size > 0.0 else 0.0
        return found

    def table(self) -> str:
        """RMS and inequality coefficient of each output as text."""
        lines = [f"{self.name}: {self.time_s.size} samples", f"  {'output':<10}{'RMS':>12}  {'unit':<8}{'TIC':>8}"]
        lines += [
            f"  {key:<10}{self.rms[key]:>12.4g}  {self.units[key]:<8}{self.tic[key]:>8.3f}" for key in self.measured
        ]
        return "\n".join(lines)

    def to_frame(self) -> Any:
        """A pandas frame over time_s with measured and simulated columns of each output, SI units."""
        pandas = library("pandas", "to_frame")
        data = {(kind, key): values for kind, part in (("measured", self.measured), ("simulated", self.simulated))
                for key, values in part.items()}  # fmt: skip
        return pandas.DataFrame(data, index=pandas.Index(self.time_s, name="time_s"))

    def plot(self) -> Any:
        """Measured and simulated outputs over time."""
        from flightmodel.figures import compared

        return compared(self.time_s, self.measured, self.simulated, self.units, self.name)

    def __str__(self) -> str:
        return self.table()

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.table())}</pre>"


@dataclass(frozen=True)
class Design:
    """A planned flight and the standard errors that it will give.

    result: as `gcs design --json` prints it.
    """

    result: Mapping[str, Any] = field(repr=False)
    plan: Mapping[str, Any] = field(repr=False)

    @property
    def stds(self) -> dict[str, float]:
        """Coefficient -> predicted standard error."""
        return {entry["name"]: entry["std"] for entry in self.result["coefficients"]}

    @property
    def refused(self) -> dict[str, str]:
        """What it will not determine -> why."""
        return {entry["name"]: entry["reason"] for entry in self.result["refused"]}

    def table(self) -> str:
        """The plan and its predicted errors as text."""
        from gcs.design.text import design_text

        return design_text(dict(self.result))

    def save(self, path: str | Path) -> None:
        """Write the plan file, for `sim-vehicle fly --plan` and `gcs design --plan`."""
        from gcs.text.files import write_whole
        from gcs.text.jsontext import dumps

        write_whole(Path(path), dumps(dict(self.plan), indent=2) + "\n")

    def __str__(self) -> str:
        return self.table()

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.table())}</pre>"


def _interval(entry: Mapping[str, Any]) -> tuple[float, float]:
    """95 % of an estimate; NaN where it has no standard error."""
    return interval(entry) or (np.nan, np.nan)


def one_flight(flights: Flight | Sequence[Flight]) -> list[Flight]:
    """The flights of an argument that takes one or several."""
    several = isinstance(flights, Sequence) and not isinstance(flights, (str, bytes))
    found: list[Any] = [*flights] if several else [flights]  # type: ignore[misc]
    if not found:
        raise FlightModelError("no flight was given")
    for flight in found:
        if not isinstance(flight, Flight):
            raise FlightModelError(
                f"a {type(flight).__name__} is no flight: make one with Flight.from_frame or Flight.read"
            )
    return found
