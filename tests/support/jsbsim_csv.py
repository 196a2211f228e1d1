"""A flight whose table JSBSim itself writes: its CSV output, nothing of ours between."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jsbsim_flight import _LINEAR, Aircraft, _start, _trim, linear_aircraft, multisine
from jsbsim_twin import load_twin, set_inputs, write_twin

TRUTH = dict(_LINEAR)
STEP, TICK, SECONDS = 0.002, 0.02, 24.0
_OUTPUT = """<?xml version="1.0"?>
<output name="{file}" type="CSV" rate="50">
  <rates>ON</rates> <velocities>ON</velocities> <position>ON</position> <atmosphere>ON</atmosphere>
  <property>fcs/elevator-pos-rad</property> <property>fcs/left-aileron-pos-rad</property>
  <property>fcs/rudder-pos-rad</property> <property>external_reactions/thrust/magnitude</property>
</output>
"""


def fly_csv(folder: Path, seed: int = 1) -> tuple[Path, Aircraft]:
    """Fly multisines on all axes; the CSV that JSBSim wrote, and the aircraft."""
    aircraft = linear_aircraft()
    write_twin(folder, aircraft.vehicle, aircraft.model, aircraft.functions)
    alpha, de, thrust = _trim(folder, (), 1.1)
    generator = np.random.default_rng(seed)
    times = np.arange(round(SECONDS / TICK)) * TICK
    waves = [multisine(times, size, place, generator) for place, size in enumerate((0.07, 0.05, 0.06))]
    twin = load_twin(folder, _start(alpha), STEP, 1.1)
    target = folder / "flight.csv"
    (folder / "output.xml").write_text(_OUTPUT.format(file=target), encoding="utf-8")
    assert twin.set_output_directive(str(folder / "output.xml"))
    set_inputs(twin, np.array([de, 0.0, 0.0]), thrust)
    assert twin.run_ic()
    for row in range(times.size):
        held = 0.06 * twin["attitude/phi-rad"], 0.10 * (twin["attitude/theta-rad"] - alpha)
        surfaces = np.array([de + waves[0][row] + held[1], waves[1][row] + held[0], waves[2][row]])
        set_inputs(twin, surfaces, thrust)
        for _ in range(round(TICK / STEP)):
            twin.run()
    del twin
    return target, aircraft
