"""Forms are put into vehicle files in a process of its own, ended where it takes long or the service ends."""

import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from patience import PATIENCE_S
from traffic import wait_until

from gcs.errors import BusyError, ServiceError
from gcs.jobs.drafts import Drafts
from gcs.settings import Settings
from gcs.vehicles.document import Answers, BenchAnswer, ControlAnswer, ServoAnswer, with_answers
from sim_vehicle.errors import VehicleFileError
from sim_vehicle.vehicle.vehicle_file import VEHICLES

ANSWERS = Answers(
    "Bixler",
    {"mass_kg": 1.05, "span_m": 1.5, "area_m2": 0.26},
    {"elevator": ControlAnswer((ServoAnswer(2, (1100.0, 1900.0), (-20.0, 22.5)),), guessed_to=0.3)},
    {"accelerometer": (0.1, 0.0, 0.02)},
    {"alpha": BenchAnswer("SERVO", "line", "deg", ((0.0, 1.0), (10.0, 2.0)))},
)
ENDLESS = (sys.executable, "-c", "import time; time.sleep(600)")


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(data=tmp_path)


def test_a_form_comes_to_stand_in_the_text(settings: Settings) -> None:
    text = (VEHICLES / "iitb-mav.toml").read_text(encoding="utf-8")
    made = Drafts(settings).filled(text, ANSWERS)
    assert made == with_answers(text, ANSWERS)
    assert tomllib.loads(made)["name"] == "Bixler"
    assert not list(settings.data.glob("draft-*"))


def test_a_text_that_is_none_is_said_to_be_none(settings: Settings) -> None:
    with pytest.raises(VehicleFileError, match=r"^vehicle file: is not a TOML file: "):
        Drafts(settings).filled("[", ANSWERS)


def test_what_takes_long_is_ended(settings: Settings) -> None:
    with pytest.raises(VehicleFileError, match=r"the vehicle file was not read within 0\.2 s"):
        Drafts(settings, ENDLESS, longest_s=0.2).filled("", ANSWERS)
    assert not list(settings.data.glob("draft-*"))


def test_there_are_two_places_and_stopping_the_service_ends_what_is_worked_on(settings: Settings) -> None:
    drafts = Drafts(settings, ENDLESS, longest_s=PATIENCE_S)
    with ThreadPoolExecutor(2) as pool:
        asked = [pool.submit(drafts.filled, "", ANSWERS) for _ in range(2)]
        wait_until(lambda: len(list(settings.data.glob("draft-*"))) == 2)
        with pytest.raises(BusyError):
            drafts.filled("", ANSWERS)
        drafts.close()
        for one in asked:
            assert isinstance(one.exception(PATIENCE_S), ServiceError)
    assert not list(settings.data.glob("draft-*"))


def test_a_folder_that_takes_nothing_is_named(tmp_path: Path) -> None:
    gone = Settings(data=tmp_path / "gone")
    with pytest.raises(ServiceError, match=r"gone: No such file or directory; a form needs a little room there"):
        Drafts(gone).filled("name = 'x'", ANSWERS)
