"""What the estimate takes as known and is not: mass, inertia, density, linkages, gains of sensors (consider columns).

An error of one of them moves the outputs, and the estimate follows it by what the data weigh: to first order
H^-1 J' S^-1 dy (consider analysis: Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, ch. 8).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import partial

from sim_vehicle.vehicle.controls import signal_of
from sim_vehicle.vehicle.vehicle_file import Vehicle, stronger
from sysid.posterior.group_model import PerturbedInputs
from sysid.problem.vehicle_errors import DENSITY, DENSITY_SHARE, doubts_of_mass, heavier, is_stated
from sysid.signals.record import SURFACES
from sysid.signals.thrust.source import BATTERY

_OUTPUTS = {"accelerometer": ("ax", "ay", "az"), "gyro": ("p", "q", "r")}
# Half as much inertia again is another aircraft, and so is a stall at another angle: the change of its motion is no
# line. So a thousandth of the error, a thousand times.
PARTS = 1000.0


@dataclass(frozen=True)
class ConsiderParameter:
    """One quantity that is not estimated. stated: whether the vehicle file says how well it is known: by one standard
    deviation then, which the error bars hold; else by a usual amount, which stands beside them. changed: what a
    model of the vehicle is given with so small a part of that error (one of PARTS) that outputs move in proportion;
    results are pickled with it.
    """

    name: str
    stated: bool
    changed: Callable[[Vehicle], PerturbedInputs]


def doubts_of(vehicle: Vehicle, thrust: Collection[str]) -> tuple[ConsiderParameter, ...]:
    """Doubts of a vehicle. thrust: the signals that gave it in the flights."""
    found = [_mass(name, change) for name, change in doubts_of_mass(vehicle).items()]
    found.append(ConsiderParameter(DENSITY, False, partial(PerturbedInputs, density=1.0 + DENSITY_SHARE / PARTS)))
    found += _linkages(vehicle)
    for name, outputs in _OUTPUTS.items():
        if std := vehicle.sensors[name].scale_std:
            found.append(_readings(f"{name}_scale", outputs, std))
    if "throttle" in thrust and vehicle.propulsion is not None:
        found.append(ConsiderParameter("thrust_5pct", False, _stronger))
    if BATTERY in thrust:
        found.append(ConsiderParameter("propeller_blades", True, partial(PerturbedInputs, blades=1.0 / PARTS)))
    return tuple(found)


def flow_doubts(name: str, scale: float, zero: float) -> tuple[ConsiderParameter, ...]:
    """Scale and zero [rad], one standard deviation each, of the vane of `name` (alpha, beta) whose flow is imposed."""
    return (
        ConsiderParameter(f"{name}_scale_std", True, partial(PerturbedInputs, flow=1.0 + scale / PARTS)),
        ConsiderParameter(f"{name}_zero_std", True, partial(PerturbedInputs, flow_zero=zero / PARTS)),
    )


def _mass(name: str, change: Mapping[str, float]) -> ConsiderParameter:
    return ConsiderParameter(name, is_stated(name), partial(_heavier, change=dict(change)))


def _heavier(vehicle: Vehicle, change: Mapping[str, float]) -> PerturbedInputs:
    return PerturbedInputs(heavier(vehicle, change, 1.0 / PARTS))


def _stronger(vehicle: Vehicle) -> PerturbedInputs:
    return PerturbedInputs(stronger(vehicle, 1.0 + 0.05 / PARTS))


def _linkages(vehicle: Vehicle) -> list[ConsiderParameter]:
    """Each linkage that the bench has measured, or all together by a usual amount."""
    found = []
    for control, known in vehicle.controls.items():
        surface = signal_of(control)
        if surface == "throttle":
            continue
        if known.gain_std:
            found.append(_commands(f"{control}_gain_std", True, {surface: 1.0 + known.gain_std / PARTS}, {}))
        if known.bias_std:
            found.append(_commands(f"{control}_bias_std", True, {}, {surface: known.bias_std / PARTS}))
    every = (*SURFACES, *vehicle.named_controls)
    return found or [_commands("linkage_5pct", False, dict.fromkeys(every, 1.0 + 0.05 / PARTS), {})]


def _commands(name: str, stated: bool, gains: dict[str, float], biases: dict[str, float]) -> ConsiderParameter:
    return ConsiderParameter(name, stated, partial(PerturbedInputs, gains=gains, biases=biases))


def _readings(name: str, outputs: tuple[str, ...], share: float) -> ConsiderParameter:
    readings = dict.fromkeys(outputs, 1.0 + share / PARTS)
    return ConsiderParameter(f"{name}_std", True, partial(PerturbedInputs, readings=readings))
