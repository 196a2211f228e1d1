"""One Gauss-Newton iteration of output error, against CasADi and scipy. Run: python benchmarks/output_error.py

A flight of 60 s at 50 Hz, 12 states, 12 outputs, 25 unknowns (16 coefficients and 9 initial states). Every contestant
predicts the outputs, finds their sensitivities and sums the normal equations. All must find the same matrix, but for
scipy's solve_ivp called as it mostly is, whose differences are noise.
"""

from __future__ import annotations

import argparse
import math
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import casadi
import numpy as np
from flight_equations import FREE, OUTPUTS, STATES, rates_and_outputs
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.trim import solve_trim
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.packed_model import flatten
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.output_error.estimator import OutputError
from sysid.problem.free_parameters import coefficient
from sysid.problem.predictor import Predictor
from sysid.signals.record import OUTPUTS as SIGNALS
from sysid.signals.record import Record

Array = NDArray[np.float64]
Equations = tuple[Array, Array]

INTERVAL, SAMPLES = 0.02, 3000
SCIPY, SCIPY_HELD = "scipy solve_ivp, one call", "scipy, a call per command held"
# Of the differences that scipy's derivatives are: well above what its integration leaves open.
STEP = 3e-4
NOISE = np.array([0.1, 0.005, 0.005, 0.01, 0.01, 0.01, 0.005, 0.005, 0.005, 0.1, 0.1, 0.1])


