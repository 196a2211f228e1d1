"""The page of a result: valid, self-contained, and saying what the file says."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs.cli import main
from gcs.demo.run import REPORT, REPORT_OF_EFFECT, Demo
from gcs.report.page import report

VOID = {"meta", "br", "path", "use"}


class Page(HTMLParser):
    """Elements of a page, its text, and its mistakes."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.data: list[tuple[float, str]] = []
        self.words: list[str] = []
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag == "data":
            self.data.append((float(dict(attrs)["value"] or "nan"), ""))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)
        if "data" in self.open:
            value, shown = self.data[-1]
            self.data[-1] = (value, shown + ("^" if self.open[-1] == "sup" else "") + data)

    @property
    def text(self) -> str:
        return " ".join("".join(self.words).split())


def curves() -> dict[str, Any]:
    time = np.arange(200) * 0.02
    measured = np.sin(time)
    columns = {"time_s": time, "alpha": 0.1 * measured, "measured": measured, "predicted": 0.98 * measured}
    statistics = {"lag_step_s": 0.02, "autocorrelation": [1.0, 0.1, -0.02], "limit": 0.05, "samples": 200}
    histogram = {"low": -1.0, "high": 1.0, "counts": [1, 5, 9, 5, 1]}
    return {
        "use": "validation",
        "flights": [{"flight": "second", "axes": {"CL": {name: list(column) for name, column in columns.items()}}}],
        "residuals": {"CL": {**statistics, "mean": 0.0, "std": 0.3, "histogram": histogram}},
        "outputs": {"q": statistics},
    }


def identification() -> dict[str, Any]:
    """A result with an odd name, a refusal, a small number and nulls."""
    hz = [0.1, 1.0, 10.0]
    return {
        "schema": "identification/1",
        "flights": ["<first> & foremost"],
        "thrust": {"<first> & foremost": "measured"},
        "method": "oe",
        "turbulence": None,
        "sensor_errors": {"alpha_scale": {"value": 0.08123, "std": 0.0213, "unit": "1"}},
        "compatibility": {
            "before": {"alpha": {"rms": 0.0791, "tic": 0.341}},
            "after": {"alpha": {"rms": 0.00551, "tic": 0.0322}},
            "compatible": True,
            "turbulence": 0.0,
            "verdicts": [{"signal": "alpha", "verdict": "alpha reads 1.081 ± 0.021 of true", "status": "corrected"}],
        },
        "mistakes": [{"signal": "theta", "kind": "unit", "sentence": "pitch is in degrees", "found": None}],
        "noise_spectrum": [
            {"flight": "second", "output": name, "unit": unit, "frequency_hz": hz, "density": [0.02, 0.004, 0.001],
             "sensor": sensor}
            for name, unit, sensor in (("q", "rad/s/sqrt(Hz)", 0.0012), ("beta", "rad/sqrt(Hz)", None))
        ],
        "nuisances": [
            {"name": "vane_clock", "group": "both", "value": 0.0402, "std": 0.0011, "prior_std": 0.02, "unit": "s"}
        ],
        "model": {
            "schema": "model/1",
            "name": "mav",
            "coefficients": {
                "CL_0": {"value": 0.17812, "std": 0.00412},
                "CL_alpha": {"value": 2.45321, "std": 0.0312, "systematic": {"mass_1pct": 0.003, "timing_10ms": -0.04}},
                "CL_de": {"value": -0.7391, "std": 0.021, "ci95": [-0.81, -0.70]},
                "CD_k": {"value": 0.4, "std": 0.01},
                "Cm_alpha2": {"value": 1.5e-7, "std": 3e-10},
                "Cl_r": {"refused": "the flight holds no yaw"},
            },
            "effects": [],
            "validity": {"alpha": [-0.05, 0.25], "airspeed": [11.0, 19.0]},
        },
        "modes": [
            {"name": "short period", "eigenvalue": [-1.0, 9.0], "frequency_hz": {"value": 1.44, "std": 0.012},
             "damping_ratio": {"value": 0.227, "std": 0.004}, "time_constant_s": {"value": 0.42, "std": 0.01}},
            {"name": "roll", "eigenvalue": [-20.0, 0.0], "frequency_hz": None, "damping_ratio": None,
             "time_constant_s": {"value": 0.05, "std": 0.001}},
        ],
        "frequency_responses": [
            {"input": "de", "output": "q", "frequency_hz": hz, "gain_db": [1.0, 9.0, -5.0],
             "gain_std_db": [0.1, 0.2, 0.1], "phase_rad": [0.1, None, -1.5], "phase_std_rad": [0.01, None, 0.02]}
        ],
        "validation": {
            "flights": ["second"], "acceptable": False, "limit": 0.25, "reason": "TIC above 0.25: CL 0.31",
            "outputs": {"CL": {"tic": 0.3112, "tic_bias": 0.01, "r2": 0.901, "residual_mean": 1e-4, "white": 0.9,
                               "residual_std": 0.0031, "gaussian_p": None}},
        },
        "series": curves(),
        "refused": [{"name": "Cl_r", "reason": "the flight holds no yaw", "manoeuvre": "rudder doublets"}],
        "segments": [{"flight": "first", "start": 0.0, "end": 20.0, "kind": "combined", "reason": ""}],
        "warnings": ["the mass is doubtful"],
        "made": {"utc": "2026-01-01T00:00:00+00:00", "software": {"gcs": "1.2"}, "settings": {"method": "auto"},
                 "files": [{"name": "first.mcap", "sha256": "ab12"}]},
    }  # fmt: skip


