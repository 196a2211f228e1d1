"""The live view in Chromium as somebody reads it: nothing is taken from under the eyes, nothing old passes for new."""

from __future__ import annotations

import re
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from browser import Visitor
from ground import Ground
from node_reader import NodeReader
from patience import PATIENCE_S
from playwright.sync_api import Browser
from processes import free_port, start
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from traffic import Vehicle, wait_until

COEFFICIENTS = ".wide:has(caption:text-matches('^Coefficients of the last'))"
LINKS = ".wide:has(th:text-is('Stray bytes'))"
# What hangs on an element staying in the page: the focus, how far it is moved sideways, where its row stands.
PLACE = """region => [document.activeElement === region, region.scrollLeft,
  Math.round(region.querySelector('tbody tr').getBoundingClientRect().top)]"""
# In large type the table of coefficients is wider than this and is moved sideways; on a phone its rows wrap.
TABLET = {"width": 740, "height": 844}


@pytest.fixture(scope="module")
def ground(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ground]:
    made = Ground(tmp_path_factory.mktemp("live"), free_port(), free_port())
    made.start()
    yield made
    made.stop()


@pytest.fixture
def phone(browser: Browser, ground: Ground, node: NodeReader) -> Iterator[Visitor]:
    made = Visitor(browser, ground.url, node.folder / "node_modules" / "axe-core" / "axe.min.js", "phone")
    yield made
    made.close()


@contextmanager
def flying(ground: Ground, *options: object) -> Iterator[None]:
    """A vehicle that flies in real time; straight on, so that hardly any coefficient becomes known."""
    ground.wait_until_landed()
    command = ("fly", "--vehicle", "iitb-mav", "--seed", 5, "--duration", 600, *options)
    simulator = start("sim-vehicle", [*command, "--out", f"udpout:127.0.0.1:{ground.udp}"])
    with simulator:
        try:
            yield
        finally:
            simulator.kill()
            simulator.communicate(timeout=PATIENCE_S)


def counted(ground: Ground) -> Callable[[], float]:
    """How many seconds of flight went into the estimates since it was called."""
    begun = ground.get("/api/live")["identification"]["time_s"]
    return lambda: float(ground.get("/api/live")["identification"]["time_s"]) - begun


def test_tables_are_read_in_peace(phone: Visitor, ground: Ground) -> None:
    with flying(ground, "--manoeuvre", "cruise"):
        phone.open("#/live")
        phone.wait_for_text(f"{COEFFICIENTS} tbody tr:last-child", "rudder-multisine")
        phone.wait_for_text(LINKS, "receiving")
        phone.wait_for_plots(3)
        for table in (COEFFICIENTS, LINKS):
            assert phone.page.locator(table).evaluate("one => one.scrollWidth <= one.clientWidth"), (
                "wider than the phone"
            )
        phone.check()
        stay_where_they_are(phone, ground)
        phone.page.set_viewport_size(TABLET)
        phone.page.evaluate("document.documentElement.style.fontSize = '28px'")
        phone.page.wait_for_timeout(2000)  # the plots above the tables are laid out anew
        stay_where_they_are(phone, ground)
        assert phone.page.locator(COEFFICIENTS).evaluate("one => one.scrollLeft") == 50


def stay_where_they_are(phone: Visitor, ground: Ground) -> None:
    """Both tables keep the focus and their places over estimates and news of the links."""
    for table in (COEFFICIENTS, LINKS):
        region = phone.page.locator(table)
        region.evaluate("one => one.focus({ preventScroll: true })")
        region.evaluate("one => one.querySelector('tbody tr').scrollIntoView({ behavior: 'instant' })")
        region.evaluate("one => { one.scrollLeft = 50 }")
        focused, *before = region.evaluate(PLACE)
        assert focused
        seconds = counted(ground)
        wait_until(lambda more=seconds: more() > 3.0)  # the links are asked for every 2 s
        focused, *after = region.evaluate(PLACE)
        assert focused
        assert after[0] == before[0]
        if table == COEFFICIENTS:  # the links are the end of the page, which cannot be brought to the top
            assert after[1] == pytest.approx(before[1], abs=2.0)


def tile(phone: Visitor, title: str) -> str:
    """What the tile shows, and what it tells a screen reader instead of a figure."""
    return " ".join(phone.text(f".tile:has(dt:text-matches('^{title},')) dd").split())


def shows_old_figures(phone: Visitor) -> bool:
    """Whether every figure is called old, and the attitude crossed and told as an old one."""
    tiles, attitude = phone.page.locator(".tile"), phone.page.locator(".horizon")
    return (
        tiles.count() == tiles.locator(".mark >> visible=true").count()
        and phone.page.locator(".instruments.stale").count() == 1
        and attitude.locator(".cross").is_visible()
        and (attitude.get_attribute("aria-label") or "").startswith("Old attitude")
    )


