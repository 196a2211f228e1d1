"""`gcs record --live`: coefficients in the terminal while the flight is recorded, which loses nothing by it."""

from __future__ import annotations

import signal
from pathlib import Path

from patience import PATIENCE_S
from processes import free_port, messages_on_disk, run, start
from traffic import wait_until

from gcs.recording.reader import Recording


def test_coefficients_are_printed_while_everything_is_recorded(tmp_path: Path) -> None:
    port, path = free_port(), tmp_path / "flight.mcap"
    command = ["record", "--live", "--vehicle", "iitb-mav", "--connect", f"udpin:127.0.0.1:{port}", "-o", path]
    with start("gcs", command) as process:
        wait_until(path.exists)
        flown = run("sim-vehicle", "fly", "--manoeuvre", "multisine", "--duration", "14",
                    "--out", f"udpout:127.0.0.1:{port}")  # fmt: skip
        assert flown.returncode == 0
        # The line of the last estimate comes within two seconds of it.
        assert process.stdout is not None
        lines = []
        while not lines or "Cm_alpha" not in lines[-1]:
            lines.append(process.stdout.readline())
        wait_until(lambda: messages_on_disk(path) >= 14 * 400)
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, error
    words = lines[-1].split()
    assert " of 28 known" in lines[-1]
    value, std = map(float, words[words.index("Cm_alpha") + 1].split("±"))
    assert abs(value + 0.5998) < max(4.0 * std, 0.05)
    assert Recording(path).lost() == dict.fromkeys(Recording(path).lost(), 0)


def test_it_needs_a_vehicle_file(tmp_path: Path) -> None:
    done = run("gcs", "record", "--live", "--connect", "udpin:127.0.0.1:0", "-o", tmp_path / "flight.mcap")
    assert done.returncode == 2
    assert "--vehicle FILE" in done.stderr
    assert len(done.stderr.splitlines()) == 1
