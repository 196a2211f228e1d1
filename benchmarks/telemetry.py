"""What the benchmarks of framing and recording share: an ordinary telemetry stream, and ratios from one run."""

from __future__ import annotations

import random
import statistics
import time
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

#: Message -> rate in Hz: eight types at 50 Hz and the GPS at 10 Hz, 410 messages per second.
MIX = {
    "HIGHRES_IMU": 50,
    "ATTITUDE": 50,
    "AOA_SSA": 50,
    "AIRSPEED": 50,
    "VFR_HUD": 50,
    "SERVO_OUTPUT_RAW": 50,
    "RPM": 50,
    "NAMED_VALUE_FLOAT": 50,
    "GPS_RAW_INT": 10,
}


def telemetry(seconds: float, seed: int = 1) -> list[tuple[int, bytes]]:
    """(time in ns, MAVLink 2 frame) of the mix, values random but as large as in flight."""
    chooser = random.Random(seed)
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    kinds = {kind.msgname: kind for kind in mavlink.mavlink_map.values()}
    frames = []
    for tick in range(round(seconds * 50)):
        for name, rate in MIX.items():
            if tick % (50 // rate):
                continue
            kind = kinds[name]
            values = [_value(chooser, field, field_type, tick) for field, field_type in _fields(kind)]
            frame = getattr(mavlink, f"MAVLink_{name.lower()}_message")(*values).pack(sender)
            sender.seq = (sender.seq + 1) % 256
            frames.append((1_760_000_000_000_000_000 + tick * 20_000_000, bytes(frame)))
    return frames


def _fields(kind: type[mavlink.MAVLink_message]) -> list[tuple[str, str]]:
    return list(zip(kind.fieldnames, kind.fieldtypes, strict=True))


def _value(chooser: random.Random, field: str, kind: str, tick: int) -> bytes | float | int:
    if kind == "char":
        return b"thrust"
    if kind == "float":
        return chooser.gauss(0.0, 3.0)
    if field == "time_usec":
        return tick * 20_000
    if field == "time_boot_ms":
        return tick * 20
    return chooser.randrange(0, 100 if kind.endswith("int8_t") else 2000)


def compare(
    what: str, unit: str, amount: dict[str, float], runs: dict[str, Callable[[], object]], rounds: int = 7
) -> None:
    """Run all in turn, forward and backward, and print speed and the median of the per-round ratios to the first.

    amount: units that one call of each run handles.
    """
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for run in runs.values():
        run()
    for turn in range(rounds):
        for name in list(runs)[:: 1 if turn % 2 == 0 else -1]:
            start = time.perf_counter()
            runs[name]()
            seconds[name].append((time.perf_counter() - start) / amount[name])
    print(what)
    first = next(iter(runs))
    for name, times in seconds.items():
        ratios = [peer / own for peer, own in zip(seconds[first], times, strict=True)]
        print(f"  {name:42s} {1.0 / statistics.median(times):14,.0f} {unit}/s   {statistics.median(ratios):7.1f} x")
