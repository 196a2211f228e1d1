"""Signals of a flight in a real browser: zoomed, read at a cursor, drawn in other ways, kept as pictures."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from browser import Visitor
from ground import Ground, flight_with
from PIL import Image
from traffic import wait_until


def test_zooming_asks_for_what_is_seen(visitor: Visitor, ground: Ground) -> None:
    visitor.open(f"#/flights/{flight_with(ground, 'identify')}?signals=q")
    visitor.wait_for_plots(1)
    whole = visitor.text("output")
    with visitor.page.expect_response(lambda answer: "/signals?" in answer.url) as asked:
        visitor.page.click("button[aria-label='Zoom in']")
    series = asked.value.json()["signals"]["q"]
    wait_until(lambda: visitor.text("output") != whole)
    low, high = (float(number) for number in re.findall(r"[\d.]+", visitor.text("output")))
    assert low - 0.1 * (high - low) < series["time"][0] < series["time"][-1] < high + 0.1 * (high - low)
    assert visitor.page.evaluate("location.hash").count("start=") == 1


def test_values_are_read_at_a_cursor_that_all_plots_share(visitor: Visitor, ground: Ground) -> None:
    flight = flight_with(ground, "identify")
    visitor.open(f"#/flights/{flight}?signals=airspeed,q")
    visitor.wait_for_plots(2)
    plot = visitor.page.locator(".plot").first
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    assert box is not None
    visitor.page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 60)
    wait_until(lambda: re.match(r"[\d.]+ s", visitor.text(".cursor")))
    at = float(visitor.text(".cursor b").split()[0])
    series = ground.get(f"/api/flights/{flight}/signals?names=airspeed&points=100000")["signals"]["airspeed"]
    nearest = min(range(len(series["time"])), key=lambda i: abs(series["time"][i] - at))
    shown = re.search(r"airspeed ([\d.]+) m/s", visitor.text(".cursor"))
    assert shown is not None
    around = series["value"][max(nearest - 10, 0) : nearest + 11]
    assert min(around) - 0.01 <= float(shown[1]) <= max(around) + 0.01
    assert visitor.page.locator(".cursor-line:not([hidden])").count() == 2
    visitor.page.focus(".cursor")
    visitor.page.keyboard.press("ArrowRight")
    wait_until(lambda: float(visitor.text(".cursor b").split()[0]) > at)
    visitor.check("cursor")


@pytest.mark.parametrize(("way", "plots"), [("together", 2), ("xy", 2), ("spectrum", 3), ("spectrogram", 3)])
def test_signals_are_drawn_in_other_ways(visitor: Visitor, ground: Ground, way: str, plots: int) -> None:
    visitor.open(f"#/flights/{flight_with(ground, 'identify')}?signals=p,q,theta")
    visitor.wait_for_plots(3)
    visitor.page.get_by_label("How they are drawn").select_option(way)
    wait_until(lambda: visitor.page.locator(".plots figure").count() == plots)
    # What was drawn before stays until all of the new is there.
    words = {"together": "p roll rate, q pitch rate", "xy": "against", "spectrum": "/Hz", "spectrogram": "dB of 1"}
    visitor.wait_for_text(".plots h3", words[way])
    visitor.wait_for_plots(plots)
    assert f"as={way}" in visitor.page.evaluate("location.hash")
    with visitor.page.expect_download() as download:
        visitor.page.click("button:text-is('Values (CSV)')")
    rows = Path(download.value.path()).read_text(encoding="utf-8").splitlines()
    heads = {"spectrum": "frequency_Hz,p [(rad/s)²/Hz]", "spectrogram": "signal,time_s,frequency_Hz,density_dB"}
    assert rows[0].startswith(heads.get(way, "time_s,p [°/s],q [°/s],theta [°]"))
    assert len(rows) > 100
    visitor.check()


def test_a_spectrogram_is_what_the_service_says(visitor: Visitor, ground: Ground) -> None:
    flight = flight_with(ground, "identify")
    visitor.open(f"#/flights/{flight}?signals=q&as=spectrogram")
    visitor.wait_for_plots(1)
    served = ground.get(f"/api/flights/{flight}/spectrogram?names=q")["signals"]["q"]
    strongest = max((level, at) for row, at in zip(served["value"], served["frequency"], strict=True) for level in row)
    assert f"strongest at {strongest[1]:.2f} Hz" in visitor.text("figcaption")
    visitor.page.locator(".plots h3").first.evaluate("heading => heading.scrollIntoView()")
    visitor.check("spectrogram")


def test_signals_of_two_units_share_a_plot_with_an_axis_for_each(visitor: Visitor, ground: Ground) -> None:
    flight, page = flight_with(ground, "identify"), visitor.page
    visitor.open(f"#/flights/{flight}?signals=airspeed,alpha,q")
    visitor.wait_for_plots(3)
    page.locator("summary:text-is('Picture and place')").nth(2).click()
    page.locator("figure").nth(2).locator("button:text-is('Draw with α')").click()
    wait_until(lambda: page.locator(".plots figure").count() == 2)
    assert "signals=airspeed%2Calpha%7Eq" in page.evaluate("location.hash")
    visitor.wait_for_text("h3", "α, °, q pitch rate, °/s")
    axes = """[...Bokeh.documents.flatMap(one => one.roots())].map(one => one.yaxes.map(axis =>
      [axis.axis_label, (one.extra_y_ranges[axis.y_range_name] ?? one.y_range).end])).find(one => one.length == 2)"""
    (left, alpha), (right, rate) = wait_until(lambda: page.evaluate(axes))
    assert (left, right) == ("°", "°/s")
    # Each axis goes by its own lines: the rate swings through far more than the angle.
    series = ground.get(f"/api/flights/{flight}/signals?names=alpha,q")["signals"]
    for end, name in ((alpha, "alpha"), (rate, "q")):
        most = 57.29578 * max(value for value in series[name]["value"] if value is not None)
        assert most <= end <= 1.5 * most
    page.locator(".plots h3").nth(1).evaluate("heading => heading.scrollIntoView({ block: 'center' })")
    visitor.check("two-axes")
    with page.expect_download() as download:
        page.locator("figure").nth(1).locator("summary:text-is('Picture and place')").click()
        page.locator("figure").nth(1).locator("button:text-is('Picture (PNG)')").click()
    assert download.value.suggested_filename == f"{flight}-alpha-q.png"
    with Image.open(download.value.path()) as picture:
        assert picture.width > 300
    with page.expect_download() as download:
        page.locator("figure").nth(1).locator("button:text-is('Picture (SVG)')").click()
    drawing = Path(download.value.path()).read_text(encoding="utf-8")
    assert ET.fromstring(drawing).tag.endswith("svg")
    assert "time, s" in drawing
    page.locator("button:text-is('Draw each in a plot of its own')").click()
    wait_until(lambda: page.locator(".plots figure").count() == 3)


def test_a_plot_is_dragged_onto_another(visitor: Visitor, ground: Ground) -> None:
    visitor.open(f"#/flights/{flight_with(ground, 'identify')}?signals=airspeed,alpha,q")
    visitor.wait_for_plots(3)
    visitor.page.locator("h3:has-text('q pitch rate')").drag_to(visitor.page.locator("figure:has(h3:has-text('α'))"))
    wait_until(lambda: visitor.page.locator(".plots figure").count() == 2)
    assert "signals=airspeed%2Calpha%7Eq" in visitor.page.evaluate("location.hash")
    visitor.check()


def test_layouts_are_kept_and_taken_and_forgotten(visitor: Visitor, ground: Ground) -> None:
    flight, page = flight_with(ground, "identify"), visitor.page
    visitor.open(f"#/flights/{flight}?signals=p~q&as=")
    visitor.wait_for_plots(1)
    page.click("button:text-is('Keep as a layout')")
    page.get_by_label("Name of the layout").fill("rates")
    visitor.check()
    page.keyboard.press("Enter")
    visitor.wait_for_text("select[aria-label=Layout]", "rates")
    visitor.open(f"#/flights/{flight}?signals=theta")
    visitor.wait_for_plots(1)
    page.get_by_label("Layout").select_option("rates")
    visitor.wait_for_text("h3", "p roll rate, q pitch rate")
    assert "signals=p%7Eq" in page.evaluate("location.hash")
    visitor.check()
    page.click("button:text-is('Forget it')")
    wait_until(lambda: page.get_by_label("Layout").count() == 0)
    page.evaluate("localStorage.setItem('layouts', '[]')")  # another program's, or damaged
    visitor.open(f"#/flights/{flight}?signals=p")
    visitor.wait_for_plots(1)
    visitor.check()