def numbers_of(value: Any) -> Iterator[float]:
    """Every number in a JSON value."""
    if isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            yield from numbers_of(item)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield float(value)


def shown_number(text: str) -> tuple[float, float]:
    """What a reader reads, and half a unit of its last digit."""
    mantissa, _, power = text.replace("−", "-").partition("·10^")
    places = len(mantissa.partition(".")[2])
    scale = 10.0 ** float(power or 0)
    return float(mantissa) * scale, 0.5 * 10.0**-places * scale


def make(folder: Path, result: Any) -> str:
    source, page = folder / "result.json", folder / "report.html"
    source.write_text(json.dumps(result), encoding="utf-8")
    assert main(["report", str(source), "-o", str(page)]) == 0
    return page.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def html(tmp_path_factory: pytest.TempPathFactory) -> str:
    return make(tmp_path_factory.mktemp("report"), identification())


@pytest.fixture(scope="module")
def page(html: str) -> Page:
    return Page(html)


def test_nothing_is_fetched(html: str, page: Page) -> None:
    assert not re.search(r"https?:|//\w|@import", html)
    for tag, attributes in page.elements:
        assert tag not in {"script", "link", "img", "iframe", "object"}
        assert (attributes.get("href") or "#").startswith("#")
        assert all(place.startswith("#") for place in re.findall(r"url\(([^)]*)", str(attributes)))


def test_every_reference_has_its_one_target(html: str, page: Page) -> None:
    names = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(names) == len(set(names))
    wanted = set(re.findall(r"url\(#([^)]+)\)", html)) | set(re.findall(r'(?:href="#|labelledby=")([^"]+)"', html))
    assert wanted <= set(names)


def test_it_can_be_read_without_seeing_it(page: Page) -> None:
    tags = [tag for tag, _ in page.elements]
    attributes = dict(page.elements)
    assert attributes["html"]["lang"] == "en"
    assert (tags.count("h1"), tags.count("title") >= 1) == (1, True)
    assert tags.count("caption") == tags.count("table") > 8
    assert tags.count("figcaption") == tags.count("svg") == tags.count("figure") == 8
    assert all(a["aria-label"] for tag, a in page.elements if tag == "svg")
    assert all(a["scope"] in {"row", "col"} for tag, a in page.elements if tag == "th")


def test_numbers_are_those_of_the_file(page: Page) -> None:
    result = identification()
    of_file = set(numbers_of(result))
    derived = {
        round(entry["value"] + side * 1.96 * entry["std"], 9)
        for entry in [*result["model"]["coefficients"].values(), *result["sensor_errors"].values()]
        if "value" in entry
        for side in (-1.0, 1.0)
    }
    degrees = set(result["model"]["validity"]["alpha"])
    for value, text in page.data:
        assert value in of_file or round(value, 9) in derived
        factor = 180.0 / np.pi if value in degrees else 1e3 if value in {0.0402, 0.0011, 0.02} else 1.0
        read, half = shown_number(text)
        assert read == pytest.approx(value * factor, abs=1.001 * half)
    there = {value for value, _ in page.data}
    for entry in result["model"]["coefficients"].values():
        assert set(numbers_of(entry)) <= there
    assert set(numbers_of(result["compatibility"]["before"])) <= there
    assert {0.3112, 0.901, 1.44, 0.227, 0.0402} <= there


def test_equations_have_their_numbers(page: Page) -> None:
    assert "CL = 0.1781 + 2.453 α − 0.739 δe" in page.text
    assert "CD = 0.400 CL²" in page.text
    assert "Cm = 1.5·10−7 α²" in page.text
    assert "Cl = " not in page.text


@pytest.mark.parametrize(
    "words",
    [
        "<first> & foremost", "output error", "Not acceptable, fly again", "TIC above 0.25: CL 0.31",
        "alpha reads 1.081 ± 0.021 of true", "the flight holds no yaw", "rudder doublets", "pitch is in degrees",
        "the mass is doubtful", "first.mcap", "ab12", "gcs 1.2", "5 estimated, 1 refused",
        "40.2 ± 1.1", "1.440 ± 0.012",
    ],
)  # fmt: skip
def test_it_says(words: str, page: Page) -> None:
    assert words in page.text


def test_warnings_stand_before_what_they_make_doubtful(page: Page) -> None:
    assert page.text.index("the mass is doubtful") < page.text.index("Not acceptable")


def test_an_older_result_without_curves_or_modes_is_a_page_too(tmp_path: Path) -> None:
    result = identification()
    for name in ("series", "frequency_responses", "made", "mistakes"):
        del result[name]
    result |= {"validation": None, "modes": {"refused": "CL_alpha is not known"}}
    text = Page(make(tmp_path, result)).text
    assert "identify the flight again" in text
    assert "Not judged" in text
    assert "CL_alpha is not known" in text


