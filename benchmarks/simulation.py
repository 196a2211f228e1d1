"""Steps of the six-degree-of-freedom simulation against JSBSim's. Run: python benchmarks/simulation.py

One core, steps of 1/120 s of a minute's flight, sensors read at each. Ours is the bundled aircraft, first as it is
(a servo that lags), then with ten more effects switched on. JSBSim flies the Cessna 172 of its wheel, which does more
in a step (piston engine, atmosphere, landing gear) and reads nothing: a budget, not one and the same work.
"""

from __future__ import annotations

from collections.abc import Callable

import jsbsim
import numpy as np
from telemetry import compare

from sim_vehicle.effects import EFFECTS
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.trim import solve_trim
from sim_vehicle.model.model_file import Model, read_model
from sim_vehicle.physics.kernel_records import DrivingInputs
from sim_vehicle.physics.layout import CHANNELS
from sim_vehicle.physics.simulation import simulate
from sim_vehicle.vehicle.packed_model import flatten
from sim_vehicle.vehicle.vehicle_file import load_vehicle

STEP, STEPS = 1.0 / 120.0, 7200
SWITCHED_ON = {
    "stall": {"alpha_stall": 0.3, "sharpness": 30.0},
    "propwash_elevator": {"k": 0.1},
    "reynolds_drag": {"n": 0.2},
    "propeller_torque": {"k_Q": 0.02},
    "p_factor": {"k_P": 0.1},
    "thrust_line_offset": {"z_T": 0.01},
    "actuator_backlash": {"width": 0.01},
    "vane_lag": {"tau": 0.05},
    "pitot_lag": {"tau": 0.1},
    "accelerometer_offset": {"x": 0.02, "y": 0.0, "z": 0.0},
}


def with_effects(model: Model) -> Model:
    """The model with those effects on top of its own."""
    for name, parameters in SWITCHED_ON.items():
        model = model.with_effect(EFFECTS[name], parameters)
    return model


def own(model: Model) -> Callable[[], object]:
    """A minute of flight at trim, the surfaces moving."""
    vehicle = load_vehicle("iitb-mav")
    flat = flatten(vehicle, model)
    trim = solve_trim(Plant(vehicle, model), 15.0, 100.0)
    commands = np.tile(trim.state.surfaces, (STEPS, 1))
    commands[:, 0] += 0.01 * np.sign(np.sin(2.0 * np.pi * 0.7 * STEP * np.arange(STEPS)))
    thrust, rho = np.full(STEPS, np.nan), np.full(STEPS, 1.2)
    x0, y = trim.state.x.copy(), np.empty((STEPS, len(CHANNELS)))

    inputs = DrivingInputs(commands, thrust, rho, np.zeros((0, 9)), np.zeros((0, 3)), STEP, 1, False)

    def run() -> object:
        simulate(x0, 0, 0, STEPS, inputs, flat.arrays, y)
        assert np.isfinite(y).all()
        return y

    return run


def peer() -> Callable[[], object]:
    """JSBSim's Cessna 172, engine running, wings level."""
    engine = jsbsim.FGFDMExec(None)
    engine.set_debug_level(0)
    engine.load_model("c172p")
    engine.set_dt(STEP)
    for name, value in (("ic/h-sl-ft", 4000.0), ("ic/vc-kts", 100.0), ("propulsion/set-running", -1.0)):
        engine[name] = value
    engine.run_ic()

    def run() -> object:
        engine.reset_to_initial_conditions(0)
        for _ in range(STEPS):
            engine.run()
        return engine["velocities/vc-kts"]

    return run


def main() -> None:
    """Print steps per second and the ratios."""
    model = read_model("iitb-mav")
    runs = {"JSBSim c172p": peer(), "this project": own(model)}
    compare("simulation, the model as it is", "steps", dict.fromkeys(runs, float(STEPS)), runs, 9)
    runs = {"JSBSim c172p": peer(), "this project": own(with_effects(model))}
    title = f"simulation, {len(SWITCHED_ON)} more effects"
    compare(title, "steps", dict.fromkeys(runs, float(STEPS)), runs, 9)


if __name__ == "__main__":
    main()
