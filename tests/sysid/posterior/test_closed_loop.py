"""How far commands follow what a model leaves: none where they are given, much where an autopilot answers gusts."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from field_flight import FieldFlight, field_flight
from own_bars import own_bar
from simulated import fly_mav

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.identification.identify import Identification, identify
from sysid.numerics.feedback_law import is_feedback_law, law_share
from sysid.posterior.closed_loop import external, feedback_share, most_answered, rests
from sysid.posterior.estimator import Posterior
from sysid.posterior.inputs import InputSignal
from sysid.posterior.observations import common_grid
from sysid.signals.flight import FlightSignals, Signal

GRID = common_grid(0.0, 60.0, 0.02, [], 0.5)


def noise(seed: int) -> np.ndarray:
    """Two residuals, coloured as gusts are."""
    white = np.random.default_rng(seed).standard_normal((2, GRID.points.size))
    for k in range(1, GRID.points.size):
        white[:, k] = 0.95 * white[:, k - 1] + 0.3 * white[:, k]
    return white


def test_given_commands_follow_nothing_and_fed_back_ones_follow_by_their_share() -> None:
    residual = noise(0)
    given = noise(1)[0]
    given *= residual[0].std() / given.std()
    assert feedback_share(InputSignal(GRID.points, given, "joined"), residual, GRID) < 0.12
    late = np.concatenate((np.zeros(5), residual[0, :-5]))  # an autopilot that answers 0.1 s later
    for share in (0.2, 0.5, 0.8):
        command = np.sqrt(1.0 - share) * given + np.sqrt(share) * late
        told = feedback_share(InputSignal(GRID.points, command, "joined"), residual, GRID)
        assert told == pytest.approx(share, abs=0.15)


def test_slopes_keep_what_set_points_did_and_lose_what_noise_did() -> None:
    residual, given = noise(6), noise(7)[0]
    late = np.concatenate((np.zeros(5), residual[0, :-5]))
    slopes = np.stack((np.stack((given, late), axis=1), np.stack((late, given), axis=1)))
    left = external(slopes, residual, GRID)
    inner = GRID.taper == 1.0
    for output, (own, answered) in enumerate(((0, 1), (1, 0))):
        kept = slopes[output, inner, own] - left[output, inner, own]
        assert kept.std() < 0.35 * slopes[output, inner, own].std()  # chance explains a little of anything
        assert left[output, inner, answered].std() < 0.2 * slopes[output, inner, answered].std()


def test_commands_know_nothing_of_gusts_to_come() -> None:
    # White steps half a second ahead: no causal filter of what is left explains them.
    fast = np.random.default_rng(3).standard_normal((2, GRID.points.size))
    early = np.concatenate((fast[0, 25:], np.zeros(25)))
    assert feedback_share(InputSignal(GRID.points, early, "joined"), fast, GRID) < 0.1


@pytest.fixture(scope="module")
def answered(tmp_path_factory: pytest.TempPathFactory) -> tuple[FieldFlight, Identification]:
    """A flight whose autopilot answers every gust, and what is identified of it."""
    flight = field_flight("closed-loop", 1, tmp_path_factory.mktemp("closed-loop"))
    return flight, identify([flight.signals], flight.vehicle, method="map")


@pytest.mark.whole_flight
def test_what_an_autopilot_hides_is_said_and_nothing_is_confidently_wrong(
    answered: tuple[FieldFlight, Identification],
) -> None:
    flight, found = answered
    assert any("autopilot or pilot in the loop" in warning for warning in found.warnings)
    for name in flight.excited:
        entry, (low, high) = found.model.coefficients[name], flight.truth[name]
        if entry.value is not None and entry.std is not None:
            assert max(low - entry.value, entry.value - high) < 4.0 * own_bar(entry), name
    # Where the sideslip that is flown begins, moments at rest take up: no derivative follows it.
    damping = found.model.coefficients["Cl_p"]
    assert damping.value is not None
    assert abs(damping.extra["systematic"]["beta_zero_std"]) < 1e-3 * abs(damping.value)


def test_a_damper_is_a_law_of_the_motion_and_a_test_input_is_none() -> None:
    q, theta = noise(4)
    grid = GRID.points
    assert is_feedback_law(InputSignal(grid, 0.1 * q + 0.4 * theta, "joined").at, grid, [theta, q])
    late = np.concatenate((np.zeros(2), 0.1 * q[:-2]))  # 0.04 s
    assert is_feedback_law(InputSignal(grid, late, "joined").at, grid, [q])
    own = 0.1 * q + 0.4 * theta + 0.3 * noise(5)[0]
    assert not is_feedback_law(InputSignal(grid, own, "joined").at, grid, [theta, q])


def test_a_damper_that_lets_go_for_a_test_input_is_a_law_for_the_rest_of_the_time() -> None:
    r, other = noise(8)
    freed = (GRID.points > 20.0) & (GRID.points < 32.0)
    for doublet in (0.0, 0.5):
        dr = np.where(freed, doublet * np.sign(np.sin(GRID.points)), -0.3 * r)
        command = InputSignal(GRID.points, dr, "held").at
        assert not is_feedback_law(command, GRID.points, [r])
        assert 0.7 < law_share(command, GRID.points, [r]) < 1.0
    assert law_share(InputSignal(GRID.points, other, "held").at, GRID.points, [r]) == 0.0
    assert law_share(InputSignal(GRID.points, np.zeros(GRID.points.size), "held").at, GRID.points, [r]) == 0.0


def test_a_roll_that_follows_its_ailerons_at_once_makes_no_law_of_them() -> None:
    """First order of 0.02 s, behind nothing: the rate is the command but for a hundredth, and comes after it."""
    grid = GRID.points
    da = 0.1 * np.sin(2.0 * np.pi * 0.7 * grid) + 0.05 * np.sin(2.0 * np.pi * 1.3 * grid + 1.0)
    p = np.zeros_like(da)
    for k in range(1, p.size):
        p[k] = p[k - 1] + (4.0 * da[k - 1] - p[k - 1]) * (1.0 - np.exp(-1.0))
    phi = np.cumsum(p) * 0.02
    assert np.corrcoef(da, p)[0, 1] ** 2 > 0.97
    assert not is_feedback_law(InputSignal(grid, da, "joined").at, grid, [phi, p])
    # The same motion as cause.
    assert is_feedback_law(InputSignal(grid, 0.3 * phi + 0.02 * p, "joined").at, grid, [phi, p])


@pytest.mark.whole_flight
def test_pitch_is_told_though_an_autopilot_answers_every_gust(answered: tuple[FieldFlight, Identification]) -> None:
    flight, found = answered
    for name in ("CL_alpha", "Cm_alpha", "Cm_q", "Cm_de"):
        entry, (low, high) = found.model.coefficients[name], flight.truth[name]
        assert entry.value is not None
        assert entry.std is not None
        assert own_bar(entry) < 0.2 * abs(entry.value)
        assert max(low - entry.value, entry.value - high) < 2.5 * own_bar(entry), name
    # What gusts roll the aircraft by is answered by the ailerons: weights that are held at each step made roll half as
    # fast again.
    for name in ("Cl_p", "Cl_da"):
        entry, (low, high) = found.model.coefficients[name], flight.truth[name]
        assert entry.value is not None
        assert max(low - entry.value, entry.value - high) < 2.0 * own_bar(entry), name
    # The rudder did nothing but damp yaw, and is told by how late it does.
    assert any(warning.startswith("rudder: moved by nothing but a law") for warning in found.warnings)
    entry, (low, high) = found.model.coefficients["Cn_dr"], flight.truth["Cn_dr"]
    assert entry.value is not None
    assert entry.std is not None
    assert max(low - entry.value, entry.value - high) < 2.5 * own_bar(entry)
    reported = [name for name in flight.excited if found.model.coefficients[name].value is not None]
    assert len(reported) >= 0.6 * len(flight.excited)


def test_what_is_next_to_nothing_of_the_motion_is_answered_by_no_command() -> None:
    g = np.random.default_rng(4)
    motion = np.sin(2.0 * np.pi * 0.7 * GRID.points)[None, :]
    lacking = 0.01 * motion
    assert most_answered(lacking, motion, GRID) == pytest.approx(25e-4)
    assert most_answered(motion + g.standard_normal(motion.shape), motion, GRID) == 1.0
    command = InputSignal(GRID.points, motion[0], "joined")
    # The command goes with what the structure lacks as with its own answer; by its size it is known to come first.
    assert feedback_share(command, lacking, GRID, most_answered(lacking, motion, GRID)) == 0.0


@pytest.mark.whole_flight
def test_test_inputs_that_come_again_and_again_are_no_closed_loop() -> None:
    signals, _ = fly_mav("multisine,multisine,multisine", 5)
    found = identify([signals], load_vehicle("iitb-mav"), method="map", systematic=False)
    assert not any("autopilot or pilot in the loop" in line for line in found.warnings)
    truth = read_model("iitb-mav").values()
    for name in ("Cm_alpha", "Cm_de", "Cl_p", "Cl_da", "Cn_beta"):
        assert found.model.coefficients[name].value == pytest.approx(truth[name], rel=0.02), name


@pytest.mark.whole_flight
def test_a_part_that_is_too_short_to_see_a_loop_has_no_narrower_bars(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flight = field_flight("closed-loop", 1, tmp_path)
    part = partial(identify, [flight.signals], flight.vehicle, method="map", systematic=False, stop_s=12.0)
    found = part()
    assert any("too short to see whether an autopilot" in one for one in found.warnings)
    monkeypatch.setattr(Posterior, "_unclear", lambda self, at: [])
    alone = part()
    assert found.posterior is not None
    assert alone.posterior is not None
    ratios = np.sqrt(np.diag(found.posterior.joint.covariance) / np.diag(alone.posterior.joint.covariance))
    # Of the angle of attack and sideslip that each group takes from the other, a hundredth.
    assert ratios.min() > 0.98
    assert ratios.max() > 1.3


def test_test_inputs_rest_and_an_answer_to_gusts_does_not() -> None:
    grid = GRID.points
    doublets = 0.05 * np.sign(np.sin(2.0 * np.pi * 0.5 * grid)) * (grid % 10.0 < 4.0)
    assert rests(InputSignal(grid, doublets, "held"), grid)
    assert not rests(InputSignal(grid, 0.02 * noise(8)[0], "joined"), grid)


def test_a_few_samples_and_a_command_at_rest_are_no_law() -> None:
    few, rest = np.arange(4.0), np.full(500, 0.1)
    assert not is_feedback_law(lambda time_s: np.interp(time_s, few, few**2), few, [few, few**3])
    grid = 0.02 * np.arange(500.0)
    assert not is_feedback_law(lambda time_s: np.interp(time_s, grid, rest), grid, [np.sin(grid), np.cos(grid)])


@pytest.mark.whole_flight
def test_ailerons_that_a_hold_alone_moves_tell_no_method_anything_of_roll(tmp_path: Path) -> None:
    # Gusts roll the aircraft and a hold answers: roll damping came out as a tenth of what it is, within 4 % of it.
    flight = field_flight("odd", 2, tmp_path)
    for method in ("auto", "ee"):
        found = identify([flight.signals], flight.vehicle, method=method, systematic=False)
        for name, entry in found.model.coefficients.items():
            if name[:2] in ("CY", "Cl", "Cn"):
                assert entry.value is None, (method, name)
        assert found.model.coefficients["Cl_p"].refused.startswith("aileron did nothing but follow")
        assert found.model.coefficients["Cm_alpha"].value is not None
        assert found.quality.of_axis("Cl") == "poor"
        assert found.quality.of_axis("Cm") != "poor"


def without_vanes(signals: FlightSignals, rate_hz: float) -> FlightSignals:
    """A flight as a board without vanes logs it at one rate."""
    kept = {}
    for name, one in signals.signals.items():
        step = max(1, round(1.0 / (rate_hz * float(np.median(np.diff(one.time_s))))))
        if name not in ("alpha", "beta"):
            kept[name] = Signal(one.time_s[::step], one.values[::step], one.unit, one.source)
    return FlightSignals(signals.name, kept)


@pytest.mark.whole_flight
@pytest.mark.parametrize("rate_hz", [50.0, 10.0])
def test_without_a_vane_nothing_is_said_of_what_an_autopilot_mixes_with_gusts(rate_hz: float) -> None:
    # Its yaw damper lets go for the doublet alone: Cn_dr and Cl_beta came out 7 to 30 bars off, "usable with care".
    vehicle, truth = load_vehicle("iitb-mav"), read_model("iitb-mav").values()
    plan, gusts = "elevator-pulse,aileron-doublet", ("turbulence:sigma=0.7",)
    flight, _ = fly_mav(plan, 511, effects=gusts, duration=30.0)
    found = identify([without_vanes(flight, rate_hz)], vehicle, systematic=False).model.coefficients
    assert "without a vane of the sideslip" in found["Cn_dr"].refused
    assert not [name for name, one in found.items() if one.value is not None and name[:2] in ("CY", "Cl", "Cn")]
    for name in ("CL_alpha", "Cm_alpha"):
        one = found[name]
        assert one.value is not None
        assert abs(one.value - truth[name]) < 4.0 * own_bar(one), name
    # Where nothing but sensors' noise is answered there is nothing to mix with.
    calm, _ = fly_mav(plan, 512, duration=30.0)
    assert identify([without_vanes(calm, 50.0)], vehicle, systematic=False).model.coefficients["Cl_p"].value is not None


@pytest.mark.whole_flight
def test_a_noisy_vane_shows_the_gusts_that_a_yaw_damper_answers() -> None:
    # As a free output the sideslip left the gusts to the side force: Cn_dr came out 4 to 11 bars off in 11 of 12.
    truth = read_model("iitb-mav").values()
    plan = "elevator-3211,aileron-3211,rudder-3211"
    flight, _ = fly_mav(plan, 561, effects=("turbulence:sigma=0.3",), duration=30.0)
    found = identify([flight], load_vehicle("iitb-mav"), systematic=False).model.coefficients
    known = {name: one for name, one in found.items() if one.value is not None and one.std is not None}
    assert {"Cn_dr", "Cn_beta", "Cl_p", "Cl_da"} <= known.keys()
    for name, one in known.items():
        assert one.value is not None
        assert abs(one.value - truth.get(name, 0.0)) < 4.0 * own_bar(one), name


@pytest.mark.whole_flight
def test_a_log_slower_than_the_loop_tells_no_damping_in_pitch() -> None:
    # What the autopilot does between two samples acts as damping: Cm_q came out 11 bars off.
    truth = read_model("iitb-mav").values()
    plan, gusts = "elevator-multisine,aileron-multisine", ("turbulence:sigma=1.0",)
    flight, _ = fly_mav(plan, 564, effects=gusts, duration=30.0)
    found = identify([without_vanes(flight, 10.0)], load_vehicle("iitb-mav"), systematic=False).model.coefficients
    assert "faster than 10 Hz show" in found["Cm_q"].refused
    for name in ("CL_alpha", "Cm_alpha", "Cm_de"):
        one = found[name]
        assert one.value is not None
        assert abs(one.value - truth[name]) < 4.0 * own_bar(one), name
