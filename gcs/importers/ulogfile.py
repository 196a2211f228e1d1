"""The file format of PX4's onboard logs (.ulg), read by pyulog: topics by name and instance at their samples' times."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyulog import ULog

from gcs.errors import ImportFileError
from gcs.importers.synthesis import Ints

_LONGEST_WAY_US = 500_000  # from a sample to its publication; what is more is damaged, or no stamp of this clock

Values = NDArray[np.float64]


class _Bounded(io.BytesIO):
    """A log in memory that may be read a hundred times over, but not for ever, as pyulog would some damaged ones."""

    def __init__(self, data: bytes) -> None:
        super().__init__(data)
        self._left = 100 * len(data) + (1 << 20)

    def read(self, size: int | None = -1, /) -> bytes:
        """As a file does; RuntimeError once it has been read too often."""
        data = super().read(size)
        self._left -= max(len(data), 1)
        if self._left < 0:
            raise RuntimeError("its definitions are damaged")
        return data


def read_ulog(path: Path) -> Any:
    """Read a log whole, as pyulog does; ImportFileError, one line, if that fails."""
    try:
        # pyulog prints what it finds damaged; the notes of the import say so.
        with contextlib.redirect_stdout(io.StringIO()):
            return ULog(_Bounded(path.read_bytes()))
    except OSError as error:
        raise ImportFileError(f"{path} cannot be read: {error.strerror}") from None
    except Exception as error:  # on damaged files pyulog fails with whatever its unpacking meets
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ImportFileError(f"{path} cannot be read as a PX4 log ({reason}); check that it is a .ulg") from None


class Topic:
    """One instance of one topic: (N,) arrays by field."""

    def __init__(self, data: dict[str, NDArray[Any]], keep: NDArray[np.bool_] | None = None) -> None:
        self._data = data if keep is None else {name: column[keep] for name, column in data.items()}
        self.time_us = self._sampled()

    def __len__(self) -> int:
        return int(self.time_us.size)

    def __contains__(self, field: object) -> bool:
        return field in self._data

    def _sampled(self) -> Ints:
        """(N,) when the sample was taken where the log gives it, else when it was published."""
        published = self._data["timestamp"].astype(np.int64)
        if "timestamp_sample" not in self._data:
            return published
        way = published - self._data["timestamp_sample"].astype(np.int64)
        return np.where((way > 0) & (way < _LONGEST_WAY_US), published - way, published)

    def values(self, *names: str) -> Values:
        """(N,) the first of these fields that there is; NaN where the log has none of them."""
        for name in names:
            if name in self._data:
                with np.errstate(invalid="ignore"):  # damaged bytes may be a signalling NaN
                    return np.asarray(self._data[name], np.float64)
        return np.full(len(self), np.nan)

    def vector(self, name: str, count: int) -> list[Values]:
        """The elements of an array field."""
        return [self.values(f"{name}[{i}]") for i in range(count)]

    def only(self, keep: NDArray[np.bool_]) -> Topic:
        """The samples chosen by a mask."""
        return Topic(self._data, keep)


__all__ = ["Topic", "Values", "read_ulog"]
