"""Frames of every kind give the same flight; what is no flight and no aircraft is said in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas
import polars
import pytest
import xarray

import flightmodel
from flightmodel import ERRORS, Aircraft, Flight, FlightModelError, identify

T = 0.02 * np.arange(500)
COLUMNS = {"time_s": T, "alpha_deg": 3.0 + np.sin(T), "q_deg_s": np.cos(T)}
FRAMES = {
    "mapping": COLUMNS,
    "pandas": pandas.DataFrame(COLUMNS),
    "pandas, time as index": pandas.DataFrame(COLUMNS).set_index("time_s"),
    "polars": polars.DataFrame(COLUMNS),
    "structured": np.rec.fromarrays(list(COLUMNS.values()), names=list(COLUMNS)),
    "xarray": xarray.Dataset(
        {
            "alpha": ("time", COLUMNS["alpha_deg"], {"units": "deg"}),
            "q": ("time", COLUMNS["q_deg_s"], {"units": "deg/s"}),
        },
        {"time": T},
    ),
    "mapping with moments": {
        **{k: v for k, v in COLUMNS.items() if k != "time_s"},
        "time": np.datetime64("2026-05-01") + (1e9 * T).astype("timedelta64[ns]"),
    },
    "pandas with a time zone": pandas.DataFrame(
        {**COLUMNS, "time_s": pandas.Timestamp("2026-05-01", tz="Europe/Vienna") + pandas.to_timedelta(T, "s")}
    ).rename(columns={"time_s": "time"}),
    "pandas, moments as index": pandas.DataFrame(
        {k: v for k, v in COLUMNS.items() if k != "time_s"},
        index=pandas.Timestamp("2026-05-01") + pandas.to_timedelta(T, "s"),
    ),
    "pandas, missing values of its own": pandas.DataFrame(COLUMNS).convert_dtypes(),
    "pandas with words": pandas.DataFrame({**COLUMNS, "mode": ["AUTO"] * 500}),
    "pandas with moments": pandas.DataFrame(
        {**COLUMNS, "time_s": pandas.Timestamp("2026-05-01") + pandas.to_timedelta(T, "s")}
    ).rename(columns={"time_s": "timestamp"}),
}


@pytest.mark.parametrize("kind", FRAMES)
def test_every_frame_gives_the_same_flight(kind: str) -> None:
    flight = Flight.from_frame(FRAMES[kind])
    assert set(flight.signals.signals) == {"alpha", "q"}
    time_s, alpha = flight["alpha"]
    np.testing.assert_allclose(time_s, T, atol=1e-6)
    np.testing.assert_allclose(alpha, np.radians(COLUMNS["alpha_deg"]), rtol=1e-12)
    assert repr(flight) == "Flight('flight', 10.0 s, 2 signals)"


def test_columns_of_words_are_not_used_and_said() -> None:
    assert Flight.from_frame(FRAMES["pandas with words"]).unused == ("mode",)


def test_an_aircraft_takes_numpy_s_numbers_and_any_name() -> None:
    found = Aircraft.estimate(
        span=np.float32(1.5), mass=np.float64(2.0), name='my "plane"\\', max_thrust=np.float32(8.0)
    )
    assert (found.span, found.mass, found.name) == (1.5, 2.0, 'my "plane"\\')
    for wrong in ({"span": 0.0}, {"mass": float("nan")}, {"Izz": -1.0, "Ixx": 1.0, "Iyy": 1.0}, {"area": "x"}):
        with pytest.raises(FlightModelError, match="give a number above 0"):
            Aircraft.estimate(**{"span": 1.0, "mass": 1.0, **wrong})  # type: ignore[arg-type]


def test_what_is_no_table_is_said() -> None:
    for thing in (3, np.zeros((5, 5)), "flight.csv"):
        with pytest.raises(FlightModelError, match="is no table: give a pandas or polars frame"):
            Flight.from_frame(thing)


def test_every_error_is_one_line_that_says_what_to_do(tmp_path: Path) -> None:
    aircraft = Aircraft.estimate(span=1.27, mass=1.96)
    flight = Flight.from_frame(COLUMNS)
    log = tmp_path / "a.bin"
    log.write_bytes(b"nothing")
    wrong = {
        "no signal phi, theta, airspeed": lambda: identify(flight, aircraft, progress=False),
        "is no flight: make one with": lambda: identify(COLUMNS, aircraft),  # type: ignore[arg-type]
        "no flight was given": lambda: identify([], aircraft),
        "Iyy, Izz is missing: give all": lambda: Aircraft.estimate(span=1.0, mass=1.0, Ixx=0.1),
        "'alpha' is none of elevator": lambda: Aircraft.estimate(span=1.0, mass=1.0, controls=("alpha",)),
        "give max_thrust": lambda: Aircraft.estimate(span=1.0, mass=1.0, thrust_line=(0.1, 0.0, 0.0)),
        "mass is 0.0; give a number above 0": lambda: Aircraft.estimate(span=1.0, mass=0.0),
        "leave columns and units out": lambda: Flight.read(log, units="SI"),
        "There is no such file": lambda: Flight.read(tmp_path / "b.bin"),
        "unknown method 'best'": lambda: identify(flight, aircraft, method="best"),
    }  # fmt: skip
    for words, call in wrong.items():
        with pytest.raises(ERRORS) as refused:
            call()
        text = str(refused.value)
        assert words.lower() in text.lower(), text
        assert "\n" not in text


def test_what_is_missing_is_said_with_the_columns_that_became_no_signal() -> None:
    flight = Flight.from_frame({**COLUMNS, "stick": T, "Nz": T})
    with pytest.raises(ERRORS) as refused:
        identify(flight, Aircraft.estimate(span=1.27, mass=1.96), progress=False)
    assert "columns of the table that became no signal: 'stick', 'Nz': name them" in str(refused.value)
    with pytest.raises(ERRORS, match="is no array of numbers; give the variable fdata itself"):
        Flight.from_fdata(np.array([{"t": 1.0}]))


def test_public_names_are_there_for_completion() -> None:
    assert {"Aircraft", "Flight", "identify"} <= set(dir(flightmodel))
    assert "TYPE_CHECKING" not in dir(flightmodel)


def test_a_product_of_inertia_that_nobody_gives_is_open() -> None:
    swung = {"Ixx": 0.07, "Iyy": 0.08, "Izz": 0.14}
    found = Aircraft.estimate(span=1.27, mass=1.96, **swung).vehicle.mass
    assert (found.Ixz, found.Ixz_std) == (0.0, pytest.approx(0.1 * np.sqrt(0.07 * 0.14), rel=1e-2))
    assert Aircraft.estimate(span=1.27, mass=1.96, **swung, Ixz=0.01).vehicle.mass.Ixz_std is None


def test_an_aircraft_by_ruler_and_scale_says_what_was_taken_for_it(tmp_path: Path) -> None:
    found = Aircraft.estimate(span=1.4, mass=2.0, positions={"alpha_vane": (0.3, 0.1, 0.0)})
    assert found.area == pytest.approx(1.4**2 / 7.0, rel=1e-3)
    assert any("swing the aircraft as a pendulum" in one for one in found.warnings)
    assert any("0.28 m^2 is taken: coefficients stand on it" in one for one in found.warnings)
    assert found.vehicle.sensors.alpha_vane.position == (0.3, 0.1, 0.0)
    found.save(tmp_path / "a.toml")
    again = Aircraft.read(tmp_path / "a.toml")
    assert again.vehicle.mass == found.vehicle.mass
    assert again.vehicle.controls["elevator"].servos == ()
    assert "span b" in found._repr_html_()
