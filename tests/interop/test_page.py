"""The page in Chromium: live while the simulator flies, lost and found, a log taken in, results as REST tells them."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import httpx
import pytest
from browser import Visitor
from ground import Ground, flight_with
from node_reader import NodeReader
from patience import PATIENCE_S
from playwright.sync_api import Browser
from processes import free_port, run, start
from traffic import wait_until

from gcs.catalogue.flight_table import Flight
from gcs.catalogue.store import Catalogue
from gcs.client import Station
from sim_vehicle.cli.main import main as sim_vehicle

FLY = ("fly", "--vehicle", "iitb-mav", "--manoeuvre", "multisine", "--seed", 5)


@pytest.fixture
def flying(ground: Ground) -> Iterator[None]:
    """A vehicle that flies in real time until the test is over."""
    ground.wait_until_landed()
    simulator = start("sim-vehicle", [*FLY, "--duration", 600, "--out", f"udpout:127.0.0.1:{ground.udp}"])
    with simulator:
        try:
            yield
        finally:
            simulator.kill()
            simulator.communicate(timeout=PATIENCE_S)


def test_live_a_lost_connection_and_its_return(visitor: Visitor, ground: Ground, flying: None) -> None:
    visitor.open("#/live")
    visitor.wait_for_text(".banner", "Live: iitb-mav")
    visitor.wait_for_plots(3)
    shown = wait_until(lambda: re.search(r"\d+\.\d", visitor.text(".tile >> nth=0")))
    assert float(shown[0]) == pytest.approx(ground.get("/api/live")["signals"]["airspeed"]["value"], abs=4.0)
    (link,) = ground.get("/api/links")
    assert link["url"] in visitor.text("main")
    visitor.page.wait_for_timeout(15_000 if os.environ.get("PAGE_PICTURES") else 1000)
    visitor.check("live")
    visitor.wait_for_text("main", "coefficients known")
    visitor.wait_for_text("table", "CL_alpha")
    visitor.page.locator("h2:text-is('Coefficients')").evaluate("heading => heading.scrollIntoView()")
    visitor.check("coefficients")
    ground.stop()
    visitor.wait_for_text(".banner", "connection to the ground station is lost")
    visitor.page.evaluate("window.scrollTo(0, 0)")
    visitor.check("lost")
    ground.start()
    visitor.wait_for_text(".banner", "Live: iitb-mav")
    visitor.check()


def test_after_a_landing_the_page_says_so_and_leads_to_what_came_of_it(visitor: Visitor, ground: Ground) -> None:
    ground.wait_until_landed()
    flight = ["fly", "--vehicle", "iitb-mav", "--taxi", "--manoeuvre", "elevator-3211", "--speed", 5]
    done = run("sim-vehicle", *flight, "--out", f"udpout:127.0.0.1:{ground.udp}")
    assert done.returncode == 0, done.stderr
    visitor.open("#/live")
    visitor.wait_for_text(".banner", "Flight over: the vehicle is disarmed")
    visitor.check()
    visitor.page.click("text=See what came of it")
    visitor.wait_for_text("h1", f"Flight {ground.get('/api/flights')['flights'][0]['id']}")
    ground.stop()  # for the next one, who knows of no landing
    ground.start()


def test_a_silent_vehicle_is_told(visitor: Visitor, ground: Ground) -> None:
    visitor.open("#/live")
    wait_until(lambda: ground.get("/api/live")["state"] != "live")
    visitor.wait_for_text(".banner", "links below")
    visitor.check()


def test_a_log_is_taken_in_and_identified(visitor: Visitor, ground: Ground, tmp_path: Path) -> None:
    # A name that would be markup, but not in the pictures of the docs.
    log = tmp_path / ("morning.tlog" if os.environ.get("PAGE_PICTURES") else "a <b>log.tlog")
    done = run("sim-vehicle", "fly", "--manoeuvre", "elevator-3211", "--seed", 6, "--record", log)
    assert done.returncode == 0, done.stderr
    visitor.open("#/flights")
    visitor.check("flights")
    broken = tmp_path / "notes.tlog"
    broken.write_bytes(b"no telemetry" * 100)
    visitor.page.set_input_files("input[type=file]", broken)
    visitor.page.click("button.main")
    visitor.wait_for_text("main", "notes.tlog was not taken:")
    visitor.page.set_input_files("input[type=file]", log)
    visitor.page.click("button.main")
    visitor.wait_for_text("main", f"{log.name} is in the list")
    visitor.page.click("text=open it")
    visitor.wait_for_plots(5)
    assert log.name in visitor.text("h1")
    assert visitor.page.locator("main b").count() == 0
    visitor.check("flight")
    visitor.page.click("summary:text-is('More settings')")
    visitor.page.get_by_label("Method").select_option("ee")
    visitor.page.get_by_label("Signals that are right as recorded").fill("q, az")
    visitor.page.click("button:text-is('Identify')")
    visitor.page.click("a:text-is('See the result')", timeout=PATIENCE_S * 1000)
    visitor.wait_for_plots(4)
    newest = ground.get("/api/models")[0]
    result = ground.get(f"/api/flights/{newest['flight_id']}/identification")
    assert result["made"]["settings"]["as_recorded"] == ["q", "az"]
    # The plots of the page before count as well until the result is there.
    visitor.page.get_by_text(re.compile("for identification|because")).first.wait_for()
    entry = ground.get(f"/api/models/{newest['id']}")["coefficients"]["CL_alpha"]
    told = visitor.text("tr:has(code:text-is('CL_alpha')) td:nth-child(2)").split("\xa0±\xa0")
    assert [float(number) for number in told] == [
        pytest.approx(entry["value"], abs=0.1 * entry["std"]),
        pytest.approx(entry["std"], rel=0.05),
    ]
    visitor.check()
    visitor.open(f"#/flights/{newest['flight_id']}")
    visitor.page.get_by_role("button", name="Run again").click()
    visitor.page.get_by_role("button", name="Cancel").click()
    visitor.wait_for_text("main", "Identification, cancelled")
    visitor.page.once("dialog", lambda dialog: dialog.accept())
    visitor.page.click("button:text-is('Delete this flight')")
    visitor.page.click("summary:text('Deleted in the last day')")
    visitor.check()
    visitor.page.get_by_role("button", name="Take back").first.click()
    visitor.wait_for_text("main", "is in the list again")
    assert ground.get(f"/api/flights/{newest['flight_id']}")["id"] == newest["flight_id"]


def test_a_model_stands_there_with_its_error_bars(visitor: Visitor, ground: Ground) -> None:
    flight = flight_with(ground, "identify")
    visitor.open(f"#/flights/{flight}/model")
    visitor.wait_for_plots(4)
    result = ground.get(f"/api/flights/{flight}/identification")
    assert visitor.page.locator("table:has-text('Coefficients.') tbody tr").count() == len(
        [entry for entry in result["model"]["coefficients"].values() if "value" in entry]
    )
    assert "for identification" in visitor.text(".remark >> nth=0")
    assert result["validation"]["reason"] in visitor.text(".remark >> nth=1")
    with visitor.page.expect_download() as download:
        visitor.page.click("text=Model (JSON)")
    assert '"model/1"' in Path(download.value.path()).read_text(encoding="utf-8").replace(" ", "")
    visitor.check("model")


def test_what_follows_from_a_model_is_shown_for_the_autopilot_that_is_chosen(visitor: Visitor, ground: Ground) -> None:
    flight = flight_with(ground, "identify")
    visitor.open(f"#/flights/{flight}/use")
    visitor.wait_for_plots(1)
    assert "RLL_RATE_FF" in visitor.text("main")
    visitor.page.get_by_label("Autopilot").select_option("px4")
    visitor.page.wait_for_selector("code:text-is('FW_RR_FF')")
    assert "RLL_RATE_FF" not in visitor.text("main")
    assert b"FW_RR_FF" in visitor.downloaded("a:text-is('Parameter file')")
    glide = "tr:has(th:text-is('Speed for best glide'))"
    of_one = float(visitor.text(glide).split()[4])
    visitor.page.get_by_label("Take-off mass, kg").fill("2")
    visitor.page.click("button:text-is('Work it out')")
    visitor.wait_for_text("caption", "With 2.000 kg at 0 m")
    visitor.wait_for_plots(1)
    visitor.page.get_by_label("Battery, Wh").fill("40")
    visitor.page.click("button:text-is('Work it out')")
    visitor.wait_for_text("tr:has(th:text-is('Longest flight'))", "have the board log its voltage and current")
    visitor.wait_for_plots(1)
    # Twice the mass glides as far, faster by the root of two.
    assert float(visitor.text(glide).split()[4]) == pytest.approx(2.0**0.5 * of_one, rel=0.01)
    visitor.check()


def test_a_discrepancy_is_told_in_a_sentence_and_bars(visitor: Visitor, ground: Ground) -> None:
    flight = flight_with(ground, "discrepancy")
    visitor.open(f"#/flights/{flight}/discrepancy")
    visitor.wait_for_plots(4)
    result = ground.get(f"/api/flights/{flight}/discrepancy")
    assert result["sentence"] in visitor.text(".remark")
    assert all(effect["name"] in visitor.text("table >> nth=0") for effect in result["effects"])
    visitor.page.locator("h2:text-is('The gap')").scroll_into_view_if_needed()
    visitor.check("discrepancy")


def test_what_is_to_be_ruled_out_is_looked_up_at_once(visitor: Visitor, ground: Ground) -> None:
    visitor.open(f"#/flights/{flight_with(ground, 'identify')}")
    visitor.page.locator("summary:text-is('More settings')").nth(1).click()
    visitor.page.get_by_label("Ruled out on the ground").fill("cg_shift, mass")
    visitor.page.click("button:text-is('Question')")
    visitor.wait_for_text("form .remark", "unknown effect 'mass'")
    visitor.check()


def test_two_models_and_two_flights_are_compared(visitor: Visitor, ground: Ground) -> None:
    visitor.open("#/compare")
    visitor.wait_for_text("table", "CL_alpha")
    visitor.wait_for_plots(1)
    visitor.check()
    models = [
        [m["id"] for m in ground.get("/api/models") if m["kind"] == kind][-1] for kind in ("identify", "discrepancy")
    ]
    visitor.open("#/compare?ma={}&mb={}".format(*models))
    visitor.wait_for_text("table", "CL_alpha")
    visitor.wait_for_plots(1)
    visitor.check("compare")


def test_a_flight_older_than_the_list_is_found(data: Path, browser: Browser, node: NodeReader, tmp_path: Path) -> None:
    with closing(Catalogue(tmp_path / "catalogue.sqlite")) as catalogue:
        for number in range(120):
            start = (1_600_000_000 + 86_400 * number) * 10**9
            name = f"calm morning {number}.tlog"
            catalogue.put_flight(
                Flight(f"f{number}", "gone.mcap", name, "upload", "complete", 1, start, start, 9, 9, vehicle_s=9.0)
            )
    ground = Ground(tmp_path, free_port(), free_port())
    ground.start()
    visitor = Visitor(browser, ground.url, node.folder / "node_modules" / "axe-core" / "axe.min.js", "phone")
    try:
        recording = min((data / "flights").glob("*.mcap"))
        address = f"{ground.url}/api/flights?name={recording.name}"
        flight = httpx.post(address, content=recording.read_bytes(), timeout=PATIENCE_S).raise_for_status().json()["id"]
        visitor.open("#/flights")
        visitor.page.fill("input[type=search]", "2020-09-14")  # the second of 120
        visitor.wait_for_text("tbody tr:only-child", "calm morning 1.tlog")
        visitor.page.fill("input[type=search]", "")
        visitor.page.get_by_text("By aircraft and day").click()
        visitor.page.get_by_label("From day (UTC)").fill("2020-09-20")
        visitor.page.get_by_label("To day (UTC)").fill("2020-09-22")
        visitor.page.get_by_label("To day (UTC)").blur()
        wait_until(lambda: visitor.page.locator("tbody tr").count() == 3)
        assert "since=2020-09-20&until=2020-09-22" in visitor.page.evaluate("location.hash")
        visitor.page.get_by_label("From day (UTC)").fill("2021-09-20")
        visitor.page.get_by_label("From day (UTC)").blur()
        visitor.wait_for_text("main", "No flight fits what is asked for above")
        visitor.check()
        visitor.open(f"#/flights/{flight}")
        form = visitor.page.locator("form:has(h3:text-is('Identify the model'))")
        find, judges = form.locator("input[type=search]"), form.locator("fieldset")
        find.fill("calm 3.tlog")
        judges.locator("label:text-is('calm morning 3.tlog')").check()
        find.fill("morning 7.tlog")
        judges.locator("label:text-is('calm morning 7.tlog')").wait_for()
        assert judges.locator("input:checked").evaluate_all("boxes => boxes.map(box => box.value)") == ["f3"]
        visitor.check()
        visitor.open(f"#/compare?fa={flight}&fb=f5")
        assert visitor.page.locator("main select").last.input_value() == "f5"
        visitor.page.fill("input[type=search]", "2020-09-21")
        options = visitor.page.locator("main select").last.locator("option", has_text="calm morning 8.tlog")
        options.wait_for(state="attached")
        assert visitor.page.locator("main select").last.input_value() == "f5"
        visitor.check()
    finally:
        visitor.close()
        ground.stop()


def test_the_keyboard_reaches_the_views_and_the_focus_follows(visitor: Visitor) -> None:
    visitor.open("#/live")
    assert visitor.page.evaluate("document.activeElement.tagName") == "H1"
    visitor.page.focus("a[href='#/flights']")
    visitor.page.keyboard.press("Enter")
    visitor.wait_for_text("h1", "Flights")
    wait_until(lambda: visitor.page.evaluate("document.activeElement.textContent") == "Flights")
    assert visitor.page.title() == "Flights – Ground station"
    assert visitor.text("nav [aria-current]") == "Flights"


def test_a_shared_link_shows_its_flight_to_somebody_without_a_token(
    browser: Browser, node: NodeReader, tmp_path: Path
) -> None:
    guarded = Ground(tmp_path, free_port(), free_port(), token="token-of-the-browser-test")
    log = tmp_path / "club.tlog"
    sim_vehicle(["fly", "--manoeuvre", "elevator-pulse", "--duration", "5", "--record", str(log)])
    guarded.start()
    axe = node.folder / "node_modules" / "axe-core" / "axe.min.js"
    owner, guest = (Visitor(browser, guarded.url, axe, "phone") for _ in range(2))
    try:
        with Station(guarded.url, token=guarded.token) as station:
            flight = station.upload(log).id
        owner.open(f"#/flights/{flight}")
        owner.page.fill("input[type=password]", guarded.token)
        owner.page.click("button:text-is('Open')")
        owner.page.click("summary:text-is('Share this flight')")
        owner.page.click("button:text-is('Make a link')")
        owner.wait_for_text("[role=status]", "sees this flight alone")
        address = owner.page.input_value("[role=status] input")
        guest.open(address.removeprefix(guarded.url).lstrip("/"))
        guest.wait_for_text("main", "No model has been identified from this flight yet")
        guest.check("shared")
        assert guest.downloaded("a:text-is('Download the recording')").startswith(b"\x89MCAP")
        guest.open("#/flights")
        assert "shared link" in guest.text("main") or guest.text("h1") == "Token needed"
        owner.wait_for_text("details ul", "Link by")
        owner.check("sharing")
        owner.page.click("details li button:text-is('End')")
        owner.page.wait_for_selector("details li", state="detached")
        guest.open(address.removeprefix(guarded.url).lstrip("/"))
        guest.wait_for_text("h1", "This link shows nothing any more")
        guest.check("link that has ended")
    finally:
        owner.close()
        guest.close()
        guarded.stop()


def test_a_token_is_asked_for_and_kept(browser: Browser, node: NodeReader, tmp_path: Path) -> None:
    guarded = Ground(tmp_path, free_port(), free_port(), token="token-of-the-browser-test")
    guarded.start()
    visitor = Visitor(browser, guarded.url, node.folder / "node_modules" / "axe-core" / "axe.min.js", "phone")
    try:
        visitor.open("#/flights")
        assert visitor.text("h1") == "Token needed"
        visitor.check("token")
        visitor.page.fill("input[type=password]", "not the right token")
        visitor.page.click("button:text-is('Open')")
        visitor.wait_for_text("[role=alert]", "did not accept")
        visitor.page.fill("input[type=password]", guarded.token)
        visitor.page.click("button:text-is('Open')")
        visitor.wait_for_text("main", "There is no flight yet")
        visitor.check()
        visitor.open("#/live")
        visitor.wait_for_text(".banner", "Waiting for the first message")
        visitor.check()
    finally:
        visitor.close()
        guarded.stop()
