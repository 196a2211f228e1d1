"""What a pilot's helper looks at beside the signals: mode, battery, GPS, place, wind, and what the vehicle says."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Any

from gcs.flights.streams import Stream
from gcs.flights.timeline import ARMED, mode_name, text_of
from gcs.live.place import metres
from gcs.mavlink.frameparts import AUTOPILOT

MESSAGES = (
    "HEARTBEAT", "SYS_STATUS", "BATTERY_STATUS", "GPS_RAW_INT", "GLOBAL_POSITION_INT", "HOME_POSITION", "WIND",
    "WIND_COV", "STATUSTEXT",
)  # fmt: skip
_FIXES = {0: "no GPS", 1: "no fix", 2: "2D", 3: "3D", 4: "DGPS", 5: "RTK float", 6: "RTK"}
_UNKNOWN_U16 = 65535
_MOST_TEXTS = 20


class VehicleStatus:
    """Takes a vehicle's messages as they come. number: rises with everything new."""

    def __init__(self) -> None:
        self.number = 0
        self._found: dict[str, Any] = {}
        self._texts: deque[dict[str, Any]] = deque(maxlen=_MOST_TEXTS)
        # Of texts in pieces, by component, id and number of the piece, the text that it went into.
        self._pieces: dict[tuple[int, int, int], dict[str, Any]] = {}
        self._home: tuple[float, float] | None = None
        self._home_is_given = False

    def take(self, streams: Sequence[Stream]) -> None:
        """Streams of MESSAGES among others."""
        for stream in streams:
            if stream.message in MESSAGES and stream.log_ns.size:
                getattr(self, f"_take_{stream.message.lower()}")(stream)
                self.number += 1

    def to_json(self) -> dict[str, Any]:
        """What is known: each key is there once its message has come; SI, degrees for places, places in m from home."""
        return {**self._found, "texts": list(self._texts)}

    def _take_heartbeat(self, stream: Stream) -> None:
        if stream.component != AUTOPILOT and "mode" in self._found:
            return
        custom, base, kind, autopilot = (
            int(stream.records[name][-1]) for name in ("custom_mode", "base_mode", "type", "autopilot")
        )
        self._found |= {"mode": mode_name(custom, base, kind, autopilot), "armed": bool(base & ARMED)}

    def _take_sys_status(self, stream: Stream) -> None:
        last = stream.records[-1]
        self._battery(int(last["voltage_battery"]), int(last["current_battery"]), int(last["battery_remaining"]))

    def _take_battery_status(self, stream: Stream) -> None:
        last = stream.records[-1]
        cells = [int(one) for one in last["voltages"] if 0 < int(one) < _UNKNOWN_U16]
        self._battery(sum(cells) or _UNKNOWN_U16, int(last["current_battery"]), int(last["battery_remaining"]))

    def _battery(self, millivolt: int, centiampere: int, percent: int) -> None:
        found = dict(self._found.get("battery") or {})
        if 0 < millivolt < _UNKNOWN_U16:
            found["voltage_v"] = millivolt / 1000.0
        if centiampere >= 0:
            found["current_a"] = centiampere / 100.0
        if 0 <= percent <= 100:
            found["remaining"] = percent / 100.0
        if found:
            self._found["battery"] = found

    def _take_gps_raw_int(self, stream: Stream) -> None:
        last = stream.records[-1]
        seen, hdop = int(last["satellites_visible"]), int(last["eph"])
        fix = int(last["fix_type"])
        self._found["gps"] = {
            "fix": _FIXES.get(fix, f"fix {fix}"), "good": fix >= 3, "satellites": seen if seen < 255 else None,
            "hdop": hdop / 100.0 if 0 < hdop < _UNKNOWN_U16 else None,
        }  # fmt: skip
        self._found.pop("ground_speed", None)
        if fix >= 2 and int(last["vel"]) < _UNKNOWN_U16:
            self._found["ground_speed"] = int(last["vel"]) / 100.0
        if fix >= 2 and "GLOBAL_POSITION_INT" not in self._found.get("by", ()):
            self._place(last)

    def _take_global_position_int(self, stream: Stream) -> None:
        last = stream.records[-1]
        if int(last["lat"]) or int(last["lon"]):
            self._found["by"] = ["GLOBAL_POSITION_INT"]
            self._place(last)

    def _place(self, record: Any) -> None:
        place = int(record["lat"]) / 1e7, int(record["lon"]) / 1e7
        if self._home is None:
            self._home = place
        north, east = metres(place, self._home)
        self._found |= {"position": [north, east], "place": list(place)}
        self._found["home"] = {"place": list(self._home), "given": self._home_is_given}

    def _take_home_position(self, stream: Stream) -> None:
        last = stream.records[-1]
        place = int(last["latitude"]) / 1e7, int(last["longitude"]) / 1e7
        if place == (0.0, 0.0):
            return
        self._home, self._home_is_given = place, True
        if "place" in self._found:
            here = self._found["place"]
            self._found["position"] = list(metres((here[0], here[1]), place))
        self._found["home"] = {"place": list(place), "given": True}

    def _take_wind(self, stream: Stream) -> None:
        last = stream.records[-1]
        # Where it comes from, degrees, and how fast, m/s.
        away = math.radians(float(last["direction"]) + 180.0)
        self._wind(float(last["speed"]) * math.cos(away), float(last["speed"]) * math.sin(away))

    def _take_wind_cov(self, stream: Stream) -> None:
        last = stream.records[-1]
        self._wind(float(last["wind_x"]), float(last["wind_y"]))

    def _wind(self, north: float, east: float) -> None:
        if math.isfinite(north) and math.isfinite(east):
            self._found["wind"] = {"north": north, "east": east}

    def _take_statustext(self, stream: Stream) -> None:
        for row, time_s in zip(stream.records, stream.time_s.tolist(), strict=True):
            text, piece = text_of(row)
            key = (stream.component, int(row["id"]) if piece is not None else 0, piece or 0)
            if piece:
                begun = self._pieces.get((key[0], key[1], piece - 1))
                if begun is not None and key not in self._pieces:
                    begun["text"] += text
                    self._pieces[key] = begun
                continue
            said = {"time_s": round(time_s, 2), "severity": int(row["severity"]), "text": text}
            # Another link brings it once more.
            if any(one["text"].startswith(text) and abs(one["time_s"] - time_s) < 1.0 for one in self._texts):
                continue
            self._texts.append(said)
            if piece is not None:
                self._pieces = {one: kept for one, kept in self._pieces.items() if one[:2] != key[:2]} | {key: said}
