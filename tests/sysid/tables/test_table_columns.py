"""Headers as other programs write them become signals; what they do not say has to be said."""

import pytest

from sysid.errors import TableError
from sysid.tables.columns import TAKEN_FOR_SECONDS, match_columns, split_header

# What JSBSim's CSV output writes for simulation, velocities, fcs and atmosphere (FGOutputTextFile).
JSBSIM = [
    *("Time", "Aileron Command (norm)", "Elevator Command (norm)", "Left Aileron Position (deg)"),
    *("Right Aileron Position (deg)", "Elevator Position (deg)", "Rudder Position (deg)", "P (deg/s)", "Q (deg/s)"),
    *("R (deg/s)", "P dot (deg/s^2)", "q bar (psf)", "V_{Total} (ft/s)", "V_{North} (ft/s)", "BodyAccel_X"),
    *("Rho (slugs/ft^3)", "Temperature (R)", "P_{Ambient} (psf)", "Altitude ASL (ft)", "Phi (deg)", "Alpha (deg)"),
    *("fcs/elevator", "/fdm/jsbsim/aero/mag-beta-deg"),
]
XPLANE = [
    "_real,_time ",
    "_totl,_time ",
    "Vtrue,_ktas ",
    "____Q,deg/s ",
    "pitch,__deg ",
    "alpha,__deg ",
    "elev1,__deg ",
]


def used(headers: list[str], **given: object) -> dict[str, tuple[tuple[str, ...], str]]:
    found = match_columns(headers, **given)  # type: ignore[arg-type]
    return {use.signal: (use.headers, use.written) for use in (found.time, *found.uses)}


def test_jsbsim_s_columns_are_known_with_their_units() -> None:
    found = used(JSBSIM)
    assert found == {
        "time": (("Time",), TAKEN_FOR_SECONDS),
        "ax": (("BodyAccel_X",), "ft/s^2"),
        "p": (("P (deg/s)",), "deg/s"),
        "q": (("Q (deg/s)",), "deg/s"),
        "r": (("R (deg/s)",), "deg/s"),
        "pdot": (("P dot (deg/s^2)",), "deg/s^2"),
        "phi": (("Phi (deg)",), "deg"),
        "alpha": (("Alpha (deg)",), "deg"),
        "true_airspeed": (("V_{Total} (ft/s)",), "ft/s"),
        "differential_pressure": (("q bar (psf)",), "psf"),
        "static_pressure": (("P_{Ambient} (psf)",), "psf"),
        "temperature": (("Temperature (R)",), "R"),
        "air_density": (("Rho (slugs/ft^3)",), "slugs/ft^3"),
        "altitude": (("Altitude ASL (ft)",), "ft"),
        "vn": (("V_{North} (ft/s)",), "ft/s"),
        "de": (("Elevator Position (deg)",), "deg"),
        "da": (("Left Aileron Position (deg)", "Right Aileron Position (deg)"), "deg"),
        "dr": (("Rudder Position (deg)",), "deg"),
    }


def test_x_plane_s_columns_are_known() -> None:
    assert used(XPLANE) == {
        "time": (("_totl,_time ",), TAKEN_FOR_SECONDS),
        "true_airspeed": (("Vtrue,_ktas ",), "ktas"),
        "q": (("____Q,deg/s ",), "deg/s"),
        "theta": (("pitch,__deg ",), "deg"),
        "alpha": (("alpha,__deg ",), "deg"),
        "de": (("elev1,__deg ",), "deg"),
    }


