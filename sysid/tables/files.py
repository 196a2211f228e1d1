"""Tables in files: text (CSV, X-Plane's Data.txt), Parquet, MATLAB's .mat of both kinds, NumPy's .npz."""

from __future__ import annotations

import lzma
import math
import re
import struct
import tokenize
import tomllib
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from sysid.arrays import Array
from sysid.errors import TableError
from sysid.tables.blackbox import blackbox_columns, is_blackbox, is_of_words, settings_before
from sysid.tables.columns import Matched, Wanted, match_columns
from sysid.tables.pose_columns import derived_columns
from sysid.tables.sidpac import fdata_columns, looks_like_fdata
from sysid.tables.units import is_unit

ENDINGS = (".csv", ".txt", ".tsv", ".parquet", ".mat", ".npz")
_DELIMITERS = "|\t;,"
_NO_VALUE = ("", "nan", "NaN", "NAN", "NA", "N/A", "null", "None", "-", "--", "inf", "-inf")
# Cells that are words and yet numbers, or none.
_MEANT = {**dict.fromkeys(_NO_VALUE, np.nan), **dict.fromkeys(("true", "True", "TRUE"), 1.0),
          **dict.fromkeys(("false", "False", "FALSE"), 0.0)}  # fmt: skip
_MOMENT = re.compile(r"(?P<moment>\d{4}-\d\d-\d\d[T ]\d\d:\d\d(?::\d\d(?:\.\d+)?)?) ?(?P<zone>Z|[+-]\d\d(?::?\d\d)?)?")
# Rows of a text that are taken together.
_BLOCK_ROWS = 20_000
# Share of cells that are no numbers, below which they are slips; and a number with a decimal comma.
_FEW_WORDS = 0.2
_COMMA = re.compile(r"[-+]?\d+,\d+")
# Of structures in structures, and bytes of one variable.
_DEEPEST, _LARGEST_BYTES = 4, 1_000_000_000
# Characters of a row of headers, and columns: what no logger writes.
_LONGEST_ROW, _MOST_COLUMNS = 100_000, 5_000
# What reading an archive that is none, or damaged, or made to harm raises.
_NO_ARCHIVE = (
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, tokenize.TokenError, struct.error, ValueError, TypeError,
    OverflowError, RuntimeError, EOFError, NotImplementedError, MemoryError, SyntaxError, KeyError,
)  # fmt: skip
# How the columns of NumPy's matrices are called: of a position, and of a quaternion, scalar first.
_PARTS = {3: "xyz", 4: "0123"}
# MATLAB's files since 7.3 are HDF5's behind a header of their own.
_HDF5_MARK = b"MATLAB 7.3"


@dataclass(frozen=True)
class ColumnTable:
    """What a file holds as columns of numbers.

    columns: header -> (N,) values. units: header -> unit, where the file says them apart from the header. fdata: the
    flight data array of SIDPAC, where the file holds one. left_out: what is no column of numbers of that length.
    warnings: what the file lacks. settings: what a log's header says of the aircraft.
    """

    name: str
    columns: Mapping[str, Array]
    units: Mapping[str, str] = field(default_factory=dict)
    fdata: Array | None = None
    left_out: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    settings: Mapping[str, str] = field(default_factory=dict)

    def matched(
        self, columns: Mapping[str, Wanted] | None = None, units: Mapping[str, str] | str | None = None
    ) -> tuple[Mapping[str, Array], Matched]:
        """The columns and which is what, as `match_columns` finds them; SIDPAC's array by its own layout."""
        if self.fdata is not None:
            if columns or units:
                raise TableError(f"{self.name}: is SIDPAC's array, whose columns and units are fixed; leave yours out")
            return fdata_columns(self.fdata, self.name)
        if is_blackbox(list(self.columns)):
            return self._of_blackbox(columns or {}, units or {})
        said = units if isinstance(units, str) else {**self.units, **(units or {})}
        every, named, left = derived_columns(self.columns, columns, said)
        return every, match_columns(list(every), named, left)

    def _of_blackbox(
        self, columns: Mapping[str, Wanted], units: Mapping[str, str] | str
    ) -> tuple[Mapping[str, Array], Matched]:
        """A Blackbox's columns: those of known axes and units, and what the user names; no other by its name alone."""
        headers = list(self.columns)
        numbered = {key: headers[one] if isinstance(one, int) and 0 <= one < len(headers) else one
                    for key, one in columns.items()}  # fmt: skip
        wanted, said = blackbox_columns(self.name, headers, self.settings, numbered, units)
        named = {header for one in wanted.values() for header in ([one] if not isinstance(one, Mapping) else one)}
        kept = [header for header in headers if header in named or header in said]
        found = match_columns(kept, wanted, said)
        used = {header for use in (found.time, *found.uses) for header in use.headers}
        return self.columns, Matched(found.time, found.uses, tuple(one for one in headers if one not in used))