def shows_new_figures(phone: Visitor) -> bool:
    return not any(phone.page.locator(f"{one} >> visible=true").count() for one in (".mark", ".stale", ".cross"))


def figures_come(phone: Visitor) -> bool:
    return phone.page.locator(".tile", has_text=re.compile(r"\d\s*$")).count() == phone.page.locator(".tile").count()


def test_figures_of_a_silent_vehicle_are_called_old(phone: Visitor, ground: Ground) -> None:
    with flying(ground, "--manoeuvre", "cruise"):
        phone.open("#/live")
        phone.wait_for_text(".banner", "Live: iitb-mav")
        wait_until(lambda: figures_come(phone))
        assert shows_new_figures(phone)
    phone.wait_for_text(".banner", "No message from the vehicle")
    wait_until(lambda: shows_old_figures(phone))
    phone.check()
    phone.page.reload()
    wait_until(lambda: shows_old_figures(phone))


def test_what_a_helper_reads_at_the_field(phone: Visitor, ground: Ground) -> None:
    with flying(ground, "--manoeuvre", "cruise"):
        phone.open("#/live")
        for words in ("STABILIZE", "ARMED", "3D, 12 sat.", "0 % lost", "on, "):
            phone.wait_for_text(".strip", words)
        phone.wait_for_text(".ground-track figcaption", "m from where it was heard first")
        phone.wait_for_text(".next-what", "multisine")
        # State, attitude, figures and what to fly stand on one screen of a phone.
        bottom = "document.querySelector('.next-what').getBoundingClientRect().bottom"
        assert phone.page.evaluate(bottom) < 844
        phone.page.fill(".note-form input", "rough over the trees")
        phone.page.click("text=Note >> nth=-1")
        phone.wait_for_text(".said", "rough over the trees")
        for theme in ("dark", "sunlight"):
            phone.page.select_option("#theme", theme)
            wait_until(lambda theme=theme: phone.page.evaluate("document.documentElement.dataset.theme") == theme)
            phone.page.evaluate("window.scrollTo(0, 0)")
            phone.check(f"live-{theme}")
        # WCAG 2.2, success criterion 1.4.6: seven to one.
        enhanced = """axe.run(document, {runOnly: ['color-contrast-enhanced']}).then(found => found.violations
          .flatMap(one => one.nodes.map(node => node.html)))"""
        assert phone.page.evaluate(enhanced) == []
    wait_until(
        lambda: "note" in str(ground.get(f"/api/flights/{ground.get('/api/flights')['flights'][0]['id']}")["texts"])
    )


def test_figures_of_a_service_that_stands_still_are_called_old(phone: Visitor, ground: Ground) -> None:
    assert ground.process is not None
    with flying(ground, "--manoeuvre", "cruise"):
        phone.open("#/live")
        phone.wait_for_text(".banner", "Live: iitb-mav")
        wait_until(lambda: figures_come(phone))
        ground.process.send_signal(signal.SIGSTOP)
        try:
            phone.wait_for_text(".banner", "Nothing new has come", timeout_ms=10_000)
            assert shows_old_figures(phone)
        finally:
            ground.process.send_signal(signal.SIGCONT)
        phone.wait_for_text(".banner", "Live: iitb-mav")
        wait_until(lambda: shows_new_figures(phone))


class Telemetry(threading.Thread):
    """Attitude and airspeed from a vehicle, twenty times a second, of which the airspeed can be taken away."""

    def __init__(self, ground: Ground) -> None:
        super().__init__(daemon=True)
        self._address = ("127.0.0.1", ground.udp)
        self.airspeed, self.ending = True, threading.Event()

    def run(self) -> None:
        vehicle = Vehicle()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while not self.ending.wait(0.05):
                sent = [vehicle.heartbeat(), vehicle.system_time(), vehicle.attitude(0.3)]
                if self.airspeed:
                    sent.append(vehicle.frame(mavlink.MAVLink_vfr_hud_message(14.0, 14.0, 0, 0, 90.0, 0.0)))
                for frame in sent:
                    out.sendto(frame, self._address)
                vehicle.boot_ms += 50


def test_a_sensor_that_falls_silent_has_no_figure(phone: Visitor, ground: Ground) -> None:
    ground.wait_until_landed()
    telemetry = Telemetry(ground)
    telemetry.start()
    try:
        phone.open("#/live")
        wait_until(lambda: (tile(phone, "Airspeed"), tile(phone, "Roll")) == ("14.0", "17"))
        telemetry.airspeed = False
        wait_until(lambda: tile(phone, "Airspeed") == "– not known", timeout_s=10.0)
        assert (tile(phone, "Roll"), tile(phone, "α")) == ("17", "– not known")
        assert shows_new_figures(phone)
        phone.check()
        phone.page.reload()
        wait_until(lambda: tile(phone, "Roll") == "17")
        assert tile(phone, "Airspeed") == "– not known"
        telemetry.airspeed = True
        wait_until(lambda: tile(phone, "Airspeed") == "14.0", timeout_s=10.0)
    finally:
        telemetry.ending.set()
        telemetry.join()


