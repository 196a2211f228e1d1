"""A writer of ArduPilot's onboard log format, by its rules: A3 95, type, packed fields as the FMT messages declare."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

from pymavlink.DFReader import DFReader_binary

HEAD = b"\xa3\x95"
FMT_TYPE = 0x80
LETTERS = {
    **{"b": "b", "B": "B", "h": "h", "H": "H", "i": "i", "I": "I", "q": "q", "Q": "Q", "f": "f", "d": "d"},
    **{"n": "4s", "N": "16s", "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B"},
}
SCALES = {"c": 100, "C": 100, "e": 100, "E": 100, "L": 10_000_000}
BOOT_US = 80_000_000
# 2024-06-01 12:00:00 UTC, a Saturday, is GPS week 2316, 6 d 12 h 0 min 18 s into it.
WEEK, WEEK_MS = 2316, (6 * 86_400 + 12 * 3_600 + 18) * 1000
UTC_US = 1_717_243_200_000_000


class DataflashWriter:
    """Builds the bytes of a log; formats are declared first, as ArduPilot does."""

    def __init__(self) -> None:
        self.data = b""
        self._types: dict[str, tuple[int, str]] = {}
        self.declare("FMT", "BBnNZ", "Type,Length,Name,Format,Columns", FMT_TYPE)

    def declare(self, name: str, letters: str, columns: str, number: int | None = None) -> None:
        """Add a FMT message."""
        number = len(self._types) + 1 if number is None else number
        length = 3 + struct.calcsize("<" + "".join(LETTERS[letter] for letter in letters))
        self._types[name] = (number, letters)
        fields = struct.pack("<BB4s16s64s", number, length, name.encode(), letters.encode(), columns.encode())
        self.data += HEAD + bytes((FMT_TYPE,)) + fields

    def message(self, name: str, *values: float | str) -> bytes:
        """One message; scaled letters take values in their unit."""
        number, letters = self._types[name]
        packed = []
        for letter, value in zip(letters, values, strict=True):
            if isinstance(value, str):
                packed.append(value.encode())
            elif letter in SCALES:
                packed.append(round(value * SCALES[letter]))
            else:
                packed.append(value)
        return HEAD + bytes((number,)) + struct.pack("<" + "".join(LETTERS[c] for c in letters), *packed)

    def add(self, name: str, *values: float | str) -> None:
        """Append one message."""
        self.data += self.message(name, *values)


def a_log(seconds: float = 4.0) -> DataflashWriter:
    """A plane that rolls, at 50 Hz, with GPS, barometer and airspeed."""
    log = DataflashWriter()
    log.declare("PARM", "QNf", "TimeUS,Name,Value")
    log.declare("MSG", "QZ", "TimeUS,Message")
    log.declare("IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    log.declare("ATT", "QccccC", "TimeUS,DesRoll,Roll,DesPitch,Pitch,Yaw")
    log.declare("ARSP", "QBffcffBB", "TimeUS,I,Airspeed,DiffPress,Temp,RawPress,Offset,U,H")
    log.declare("BARO", "QBffcf", "TimeUS,I,Alt,Press,Temp,CRt")
    log.declare("GPS", "QBIHBcLLeffffB", "TimeUS,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U")
    log.declare("RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4")
    log.declare("AOA", "Qff", "TimeUS,AOA,SSA")
    log.declare("RPM", "Qff", "TimeUS,rpm1,rpm2")
    log.declare("EV", "QB", "TimeUS,Id")
    log.declare("MODE", "QMBB", "TimeUS,Mode,ModeNum,Rsn")
    log.declare("ODD", "Qf", "TimeUS,Secret")
    log.add("PARM", BOOT_US, "SYSID_THISMAV", 7.0)
    log.add("PARM", BOOT_US, "TRIM_ARSPD_CM", 1500.0)
    log.add("MSG", BOOT_US, "ArduPlane V4.5.1 (deadbeef) and more than fifty letters")
    log.add("MODE", BOOT_US, 5, 5, 0)
    for i in range(round(50 * seconds)):
        now = BOOT_US + 20_000 * i
        t = 0.02 * i
        log.add("IMU", now, 0, 0.1 * t, -0.2, 0.3, 0.5, -0.25, -9.75 + t)
        log.add("IMU", now + 5, 1, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0)
        log.add("ATT", now + 10, 0.0, 10.0 * t, 0.0, -2.5, 350.0)
        log.add("RCOU", now + 20, 1500 + i, 1400, 1100, 1600)
        log.add("AOA", now + 30, 3.0, -1.0)
        log.add("RPM", now + 40, 5000.0 + i, 0.0)
        if i % 5 == 0:
            log.add("ARSP", now + 50, 0, 15.5, 147.0, 21.0, 150.0, 3.0, 1, 1)
            log.add("BARO", now + 60, 0, 12.0, 94_144.25, 15.5, 0.0)
            log.add("BARO", now + 61, 1, 12.0, 1.0, 1.0, 0.0)
            log.add("ODD", now + 70, 42.0)
        if i % 10 == 0:
            elapsed = (now - BOOT_US) // 1000
            place = (-35.3626277, 149.1653034, 588.82, 12.5, 90.0)
            log.add("GPS", now, 3, WEEK_MS + elapsed, WEEK, 11, 0.77, *place, -0.5, 0.0, 1)
        if i == 50:
            log.add("EV", now + 80, 10)
        if i == 150:
            log.add("EV", now + 80, 11)
    return log


def as_text(path: Path) -> str:
    """A log of bytes as the text that pymavlink reads of it, a line for each message."""
    reader, lines = DFReader_binary(str(path)), []
    while (message := reader.recv_msg()) is not None:
        values = [getattr(message, name) for name in message.fmt.columns]
        words = [
            one if isinstance(one, str) else f"{one:.9g}" if isinstance(one, float) else str(one) for one in values
        ]
        lines.append(", ".join([message.get_type(), *words]))
    closed(reader)
    return "\n".join(lines) + "\n"


def closed(reader: Any) -> None:
    """What pymavlink leaves open."""
    reader.data_map.close()
    reader.filehandle.close()
