"""The aircraft: what is known of it before a flight."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from numpy.typing import ArrayLike

from flightmodel.errors import FlightModelError
from sim_vehicle.model.aerodynamic_terms import may_name_control
from sim_vehicle.vehicle.controls import CONTROL_NAMES
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle, vehicle_from_text
from sysid.tables.sidpac import aircraft_of_fdata

# Of a small aircraft whose wing nobody measured: coefficients then stand on this area, whatever the true one is.
_USUAL_ASPECT_RATIO = 7.0
# Of a product of inertia that nobody gives, over the root of Ixx Izz, as for aircraft of which nothing was measured.
_USUAL_PRODUCT = 0.1


@dataclass(frozen=True)
class Aircraft:
    """Mass, inertia, wing, controls and sensors of an aircraft, as a vehicle file says them.

    vehicle: the file as it was read. text: the file itself.
    """

    vehicle: Vehicle
    text: str = ""

    @classmethod
    def read(cls, name_or_path: str | Path) -> Aircraft:
        """Read a vehicle file.

        Parameters
        ----------
        name_or_path : str | Path
            A file (docs/reference/vehicle-file.md), or the name of an aircraft that comes with the package:
            "ultrastick25e".

        Returns
        -------
        Aircraft
            The aircraft.

        Examples
        --------
        >>> Aircraft.read("ultrastick25e").span
        1.27
        """
        vehicle = load_vehicle(name_or_path)
        return cls(vehicle, vehicle.path.read_text(encoding="utf-8"))

    @classmethod
    def from_text(cls, text: str, name: str = "aircraft") -> Aircraft:
        """An aircraft from the text of a vehicle file."""
        return cls(vehicle_from_text(text, Path(f"{name}.toml")), text)

    @classmethod
    def estimate(
        cls,
        *,
        span: float,
        mass: float,
        area: float | None = None,
        chord: float | None = None,
        Ixx: float | None = None,
        Iyy: float | None = None,
        Izz: float | None = None,
        Ixz: float | None = None,
        name: str = "aircraft",
        controls: Sequence[str] = CONTROL_NAMES,
        surfaces: str = "command",
        airspeed: str = "calibrated",
        air_density: float | None = None,
        positions: Mapping[str, Sequence[float]] | None = None,
        max_thrust: float | None = None,
        thrust_line: Sequence[float] | None = None,
        moving_mass: float | None = None,
    ) -> Aircraft:
        """An aircraft from what a ruler and a scale say; the rest is what is usual for small aircraft.

        Parameters
        ----------
        span : float
            Wing span, m.
        mass : float
            Mass, kg.
        area : float | None
            Wing area, m^2; None takes span^2 / 7. Coefficients stand on this area.
        chord : float | None
            Mean chord, m; None takes area / span.
        Ixx, Iyy, Izz, Ixz : float | None
            Moments of inertia, kg m^2. Where none is given what is usual for mass and span is taken, to 70 %, and the
            moment coefficients say so in their bars; Ixz alone that is not given is known to 0.1 of the other two.
        name : str
            What it is called.
        controls : Sequence[str]
            Those it has, of elevator, aileron, rudder and throttle, and of names of their own as flap.
        surfaces : str
            What the columns of the surfaces hold: the "command", or the measured "position", which narrows the bars.
        airspeed : str
            What a column called airspeed holds, "calibrated" or "true"; one of true airspeed (tas, vt) is turned into
            that kind.
        air_density : float | None
            kg/m^3; None takes the flight's, or that at sea level.
        positions : Mapping[str, Sequence[float]] | None
            Sensor (accelerometer, alpha_vane, beta_vane) -> x forward, y right, z down from the centre of gravity, m;
            those that are not named count as there. A vane 0.3 m ahead of it that is taken to be there moves CY_r and
            CL_q by more than their bars.
        max_thrust : float | None
            N, at full throttle; needed where thrust was not measured.
        thrust_line : Sequence[float] | None
            A point that the thrust passes through, m, as for positions; None leaves it open to 0.15 chords above or
            below the centre of gravity, and the bars say so.
        moving_mass : float | None
            kg, what hangs on the sensor that measures thrust: motor and propeller, 0 where the thrust is the
            propeller's own; None leaves it open to 7 % of the mass, and the bars of the drag say so.

        Returns
        -------
        Aircraft
            With warnings about what was taken for it.

        Examples
        --------
        >>> Aircraft.estimate(span=1.27, mass=1.96).chord
        0.1814
        """
        span, mass = _positive("span", span), _positive("mass", mass)
        area = None if area is None else _positive("area", area)
        chord = None if chord is None else _positive("chord", chord)
        for key, moment in (("Ixx", Ixx), ("Iyy", Iyy), ("Izz", Izz)):
            if moment is not None:
                _positive(key, moment)
        inertia = {"Ixx": Ixx, "Iyy": Iyy, "Izz": Izz, "Ixz": Ixz}
        given = {key: float(value) for key, value in inertia.items() if value is not None}
        lacking = [key for key in ("Ixx", "Iyy", "Izz") if key not in given]
        if given and lacking:
            raise FlightModelError(f"{', '.join(lacking)} is missing: give all moments of inertia, or none")
        for name_of, value in (("thrust_line", thrust_line), ("moving_mass", moving_mass)):
            if value is not None and max_thrust is None:
                raise FlightModelError(f"{name_of}: give max_thrust, N, as well")
        if unknown := [one for one in controls if one not in CONTROL_NAMES and not may_name_control(one)]:
            raise FlightModelError(
                f"controls: {unknown[0]!r} is none of {', '.join(CONTROL_NAMES)}, nor a name of its own as flap"
            )
        wing = float(f"{span**2 / _USUAL_ASPECT_RATIO:.4g}") if area is None else area
        mean = float(f"{wing / span:.4g}") if chord is None else chord
        table: dict[str, Any] = {
            "name": str(name),
            "mass": {"mass": mass, **given},
            "geometry": {"S": wing, "b": span, "c": mean},
            "controls": {one: {"signal": surfaces if one != "throttle" else "command"} for one in controls},
            "sensors": {"airspeed": {"kind": airspeed}},
        }
        if given and Ixz is None:
            table["mass"]["Ixz_std"] = float(f"{_USUAL_PRODUCT * math.sqrt(given['Ixx'] * given['Izz']):.3g}")
        for sensor, place in (positions or {}).items():
            table["sensors"][sensor] = {"position": [float(one) for one in place]}
        if max_thrust is not None:
            table["propulsion"] = {"max_thrust": float(max_thrust)}
        if thrust_line is not None:
            table["propulsion"]["line"] = [float(one) for one in thrust_line]
        if moving_mass is not None:
            table["propulsion"]["moving_mass"] = float(moving_mass)
        if air_density is not None:
            table["environment"] = {"air_density": float(air_density)}
        made = cls.from_text(tomlkit.dumps(table), name)
        if area is not None:
            return made
        guessed = (
            f"geometry.S: not given; span^2 / {_USUAL_ASPECT_RATIO:g} = {wing:g} m^2 is taken: coefficients stand on it"
        )
        return cls(replace(made.vehicle, warnings=(*made.vehicle.warnings, guessed)), made.text)

    @classmethod
    def from_fdata(cls, fdata: ArrayLike, name: str = "aircraft") -> Aircraft:
        """The aircraft that SIDPAC's flight data array describes: columns 48 to 52 and 77 to 79.

        Parameters
        ----------
        fdata : ArrayLike, shape (N, 90)
            The array, U.S. customary units.
        name : str
            What it is called.

        Returns
        -------
        Aircraft
            Surfaces as measured positions, true airspeed.
        """
        found = aircraft_of_fdata(np.asarray(fdata, dtype=np.float64))
        return cls.estimate(
            span=found.b, mass=found.mass, area=found.S, chord=found.c, Ixx=found.Ixx, Iyy=found.Iyy, Izz=found.Izz,
            Ixz=found.Ixz, name=name, surfaces="position", airspeed="true",
        )  # fmt: skip

    @property
    def name(self) -> str:
        """What it is called."""
        return self.vehicle.name

    @property
    def mass(self) -> float:
        """Mass, kg."""
        return self.vehicle.mass.mass

    @property
    def span(self) -> float:
        """Wing span b, m."""
        return self.vehicle.geometry.b

    @property
    def area(self) -> float:
        """Wing area S, m^2."""
        return self.vehicle.geometry.S

    @property
    def chord(self) -> float:
        """Mean chord c, m."""
        return self.vehicle.geometry.c

    @property
    def warnings(self) -> tuple[str, ...]:
        """Doubts about it, one line each."""
        return self.vehicle.warnings

    def save(self, path: str | Path) -> None:
        """Write the vehicle file, for `gcs identify --vehicle`."""
        Path(path).write_text(self.text, encoding="utf-8")

    def __repr__(self) -> str:
        return f"Aircraft({self.name!r}, {self.mass:g} kg, span {self.span:g} m, wing {self.area:.3g} m^2)"

    def _repr_html_(self) -> str:
        mass = self.vehicle.mass
        rows = {
            "mass": f"{mass.mass:g} kg", "span b": f"{self.span:g} m", "wing area S": f"{self.area:g} m²",
            "mean chord c": f"{self.chord:g} m", "Ixx": f"{mass.Ixx:.3g} kg m²", "Iyy": f"{mass.Iyy:.3g} kg m²",
            "Izz": f"{mass.Izz:.3g} kg m²", "controls": ", ".join(self.vehicle.controls),
        }  # fmt: skip
        body = "".join(f"<tr><th>{escape(key)}</th><td>{escape(value)}</td></tr>" for key, value in rows.items())
        doubts = "".join(f"<li>{escape(one)}</li>" for one in self.warnings)
        return f"<table><caption>{escape(self.name)}</caption>{body}</table>{f'<ul>{doubts}</ul>' if doubts else ''}"


def _positive(name: str, value: float) -> float:
    """A size as a float; FlightModelError where it is none."""
    try:
        size = float(value)
    except (TypeError, ValueError):
        size = math.nan
    if not 0.0 < size < math.inf:
        raise FlightModelError(f"{name} is {value!r}; give a number above 0, in SI units")
    return size
