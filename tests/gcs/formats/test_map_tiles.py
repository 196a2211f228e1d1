"""A map from an MBTiles file, as QGIS or mb-util write it, and what is none."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from gcs.cli import main
from gcs.errors import SettingsError
from gcs.formats.map_tiles import MapTiles


def mbtiles(
    path: Path, kind: str = "png", rows: tuple[tuple[int, int, int, bytes], ...] = ((2, 1, 3, b"north"),)
) -> Path:
    with closing(sqlite3.connect(path)) as made, made:
        made.execute("CREATE TABLE metadata (name text, value text)")
        made.execute("CREATE TABLE tiles (zoom_level integer, tile_column integer, tile_row integer, tile_data blob)")
        stated = [("format", kind), ("attribution", "© somebody")]
        made.executemany("INSERT INTO metadata VALUES (?, ?)", stated)
        made.executemany("INSERT INTO tiles VALUES (?, ?, ?, ?)", rows)
    return path


def test_rows_are_counted_from_the_north(tmp_path: Path) -> None:
    tiles = MapTiles(mbtiles(tmp_path / "field.mbtiles"))
    assert (tiles.least_zoom, tiles.most_zoom, tiles.kind, tiles.attribution) == (2, 2, "image/png", "© somebody")
    assert tiles.tile(2, 1, 0) == b"north"
    assert tiles.tile(2, 1, 3) is None
    assert [tiles.tile(*place) for place in ((-1, 0, 0), (2, 9, 0), (2, 0, -1), (99, 0, 0))] == [None] * 4
    tiles.close()


def test_tiles_that_are_no_pictures_are_none(tmp_path: Path) -> None:
    rows = ((2, 1, 3, None), (2, 1, 2, "text"), ("deep", 1, 1, b"x"))
    tiles = MapTiles(mbtiles(tmp_path / "odd.mbtiles", rows=rows))  # type: ignore[arg-type]
    assert (tiles.tile(2, 1, 0), tiles.tile(2, 1, 1)) == (None, None)
    tiles.close()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda path: path.write_bytes(b"no database" * 100), "not a database"),
        (lambda path: mbtiles(path, "pbf"), "its tiles are pbf; give a file of pictures"),
        (lambda path: mbtiles(path, rows=()), "it holds no tiles"),
        (lambda path: None, "unable to open"),
    ],
)
def test_what_is_no_map_of_pictures_is_one_line(tmp_path: Path, make, words: str, capsys) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "map.mbtiles"
    make(path)
    with pytest.raises(SettingsError, match=words):
        MapTiles(path)
    assert main(["serve", "--data", str(tmp_path / "data"), "--map", str(path)]) == 2
    assert words in capsys.readouterr().err