def read_table(path: Path, name: str = "") -> ColumnTable:
    """Read a table.

    Parameters
    ----------
    path : Path
        A file whose ending is one of `ENDINGS`.
    name : str
        What it is called in errors and results, where `path` has another name.

    Returns
    -------
    ColumnTable
        Its columns of numbers.

    Raises
    ------
    TableError
        In one line, where the file cannot be read or holds no table of numbers.
    """
    called = name or path.name
    ending = Path(called).suffix.lower()
    try:
        if ending == ".parquet":
            return _parquet(path, called)
        if ending == ".mat":
            return _matlab(path, called)
        if ending == ".npz":
            return _numpy(path, called)
        return _text(path, called)
    except OSError as error:
        raise TableError(f"{called}: cannot be read: {error.strerror or error}") from None


def read_mapping(path: Path) -> tuple[dict[str, Wanted], dict[str, str] | str]:
    """Columns and units of a mapping file, TOML with the tables [columns] and [units]. TableError where it is none.

    A column is a header, the number of a column from 0, or headers with weights: da = { "left" = 0.5, "right" = -0.5 }.
    `units = "SI"` says that all others are in SI units.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise TableError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise TableError(f"{path}: is no TOML file: {_line(error)}") from None
    columns, units = data.pop("columns", {}), data.pop("units", {})
    if data:
        raise TableError(f"{path}: {next(iter(data))!r} is not known; a mapping has [columns] and [units]")
    if not isinstance(columns, dict) or not isinstance(units, dict | str):
        raise TableError(f"{path}: [columns] and [units] are tables of names")
    for signal, wanted in columns.items():
        weighted = isinstance(wanted, dict) and wanted and all(isinstance(one, int | float) for one in wanted.values())
        if not (weighted or isinstance(wanted, str | int)) or isinstance(wanted, bool):
            raise TableError(f"{path}: columns.{signal} must be a header, a number, or headers with weights")
    if isinstance(units, dict) and not all(isinstance(unit, str) for unit in units.values()):
        raise TableError(f"{path}: units must be texts, as alpha = 'deg'")
    return columns, units


def _text(path: Path, name: str) -> ColumnTable:
    raw = path.read_bytes()
    if b"\x00" in raw[:4096]:
        raise TableError(f"{name}: is no text: give a table as CSV, Parquet or .mat")
    lines = raw.decode("utf-8-sig", errors="replace").splitlines()
    start, settings = settings_before(lines)
    lines = lines[start:]
    first = next((i for i, line in enumerate(lines) if line.strip() and line.lstrip()[0] not in "#%"), None)
    if first is None:
        raise TableError(f"{name}: is empty; the first row names the columns")
    delimiter = _delimiter(lines[first])
    if len(lines[first]) > _LONGEST_ROW:
        raise TableError(f"{name}: the first row has {len(lines[first])} characters; it names the columns")
    headers = _cells(lines[first], delimiter)
    if len(headers) > _MOST_COLUMNS:
        raise TableError(f"{name}: has {len(headers)} columns; {_MOST_COLUMNS} are the most that are read")
    if not any(re.search(r"[A-Za-z]", header) for header in headers):
        raise TableError(f"{name}: the first row, {lines[first].strip()[:60]!r}, names no columns; add a row of names")
    body = [line for line in lines[first + 1 :] if line.strip() and line.lstrip()[0] not in "#%"]
    units: dict[str, str] = {}
    second = _cells(body[0], delimiter) if body else []
    if any(is_unit(cell) and not _is_number(cell) for cell in second) and not any(_is_number(cell) for cell in second):
        units = {header: cell for header, cell in zip(headers, second, strict=False) if cell and is_unit(cell)}
        body = body[1:]
    headers = _distinct(headers)
    warnings: list[str] = []
    if len(body) > 1 and len(_cells(body[-1], delimiter)) < len(headers):
        body.pop()
        warnings.append("the last row is cut off; it is left out")
    for number, line in enumerate(body[:1]):
        if len(_cells(line, delimiter)) != len(headers):
            raise TableError(
                f"{name}: row {first + 2 + number} has {len(_cells(line, delimiter))} cells, the header {len(headers)}"
            )
    if not body:
        raise TableError(f"{name}: has a header and no rows")
    columns, words = _of_cells(body, delimiter, headers, name)
    flags = is_blackbox(headers)
    _check_words(name, {key: one for key, one in words.items() if not (flags and is_of_words(key))}, delimiter)
    said = {header: unit for header, unit in units.items() if header in columns}
    return ColumnTable(Path(name).stem, columns, said, None, tuple(words), tuple(warnings), settings)


def _of_cells(
    body: Sequence[str], delimiter: str, headers: Sequence[str], name: str
) -> tuple[dict[str, Array], dict[str, tuple[str, ...]]]:
    """The columns that are numbers, moments as s since 1970, and the cells of the others."""
    parts: dict[str, list[Array] | None] = {header: [] for header in headers}
    for block in _blocks(body, delimiter, len(headers), name):
        for header, cells in zip(headers, zip(*block, strict=True), strict=True):
            known = parts[header]
            values = None if known is None else _numbers_in(cells)
            if known is None or values is None:
                parts[header] = None
            else:
                known.append(values)
    columns = {header: np.concatenate(known) for header, known in parts.items() if known is not None}
    others: dict[str, list[str]] = {header: [] for header, known in parts.items() if known is None}
    for block in _blocks(body, delimiter, len(headers), name) if others else ():
        for header, cells in zip(headers, zip(*block, strict=True), strict=True):
            if header in others:
                others[header] += ["" if (word := cell.strip()) in _NO_VALUE else word for cell in cells]
    moments = {header: _moments_in(cells) for header, cells in others.items()}
    columns |= {header: values for header, values in moments.items() if values is not None}
    words = {header: tuple(others[header]) for header, values in moments.items() if values is None}
    return {header: columns[header] for header in headers if header in columns}, words


def _blocks(body: Sequence[str], delimiter: str, count: int, name: str) -> Iterator[list[list[str]]]:
    """Cells of every row, as many as the header has, in blocks of rows."""
    import csv

    # What ends a row in X-Plane's files is no cell.
    lines = (line.rstrip().removesuffix("|") for line in body) if delimiter == "|" else iter(body)
    reader, done = csv.reader(lines, delimiter=delimiter, skipinitialspace=delimiter == "|"), 0
    while True:
        try:
            block = list(islice(reader, _BLOCK_ROWS))
        except csv.Error as error:
            raise TableError(f"{name}: is no table: {_line(error)}") from None
        if not block:
            return
        wrong = next((number for number, cells in enumerate(block) if len(cells) != count), None)
        if wrong is not None:
            raise TableError(
                f"{name}: is no table: row {done + wrong + 1} of its values has {len(block[wrong])} cells, the header"
                f" {count}"
            )
        yield block
        done += len(block)


def _numbers_in(cells: Sequence[str]) -> Array | None:
    """(N,) numbers, NaN where there is none; None where a cell is something else."""
    if not all(map(_is_plain, cells)):
        return None
    try:
        values = np.array(list(map(float, cells)))
    except ValueError:
        said = {cell: _MEANT.get(cell.strip()) for cell in set(cells)}
        try:
            values = np.array([float(cell) if (value := said[cell]) is None else value for cell in cells])
        except ValueError:
            return None
    values[np.isinf(values)] = np.nan
    return values


def _moments_in(cells: Sequence[str]) -> Array | None:
    """(N,) s since 1970 of moments by ISO 8601, in UTC where they name no zone; None where they are none."""
    moments = [_MOMENT.fullmatch(cell) for cell in cells if cell]
    if not moments or None in moments:
        return None
    try:
        ns = np.array([one["moment"] for one in moments if one], dtype="datetime64[ns]").astype(np.int64)
    except ValueError:
        return None
    ns -= np.array([_zone_ns(one["zone"]) for one in moments if one])
    values = np.full(len(cells), np.nan)
    values[[bool(cell) for cell in cells]] = _seconds_of(ns)
    return values


def _zone_ns(zone: str | None) -> int:
    """How far a zone's clock is ahead of UTC."""
    digits = "" if zone in (None, "", "Z") else str(zone)[1:].replace(":", "").ljust(4, "0")
    minutes = 60 * int(digits[:2]) + int(digits[2:]) if digits else 0
    return (-1 if str(zone).startswith("-") else 1) * minutes * 60_000_000_000


