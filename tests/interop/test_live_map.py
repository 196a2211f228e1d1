"""A map beneath the track: pictures of the station's own file, where they belong, in Chromium."""

from __future__ import annotations

import io
import math
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from ground import Ground
from patience import PATIENCE_S
from PIL import Image
from playwright.sync_api import Browser
from processes import free_port, start

ZOOM = 17
# The simulator's field; a tile is 289 m wide there.
HOME = (19.1334, 72.9133)


def tile_at(latitude: float, longitude: float) -> tuple[float, float]:
    """Web Mercator by the secant and tangent, as OpenStreetMap's wiki writes it."""
    angle = math.radians(latitude)
    up = math.log(math.tan(angle) + 1.0 / math.cos(angle)) / math.pi
    return (longitude / 360.0 + 0.5) * 2**ZOOM, (1.0 - up) / 2.0 * 2**ZOOM


@pytest.fixture(scope="module")
def field_map(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Tiles about the field: red west of home's tile, blue from there on."""
    path = tmp_path_factory.mktemp("map") / "field.mbtiles"
    column, row = (int(one) for one in tile_at(*HOME))
    with closing(sqlite3.connect(path)) as made, made:
        made.execute("CREATE TABLE metadata (name text, value text)")
        made.execute("CREATE TABLE tiles (zoom_level integer, tile_column integer, tile_row integer, tile_data blob)")
        made.executemany("INSERT INTO metadata VALUES (?, ?)", [("format", "png"), ("attribution", "© the club")])
        for x in range(column - 12, column + 13):
            for y in range(row - 12, row + 13):
                picture = io.BytesIO()
                Image.new("RGB", (8, 8), (255, 0, 0) if x < column else (0, 0, 255)).save(picture, "PNG")
                made.execute("INSERT INTO tiles VALUES (?, ?, ?, ?)", (ZOOM, x, 2**ZOOM - 1 - y, picture.getvalue()))
    return path


def test_the_map_lies_where_it_belongs(browser: Browser, tmp_path: Path, field_map: Path) -> None:
    ground = Ground(tmp_path, free_port(), free_port(), options=("--map", str(field_map)))
    ground.start()
    command = ("fly", "--vehicle", "iitb-mav", "--manoeuvre", "cruise", "--seed", 5, "--duration", 120)
    simulator = start("sim-vehicle", [*command, "--out", f"udpout:127.0.0.1:{ground.udp}"])
    try:
        page = browser.new_page()
        page.goto(f"{ground.url}/#/live")
        page.wait_for_selector(".tiles image[href^='blob:']", state="attached")
        page.wait_for_selector(".ground-track small:text('© the club')")
        page.wait_for_timeout(1000)
        # Where the colours meet, in metres of the drawing's scale east of home.
        seen = page.evaluate("""async () => {
          const images = [...document.querySelectorAll('.tiles image')]
          const home = document.querySelector('.home').getAttribute('transform').match(/[-\\d.]+/g).map(Number)
          const loaded = async address => { const one = new Image(); one.src = address; await one.decode(); return one }
          const colour = async image => {
            const canvas = new OffscreenCanvas(1, 1), drawn = canvas.getContext('2d')
            drawn.drawImage(await loaded(image.getAttribute('href')), 0, 0)
            return drawn.getImageData(0, 0, 1, 1).data[2] > 128
          }
          const blue = []
          for (const one of images) if (await colour(one)) blue.push(Number(one.getAttribute('x')))
          const width = Number(images[0].getAttribute('width')) - 0.3
          return { edge: Math.min(...blue), home: home[0], width, count: images.length }
        }""")
        share = (seen["home"] - seen["edge"]) / seen["width"]
        latitude, longitude = ground.get("/api/live")["status"]["home"]["place"]
        assert share == pytest.approx(tile_at(latitude, longitude)[0] - int(tile_at(*HOME)[0]), abs=0.02)
        assert seen["count"] <= 48
        page.close()
    finally:
        simulator.kill()
        simulator.communicate(timeout=PATIENCE_S)
        ground.stop()
