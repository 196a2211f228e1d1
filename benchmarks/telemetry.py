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
    """Run all in turn, forward and backward; print speed and the median of the per-round ratios to each peer.

    amount: units that one call of each run handles. The last run is compared with all others, which are peers.
    Time is the clock's; the ratio of CPU times (all threads of the process) stands behind it, for a shared machine.
    """
    seconds: dict[str, list[tuple[float, float]]] = {name: [] for name in runs}
    for run in runs.values():
        run()
    for turn in range(rounds):
        for name in list(runs)[:: 1 if turn % 2 == 0 else -1]:
            start, cpu = time.perf_counter(), time.process_time()
            runs[name]()
            spent = time.perf_counter() - start, time.process_time() - cpu
            seconds[name].append((spent[0] / amount[name], spent[1] / amount[name]))
    print(what)
    own = list(runs)[-1]
    for name, times in seconds.items():
        line = f"  {name:42s} {1.0 / statistics.median(wall for wall, _ in times):14,.0f} {unit}/s"
        if name != own:
            pairs = list(zip(times, seconds[own], strict=True))
            clock = statistics.median(peer[0] / mine[0] for peer, mine in pairs)
            cpu = statistics.median(peer[1] / mine[1] for peer, mine in pairs)
            line += f"   {own} is {clock:.1f} times as fast, in CPU time {cpu:.1f}"
        print(line)
