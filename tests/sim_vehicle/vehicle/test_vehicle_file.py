"""The vehicle file: what is read, what is refused in one line, and what is doubted."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_vehicle.errors import VehicleFileError
from sim_vehicle.vehicle.vehicle_file import VEHICLES, Vehicle, load_vehicle

BASE = """
[mass]
mass = 1.0
Ixx = 0.02
Iyy = 0.03
Izz = 0.045
[geometry]
S = 0.2
b = 1.0
c = 0.2
"""
ELEVATOR = "[controls.elevator]\nservo = 2\npwm = [1000, 1500, 2000]\ndeflection = [-0.4, 0.0, 0.3]\n"
ELEVONS = """
[controls.elevator]
servo = [1, 2]
pwm = [[1000, 2000], [1000, 2000]]
deflection = [[-0.4, 0.4], [0.4, -0.4]]
mix = [0.5, 0.5]
[controls.aileron]
servo = [1, 2]
pwm = [[1000, 2000], [1000, 2000]]
deflection = [[-0.4, 0.4], [0.4, -0.4]]
mix = [0.5, -0.5]
"""


def load(folder: Path, text: str) -> Vehicle:
    path = folder / "plane.toml"
    path.write_text(text, encoding="utf-8")
    return load_vehicle(path)


def test_the_packaged_vehicle_is_found_by_name_and_raises_no_doubt() -> None:
    vehicle = load_vehicle("iitb-mav")
    assert vehicle.name == "iitb-mav"
    assert (vehicle.mass.mass, vehicle.geometry.S, vehicle.flight.airspeed) == (1.0, 0.2, 15.0)
    assert vehicle.warnings == ()
    assert vehicle.sensors["alpha_vane"].position[1] != 0.0


def test_a_vehicle_may_be_given_by_path_with_only_mass_and_geometry(tmp_path: Path) -> None:
    vehicle = load(tmp_path, BASE)
    assert vehicle.name == "plane"
    assert vehicle.propulsion is None
    assert vehicle.environment.gravity == 9.80665
    assert vehicle.sensors.beta_vane.kind == "sideslip"
    # lift = weight at CL 0.5: V = sqrt(2 m g / (rho S CL))
    assert vehicle.flight.airspeed == pytest.approx((2 * 9.80665 / (1.225 * 0.2 * 0.5)) ** 0.5)


def test_inertia_that_nobody_measured_is_what_is_usual_and_said_so(tmp_path: Path) -> None:
    path = tmp_path / "small.toml"
    path.write_text("[mass]\nmass = 1.943\n[geometry]\nS = 0.308\nb = 1.27\nc = 0.25\n", encoding="utf-8")
    vehicle = load_vehicle(str(path))
    assert vehicle.mass.estimated
    assert any("swing the aircraft" in warning for warning in vehicle.warnings)
    # The Ultra Stick 25e, as it was swung.
    for key, swung in (("Ixx", 0.0894), ("Iyy", 0.1444), ("Izz", 0.1620)):
        assert abs(getattr(vehicle.mass, key) - swung) < 2.0 * getattr(vehicle.mass, f"{key}_std")
    path.write_text(path.read_text().replace("mass = 1.943", "mass = 1.943\nIxx = 0.09"), encoding="utf-8")
    with pytest.raises(VehicleFileError, match=r"mass\.Iyy"):
        load_vehicle(str(path))


def test_deflection_is_linear_between_points_and_held_beyond_them(tmp_path: Path) -> None:
    elevator = load(tmp_path, BASE + ELEVATOR).controls["elevator"]
    pwm = np.array([900.0, 1000.0, 1250.0, 1750.0, 2100.0, np.nan])
    np.testing.assert_allclose(elevator.deflection_from_pwm(pwm), [-0.4, -0.4, -0.2, 0.15, 0.3, np.nan])
    assert elevator.is_outside(pwm).tolist() == [True, False, False, False, True, False]
    assert elevator.limits == pytest.approx((-0.4, 0.3))


def test_a_falling_pwm_table_means_the_same_as_a_rising_one(tmp_path: Path) -> None:
    text = ELEVATOR.replace("1000, 1500, 2000", "2000, 1500, 1000")
    vehicle = load(tmp_path, BASE + text)
    assert vehicle.controls["elevator"].deflection_from_pwm(2000.0) == pytest.approx(-0.4)
    assert list(vehicle.servo_pwm({"elevator": 0.3}).values()) == pytest.approx([1000.0])


def test_elevons_are_unmixed_and_mixed_again(tmp_path: Path) -> None:
    vehicle = load(tmp_path, BASE + ELEVONS)
    pwm = vehicle.servo_pwm({"elevator": 0.1, "aileron": -0.05})
    # elevon 1 moves by 0.1 - 0.05 at 0.8 rad per 1000 us, elevon 2 by 0.1 + 0.05 on a reversed linkage
    assert pwm == pytest.approx({1: 1500 + 0.05 * 1250, 2: 1500 - 0.15 * 1250})
    for name, wanted in (("elevator", 0.1), ("aileron", -0.05)):
        assert vehicle.controls[name].deflection_from_pwm(pwm[1], pwm[2]) == pytest.approx(wanted)


IMPOSSIBLE = {
    "mass.mass is 0": BASE.replace("mass = 1.0", "mass = 0"),
    "mass.Iyy is missing": BASE.replace("Iyy = 0.03\n", ""),
    "mass.Izz is too large": BASE.replace("Izz = 0.045", "Izz = 0.06"),
    "mass.Ixz is 0.04": BASE.replace("Izz = 0.045", "Izz = 0.045\nIxz = 0.04"),
    "mass.mas is not a key of a vehicle file; did you mean mass?": BASE.replace("[geometry]", "mas = 1\n[geometry]"),
    "mass.mass is missing; mas is not a key of a vehicle file, did you mean mass?": BASE.replace("mass = 1", "mas = 1"),
    "mass.Ixx is missing; ixx is not a key": BASE.replace("Ixx", "ixx"),
    "mas is not a key of a vehicle file; did you mean mass?": "mas = 1.0\n" + BASE,
    "geometry is missing; geometri is not a key": BASE.replace("[geometry]", "[geometri]"),
    "geometry is missing": BASE.split("[geometry]")[0],
    "geometry.tail_arm is missing beside tail_area": BASE.replace("S = 0.2", "S = 0.2\ntail_area = 0.03"),
    "geometry.fin_area is missing beside fin_arm": BASE.replace("S = 0.2", "S = 0.2\nfin_arm = 0.5"),
    "geometry.fin_arm is -1; it must be": BASE.replace("S = 0.2", "S = 0.2\nfin_area = 0.02\nfin_arm = -1"),
    "geometry.S is 'big'": BASE.replace("S = 0.2", "S = 'big'"),
    "geometry.b is nan": BASE.replace("b = 1.0", "b = nan"),
    "wings is not a key": BASE + "[wings]\nspan = 1\n",
    "controls.elevater is spelt nearly as elevator": BASE + ELEVATOR.replace("elevator", "elevater"),
    "controls.alpha_flap is no name for a control": BASE + ELEVATOR.replace("elevator", "alpha_flap"),
    "controls.thrust is no name for a control": BASE + ELEVATOR.replace("elevator", "thrust"),
    "controls.c10 is one too many": BASE + "".join(f"[controls.c{n}]\n" for n in range(11)),
    "controls.elevator.pwm is missing": BASE + ELEVATOR.replace("pwm = [1000, 1500, 2000]\n", ""),
    "controls.elevator.pwm is [1000.0, 1600.0, 1500.0]": BASE + ELEVATOR.replace("1500, 2000", "1600, 1500"),
    "controls.elevator.pwm has 2 points": BASE + ELEVATOR.replace("1000, 1500, 2000", "1000, 2000"),
    "controls.elevator.deflection is": BASE + ELEVATOR.replace("-0.4, 0.0, 0.3", "-0.4, 0.3, 0.0"),
    "controls.elevator.servo must be": BASE + ELEVATOR.replace("servo = 2", "servo = 0"),
    "must be outputs from 1 to 16": BASE + ELEVATOR.replace("servo = 2", 'servo = 17\nport = "AUX"'),
    "controls.elevator.port": BASE + ELEVATOR.replace("servo = 2", 'servo = 2\nport = "SUB"'),
    "controls.elevator.signal is 'wish'": BASE + ELEVATOR + "signal = 'wish'\n",
    "controls.elevator.mix is missing": BASE + ELEVONS.replace("mix = [0.5, 0.5]\n", ""),
    "controls.mix over servos (1, 2) cannot distinguish": BASE + ELEVONS.replace("[0.5, -0.5]", "[0.5, 0.5]"),
    "controls.aileron gives servo 1 another": BASE + "[0.4, 0.41]".join(ELEVONS.rsplit("[-0.4, 0.4]", 1)),
    "throttle goes from 0 to 1": BASE + ELEVATOR.replace("elevator", "throttle"),
    "propulsion.max_thrust is missing": BASE + "[propulsion]\ndiameter = 0.2\n",
    "propulsion.diameter is missing": BASE + "[propulsion]\nCT = [[0, 0.1], [0.8, 0]]\n",
    "propulsion.CT must have its advance ratios rise": BASE
    + "[propulsion]\ndiameter = 0.2\nCT = [[0.5, 0.1], [0.1, 0]]\n",
    "sensors.beta_vane.kind is 'odd'": BASE + "[sensors]\nbeta_vane = { kind = 'odd' }\n",
    "sensors.alpha_vane.position has 2 numbers": BASE + "[sensors]\nalpha_vane = { position = [0.1, 0.2] }\n",
    "sensors.gyro.noise is 0": BASE + "[sensors]\ngyro = { noise = 0 }\n",
    "signals.alpha.message is missing": BASE + "[signals]\nalpha = { field = 'AOA' }\n",
    "calibration.airspeed.points names": BASE
    + "[calibration.airspeed]\nsource = 'adc3'\nform = 'pitot'\nunit = 'Pa'\npoints = 'none.csv'\n",
    "mass.mass is 1e+09 kg, which is impossible on a span of 1 m; 0.1 to 10 kg are": BASE.replace("= 1.0", "= 1e9", 1),
    "mass.mass is 1e-300 kg, which is impossible": BASE.replace("mass = 1.0", "mass = 1e-300"),
    "geometry.S is 1e+300 m^2, which is impossible": BASE.replace("S = 0.2", "S = 1e300"),
    "geometry.S is 9.99989e-321 m^2, which is impossible": BASE.replace("S = 0.2", "S = 1e-320"),
    "geometry.b is 1e+300 m, a span that no aircraft has": BASE.replace("b = 1.0", "b = 1e300"),
    "geometry.c is 1e+200 m, which is impossible": BASE.replace("c = 0.2", "c = 1e200"),
    "mass.Ixx is 1e+100 kg m^2": BASE.replace("0.02", "1e100").replace("0.03", "1e100").replace("0.045", "1e100"),
    "mass.mass is 999": BASE.replace("mass = 1.0", f"mass = {'9' * 400}"),
    "mass.Ixz is 1e+308, which is impossible": BASE.replace("[geometry]", "Ixz = 1e308\n[geometry]"),
    "flight.airspeed is 9.99989e-321, which is impossible": BASE + "[flight]\nairspeed = 1e-320\n",
    "flight.airspeed is 1e+308, which is impossible": BASE + "[flight]\nairspeed = 1e308\n",
    "flight.altitude is 1e+200, which is impossible": BASE + "[flight]\naltitude = 1e200\n",
    "environment.gravity is 9.99989e-321, which is impossible": BASE + "[environment]\ngravity = 1e-320\n",
    "environment.air_density is 1e+308, which is impossible": BASE + "[environment]\nair_density = 1e308\n",
    "propulsion.max_thrust is 1e+308, which is impossible": BASE + "[propulsion]\nmax_thrust = 1e308\n",
    "controls.elevator.deflection is 1e-308, which": BASE + ELEVATOR.replace("-0.4, 0.0, 0.3", "-0.4, 0.0, 1e-308"),
    "environment.air_density is 0": BASE + "[environment]\nair_density = 0\n",
}


@pytest.mark.parametrize("message", IMPOSSIBLE)
def test_what_is_impossible_is_refused_in_one_line_naming_the_key(tmp_path: Path, message: str) -> None:
    with pytest.raises(VehicleFileError) as caught:
        load(tmp_path, IMPOSSIBLE[message])
    text = str(caught.value)
    assert message in text
    assert text.startswith(str(tmp_path / "plane.toml"))
    assert "\n" not in text


def test_files_that_are_no_vehicle_files(tmp_path: Path) -> None:
    with pytest.raises(VehicleFileError, match=r"no such vehicle file.*iitb-mav"):
        load_vehicle("no-such-plane")
    with pytest.raises(VehicleFileError, match="is not a TOML file"):
        load(tmp_path, "mass: 1")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(VehicleFileError, match="is not a TOML file"):
        load_vehicle(binary)
    with pytest.raises(VehicleFileError, match="cannot be read"):
        load_vehicle(tmp_path)


DOUBTFUL = {
    "mass.mass: 1000 kg": BASE.replace("mass = 1.0", "mass = 1000.0"),
    "the span in cm": BASE.replace("b = 1.0", "b = 100.0"),
    "geometry.S": BASE.replace("S = 0.2", "S = 20"),
    "geometry.c": BASE.replace("c = 0.2", "c = 20"),
    "geometry.tail_area": BASE.replace("S = 0.2", "S = 0.2\ntail_area = 3\ntail_arm = 0.5"),
    "geometry.fin_arm": BASE.replace("S = 0.2", "S = 0.2\nfin_area = 0.02\nfin_arm = 50"),
    "mass.Ixx": BASE.replace("0.02", "20").replace("0.03", "30").replace("0.045", "45"),
    "given in degrees?": BASE + ELEVATOR.replace("-0.4, 0.0, 0.3", "-25, 0, 25"),
    "given in us?": BASE + ELEVATOR.replace("1000, 1500, 2000", "1.0, 1.5, 2.0"),
    "sensors.alpha_vane.position": BASE + "[sensors]\nalpha_vane = { position = [100, 500, 0] }\n",
    "gram-force?": BASE + "[propulsion]\nmax_thrust = 800\n",
    "flight.airspeed": BASE + "[flight]\nairspeed = 0.5\n",
    "environment.gravity": BASE + "[environment]\ngravity = 1.62\n",
    "environment.air_density": BASE + "[environment]\nair_density = 1013\n",
}


@pytest.mark.parametrize("message", DOUBTFUL)
def test_what_is_doubtful_is_warned_of(tmp_path: Path, message: str) -> None:
    assert any(message in line for line in load(tmp_path, DOUBTFUL[message]).warnings)


def test_a_wrong_unit_is_told_once_with_the_value_and_what_is_expected(tmp_path: Path) -> None:
    """What rests on the mass (inertia, thrust, speed) is not blamed for a mass in grams."""
    text = BASE + "[propulsion]\nmax_thrust = 8\n[flight]\nairspeed = 15\n"
    (line,) = load(tmp_path, text.replace("mass = 1.0", "mass = 1200")).warnings
    assert line.startswith("mass.mass: 1200 kg on a wing of 0.2 m^2 (5.88e+04 N/m^2) is hardly possible")
    assert "0.1 to 10 kg are expected: grams?" in line
    (line,) = load(tmp_path, text.replace("S = 0.2", "S = 2000")).warnings
    assert "geometry.S: 2000 m^2 on a span of 1 m is hardly possible, 0.017 to 3.3 m^2 are expected" in line
    (line,) = load(tmp_path, text.replace("c = 0.2", "c = 200")).warnings
    assert "geometry.c: a chord of 200 m is hardly possible, S over the span is 0.2 m" in line
    lines = load(tmp_path, text.replace("0.02", "20").replace("0.03", "30").replace("0.045", "45")).warnings
    assert lines[0].startswith("mass.Ixx: 20 kg m^2 is a radius of gyration of 4.47 spans, 0.0004 to 2.2 kg m^2")


@given(span=st.floats(0.3, 2.0), aspect=st.floats(3.0, 20.0), loading=st.floats(8.0, 400.0))
def test_no_sound_small_aircraft_raises_a_doubt(
    tmp_path_factory: pytest.TempPathFactory, span: float, aspect: float, loading: float
) -> None:
    area = span**2 / aspect
    mass = loading * area / 9.80665
    Ixx, Iyy, Izz = (mass * (radius * span) ** 2 for radius in (0.14, 0.17, 0.21))
    text = f"[mass]\n{mass=}\n{Ixx=}\n{Iyy=}\n{Izz=}\n[geometry]\nS = {area}\nb = {span}\nc = {span / aspect}\n"
    assert load(tmp_path_factory.mktemp("sound"), text).warnings == ()


def test_big_aircraft_raise_no_doubt(tmp_path: Path) -> None:
    """Cessna 172 and Boeing 747-100 (Nelson, Flight Stability and Automatic Control, appendix B)."""
    for mass, Ixx, Iyy, Izz, S, b, c in (
        (1100, 1285, 1825, 2667, 16.2, 10.9, 1.5),
        (288_800, 2.46e7, 4.48e7, 6.74e7, 511.0, 59.6, 8.3),
    ):
        text = (
            f"[mass]\nmass = {mass}\nIxx = {Ixx}\nIyy = {Iyy}\nIzz = {Izz}\n"
            f"[geometry]\nS = {S}\nb = {b}\nc = {c}\n[flight]\nairspeed = 60\n"
        )
        assert [line for line in load(tmp_path, text).warnings if "flight" not in line] == []


def test_bench_points_are_found_beside_the_vehicle_file(tmp_path: Path) -> None:
    (tmp_path / "vane.csv").write_text("reference,reading\n0,2.5\n10,2.6\n", encoding="utf-8")
    text = BASE + "[calibration.alpha]\nsource = 'adc0'\nform = 'linear'\nunit = 'deg'\npoints = 'vane.csv'\n"
    assert load(tmp_path, text).calibration["alpha"].points == tmp_path / "vane.csv"
    pairs = load(tmp_path, text.replace("'vane.csv'", "[[0, 2.5], [10, 2.6]]")).calibration["alpha"]
    assert pairs.points == ((0.0, 2.5), (10.0, 2.6))


def test_every_packaged_vehicle_can_be_copied_and_read_elsewhere(tmp_path: Path) -> None:
    for path in VEHICLES.iterdir():
        shutil.copy(path, tmp_path)
    for path in tmp_path.glob("*.toml"):
        assert load_vehicle(path).warnings == ()


@pytest.mark.parametrize("way", ["up", "absolute", "link", "large"])
def test_bench_points_are_a_table_of_the_vehicle_files_own_folder_and_no_other_file(tmp_path: Path, way: str) -> None:
    folder = tmp_path / "aircraft"
    folder.mkdir()
    secret = tmp_path / "secret.csv"
    secret.write_text("reference,reading\n")
    (folder / "link.csv").symlink_to(secret)
    (folder / "large.csv").write_bytes(b"0,0\n" * 300_000)
    name = {"up": "../secret.csv", "absolute": str(secret)}.get(way, f"{way}.csv")
    text = BASE + f"[calibration.alpha]\nsource = 'adc0'\nform = 'linear'\nunit = 'deg'\npoints = '{name}'\n"
    with pytest.raises(VehicleFileError, match="larger than any bench" if way == "large" else "copy it there"):
        load(folder, text)
