"""Fly a plan: the loop of sensors, autopilot, servos and equations of motion.

In the tick at t_k the sensors are read first, with the surfaces of the step that ended there; then the command for
[t_k, t_k + dt) is computed and sent out, and telemetry stamped t_k carries those readings and that command.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.errors import FlightError, PlanError
from sim_vehicle.flight.arming import Arming
from sim_vehicle.flight.autopilot import Autopilot, Targets
from sim_vehicle.flight.failures import Failures
from sim_vehicle.flight.flight_log import FlownFlight, FlownSegment
from sim_vehicle.flight.ground_roll import ROLL_ACCELERATION, Roll, ideal_readings
from sim_vehicle.flight.plant import CHANNELS, OUTPUTS, Plant, PlantState
from sim_vehicle.flight.sensor_suite import Reading, SensorSuite
from sim_vehicle.flight.tick import Tick
from sim_vehicle.flight.wind import WindField
from sim_vehicle.manoeuvres.plan import Plan
from sim_vehicle.manoeuvres.plan_ticks import Schedule
from sim_vehicle.vehicle.servo_mixing import ServoOutputs

Array = NDArray[np.float64]

_STANDING_S, _ARMED_S = 2.0, 3.0  # s: after the flight; armed before it
_LONGEST_LEG_S = 300.0
_SINK_RATE, _FLARE_RATE, _FLARE_HEIGHT, _TOUCHDOWN_HEIGHT = 2.0, 0.7, 4.0, 0.3
_CALM = np.zeros(3)
_BOUNDED = [OUTPUTS.index(name) for name in ("V", "p", "q", "r", "north", "east", "down")]
_BOUNDS = np.array([1e3, 1e3, 1e3, 1e3, 1e6, 1e6, 1e5])  # m/s, rad/s, m


def fly(
    plant: Plant,
    plan: Plan,
    *,
    suite: SensorSuite,
    generator: np.random.Generator,
    wind: WindField | None = None,
    dt: float = 0.02,
    duration: float | None = None,
    taxi: bool = False,
    on_tick: Callable[[Tick], None] | None = None,
    arming: Arming | None = None,
    failures: Failures | None = None,
    schedule: Schedule | None = None,
) -> FlownFlight:
    """Fly `plan` and return truth and measurements.

    suite: the sensors. generator: source of gusts. wind: the moving air; without it what the model's
    environment effects say. duration: s, repeats or cuts the plan. taxi: begin and end standing on the
    ground. on_tick: called once in each tick. arming: when a vehicle that stands is to arm. failures: what breaks,
    which the suite must have been given too; the plant stays broken. schedule: the plan laid out on ticks of `dt`, for
    who lays more of it while it is flown. The flight in the air starts in trim and has
    round(duration / dt) + 1 ticks. Raises TrimError, PlanError, FlightError.
    """
    if duration is not None:
        plan = plan.fitted(duration)
    flight = _Flight(plant, plan, suite, generator, wind or wind_of(plant), dt, on_tick, arming or Arming(),
                     failures or Failures(), schedule or Schedule(plan, dt, plant.vehicle.named_controls))  # fmt: skip
    if taxi:
        flight.taxi_out()
        flight.climb()
    flight.manoeuvres(last_tick=not taxi)
    if taxi:
        flight.descend()
        flight.taxi_in()
    return flight.result()


def wind_of(plant: Plant, steady: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> WindField:
    """The air of a flight: `steady` wind (north, east, down), m/s, plus the environment effects of the
    plant's model.
    """
    found = {name: plant.effect(name) or {} for name in ("steady_wind", "wind_shear", "turbulence")}
    return WindField.from_effects(steady, found, plant.vehicle.flight.altitude)


class _Flight:
    """One flight in progress."""

    def __init__(
        self,
        plant: Plant,
        plan: Plan,
        suite: SensorSuite,
        generator: np.random.Generator,
        wind: WindField,
        dt: float,
        on_tick: Callable[[Tick], None] | None,
        arming: Arming,
        failures: Failures,
        schedule: Schedule,
    ) -> None:
        self.plant, self.plan, self.suite, self.wind, self.dt = plant, plan, suite, wind, dt
        self._on_tick = on_tick
        self._arming, self._failures = arming, failures
        self._servos = ServoOutputs(plant.vehicle)
        self._trim = plant.trim()
        self._reference = dict(zip(CHANNELS, plant.read(self._trim.state).tolist(), strict=True))
        self._autopilot = Autopilot(plant, self._trim, self._reference, self._servos.limits[:4], dt)
        named = plant.vehicle.named_controls
        self._neutral = np.zeros(4 + len(named))
        self._is_motor = np.array([name in plant.vehicle.motors for name in named], dtype=np.bool_)
        self._schedule = schedule
        longest = self._schedule.ticks + round(3.0 * _LONGEST_LEG_S / dt)
        speed = float(plant.outputs(self._trim.state)[0])
        self._gusts = wind.gusts(longest, dt, speed, generator)
        self._calibrated = plant.vehicle.sensors.airspeed.kind != "true"
        self._count = 0
        self._air_ticks = 0
        self._air = (_CALM, _CALM)
        self._rows: dict[str, list[Any]] = {"truth": [], "command": [], "wind": [], "gust": [], "airborne": []}
        self._pulses: list[dict[int, int]] = []
        self._samples: list[tuple[float, Reading]] = []
        self._segments: list[FlownSegment] = []
        self._state = self._launched(self._trim.state, (0.0, 0.0))

    def _launched(self, trimmed: PlantState, ground: tuple[float, float]) -> PlantState:
        """The trimmed state in moving air: over ground the aircraft drifts with the wind."""
        state = trimmed.copy()
        wind = self.wind.at(float(-state.x[2]))
        q0, q1, q2, q3 = state.x[6:10]
        to_body = np.array(
            [
                [1 - 2 * (q2 * q2 + q3 * q3), 2 * (q1 * q2 + q0 * q3), 2 * (q1 * q3 - q0 * q2)],
                [2 * (q1 * q2 - q0 * q3), 1 - 2 * (q1 * q1 + q3 * q3), 2 * (q2 * q3 + q0 * q1)],
                [2 * (q1 * q3 + q0 * q2), 2 * (q2 * q3 - q0 * q1), 1 - 2 * (q1 * q1 + q2 * q2)],
            ]
        )
        state.x[3:6] += to_body @ wind
        state.x[0:2] += ground
        state.time_s = self._count * self.dt
        self.plant.evaluate(state, wind, _CALM, 0.0)
        self._air = (wind, _CALM)
        return state

    # --- in the air ---

    def _fly_tick(
        self, altitude: float, speed_change: float, freed: tuple[bool, bool], added: Array, *, last: bool
    ) -> None:
        """Read, command, record; then fly to the next tick unless this is the `last`."""
        time_s = self._count * self.dt
        self._failures.begin(time_s, self.plant)
        truth = self.plant.outputs(self._state)
        self._check(truth)
        ideal = dict(zip(CHANNELS, self.plant.read(self._state).tolist(), strict=True))
        ideal["rpm"], ideal["rho"] = float(truth[OUTPUTS.index("rpm")]), float(truth[OUTPUTS.index("rho")])
        reading = self.suite.sample(time_s, ideal)
        targets = Targets(self._reference["airspeed"] + speed_change, altitude, 0.0)
        wanted = self._autopilot.command(reading.values, targets, freed, added[:4])
        if added.size > 4:
            # The throttle is that of each motor.
            own = added[4:] + np.where(self._is_motor, wanted[3], 0.0)
            wanted = np.append(wanted, np.clip(own, *self._servos.limits[4:].T))
        pulses = self._servos.pulses(wanted)
        command = self._servos.command(pulses, wanted)
        reported = self._failures.reported(
            time_s, self._servos.reported(pulses, self._state.surfaces), self._servos.by_control
        )
        self._record(truth, command, reported, reading, True, True)
        if last:
            return
        wind = self.wind.at(float(-self._state.x[2]))
        gust, next_gust = self._gusts[self._air_ticks : self._air_ticks + 2]
        self._air_ticks += 1
        self._air = (wind, next_gust)
        # A gust goes on while the aircraft flies to the next tick: between its value here and the one sensed there.
        obeyed = self._failures.obeyed(time_s, command, float(truth[OUTPUTS.index("alpha")]))
        self.plant.step(self._state, obeyed, self.dt, wind, 0.5 * (gust + next_gust), next_gust)

    def _check(self, truth: Array) -> None:
        """Stop an aircraft that flies apart: its numbers would mean nothing, and some fit into no message."""
        bounded = np.abs(truth[_BOUNDED]) < _BOUNDS
        if not (bounded.all() and np.isfinite(self._state.x).all()):
            when = f"after {self._count * self.dt:.2f} s of flight"
            raise FlightError(f"the aircraft went out of control {when}; fly a steadier model, or smaller inputs")

    def manoeuvres(self, *, last_tick: bool) -> None:
        """Fly the plan; `last_tick` adds the sample at its very end."""
        schedule, start = self._schedule, self._count * self.dt
        altitude = self._reference["altitude"]
        for k in range(schedule.ticks if last_tick else schedule.ticks - 1):
            freed = (bool(schedule.freed[k, 0]), bool(schedule.freed[k, 1]))
            speed, last = float(schedule.speed_change[k]), last_tick and k == schedule.ticks - 1
            self._fly_tick(altitude, speed, freed, schedule.increments[k], last=last)
        for name, begin, end in schedule.segments:
            self._segments.append(FlownSegment(name, start + begin, start + end))

    def climb(self) -> None:
        """From lift-off to the height of the manoeuvres, and 3 s of level flight there."""
        goal, settled = self._reference["altitude"], 0
        for _ in range(round(_LONGEST_LEG_S / self.dt)):
            self._fly_tick(goal, 0.0, (False, False), self._neutral, last=False)
            near = abs(-self._state.x[2] - goal) < 3.0
            settled = settled + 1 if near else 0
            if settled * self.dt >= 3.0:
                return
        raise PlanError(f"the aircraft does not climb to {goal:g} m in {_LONGEST_LEG_S:g} s; lower flight.altitude")

    def descend(self) -> None:
        """From the height of the manoeuvres to the runway."""
        goal = float(-self._state.x[2])
        for _ in range(round(_LONGEST_LEG_S / self.dt)):
            rate = _SINK_RATE if -self._state.x[2] > _FLARE_HEIGHT else _FLARE_RATE
            goal = max(goal - rate * self.dt, float(-self._state.x[2]) - 2.0 * rate * 2.0)
            self._fly_tick(goal, 0.0, (False, False), self._neutral, last=False)
            if -self._state.x[2] < _TOUCHDOWN_HEIGHT:
                return
        raise PlanError(f"the aircraft does not come down in {_LONGEST_LEG_S:g} s; fly without the taxi option")

    # --- on the ground ---

    def taxi_out(self) -> None:
        """Stand disarmed, stand armed, roll to the trim speed; the state is then that of lift-off."""
        wind = self.wind.at(0.0)
        take_off = self.plant.trim(altitude=0.0)
        theta = float(self.plant.outputs(take_off.state)[OUTPUTS.index("theta")])
        speed = float(self.plant.outputs(take_off.state)[0])
        roll = Roll(0.0, 0.0, 0.0, 0.0, 0.0, theta, start_theta=theta)
        self._stand(roll, take_off.command, wind)
        roll.acceleration = ROLL_ACCELERATION
        while roll.speed - wind[0] < speed:
            self._ground_tick(roll, take_off.command, 1.0, wind, armed=True)
        self._state = self._launched(take_off.state, (roll.north, roll.east))

    def _stand(self, roll: Roll, neutral: Array, wind: Array) -> None:
        while not self._arming.begins(self._count * self.dt):
            self._ground_tick(roll, neutral, 0.0, wind, armed=False)
        for _ in range(round(_ARMED_S / self.dt)):
            self._ground_tick(roll, neutral, 0.0, wind, armed=True)

    def taxi_in(self) -> None:
        """Roll out, stand, disarm."""
        x = dict(zip(OUTPUTS, self.plant.outputs(self._state).tolist(), strict=True))
        theta = self._reference["theta"]
        speed = float(np.hypot(x["vn"], x["ve"]))
        course = float(np.arctan2(x["ve"], x["vn"]))
        roll = Roll(
            x["north"], x["east"], course, speed, -ROLL_ACCELERATION, theta, x["phi"], x["theta"], max(x["vd"], 0.0)
        )
        wind = self.wind.at(0.0)
        while roll.speed > 0.0:
            self._ground_tick(roll, self._trim.command, 0.0, wind, armed=True)
        for armed in (True, False):
            for _ in range(round(_STANDING_S / self.dt)):
                self._ground_tick(roll, self._trim.command, 0.0, wind, armed=armed)

    def _ground_tick(self, roll: Roll, neutral: Array, throttle: float, wind: Array, *, armed: bool) -> None:
        wanted = np.append(neutral[:4], self._neutral[4:])
        wanted[3] = throttle
        pulses = self._servos.pulses(wanted)
        command = self._servos.command(pulses, wanted)
        self._air = (wind, _CALM)
        truth = roll.truth(self.plant, throttle, command, wind)
        reading = self.suite.sample(self._count * self.dt, ideal_readings(truth, self._calibrated))
        self._record(np.array(list(truth.values())), command, pulses, reading, armed, False)
        roll.advance(self.dt)

    # --- what is kept ---

    def _record(
        self, truth: Array, command: Array, reported: dict[int, int], reading: Reading, armed: bool, airborne: bool
    ) -> None:
        time_s = self._count * self.dt
        self._count += 1
        rows = self._rows
        rows["truth"].append(truth)
        rows["command"].append(command)
        rows["wind"].append(self._air[0])
        rows["gust"].append(self._air[1])
        rows["airborne"].append(airborne)
        self._pulses.append(reported)
        self._samples.append((time_s, reading))
        if self._on_tick:
            self._on_tick(Tick(time_s, reading, reported, float(command[3]), armed))

    def result(self) -> FlownFlight:
        """Everything flown so far as arrays."""
        truth = np.array(self._rows["truth"])
        time_s = np.asarray(np.arange(self._count) * self.dt, dtype=np.float64)
        numbers = sorted(self._pulses[0])
        servos = {n: np.array([row[n] for row in self._pulses], dtype=np.float64) for n in numbers}
        measured = self._measured()
        measured.update({f"servo{n}": (time_s, values) for n, values in servos.items()})
        north, east, down = self.wind.steady
        errors = {**self.suite.true_errors(), "wind_north": north, "wind_east": east, "wind_down": down}
        return FlownFlight(
            time_s=time_s,
            truth={name: truth[:, i].copy() for i, name in enumerate(OUTPUTS)},
            command=np.array(self._rows["command"]),
            servos=servos,
            wind_ned=np.array(self._rows["wind"]),
            gust_body=np.array(self._rows["gust"]),
            measured=measured,
            sensor_errors=errors,
            segments=tuple(self._segments),
            airborne=np.array(self._rows["airborne"], dtype=np.bool_),
            failures=tuple(one.to_json() for one in self._failures.every),
        )

    def _measured(self) -> dict[str, tuple[Array, Array]]:
        found: dict[str, tuple[Array, Array]] = {}
        for group in self.suite.groups:
            taken = [(time_s, reading.values) for time_s, reading in self._samples if group in reading.due]
            times = np.array([time_s for time_s, _ in taken])
            for name in self.suite.signals_of(group):
                found[name] = (times, np.array([values[name] for _, values in taken]))
        return found
