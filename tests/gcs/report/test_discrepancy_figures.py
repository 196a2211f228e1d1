"""The figures of a discrepancy's result hold the curves of the result."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from gcs.cli import main
from gcs.report import discrepancy_figures
from gcs.report.discrepancy import gaps
from gcs.report.svg import element, save

pytestmark = pytest.mark.whole_flight


def flight(name: str) -> dict[str, Any]:
    """Two windows of four samples and a break; five outputs, of which `ax` does not change and q is lost before."""
    time = [0.0, 0.1, 0.2, 0.3, None, 5.0, 5.1, 5.2, 5.3, None]
    outputs = {}
    for k, output in enumerate(("alpha", "q", "theta", "V", "ax")):
        columns = {"measured": 1.0, "before": 1.5 + 0.1 * k, "after": 1.02}
        outputs[output] = {
            key: [None if t is None else round(factor * math.sin(t + k), 4) for t in time]
            for key, factor in columns.items()
        }
    outputs["q"]["before"][3] = 1e9
    return {"flight": name, "time_s": time, "outputs": outputs}


def gap() -> dict[str, dict[str, float]]:
    floor = {"alpha": 0.01, "q": 0.02, "theta": 0.03, "V": 0.1, "ax": 0.2}
    times = {
        "given": (9.0, 9.0, 9.0, 9.0, 1.0),
        "before": (5.0, 4.0, 6.0, 3.0, 1.0),
        "after": (1.1, 1.0, 1.2, 1.0, 1.0),
    }
    stages = {
        stage: {name: factor * floor[name] for name, factor in zip(floor, factors, strict=True)}
        for stage, factors in times.items()
    }
    return {**stages, "noise_floor": floor}


CURVE = [{"value": 0.05 * i, "residual": 0.01 * i**2, "std": 0.002 + 0.001 * i} for i in range(8)]


def result() -> dict[str, Any]:
    return {
        "schema": "discrepancy/1", "sentence": "Above 14.0° the <wing> stalls.", "flights": ["one"],
        "verdict": "missing_effect", "reasons": ["stall: likely"],
        "where": [{"axis": "CL", "variable": "alpha", "share": 0.67, "p_value": 4e-31, "curve": CURVE}],
        "effects": [], "gap": {"estimation": gap(), "validation": gap()},
        "series": {"estimation": [flight("one")], "validation": [flight("two")]},
        "model": {"schema": "model/1", "name": "mav", "coefficients": {"CL_0": {"value": 0.2, "std": 0.01}}},
    }  # fmt: skip


def lines(plot: Any) -> dict[str, np.ndarray[Any, np.dtype[np.float64]]]:
    return {line.get_label(): np.asarray(line.get_ydata(), dtype=np.float64) for line in plot.get_lines()}


def test_the_simulations_stand_over_the_measurement() -> None:
    made, one = Figure(), flight("one")
    discrepancy_figures.draw_simulations(made, one, ["q", "V"], ["before", "after"])
    rate, speed = made.axes
    assert set(lines(rate)) == {"measured", "fitted again", "effect added"}
    for plot, name, factor in ((rate, "q", 180.0 / math.pi), (speed, "V", 1.0)):
        for label, key in (("measured", "measured"), ("fitted again", "before"), ("effect added", "after")):
            wanted = factor * np.array(one["outputs"][name][key], dtype=np.float64)
            assert lines(plot)[label] == pytest.approx(wanted, nan_ok=True)
    assert rate.get_ylabel() == "q, deg/s"
    # A simulation that runs away does not flatten the others.
    assert max(np.abs(rate.get_ylim())) < 2.5 * np.nanmax(np.abs(lines(rate)["measured"]))
    [legend] = made.legends
    assert [entry.get_text() for entry in legend.get_texts()] == ["measured", "fitted again", "effect added"]


def test_the_residual_stands_over_its_variable_with_its_band() -> None:
    made = Figure()
    discrepancy_figures.draw_curves(made, result()["where"])
    [plot] = made.axes
    curve = plot.get_lines()[0]
    assert np.asarray(curve.get_xdata()) == pytest.approx(np.degrees([one["value"] for one in CURVE]))
    assert np.asarray(curve.get_ydata()) == pytest.approx([one["residual"] for one in CURVE])
    band = plot.collections[0].get_paths()[0].get_extents()
    assert band.y1 == pytest.approx(CURVE[-1]["residual"] + 1.96 * CURVE[-1]["std"])
    assert band.y0 == pytest.approx(-1.96 * CURVE[0]["std"])
    assert plot.get_xlabel() == "α, deg"


@pytest.mark.parametrize("largest", [0.0106, 0.01, 0.00052, 0.0043, 1.0])
def test_ticks_of_small_rates_do_not_run_into_each_other(largest: float) -> None:
    (place, *_) = result()["where"]
    steps = np.linspace(-largest, largest, 8)
    curve = [{"value": value, "residual": 0.1 * value, "std": 0.01} for value in steps.tolist()]
    places = [{**place, "variable": "phat", "curve": curve}] * 3
    made = Figure(figsize=(7.5, 2.4), layout="constrained")
    with mpl.rc_context({"font.size": 8.0}):
        discrepancy_figures.draw_curves(made, places)
        made.draw_without_rendering()
        labels = [label for label in made.axes[2].get_xticklabels() if label.get_text()]
        low, high = made.axes[2].get_xlim()
        boxes = [label.get_window_extent() for label in labels if low <= label.get_position()[0] <= high]
    assert len(boxes) >= 3
    assert all(right.x0 - left.x1 > 3.0 for left, right in pairwise(boxes))


def test_bars_are_gaps_in_times_of_the_floor() -> None:
    plot = Figure().subplots()
    discrepancy_figures.draw_bars(plot, gap())
    heights = {group.get_label(): [bar.get_height() for bar in group] for group in plot.containers}
    assert list(heights) == ["as given", "fitted again", "effect added"]
    assert heights["fitted again"] == pytest.approx([5.0, 4.0, 6.0, 3.0, 1.0])
    assert heights["effect added"] == pytest.approx([1.1, 1.0, 1.2, 1.0, 1.0])
    assert plot.get_yscale() == "linear"
    wide = gap()
    wide["given"]["alpha"] = 3.0
    plot = Figure().subplots()
    discrepancy_figures.draw_bars(plot, wide)
    assert plot.get_yscale() == "log"


def test_without_an_effect_no_bar_says_that_one_was_added() -> None:
    found = {**result(), "verdict": "none"}
    assert set(discrepancy_figures.shown_gaps(found)["validation"]) == {"given", "before", "noise_floor"}
    for told in ("".join(gaps(found)), "".join(element(one) for one in discrepancy_figures.gap_bars(found))):
        assert "fitted again" in told
        assert "effect added" not in told
    assert "effect added" in gaps(result())[0]


def test_the_page_has_the_sentence_and_a_figure_of_each(tmp_path: Path) -> None:
    source, page = tmp_path / "result.json", tmp_path / "report.html"
    source.write_text(json.dumps(result()), encoding="utf-8")
    assert main(["report", str(source), "-o", str(page)]) == 0
    html = page.read_text(encoding="utf-8")
    assert html.index("Above 14.0° the &lt;wing&gt; stalls.") < html.index("Reasons")
    captions = [part.partition("</figcaption>")[0] for part in html.split("<figcaption>")[1:]]
    assert [caption for caption in captions if caption.startswith("Residual coefficients")]
    assert sum(caption.startswith("Gap on the flights") for caption in captions) == 2
    drawn = [caption for caption in captions if "free-running simulations" in caption]
    assert [caption.partition(":")[0] for caption in drawn] == [
        "Flight one, used for the fit", "Flight two, not used for the fit",
    ]  # fmt: skip
    assert "the model fitted again and the model with the effect" in drawn[0]
    # theta's gap shrinks most, then alpha's, q's and V's; that of ax stays, and there is room for four.
    picture = html.partition('id="gap-estimation0')[2].partition("</figure>")[0]
    assert [label for label in ("θ, deg", "α, deg", "q, deg/s", "V, m/s", "ax, m/s²") if label in picture] == [
        "θ, deg", "α, deg", "q, deg/s", "V, m/s",
    ]  # fmt: skip
    assert picture.index("θ, deg") < picture.index("α, deg") < picture.index("q, deg/s") < picture.index("V, m/s")


@pytest.mark.parametrize(
    ("verdict", "model"),
    [("missing_effect", "the model fitted again"), ("unexplained", "the model fitted again"),
     ("parameter_error", "the model as given")],
)  # fmt: skip
def test_the_residual_says_against_which_model_it_is(verdict: str, model: str) -> None:
    [figure] = discrepancy_figures.residual_curves({**result(), "verdict": verdict})
    assert f"measured minus {model}, over" in figure.caption


def test_a_figure_is_saved_as_a_picture_on_white(tmp_path: Path) -> None:
    save(tmp_path / "bars.png", (4.0, 2.0), lambda made: discrepancy_figures.draw_bars(made.subplots(), gap()))
    picture = imread(tmp_path / "bars.png")
    height, width, _ = picture.shape
    assert width == 2 * height > 200
    assert picture[0, 0] == pytest.approx([1.0, 1.0, 1.0, 1.0])
    assert picture.std() > 0.05