# Everything that a screen reader would say by itself, in the order in which it would.
LISTEN = """window.said = []
new MutationObserver(changes => {
  for (const { target } of changes) {
    const region = (target.closest ? target : target.parentElement)?.closest('[role=status], [role=alert], [aria-live]')
    if (region && said.at(-1) !== region.textContent) said.push(region.textContent)
  }
}).observe(document, { childList: true, characterData: true, subtree: true })"""


def test_a_screen_reader_is_told_once(phone: Visitor, ground: Ground) -> None:
    with flying(ground, "--manoeuvre", "multisine", "--set", "sensors.alpha_bias=0.15"):
        wait_until(lambda: ground.get("/api/live")["flight"])
        phone.open("#/live")
        phone.page.evaluate(LISTEN)
        phone.wait_for_text(".remark", "the alpha vane reads")
        figures, times = set(), set()

        def moved() -> bool:
            figures.add(phone.text(".remark:has-text('the alpha vane reads')"))
            times.add(phone.text(".banner"))
            return len(figures) > 2 and len(times) > 4

        wait_until(moved)
        said = phone.page.evaluate("said")
        assert len([words for words in said if "the alpha vane reads" in words]) == 1
        assert len(said) == len(set(said)) <= 4, said
    phone.wait_for_text(".banner", "No message from the vehicle")
    assert "No message from the vehicle" in phone.page.evaluate("said.at(-1)")


# Counts what is drawn in figures within the window, and in those that are scrolled away by more than a margin.
COUNT_STROKES = """() => {
  window.strokes = { seen: 0, away: 0 }
  const { stroke } = CanvasRenderingContext2D.prototype
  CanvasRenderingContext2D.prototype.stroke = function (...path) {
    let node = this.canvas
    while (node.getRootNode() instanceof ShadowRoot) node = node.getRootNode().host
    const box = node.closest('figure')?.getBoundingClientRect()
    if (box) window.strokes[box.bottom > -40 && box.top < innerHeight + 40 ? 'seen' : 'away'] += 1
    return stroke.apply(this, path)
  }
}"""


def test_plots_that_are_scrolled_away_are_not_drawn(phone: Visitor, ground: Ground) -> None:
    with flying(ground, "--manoeuvre", "multisine"):
        phone.open("#/live")
        phone.page.evaluate(COUNT_STROKES)
        coefficient = phone.page.locator(".small.plots canvas")
        wait_until(lambda: coefficient.count() > 0)
        for one in (coefficient, phone.page.locator(".plots:not(.small) canvas")):
            one.first.evaluate("one => one.getRootNode().host.scrollIntoView({ behavior: 'instant', block: 'center' })")
            # The first picture of a coefficient is drawn wherever it stands; some time none becomes known.
            assert wait_until(lambda: draws_what_is_seen(phone, ground))


def draws_what_is_seen(phone: Visitor, ground: Ground) -> bool:
    """Whether over some estimates all that is drawn is on the screen."""
    before, seconds = phone.page.evaluate("strokes"), counted(ground)
    wait_until(lambda: seconds() > 3.0)
    after = phone.page.evaluate("strokes")
    return bool(after["seen"] > before["seen"] and after["away"] == before["away"])


# A device on which each stroke takes 8 ms; what all took, and since when.
SLOW_STROKES = """() => {
  window.spun = { ms: 0, since: performance.now() }
  const { stroke } = CanvasRenderingContext2D.prototype
  CanvasRenderingContext2D.prototype.stroke = function (...path) {
    const begun = performance.now()
    while (performance.now() < begun + 8) { /* the canvas is slow */ }
    window.spun.ms += performance.now() - begun
    return stroke.apply(this, path)
  }
}"""


def test_plots_leave_time_to_a_slow_device(phone: Visitor, ground: Ground) -> None:
    with flying(ground, "--manoeuvre", "cruise"):
        phone.open("#/live")
        phone.wait_for_plots(3)
        plots = phone.page.locator(".plots:not(.small)")
        plots.evaluate("one => one.scrollIntoView({ behavior: 'instant' })")
        phone.page.wait_for_timeout(1000)
        phone.page.evaluate(SLOW_STROKES)
        phone.page.wait_for_timeout(8000)
        share = phone.page.evaluate("spun.ms / (performance.now() - spun.since)")
        assert 0.0 < share < 0.35