def test_the_spectrum_of_what_is_left_stands_beside_the_sensors_noise_where_that_is_known() -> None:
    result = identification()
    html = report(result)
    assert "Flight second: amplitude spectrum" in html
    assert "q, rad/s/√Hz" in html
    assert "What lies above it is gusts, vibration, or what the model lacks" in html
    for one in result["noise_spectrum"]:
        one["sensor"] = None
    assert "gives no sensor&#x27;s noise" in report(result)
    del result["noise_spectrum"]
    assert "amplitude spectrum" not in report(result)


def test_a_discrepancy_is_a_page_too(tmp_path: Path) -> None:
    gap = {"given": {"q": 0.51}, "before": {"q": 0.42}, "after": {"q": 0.0213}, "noise_floor": {"q": 0.02}}
    effect = {"name": "stall", "title": "stall of the wing", "probability": 0.972,
              "parameters": {"alpha_stall": {"value": 0.2001, "std": 0.0012}},
              "alternatives": [{"name": "ground_effect", "probability": 0.02}],
              "separating_manoeuvre": "slow deceleration"}  # fmt: skip
    result = {
        "schema": "discrepancy/1", "flights": ["one"], "verdict": "missing_effect", "reasons": ["stall: likely"],
        "where": [{"axis": "CL", "variable": "alpha", "share": 0.67, "p_value": 4e-31, "intervals": [{}, {}]},
                  {"axis": "Cm", "variable": "q", "share": 0.9, "p_value": 0.0, "intervals": []}],
        "warnings": ["the mass is doubtful"],
        "effects": [effect], "gap": {"estimation": gap, "validation": None}, "model": identification()["model"],
    }  # fmt: skip
    page = Page(make(tmp_path, result))
    assert {0.2001, 0.0012, 0.972, 0.42, 0.0213, 4e-31} <= {value for value, _ in page.data}
    assert "missing effect" in page.text
    assert "< 10 −300" in " ".join(page.text.split()).replace("10−300", "10 −300")
    assert page.text.index("the mass is doubtful") < page.text.index("stall: likely")
    assert "slow deceleration" in page.text


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "cannot be read: No such file"),
        ("no json", "is not JSON"),
        ("[1, 2]", "names no schema"),
        ('{"schema": "model/1"}', "its schema is 'model/1'"),
        ('{"schema": "identification/1", "flights": []}', "does not hold what schema identification/1 says"),
        ('{"schema": ["identification/1"]}', "no result that a report can be made of"),
    ],
)
def test_what_is_no_result_is_refused_in_one_line(
    content: str | None, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, page = tmp_path / "result.json", tmp_path / "report.html"
    if content is not None:
        source.write_text(content, encoding="utf-8")
    assert main(["report", str(source), "-o", str(page)]) == 1
    said = capsys.readouterr().err
    assert words in said
    assert str(source) in said
    assert said.count("\n") == 1
    assert not page.exists()


def test_a_page_that_cannot_be_written_is_wrong_use(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = tmp_path / "result.json"
    source.write_text(json.dumps(identification()), encoding="utf-8")
    assert main(["report", str(source), "-o", str(tmp_path / "nowhere" / "report.html")]) == 2
    assert "in no existing folder" in capsys.readouterr().err


@pytest.mark.whole_flight
def test_the_demonstration_leaves_a_page_of_each_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = {"schema": "discrepancy/1", "verdict": "none", "model": identification()["model"], "effects": [], "gap": {}}
    Demo(tmp_path, 1.0, 1, "stall")._reports(identification(), found)
    assert "Flight model of" in Page((tmp_path / REPORT).read_text(encoding="utf-8")).text
    assert "What the flight model lacks: none" in Page((tmp_path / REPORT_OF_EFFECT).read_text(encoding="utf-8")).text
    assert str(tmp_path / "report.html") in capsys.readouterr().out


@pytest.mark.whole_flight
def test_a_fit_that_is_acceptable_by_tic_alone_says_so() -> None:
    result = identification()
    result["validation"] |= {"acceptable": True, "outliers": "The largest residuals are: Cl 40 times its noise"}
    text = Page(report(result)).text
    assert "Acceptable by TIC, not down to the noise" in text
    assert "Cl 40 times its noise." in text
    result["validation"]["outliers"] = ""
    assert "Acceptable: TIC above" in Page(report(result)).text


def test_one_page_comes_first_and_the_rest_is_folded_under_its_contents() -> None:
    html = report(identification())
    first, _, rest = html.partition('<nav aria-label="Contents">')
    for title in ("Main derivatives", "To fly next"):
        assert f">{title}</h2>" in first
    assert "<details" not in first
    links = re.findall(r'<li><a href="#([^"]+)">', rest)
    assert "model" in links
    for link in links:  # a link to what a closed section holds opens it
        assert re.search(rf'<details class="more">\n<summary><h2>[^<]*</h2></summary>\n<div id="{link}">', rest), link