def _check_words(name: str, words: Mapping[str, Sequence[str]], delimiter: str) -> None:
    """TableError for a column of numbers with a few words in it, and for decimal commas."""
    for header, cells in words.items():
        said = [cell for cell in cells if cell]
        if said and delimiter != "," and all(_COMMA.fullmatch(cell) for cell in said):
            raise TableError(f"{name}: column {header!r} has decimal commas ({said[0]}): save it with points")
        wrong = [cell for cell in said if not _is_number(cell)]
        if wrong and len(wrong) < _FEW_WORDS * len(said):
            raise TableError(
                f"{name}: column {header!r} holds {wrong[0][:40]!r} in row {cells.index(wrong[0]) + 1} of its values"
                " among numbers: correct the cell, or leave it empty"
            )


def _parquet(path: Path, name: str) -> ColumnTable:
    try:
        import pyarrow as pa
        import pyarrow.parquet as parquet
    except ImportError:
        raise TableError(
            f"{name}: for Parquet pyarrow is needed (pip install 'flight-model-ground-station[parquet]'); or give a CSV"
        ) from None
    try:
        table = parquet.read_table(path)
    except pa.ArrowInvalid as error:
        raise TableError(f"{name}: is no Parquet file: {str(error).splitlines()[0]}") from None
    columns, left_out = _numbers(table)
    units = {
        one.name: one.metadata[b"unit"].decode(errors="replace")
        for one in table.schema
        if one.metadata and b"unit" in one.metadata and one.name in columns
    }
    return ColumnTable(Path(name).stem, columns, units, None, left_out)


