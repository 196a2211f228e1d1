"""The recorder that the simulator borrows, where no recording can be made."""

from __future__ import annotations

from pathlib import Path

import pytest

from sim_vehicle.errors import SinkError
from sim_vehicle.mavlink.outputs import open_recording


@pytest.mark.parametrize("ending", ["mcap", "tlog"])
def test_a_recording_that_cannot_be_made_is_one_line_for_the_simulator(ending: str) -> None:
    with pytest.raises(SinkError, match="cannot be written") as told:
        open_recording(Path(f"/proc/flight.{ending}"))  # where nobody, not even root, makes files
    assert "\n" not in str(told.value)
