"""What is said of each sensor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sysid.compatibility.reconstruction import CompatibilityResult, OutputFit, Refusal, SensorError
from sysid.signal_check.sensor_assessment import verdicts
from sysid.signals.sensor_mounting import SensorMounting


def test_each_sensor_gets_a_verdict_in_words() -> None:
    after = {"airspeed": OutputFit(0.02, 0.001), "alpha": OutputFit(0.005, 0.02), "theta": OutputFit(0.3, 0.5)}
    result = CompatibilityResult(
        {
            "alpha_scale": SensorError(0.08, 0.02, "1"),
            "gyro_bias_q": SensorError(-0.0087, 0.0002, "rad/s"),
            "accel_bias_x": SensorError(0.01, 0.1, "m/s^2"),
        },
        np.zeros((3, 3)), [Refusal("accel_bias_y", "nothing turned", "aileron-doublet")], after, after, False,
        ["theta"], [], {"theta": 0.001}, 0.0, SensorMounting(), True,
    )  # fmt: skip
    # A search that has run away says nothing of any sensor.
    unsettled = verdicts(replace(result, converged=False))
    assert {one.status for one in unsettled} == {"unknown"}
    assert all("did not settle" in one.verdict for one in unsettled)
    told = {one.signal: (one.verdict, one.status) for one in verdicts(result)}
    assert told["alpha"] == ("alpha reads 1.080 ± 0.020 of true: corrected", "corrected")
    assert told["q"] == ("q reads 0.498 ± 0.011 deg/s low: corrected", "corrected")
    assert told["ax"] == ("ax agrees within its noise", "ok")
    assert told["ay"] == ("ay: its bias is not identifiable: nothing turned", "unknown")
    assert told["airspeed"] == ("airspeed agrees within its noise", "ok")
    assert told["theta"] == ("theta disagrees with the other sensors by 0.3 (noise 0.001)", "mistake")
