"""Tables in files, written by other libraries: csv, pandas, polars, scipy, h5py."""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from sysid.errors import TableError
from sysid.tables.files import read_mapping, read_table
from sysid.tables.flight_table import flight_from_table

T = 0.02 * np.arange(100)
COLUMNS = {"time_s": T, "alpha_deg": 3.0 + np.sin(T), "q_deg_s": 10.0 * np.cos(T)}


def signals(path: Path, **given: object) -> dict[str, np.ndarray]:
    table = read_table(path)
    found = flight_from_table(table.name, *table.matched(**given))  # type: ignore[arg-type]
    return {key: one.values for key, one in found.signals.items()}


def check(found: dict[str, np.ndarray]) -> None:
    assert set(found) == {"alpha", "q"}
    np.testing.assert_allclose(found["alpha"], np.radians(COLUMNS["alpha_deg"]), rtol=1e-15)
    np.testing.assert_allclose(found["q"], np.radians(COLUMNS["q_deg_s"]), rtol=1e-14)


def test_csv_of_pandas(tmp_path: Path) -> None:
    import pandas

    pandas.DataFrame(COLUMNS).to_csv(tmp_path / "a.csv", index=False)
    check(signals(tmp_path / "a.csv"))


def test_parquet_of_polars(tmp_path: Path) -> None:
    import polars

    polars.DataFrame(COLUMNS).write_parquet(tmp_path / "a.parquet")
    check(signals(tmp_path / "a.parquet"))


def test_parquet_without_its_library_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.parquet").write_bytes(b"PAR1")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(TableError, match=r"pip install 'flight-model-ground-station\[parquet\]'"):
        read_table(tmp_path / "a.parquet")


@pytest.mark.parametrize(("zone", "ahead_h"), [("", 0.0), ("Z", 0.0), ("+00:00", 0.0), ("+02", 2.0), ("-0330", -3.5)])
def test_words_that_are_numbers_and_moments_of_any_zone(tmp_path: Path, zone: str, ahead_h: float) -> None:
    rows = [f"2026-05-01 10:00:0{i}.25{zone},{['False', 'true'][i % 2]},{i}e-1,now,2026-05-01,{i}_0" for i in range(5)]
    rows[3] = ",TRUE,inf,now,,3_0"
    (tmp_path / "a.csv").write_text("when,on,x,word,day,id\n" + "\n".join(rows))
    table = read_table(tmp_path / "a.csv")
    assert table.left_out == ("word", "day", "id")
    assert table.columns["on"].tolist() == [0.0, 1.0, 0.0, 1.0, 0.0]
    np.testing.assert_array_equal(table.columns["x"], [0.0, 0.1, 0.2, np.nan, 0.4])
    first = 1777629600.25 - 3600.0 * ahead_h
    np.testing.assert_array_equal(table.columns["when"], [first, first + 1, first + 2, np.nan, first + 4])


def test_csv_with_remarks_a_row_of_units_semicolons_and_words(tmp_path: Path) -> None:
    rows = [f"{t:.2f};{a!r};{q!r};AUTO;" for t, a, q in zip(*(v.tolist() for v in COLUMNS.values()), strict=True)]
    path = tmp_path / "a.csv"
    path.write_text("\ufeff# flown on a Sunday\n\nTime;AOA;q;mode;note\ns;deg;deg/s;;\n" + "\n".join(rows) + "\n")
    table = read_table(path)
    assert table.units == {"Time": "s", "AOA": "deg", "q": "deg/s"}
    assert set(table.left_out) == {"mode"}
    check(signals(path))


def test_a_row_that_is_cut_off_is_left_out_and_said(tmp_path: Path) -> None:
    import pandas

    pandas.DataFrame(COLUMNS).to_csv(tmp_path / "a.csv", index=False)
    whole = (tmp_path / "a.csv").read_text()
    rows = whole.count("\n") - 1
    (tmp_path / "a.csv").write_text(whole.rstrip("\n").rpartition(",")[0])
    read = read_table(tmp_path / "a.csv")
    assert all(values.size == rows - 1 for values in read.columns.values())
    assert read.warnings == ("the last row is cut off; it is left out",)


def test_missing_values_are_none(tmp_path: Path) -> None:
    rows = [f"{t:.2f},{'' if i % 3 else 2.5 + t},{'NaN' if i == 4 else i}" for i, t in enumerate(T.tolist())]
    (tmp_path / "a.csv").write_text("t,alpha (deg),q (deg/s)\n" + "\n".join(rows))
    found = signals(tmp_path / "a.csv")
    assert np.isfinite(found["alpha"]).sum() == 34
    assert np.isnan(found["q"]).sum() == 1


def test_data_txt_of_x_plane(tmp_path: Path) -> None:
    rows = [
        f"   {1 + t:.5f} |  {t:.5f} |  {a:.6f} | {q:.6f} | 80.5 |" for t, a, q in zip(*COLUMNS.values(), strict=True)
    ]
    head = "   _real,_time |   _totl,_time |   alpha,__deg |   ____Q,deg/s |   Vtrue,_ktgs |"
    (tmp_path / "Data.txt").write_text("\n\n" + head + " \n" + "\n".join(rows) + "\n")
    found = signals(tmp_path / "Data.txt")
    assert set(found) == {"alpha", "q"}  # a speed over ground is no airspeed
    np.testing.assert_allclose(found["alpha"], np.radians(COLUMNS["alpha_deg"]), atol=2e-8)


