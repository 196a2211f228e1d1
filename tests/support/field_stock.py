"""Aircraft that come with JSBSim, in a glide: their own tables, flight controls and masses, surfaces as measured.

The engines do not run, so that nothing but the air acts whose moment the vehicle file would have to tell; what a still
propeller does is logged as thrust. Mass, inertias and sizes are JSBSim's own. Truth is what comes nearest to JSBSim's
forces and moments over the flight and over each half of it, which is the interval.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jsbsim
import numpy as np
from field_air import Air, air_motion
from field_flight import LATERAL, LONGITUDINAL, FieldFlight, at_rate, sensors_of, textbook
from field_inputs import inputs_of
from field_plant import STEP, SURFACES, Inputs, Log, blow, log_of, read, trim
from field_sensors import sense
from field_truth import left_by_axis, projection
from jsbsim_flight import linear_aircraft
from jsbsim_twin import FT, NEWTON_PER_POUND_FORCE, SLUG, Array, write_twin

from sim_vehicle.vehicle.mass_properties import Geometry, MassProperties
from sim_vehicle.vehicle.sensors import Sensors
from sim_vehicle.vehicle.vehicle_file import Flight, Vehicle

# Name and airspeed, m/s, well within what each flies.
STOCK = (("c172p", 50.0), ("J3Cub", 33.0), ("SGS", 30.0), ("pa28", 50.0), ("c310", 75.0), ("DHC6", 70.0))
HEIGHT = 2000.0  # m
COMMANDS = {"de": "fcs/elevator-cmd-norm", "da": "fcs/aileron-cmd-norm", "dr": "fcs/rudder-cmd-norm"}
POSITIONS = {"de": "fcs/elevator-pos-rad", "da": "fcs/left-aileron-pos-rad", "dr": "fcs/rudder-pos-rad"}
UNITS = {"de": 0.06, "da": 0.06, "dr": 0.06}  # rad of the drawn inputs that are a full command, times `size`
MOST_LEFT = 0.1  # share of a coefficient's variation that its axis may have beyond the default structure
SETTLE = 6.0  # s that the trim is flown before the log begins


@dataclass(frozen=True)
class Trim:
    """Glide at an airspeed, m/s: angle of attack and pitch, rad, and elevator command, of its full travel."""

    speed: float
    alpha: float
    pitch: float
    elevator: float


def load(folder: Path, name: str, alpha: float, pitch: float, speed: float, elevator: float) -> Any:
    """The aircraft at the start of its glide over the flat planet."""
    fdm = jsbsim.FGFDMExec(jsbsim.get_default_root_dir())
    fdm.set_debug_level(0)
    assert fdm.load_planet(str(folder / "planet.xml"), False)
    assert fdm.load_model(name)
    fdm.set_dt(STEP)
    for part in ("rate/rotational", "rate/translational", "position/rotational", "position/translational"):
        fdm.set_property_value(f"simulation/integrator/{part}", 5)
    fdm.set_property_value("simulation/gravity-model", 0)
    for key, value in (
        *(("u-fps", speed * np.cos(alpha) / FT), ("v-fps", 0.0), ("w-fps", speed * np.sin(alpha) / FT)),
        *(("phi-rad", 0.0), ("theta-rad", pitch), ("psi-true-rad", 0.0), ("h-sl-ft", HEIGHT / FT)),
    ):
        fdm.set_property_value(f"ic/{key}", float(value))
    fdm.set_property_value(COMMANDS["de"], float(elevator))
    assert fdm.run_ic()
    return fdm


def glide(folder: Path, name: str, speed: float) -> Trim:
    """Steady glide, by JSBSim's own accelerations."""

    def accelerations(x: Array) -> Array:
        get = load(folder, name, float(x[0]), float(x[1]), speed, float(x[2])).get_property_value
        return np.array(
            [*(get(f"accelerations/{k}dot-ft_sec2") * FT for k in "uw"), get("accelerations/qdot-rad_sec2")]
        )

    alpha, pitch, elevator = trim(accelerations, np.array([0.05, 0.0, 0.0]))
    return Trim(speed, float(alpha), float(pitch), float(elevator))


def stock_vehicle(fdm: Any, name: str, speed: float, flip: bool = False) -> Vehicle:
    """What a vehicle file of the aircraft would say. flip: the other sign of its product of inertia."""
    get, inertia = fdm.get_property_value, SLUG * FT**2
    mass = MassProperties(
        get("inertia/mass-slugs") * SLUG,
        *(get(f"inertia/i{axis}-slugs_ft2") * inertia for axis in ("xx", "yy", "zz")),
        get("inertia/ixz-slugs_ft2") * inertia * (-1.0 if flip else 1.0),
    )
    geometry = Geometry(get("metrics/Sw-sqft") * FT**2, get("metrics/bw-ft") * FT, get("metrics/cbarw-ft") * FT)
    like = linear_aircraft().vehicle
    assert like.propulsion is not None
    return replace(
        like,
        name=name,
        mass=mass,
        geometry=geometry,
        controls={key: replace(control, signal="position") for key, control in like.controls.items()},
        propulsion=replace(like.propulsion, line=(0.0, 0.0, 0.0), max_thrust=1000.0),
        sensors=Sensors(),
        flight=Flight(speed, HEIGHT),
        warnings=(),
    )