def test_ardupilot_s_and_mavlink_s_names_bring_their_units() -> None:
    found = used(["TimeUS", "ATT.Roll", "IMU.GyrX", "IMU.AccZ", "ARSP.Airspeed", "AOA.AOA", "RCOU.C2"])
    assert {signal: unit for signal, (_, unit) in found.items()} == {
        "time": "us", "phi": "deg", "p": "rad/s", "az": "m/s^2", "airspeed": "m/s", "alpha": "deg", "servo2": "us",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("alpha_deg", "alpha", "deg"),
        ("p_rad_s", "p", "rad_s"),
        ("acc_x_m_s2", "acc_x", "m_s2"),
        ("airspeed_kt", "airspeed", "kt"),
        ("gyro_x [rad s-1]", "gyro_x", "rad s-1"),
        ("/fdm/jsbsim/velocities/p-rad_sec", "p", "rad_sec"),
        ("vel_n", "vel_n", ""),
        ("da_l_in", "da_l_in", ""),
        ("rudder_r", "rudder_r", ""),
        ("V (m/s)", "v", "m/s"),
        ("elev1,__deg .1", "elev1", "deg"),
        ("Winkel α", "winkel_alpha", ""),
    ],
)
def test_a_header_is_its_name_and_its_unit(header: str, name: str, unit: str) -> None:
    assert split_header(header) == (name, unit)


def test_units_that_nobody_says_are_asked_for_all_at_once() -> None:
    with pytest.raises(TableError, match="the unit of ax, q, alpha is not known") as refused:
        match_columns(["time", "alpha", "q", "ax", "throttle"])
    assert "'ax': 'g'" in str(refused.value)
    assert "SI" in str(refused.value)


def test_what_the_user_says_counts_before_the_header() -> None:
    found = used(["t", "Alpha (deg)", "q", "Nz"], columns={"az": "Nz", "alpha": "Alpha (deg)"}, units={"q": "deg/s",
                 "az": "g", "Alpha (deg)": "rad"})  # fmt: skip
    assert found["alpha"] == (("Alpha (deg)",), "rad")
    assert found["az"] == (("Nz",), "g")
    assert found["q"] == (("q",), "deg/s")


def test_columns_by_number_and_with_weights() -> None:
    found = match_columns(
        ["a", "b", "c", "d"],
        columns={"time": 0, "da": {"b": 0.5, "c": -0.5}, "alpha": 3},
        units={"da": "deg", "d": "rad"},
    )
    assert [(use.signal, use.headers, use.weights) for use in found.uses] == [
        ("alpha", ("d",), (1.0,)),
        ("da", ("b", "c"), (0.5, -0.5)),
    ]
    assert found.unused == ()


@pytest.mark.parametrize(
    ("headers", "given", "words"),
    [
        (["alpha_deg", "q_deg_s"], {}, "no column is the time"),
        (["t", "x"], {"columns": {"alfa": "x"}}, "'alfa' is no signal; did you mean alpha"),
        (["t", "x"], {"columns": {"zzz": "x"}}, "'zzz' is no signal; signals are time, ax"),
        (["t", "AOA"], {"units": {"AOA_": "deg"}}, "neither a column nor a signal; did you mean AOA?"),
        (["t", "elevator"], {"columns": {"de": "elevater"}}, "does not have; did you mean 'elevator'?"),
        (["t", "x"], {"columns": {"alpha": "y"}}, "which the table does not have; it has t, x"),
        (["t", "x"], {"columns": {"alpha": 7}}, "the table has 0 to 1"),
        (["t", "alpha"], {"units": {"beta2x": "deg"}}, "neither a column nor a signal"),
        (["t", "alpha"], {"units": "US"}, "'SI' for all of them"),
        (["t", "alpha"], {"units": {"alpha": "furlong"}}, "'furlong' is not known; usual ones are rad, deg"),
        (["t", "alpha"], {"units": {"alpha": "m/s"}}, "no unit of it"),
    ],
)
def test_what_cannot_be_meant_is_one_clear_line(headers: list[str], given: dict[str, object], words: str) -> None:
    with pytest.raises(TableError, match=words.replace("(", "\\(")) as refused:
        match_columns(headers, **given)  # type: ignore[arg-type]
    assert "\n" not in str(refused.value)


def test_a_surface_in_parts_of_its_travel_is_no_angle() -> None:
    found = match_columns(["Time", "Elevator (norm)", "Alpha (deg)"])
    assert [use.signal for use in found.uses] == ["alpha"]
    assert found.unused == ("Elevator (norm)",)
