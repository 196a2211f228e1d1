"""Every format that is documented comes in over REST, as a file that the library for it wrote."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import dataflash
import h5py
import httpx
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import ulog_writer
from api_bench import Bench
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from scipy.io import savemat
from serving import serving

START_NS = 1_780_000_000 * 10**9
T = 0.02 * np.arange(200)
TABLE = {"time_s": T, "alpha_deg": 3.0 + np.sin(T), "q_deg_s": 10.0 * np.cos(T)}
ALPHA = "/air/alpha_deg"


def separated(mark: str) -> Callable[[Path], Path]:
    def write(path: Path) -> Path:
        rows = (mark.join(map(repr, row)) for row in zip(*(one.tolist() for one in TABLE.values()), strict=True))
        path.write_text("\n".join((mark.join(TABLE), *rows)) + "\n")
        return path

    return write


def parquet(path: Path) -> Path:
    pq.write_table(pa.table(TABLE), path)
    return path


def matlab(path: Path) -> Path:
    savemat(path, TABLE)
    return path


def matlab_7_3(path: Path) -> Path:
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in TABLE.items():
            file.create_dataset(name, data=values[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as head:
        head.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    return path


def rosbag2(plugin: StoragePlugin) -> Callable[[Path], Path]:
    def write(path: Path) -> Path:
        store, kind = get_typestore(Stores.ROS2_HUMBLE), "std_msgs/msg/Float64"
        with Writer2(path.parent / "bag", version=9, storage_plugin=plugin) as bag:
            fill(bag, kind, store, lambda one: store.serialize_cdr(one, kind))
        (made,) = [*(path.parent / "bag").glob("*.mcap"), *(path.parent / "bag").glob("*.db3")]
        return made

    return write


def rosbag1(path: Path) -> Path:
    store, kind = get_typestore(Stores.ROS1_NOETIC), "std_msgs/msg/Float64"
    with Writer1(path) as bag:
        fill(bag, kind, store, lambda one: store.serialize_ros1(one, kind))
    return path


def fill(bag: Any, kind: str, store: Any, serialized: Callable[[Any], Any]) -> None:
    connection = bag.add_connection(ALPHA, kind, typestore=store)
    for i, value in enumerate(TABLE["alpha_deg"]):
        bag.write(connection, START_NS + i * 20_000_000, serialized(store.types[kind](data=float(value))))


def onboard(path: Path) -> Path:
    path.write_bytes(dataflash.a_log().data)
    return path


def onboard_text(path: Path) -> Path:
    path.write_text(dataflash.as_text(onboard(path.with_suffix(".bin"))))
    return path


def of_px4(path: Path) -> Path:
    path.write_bytes(ulog_writer.a_log().bytes())
    return path


WRITERS: dict[str, tuple[str, Callable[[Path], Path]]] = {
    "csv": ("A.CSV", separated(",")),
    "tsv": ("a.tsv", separated("\t")),
    "txt": ("a.txt", separated("|")),
    "parquet": ("a.parquet", parquet),
    "mat": ("a.mat", matlab),
    "mat 7.3": ("a.mat", matlab_7_3),
    "bin": ("a.BIN", onboard),
    "log": ("a.log", onboard_text),
    "ulg": ("a.ulg", of_px4),
    "bag": ("a.bag", rosbag1),
    "db3": ("a.db3", rosbag2(StoragePlugin.SQLITE3)),
    "mcap of ROS": ("a.mcap", rosbag2(StoragePlugin.MCAP)),
}


@pytest.mark.whole_flight
@pytest.mark.parametrize("called", WRITERS)
def test_a_file_of_each_format_is_a_flight(called: str, tmp_path: Path) -> None:
    name, write = WRITERS[called]
    bench = Bench(tmp_path / "data")
    try:
        with serving(bench.app) as client:
            whole = write(tmp_path / name).read_bytes()
            body = client.post("/api/flights", params={"name": f"../{name}"}, content=whole)
            assert (body.status_code, body.json().get("name")) == (201, name), body.text
            form = client.post("/api/flights", files={"file": (name, whole)})
            assert form.status_code == 201, form.text
            assert of_alpha_or_rates(client, form.json()["id"])
    finally:
        bench.catalogue.close()


def of_alpha_or_rates(client: httpx.Client, flight_id: str) -> bool:
    found = client.get(f"/api/flights/{flight_id}").json()
    return bool({"alpha", "q"} & {one if isinstance(one, str) else one["name"] for one in found["signals"]})
