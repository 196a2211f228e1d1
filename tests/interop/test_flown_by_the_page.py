"""A flight with the page alone as guide: a pilot flies what the card asks for until it asks for nothing."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from ground import Ground
from own_bars import own_bar
from playwright.sync_api import Browser
from processes import free_port
from traffic import wait_until

from sim_vehicle.flight.arming import Arming
from sim_vehicle.flight.flight_loop import fly
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.sensor_suite import SensorSuite
from sim_vehicle.flight.tick import Tick
from sim_vehicle.manoeuvres.plan import plan_of
from sim_vehicle.manoeuvres.plan_ticks import Schedule
from sim_vehicle.manoeuvres.shapes import manoeuvre
from sim_vehicle.mavlink.fault_options import Faults
from sim_vehicle.mavlink.frame_encoder import Voice
from sim_vehicle.mavlink.outputs import open_link
from sim_vehicle.mavlink.pacing import Pacer
from sim_vehicle.mavlink.timeline import Timeline
from sim_vehicle.mavlink.vehicle_node import Channel, Craft
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle

PACE = 3.0
LONGEST_S = 180.0
# What a pilot takes to read the card and to begin.
READS_S = 2.0
SHAPES = {"multisine": "multisine", "3-2-1-1": "3211", "doublets": "doublet", "steps": "step", "pulse": "pulse"}
SURFACES = {"elevator": "elevator", "ailerons": "aileron", "rudder": "rudder"}
MAIN = (
    *("CL_alpha", "Cm_alpha", "Cm_q", "Cm_de", "CY_beta", "CY_dr"),
    *("Cl_beta", "Cl_p", "Cl_da", "Cn_beta", "Cn_r", "Cn_dr"),
)


def asked_for(text: str) -> list[str]:
    """The manoeuvres that a card's sentence names, as a pilot reads it."""
    if "roller-coaster" in text:
        return ["roller-coaster"]
    found = []
    for shape, surfaces in re.findall(r"(multisine|3-2-1-1|doublets|steps|pulse)[^,]* on the ([a-z, ]+)", text):
        found += [f"{SURFACES[one]}-{SHAPES[shape]}" for one in re.findall(r"elevator|ailerons|rudder", surfaces)]
    assert found, text
    return found


class Pilot:
    """A vehicle that cruises, and flies what it is given."""

    def __init__(self, address: str) -> None:
        self.schedule = Schedule(plan_of(["cruise"]).fitted(LONGEST_S), 0.02)
        self.now_s = 0.0
        self.busy_until_s = 0.0
        self._address = address
        self._over = False
        self._thread = threading.Thread(target=self._fly)
        self._thread.start()

    def give(self, names: list[str]) -> None:
        """Fly manoeuvres, one after another, once the card has been read."""
        begin = self.now_s + READS_S
        for name in names:
            segment = manoeuvre(name)
            self.schedule.lay(segment, begin)
            begin += segment.duration
        self.busy_until_s = begin

    def land(self) -> None:
        self._over = True
        self._thread.join()

    def _fly(self) -> None:
        vehicle, link, pacer = load_vehicle("iitb-mav"), open_link(self._address), Pacer(PACE)
        timeline, generator = Timeline(pacer), np.random.default_rng(5)
        craft = Craft(vehicle, Channel(link, pacer, timeline), Voice(1), Arming(), Faults(), np.random.SeedSequence(5))

        def on_tick(tick: Tick) -> None:
            self.now_s = tick.time_s
            craft(tick)
            if self._over:
                raise KeyboardInterrupt

        plant, suite = Plant(vehicle, read_model("iitb-mav")), SensorSuite(vehicle, generator=generator)
        try:
            fly(plant, plan_of(["cruise"]).fitted(LONGEST_S), suite=suite, generator=generator, on_tick=on_tick,
                schedule=self.schedule)  # fmt: skip
        except KeyboardInterrupt:
            pass
        finally:
            timeline.close()
            link.close()


@contextmanager
def flying(address: str) -> Iterator[Pilot]:
    pilot = Pilot(address)
    try:
        yield pilot
    finally:
        pilot.land()


def test_every_main_coefficient_is_known_after_three_minutes_by_the_card(browser: Browser, tmp_path: Path) -> None:
    ground = Ground(tmp_path, free_port(), free_port())
    ground.start()
    try:
        # Its loops are compiled by the first one who uses them, which takes longer than the flight.
        wait_until(lambda: ground.get("/api/live")["process"]["state"] == "running", 180.0)
        page = browser.new_page()
        page.goto(f"{ground.url}/#/live")
        flown: list[str] = []
        with flying(f"udpout:127.0.0.1:{ground.udp}") as pilot:
            page.wait_for_selector(".card.next:not([hidden]) .next-what", timeout=60_000)
            while pilot.now_s < LONGEST_S - 1.0:
                page.wait_for_timeout(200)
                text = page.inner_text(".card.next .next-what")
                if text.startswith("✓"):
                    break
                if pilot.now_s >= pilot.busy_until_s and not text.startswith("Nothing is known yet"):
                    pilot.give(asked_for(text))
                    flown.append(text)
            estimate = ground.get("/api/live")["identification"]["coefficients"]
            took_s = pilot.now_s
        # Known now, or since it was flown: what rests meanwhile keeps its value, with a bar that grows.
        unknown = [name for name in MAIN if "value" not in estimate[name]]
        assert not unknown, (unknown, flown, took_s)
        # What the model does not have is zero.
        truth = {name: entry.value or 0.0 for name, entry in read_model("iitb-mav").coefficients.items()}
        off = {name: (estimate[name]["value"] - truth.get(name, 0.0)) / own_bar(estimate[name]) for name in MAIN}
        assert max(map(abs, off.values())) < 4.5, (off, flown)
        assert took_s < LONGEST_S, flown
        page.close()
    finally:
        ground.stop()