def test_moments_in_utc_are_a_time(tmp_path: Path) -> None:
    import pandas

    frame = pandas.DataFrame(
        {**COLUMNS, "time_s": pandas.Timestamp("2026-05-01T10:00:00") + pandas.to_timedelta(T, "s")}
    )
    frame.rename(columns={"time_s": "time"}).to_csv(tmp_path / "a.csv", index=False)
    check(signals(tmp_path / "a.csv"))


def test_mat_of_scipy_with_a_structure(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {"flight": {**COLUMNS, "name": "first"}, "motor_rpm": np.arange(7.0), "version": 2.0})
    table = read_table(tmp_path / "a.mat")
    assert table.left_out == ("motor_rpm",)
    check(signals(tmp_path / "a.mat"))


def test_mat_of_version_7_3(tmp_path: Path) -> None:
    import h5py

    with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
        for name, values in COLUMNS.items():
            file.create_dataset(f"log/{name}", data=values[None, :])  # MATLAB's columns come as rows
    data = (tmp_path / "a.mat").read_bytes()
    (tmp_path / "a.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + data[512:])
    check(signals(tmp_path / "a.mat"))


def test_mat_with_a_matrix_and_a_mapping_by_number(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {"data": np.column_stack(list(COLUMNS.values()))})
    check(signals(tmp_path / "a.mat", columns={"time": 0, "alpha": 1, "q": 2}, units={"alpha": "deg", "q": "deg/s"}))


def test_mat_with_sidpac_s_array(tmp_path: Path) -> None:
    fdata = np.zeros((100, 90))
    fdata[:, 0], fdata[:, 3], fdata[:, 5] = COLUMNS.values()
    savemat(tmp_path / "a.mat", {"fdata": fdata, "t": T})
    check(signals(tmp_path / "a.mat"))


def test_a_mapping_file_says_what_columns_are(tmp_path: Path) -> None:
    path = tmp_path / "map.toml"
    path.write_text('[columns]\ntime = 0\nda = { "L" = 0.5, "R" = -0.5 }\nalpha = "x"\n[units]\nda = "deg"\n')
    assert read_mapping(path) == ({"time": 0, "da": {"L": 0.5, "R": -0.5}, "alpha": "x"}, {"da": "deg"})
    path.write_text('units = "SI"\n')
    assert read_mapping(path) == ({}, "SI")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[column]\n", "'column' is not known; a mapping has [columns] and [units]"),
        ("[columns]\nalpha = true\n", "columns.alpha must be a header, a number, or headers with weights"),
        ("[units]\nalpha = 3\n", "units must be texts"),
        ("columns = 3\n", "are tables of names"),
        ("=", "is no TOML file"),
    ],
)
def test_a_wrong_mapping_file_is_one_clear_line(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "map.toml"
    path.write_text(text)
    with pytest.raises(TableError) as refused:
        read_mapping(path)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.csv", b"", "is empty"),
        ("a.csv", b"1,2,3\n4,5,6\n", "names no columns"),
        ("a.csv", b"a,b\n", "has a header and no rows"),
        ("a.csv", b"a,b\n1,2,3\n", "row 2 has 3 cells, the header 2"),
        ("a.csv", b"a,b\n1,2\n1,2,3\n", "is no table"),
        ("a.csv", b"\x89PNG\x00\x00", "is no text"),
        ("a.csv", b"t,q\n" + b"".join(b"%d,%d\n" % (i, i) for i in range(30)) + b"30,bad\n", "'bad' in row 31"),
        ("a.csv", b"t;q\n0,02;1,5\n0,04;1,6\n", "has decimal commas (0,02): save it with points"),
        ("a.parquet", b"PAR1nothing", "is no Parquet file"),
        ("a.mat", b"nothing of MATLAB" * 20, "is no MATLAB file"),
        ("a.mat", b"MATLAB 7.3 MAT-file".ljust(600), "is no MATLAB file"),
    ],
)
def test_a_damaged_file_is_one_clear_line(tmp_path: Path, name: str, content: bytes, words: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(TableError) as refused:
        read_table(tmp_path / name)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_file_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(TableError, match="No such file"):
        read_table(tmp_path / "a.csv")


def test_a_mat_of_version_7_3_reads_no_other_file(tmp_path: Path) -> None:
    import h5py

    secret, path = tmp_path / "secret.txt", tmp_path / "a.mat"
    secret.write_bytes(b"TOKEN=abcdefgh" * 100)
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_dataset("time_s", data=T)
        file.create_dataset("q_deg_s", data=np.cos(T))
        file.create_dataset("alpha_deg", (100,), "u1", external=[(str(secret), 0, 100)])
        file["beta_deg"] = h5py.ExternalLink(str(secret), "/")
        file["gone"] = h5py.SoftLink("/nowhere")
        file.create_group("loop")["again"] = file["/"]
    data = path.read_bytes()
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + data[512:])
    assert set(signals(path)) == {"q"}


def test_moments_in_whole_nanoseconds(tmp_path: Path) -> None:
    import pandas

    ns = 1_780_000_000_000_000_000 + 20_000_000 * np.arange(100)
    pandas.DataFrame({"timestamp": ns, "q_deg_s": np.cos(T)}).to_csv(tmp_path / "a.csv", index=False)
    table = read_table(tmp_path / "a.csv")
    found = flight_from_table(table.name, *table.matched(units={"timestamp": "ns"}))
    np.testing.assert_allclose(found.signals["q"].time_s, T, atol=1e-6)


def test_a_header_of_blanks_takes_no_time(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time_s,q_deg_s,(" + " " * 50_000 + "x\n" + "\n".join(f"{t},1,2" for t in T))
    assert set(signals(tmp_path / "a.csv")) == {"q"}