def fly_stock(folder: Path, name: str, glided: Trim, inputs: Inputs, size: float, air: Air, seed: int) -> Log:
    """Fly inputs from the glide; `size` is the share of a command's full travel."""
    fdm = load(folder, name, glided.alpha, glided.pitch, glided.speed, glided.elevator)
    vehicle = stock_vehicle(fdm, name, glided.speed)
    wind = air_motion(air, inputs.throttle.size, STEP, glided.speed, vehicle.geometry.b, seed)
    rows, moved, pulled = [], [], []
    lead = round(SETTLE / STEP)
    for i in range(-lead, inputs.throttle.size):
        at = max(i, 0)
        get = fdm.get_property_value
        phi, theta, psi, p, q = (
            get(k)
            for k in (
                *("attitude/phi-rad", "attitude/theta-rad", "attitude/psi-rad"),
                *("velocities/p-rad_sec", "velocities/q-rad_sec"),
            )
        )
        drawn = {key: size * float(inputs.surfaces[key][at]) / UNITS[key] for key in SURFACES}
        # A pilot's hand: it keeps wings level and pitch where the glide has it.
        fdm.set_property_value(COMMANDS["da"], drawn["da"] - 0.3 * phi - 0.1 * p)
        fdm.set_property_value(COMMANDS["de"], glided.elevator + drawn["de"] + 0.4 * (theta - glided.pitch) + 0.1 * q)
        fdm.set_property_value(COMMANDS["dr"], drawn["dr"])
        blow(fdm, wind.body[at], float(wind.down[at]), (phi, theta, psi))
        fdm.run()
        if i >= 0:
            rows.append(read(fdm))
            moved.append([fdm.get_property_value(POSITIONS[key]) for key in SURFACES])
            pulled.append(fdm.get_property_value("forces/fbx-prop-lbs") * NEWTON_PER_POUND_FORCE)
    positions = dict(zip(SURFACES, np.array(moved).T, strict=True))
    still = np.zeros(len(rows))
    sent = {f"sent_{key}": values for key, values in positions.items()}
    other = {**positions, **sent, "sent_throttle": still, "thrust": np.array(pulled), "p_gust": still}
    return log_of(rows, other, vehicle)


def momentum_error(log: Log, vehicle: Vehicle) -> float:
    """Largest share of the roll and yaw moments that the vehicle's inertias do not explain, with the air's alone."""
    m = vehicle.mass
    p, q, r, pd, rd = (log[k] for k in ("p", "q", "r", "pdot", "rdot"))
    roll = m.Ixx * pd - m.Ixz * (rd + p * q) + (m.Izz - m.Iyy) * q * r
    yaw = m.Izz * rd - m.Ixz * (pd - q * r) + (m.Iyy - m.Ixx) * p * q
    pairs = ((roll, log["l_aero_moment"]), (yaw, log["n_aero_moment"]))
    return float(max(np.std(a - b) / np.std(b) for a, b in pairs))


def calm(log: Log, glided: Trim) -> bool:
    """Whether it stayed where a linear model is of use."""
    near = np.abs(log["alpha"] - glided.alpha).max() < np.radians(5.0)
    return bool(near and np.abs(log["beta"]).max() < np.radians(10.0) and np.abs(log["phi"]).max() < 0.7)


def stock_flight(seed: int, textbook_hz: float | None = None) -> FieldFlight:
    """One flight: aircraft in turn; textbook sensors in still air, and sensors and air of the field, in turn.

    textbook_hz: textbook sensors alone, with all messages at that rate.
    """
    name, speed = STOCK[seed % len(STOCK)]
    rough = textbook_hz is None and (seed // len(STOCK) + seed) % 2 == 1
    g = np.random.default_rng([seed, 31])
    seconds = float(g.uniform(30.0, 60.0))
    inputs = inputs_of(str(g.choice(["multisine", "3211"])), seconds, g)
    air = Air(gust=float(g.uniform(0.3, 1.0)), length=300.0) if rough else Air()
    with tempfile.TemporaryDirectory() as scratch:
        folder, own = Path(scratch), linear_aircraft()
        write_twin(folder, own.vehicle, own.model)
        glided = glide(folder, name, speed)
        for size in (0.3, 0.2, 0.13, 0.09, 0.06, 0.04, 0.025):
            log = fly_stock(folder, name, glided, inputs, size, air, seed)
            if calm(log, glided):
                break
        fdm = load(folder, name, glided.alpha, glided.pitch, speed, glided.elevator)
        # Which sign JSBSim's product of inertia has is seen from the motion.
        signs = [stock_vehicle(fdm, name, speed, flip) for flip in (False, True)]
    vehicle = min(signs, key=lambda one: momentum_error(log, one))
    field = replace(sensors_of(g, 1.0), thrust_scale=0.0) if rough else textbook()
    if textbook_hz is not None:
        field = at_rate(field, textbook_hz)
    field = replace(field, positions=True, pulse=0.0, command_hz=field.imu_hz)
    half = log.time_s.size // 2
    found = [projection(log, vehicle.geometry, part) for part in (slice(None), slice(0, half), slice(half, None))]
    truth = {key: (min(one[key] for one in found), max(one[key] for one in found)) for key in found[0]}
    # What an aircraft's tables do not hold, what the two halves tell differently, and an axis that no coefficients of
    # this structure describe (JSBSim's DHC6 rolls by tables that leave 58 % of it) is nothing to be judged by.
    left = left_by_axis(log, vehicle.geometry)
    told = [
        key
        for key in (*LONGITUDINAL, *LATERAL)
        if left[key.partition("_")[0]] < MOST_LEFT
        and abs(sum(truth[key])) > 0.004
        and truth[key][1] - truth[key][0] < 0.3 * abs(sum(truth[key]) / 2.0)
    ]
    signals = sense(log, vehicle, field, seed, f"stock-{name}-{seed}")
    return FieldFlight(signals, vehicle, truth, tuple(told), float(log.time_s[-1]), log)