def _numbers(table: Any) -> tuple[dict[str, Array], tuple[str, ...]]:
    """The columns of an Arrow table that are numbers, and the names of the others; moments as s since 1970."""
    import pyarrow as pa

    columns, others = {}, []
    for header, column in zip(table.column_names, table.columns, strict=True):
        kind = column.type
        try:
            if pa.types.is_timestamp(kind):
                columns[header] = _seconds_of(column.cast(pa.timestamp("ns"), safe=False).cast(pa.int64()).to_numpy())
            elif pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_null(kind):
                columns[header] = np.asarray(column.cast(pa.float64(), safe=False).to_numpy(), dtype=np.float64)
            elif pa.types.is_boolean(kind):
                columns[header] = np.asarray(column.cast(pa.int8()).to_numpy(zero_copy_only=False), dtype=np.float64)
            else:
                others.append(header)
        except pa.ArrowException:
            others.append(header)
    return columns, tuple(others)


def _seconds_of(ns: Any) -> Array:
    """s since 1970 of whole ns: the first by itself, for 64 bits do not hold both its size and a step of 1 us."""
    whole = np.asarray(ns, dtype=np.float64)
    if not np.isfinite(whole).all():
        return whole * 1e-9
    steps = np.asarray(ns, dtype=np.int64) - int(ns[0])
    return np.asarray(float(int(ns[0]) // 1_000_000_000) + (steps + int(ns[0]) % 1_000_000_000) * 1e-9)


def matlab_variables(path: Path, name: str) -> dict[str, Any]:
    """The variables of a MATLAB file older than 7.3, structures as objects; TableError where it is damaged."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        variables: dict[str, Any] = loadmat(path, squeeze_me=True, struct_as_record=False)
    except (MatReadError, ValueError, TypeError, NotImplementedError, EOFError, LookupError, zlib.error) as error:
        raise TableError(f"{name}: is no MATLAB file that can be read: {_line(error)}") from None
    return variables


def _matlab(path: Path, name: str) -> ColumnTable:
    with path.open("rb") as file:
        head = file.read(512)
    found: dict[str, Array] = {}
    left_out: list[str] = []
    if head.startswith(_HDF5_MARK):
        _walk(_hdf5_variables(path, name), "", found, left_out)
    else:
        variables = matlab_variables(path, name)
        _walk({key: value for key, value in variables.items() if not key.startswith("__")}, "", found, left_out)
    return _of_variables(name, found, left_out)


def _numpy(path: Path, name: str) -> ColumnTable:
    """NumPy's archive of arrays. Objects in it are not read: they would run code."""
    try:
        with zipfile.ZipFile(path) as archive:
            _require_sizes(archive, name)
        with np.load(path, allow_pickle=False) as arrays:
            held = {key: arrays[key] for key in arrays.files}
    except _NO_ARCHIVE as error:
        raise TableError(f"{name}: is no .npz of arrays of numbers: {_line(error)}") from None
    found: dict[str, Array] = {}
    left_out: list[str] = []
    _walk(held, "", found, left_out)
    for key in [key for key, array in found.items() if array.ndim > 1]:
        array = found[key] = found[key] if len(found[key]) >= found[key].shape[1] else found[key].T
        if array.shape[1] not in _PARTS:
            continue
        del found[key]
        found |= {f"{key}_{part}": array[:, i] for i, part in enumerate(_PARTS[array.shape[1]])}
    return _of_variables(name, found, left_out)


def _require_sizes(archive: zipfile.ZipFile, name: str) -> None:
    """TableError for an archive whose arrays are more numbers than a flight: they are counted before they are read."""
    entries = archive.infolist()
    if len(entries) > _MOST_COLUMNS:
        raise TableError(f"{name}: has {len(entries)} arrays; {_MOST_COLUMNS} are the most that are read")
    numbers = 0
    for entry in entries:
        with archive.open(entry) as file:
            version = np.lib.format.read_magic(file)
            header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            numbers += math.prod(header(file)[0])
    if 8 * numbers > _LARGEST_BYTES or sum(entry.file_size for entry in entries) > _LARGEST_BYTES:
        raise TableError(f"{name}: its arrays take more than {_LARGEST_BYTES / 1e9:g} GB")


def _of_variables(name: str, found: Mapping[str, Array], left_out: list[str]) -> ColumnTable:
    """A table of vectors and matrices by their paths. left_out: what is none of these."""
    fdata = next((array for key, array in found.items() if _last(key) == "fdata" and looks_like_fdata(array)), None)
    if fdata is not None:
        return ColumnTable(Path(name).stem, {}, {}, fdata, tuple(left_out))
    columns: dict[str, Array] = {}
    if sum(1 if array.ndim == 1 else array.shape[1] for array in found.values()) > _MOST_COLUMNS:
        raise TableError(f"{name}: has more than {_MOST_COLUMNS} columns")
    for key, array in found.items():
        if array.ndim == 1:
            columns[key] = array
        else:
            columns |= {f"{key}(:,{column + 1})": array[:, column] for column in range(array.shape[1])}
    if not columns:
        raise TableError(f"{name}: holds no columns of numbers (tables and timetables: save them with struct or array)")
    rows = Counter(array.size for array in columns.values()).most_common(1)[0][0]
    left_out += [key for key, array in columns.items() if array.size != rows]
    short = {_last(key) for key in columns}
    names = {key: _last(key) if len(short) == len(columns) else key for key in columns}
    return ColumnTable(
        Path(name).stem, {names[key]: array for key, array in columns.items() if array.size == rows}, {}, None,
        tuple(left_out),
    )  # fmt: skip


def _walk(variables: Mapping[str, Any], prefix: str, found: dict[str, Array], left_out: list[str]) -> None:
    """Every vector and matrix of numbers in variables and structures, under its path."""
    for key, value in variables.items():
        path = f"{prefix}{key}"
        fields = getattr(value, "_fieldnames", None)
        if fields is not None:
            _walk({one: getattr(value, one) for one in fields}, f"{path}.", found, left_out)
        elif isinstance(value, Mapping):
            _walk(value, f"{path}.", found, left_out)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and value.ndim in (1, 2) and value.size > 1:
            found[path] = np.asarray(value, dtype=np.float64)
        elif isinstance(value, np.ndarray) and value.size > 1:
            left_out.append(path)


def _hdf5_variables(path: Path, name: str) -> dict[str, Any]:
    """Variables of a .mat of version 7.3: HDF5, columns before rows."""
    try:
        import h5py
    except ImportError:
        raise TableError(
            f"{name}: is a MATLAB file of version 7.3, for which h5py is needed (pip install h5py); or save it with -v7"
        ) from None

    found: dict[str, Any] = {}

    def walk(group: Any, prefix: str, depth: int) -> None:
        for key in group:
            # What lies in the file itself alone: a link may lead to any file of this computer.
            if key.startswith("#") or not isinstance(group.get(key, getlink=True), h5py.HardLink):
                continue
            one = group[key]
            if isinstance(one, h5py.Group) and depth < _DEEPEST:
                walk(one, f"{prefix}{key}.", depth + 1)
            elif isinstance(one, h5py.Dataset) and _is_own(one) and one.nbytes <= _LARGEST_BYTES:
                found[f"{prefix}{key}"] = np.squeeze(np.asarray(one[()]).T)

    try:
        with h5py.File(path, "r") as file:
            walk(file, "", 0)
    except (OSError, KeyError, RuntimeError, TypeError, ValueError) as error:
        raise TableError(f"{name}: is no MATLAB file that can be read: {_line(error)}") from None
    return found


def _is_own(one: Any) -> bool:
    """Whether a dataset's numbers lie in its own file, in the file's own bytes."""
    return one.dtype.kind in "fiub" and not one.external and not one.is_virtual


def _line(error: Exception) -> str:
    """An error of a library as one line."""
    return " ".join(str(error).split())[:200] or type(error).__name__


def _last(key: str) -> str:
    return key.rsplit(".", 1)[-1]


def _delimiter(line: str) -> str:
    """What separates the cells; a "|" alone decides, for X-Plane's headers hold commas."""
    return next((mark for mark in _DELIMITERS if mark in line), ",")


def _cells(line: str, delimiter: str) -> list[str]:
    import csv

    cells = [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]
    # A delimiter behind the last cell of a row, as X-Plane writes.
    return cells[:-1] if delimiter == "|" and cells and not cells[-1] else cells


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return _is_plain(cell)


def _is_plain(cell: str) -> bool:
    """Whether a cell has nothing of what Python takes for a number and no logger writes."""
    return "_" not in cell and cell.isascii()


def _distinct(headers: list[str]) -> list[str]:
    """Headers, those that stand twice with a number behind, and one for those that are empty."""
    seen: Counter[str] = Counter()
    result = []
    for place, header in enumerate(headers):
        text = header or f"column {place + 1}"
        result.append(f"{text} .{seen[text]}" if seen[text] else text)
        seen[text] += 1
    return result
