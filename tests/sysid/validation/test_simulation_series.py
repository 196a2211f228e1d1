"""The curves over windows: the flight's own samples, and simulations whose distance from them is the gap."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import mav_longitudinal as mav
import numpy as np
import pytest
from mav_problem import longitudinal_record, vehicle

from sim_vehicle.model.model_file import Coefficient, Model
from sim_vehicle.vehicle.packed_model import flatten
from sysid.problem.free_run import Fixed, gap
from sysid.signals.record import OUTPUTS
from sysid.signals.sensor_mounting import SensorMounting
from sysid.validation.simulation_series import simulation_series

LAYOUT = SensorMounting()


def fixed(**changes: float) -> Fixed:
    model = Model("mav", {name: Coefficient(v) for name, v in {**mav.COEFFICIENTS, **changes}.items()})
    return Fixed(flatten(vehicle(), model), {}, command_first=True)


@pytest.fixture(scope="module")
def flight() -> Any:
    """Twelve seconds of the pitching motion flown by another integrator, without a sideslip vane."""
    truth = mav.fly(mav.multisine(duration=12.0))
    record = longitudinal_record(mav.measure(truth, np.random.default_rng(0), errors={}, noise={}))
    z = record.z.copy()
    z[:, OUTPUTS.index("beta")] = np.nan
    stretch = SimpleNamespace(record=replace(record, imposed_states=np.zeros((0, 9)), z=z))
    return SimpleNamespace(data=SimpleNamespace(name="one"), stretches=(stretch,), layout=LAYOUT)


def test_the_distance_of_the_curves_is_the_gap(flight: Any) -> None:
    record = flight.stretches[0].record
    stages = {"before": fixed(Cm_q=-2.0), "after": fixed()}
    (found,) = simulation_series([flight], stages, ("before", "after"))
    assert found["flight"] == "one"
    time = np.array(found["time_s"])
    # Two windows of 250 samples each (two seconds are left over), and a break behind each.
    assert np.flatnonzero(np.isnan(time)).tolist() == [250, 501]
    assert time[:250] == pytest.approx(record.time_s[:250], abs=1e-3)
    assert list(found["outputs"]) == ["V", "alpha", "p", "q", "r", "phi", "theta", "ax", "ay", "az"]
    for stage, model in stages.items():
        table = gap([record], LAYOUT, model)
        for name, entry in found["outputs"].items():
            difference = np.array(entry["measured"]) - np.array(entry[stage])
            assert np.sqrt(np.nanmean(difference**2)) == pytest.approx(table[name], rel=0.01, abs=2e-4), (stage, name)
    assert np.array(found["inputs"]["de"])[:250] == pytest.approx(
        record.commands[record.start : record.start + 250, 0], rel=1e-4, abs=1e-9
    )
    q = found["outputs"]["q"]
    assert np.array(q["measured"])[:250] == pytest.approx(record.z[:250, OUTPUTS.index("q")], rel=1e-4, abs=1e-9)
    assert np.nanstd(np.array(q["before"]) - np.array(q["measured"])) > 20.0 * np.nanstd(
        np.array(q["after"]) - np.array(q["measured"])
    )


def test_a_long_flight_and_many_flights_are_thinned(flight: Any) -> None:
    record = flight.stretches[0].record
    alone, many = (simulation_series([flight] * n, {"after": fixed()}, ("after",), 120) for n in (1, 3))
    for found, stride in ((alone, 5), (many, 8)):
        time = np.array(found[0]["time_s"])
        begin = time[: np.flatnonzero(np.isnan(time))[0]]
        assert begin == pytest.approx(record.time_s[:250:stride], abs=1e-3)
    assert [len(alone), len(many)] == [1, 3]