class Case:
    """The flight and what all contestants are told of it."""

    def __init__(self) -> None:
        packaged = load_vehicle("iitb-mav")
        assert packaged.propulsion is not None
        at_centre = {
            name: replace(packaged.sensors[name], position=(0.0, 0.0, 0.0))
            for name in ("accelerometer", "alpha_vane", "beta_vane")
        }
        airspeed = {"airspeed": replace(packaged.sensors["airspeed"], kind="true")}
        self.vehicle: Vehicle = replace(
            packaged,
            sensors=replace(packaged.sensors, **at_centre, **airspeed),
            propulsion=replace(packaged.propulsion, moving_mass=0.0, line=(0.0, 0.0, 0.0)),
            environment=replace(packaged.environment, air_density=1.2),
        )
        self.model = replace(read_model("iitb-mav"), effects=())
        for name, value in (("Cm_q", -4.0), ("Cl_beta", -0.1)):
            self.model = self.model.with_coefficient(name, value)
        self.coefficients = self.model.values()
        trim = solve_trim(Plant(self.vehicle, self.model), 15.0, 0.0)
        x, surfaces = trim.state.x, trim.state.surfaces
        pitch = 2.0 * math.atan2(x[8], x[6])
        self.start = np.array([x[3], x[4], x[5], 0.0, 0.0, 0.0, 0.0, pitch, 0.0])
        self.commands = np.tile(surfaces, (SAMPLES, 1))
        moves = np.random.default_rng(4).choice([-1.0, 0.0, 1.0], (SAMPLES // 25, 3))
        self.commands[:, :3] += np.repeat(moves, 25, axis=0) * [0.02, 0.01, 0.02]
        mass, size, propulsion = self.vehicle.mass, self.vehicle.geometry, self.vehicle.propulsion
        assert propulsion is not None
        assert propulsion.max_thrust is not None
        self.body = {name: getattr(mass, name) for name in ("mass", "Ixx", "Iyy", "Izz", "Ixz")}
        self.body |= {"S": size.S, "b": size.b, "c": size.c, "rho": 1.2, "gravity": self.vehicle.environment.gravity}
        self.body["thrust"] = float(propulsion.max_thrust * surfaces[3])
        self.values = np.array([self.coefficients[name] for name in FREE])

    def own(self) -> Callable[[], Equations]:
        """This project's estimator."""
        rest = {name: np.full(SAMPLES, value) for name, value in (("thrust", self.body["thrust"]), ("rho", 1.2))}
        z = np.full((SAMPLES, len(SIGNALS)), np.nan)
        record = Record(
            "benchmark", INTERVAL, INTERVAL * np.arange(SAMPLES), 0, self.commands, rest["thrust"], rest["rho"], z,
            np.zeros((0, 9)),
        )  # fmt: skip
        parameters = [coefficient(name) for name in FREE]
        truth = Predictor(flatten(self.vehicle, self.model), parameters, [record], sub_steps=1, command_first=True)
        places = [SIGNALS.index(name) for name in OUTPUTS]
        flown = truth.outputs(0, truth.flat, {}, self.start)
        z[:, places] = flown[:, places] + 0.01 * NOISE
        predictor = Predictor(truth.flat, parameters, [record], sub_steps=1, command_first=True)
        sigma = np.full(len(SIGNALS), np.nan)
        sigma[places] = NOISE
        estimator = OutputError(predictor, [self.start], OUTPUTS, sigma)
        theta = np.concatenate((self.values, self.start))
        self.measured = z[:, places]

        def iteration() -> Equations:
            predicted = estimator.predict(theta)
            residuals = estimator.residuals(predicted)
            S = estimator.sensitivities(theta, predicted)
            return estimator.data_equations(residuals, S, sigma)

        return iteration

    def normal(self, y: Array, slopes: Array) -> Equations:
        """Information matrix and gradient from outputs (N, 12) and derivatives (N, 12, 25)."""
        rows = (slopes / NOISE[:, None]).reshape(-1, slopes.shape[2])
        residual = self.measured - y
        residual[:, 6:9] = (residual[:, 6:9] + math.pi) % (2.0 * math.pi) - math.pi
        return rows.T @ rows, rows.T @ (residual / NOISE).ravel()

    def casadi(self, folder: Path) -> Callable[[], Equations]:
        """One Runge-Kutta step with its tangents, generated as C, compiled with -O2, mapped over the flight."""
        count = len(FREE) + 9
        x, X = casadi.SX.sym("x", len(STATES)), casadi.SX.sym("X", len(STATES), count)
        k, u = casadi.SX.sym("k", len(FREE)), casadi.SX.sym("u", 3)
        named = {**self.coefficients, **{name: k[i] for i, name in enumerate(FREE)}}

        def both(at: Any) -> Any:
            return rates_and_outputs(casadi.vertsplit(at), casadi.vertsplit(u), named, self.body, casadi)

        def rate(at: Any) -> Any:
            return casadi.vertcat(*both(at)[0])

        k1 = rate(x)
        k2 = rate(x + 0.5 * INTERVAL * k1)
        k3 = rate(x + 0.5 * INTERVAL * k2)
        k4 = rate(x + INTERVAL * k3)
        ahead = x + INTERVAL / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        y = casadi.vertcat(*both(x)[1])
        direct = casadi.horzcat(casadi.SX.eye(len(FREE)), casadi.SX(len(FREE), 9))
        X_ahead = casadi.jacobian(ahead, x) @ X + casadi.jacobian(ahead, k) @ direct
        Y = casadi.jacobian(y, x) @ X + casadi.jacobian(y, k) @ direct
        state = casadi.veccat(x, X)
        step = casadi.Function("step", [state, u, k], [casadi.veccat(ahead, X_ahead), y, Y])
        source = casadi.CodeGenerator("step.c")
        source.add(step)
        source.generate(f"{folder}/")
        command = ["cc", "-O2", "-march=native", "-shared", "-fPIC", "-o", "step.so", "step.c"]
        subprocess.run(command, check=True, cwd=folder)
        flight = casadi.external("step", str(folder / "step.so")).mapaccum("flight", SAMPLES)
        start = np.zeros((len(STATES), count))
        start[:9, len(FREE) :] = np.eye(9)
        first = np.concatenate((self.start, np.zeros(3), start.ravel(order="F")))
        surfaces, values = self.commands[:, :3].T.copy(), np.tile(self.values[:, None], (1, SAMPLES))

        def iteration() -> Equations:
            _, y_all, slopes = flight(first, surfaces, values)
            # Columns of a step stand side by side, (12, 25 N); in memory that is sample, unknown, output.
            by_sample = np.asarray(slopes).T.reshape(SAMPLES, count, len(OUTPUTS)).transpose(0, 2, 1)
            return self.normal(np.asarray(y_all).T, by_sample)

        return iteration

    def scipy(self, calls_by_command: bool) -> Callable[[], Equations]:
        """solve_ivp and forward differences.

        One call for the whole flight, commands looked up by time, in steps of no more than a sample (longer ones fail
        at every command, which takes four times as long); or one call from each change of the commands to the next.
        With the first, steps refused where a command jumps differ from simulation to simulation, which spoils the
        differences.
        """
        surfaces = self.commands[:, :3]
        held = np.flatnonzero(np.any(np.diff(surfaces, axis=0) != 0.0, axis=1)) + 1
        edges = [0, *held.tolist(), SAMPLES] if calls_by_command else [0, SAMPLES]
        steps = {} if calls_by_command else {"first_step": INTERVAL, "max_step": INTERVAL}
        commanded = surfaces.tolist()

        def outputs(values: Array, start: Array) -> Array:
            named = {**self.coefficients, **dict(zip(FREE, values.tolist(), strict=True))}
            x, at = np.empty((len(STATES), SAMPLES)), np.concatenate((start, np.zeros(3)))
            for begin, end in pairwise(edges):

                def held(t: float, x: Array, moved: list[float] = commanded[begin]) -> list[float]:
                    return rates_and_outputs(x.tolist(), moved, named, self.body, math)[0]

                def looked_up(t: float, x: Array) -> list[float]:
                    return held(t, x, commanded[min(int(t / INTERVAL + 1e-9), SAMPLES - 1)])

                rates = held if calls_by_command else looked_up

                times = INTERVAL * np.arange(begin, end + 1)
                flown = solve_ivp(rates, (times[0], times[-1]), at, t_eval=times, rtol=1e-6, **steps).y
                x[:, begin:end], at = flown[:, :-1], flown[:, -1]
            return np.array(rates_and_outputs(list(x), list(surfaces.T), named, self.body, np)[1]).T

        def iteration() -> Equations:
            theta = np.concatenate((self.values, self.start))
            y = outputs(self.values, self.start)
            slopes = np.empty((*y.shape, theta.size))
            for i in range(theta.size):
                moved = theta.copy()
                moved[i] += STEP
                slopes[:, :, i] = (outputs(moved[: len(FREE)], moved[len(FREE) :]) - y) / STEP
            return self.normal(y, slopes)

        return iteration


def compare(own: Equations, peer: Equations, name: str, tolerance: float | None) -> None:
    """Say how far matrix and gradient differ in units of the unknowns' standard errors; tolerance: None for any."""
    scale = 1.0 / np.sqrt(np.diag(own[0]))
    worst = np.abs((own[0] - peer[0]) * np.outer(scale, scale)).max()
    gradient = np.abs((own[1] - peer[1]) * scale).max()
    if tolerance is not None:
        assert worst < tolerance, f"{name}: the information matrix differs by {worst:.2g}"
        assert gradient < 0.5, f"{name}: the gradient differs by {gradient:.2g} standard errors"
    same = "" if tolerance is not None else ", which is useless"
    print(f"  {name}: matrix within {worst:.1e}, gradient within {gradient:.2g} standard errors{same}")


def main() -> None:
    """Print times and ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--scipy-rounds", type=int, default=3, help="rounds in which scipy takes part")
    arguments = parser.parse_args()
    rounds = arguments.rounds
    with tempfile.TemporaryDirectory() as folder:
        case = Case()
        own = case.own()
        runs = {
            "this": own,
            "CasADi, generated C": case.casadi(Path(folder)),
        }
        slow = {SCIPY: case.scipy(False), SCIPY_HELD: case.scipy(True)}
        reference = own()
        print("one iteration of output error, 60 s at 50 Hz, 12 outputs, 25 unknowns")
        compare(reference, runs["CasADi, generated C"](), "CasADi", 1e-4)
        for name, peer in slow.items():
            compare(reference, peer(), name, None if name == SCIPY else 2e-2)
        seconds: dict[str, list[float]] = {name: [] for name in (*runs, *slow)}
        for turn in range(rounds):
            present = {**runs, **slow} if turn < arguments.scipy_rounds else runs
            for name in list(present)[:: 1 if turn % 2 == 0 else -1]:
                begin = time.process_time()
                present[name]()
                seconds[name].append(time.process_time() - begin)
    for name, times in seconds.items():
        ratio = statistics.median(peer / mine for peer, mine in zip(times, seconds["this"], strict=False))
        print(f"  {name:32s} {1e3 * statistics.median(times):10.1f} ms of CPU time, {ratio:8.1f} times this")


if __name__ == "__main__":
    main()
