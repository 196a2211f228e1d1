import numpy as np
import pytest

from sysid.errors import SegmentError
from sysid.signals.flight import FlightData
from sysid.signals.segments import airborne_mask, find_segments

DT = 0.02


def flight(seconds, pulses=(), taxi=0.0, surface="de", altitude=False, seed=0):
    """Stand and taxi for `taxi` s at each end, between them 15 m/s; pulses (start, s) of 3 deg and a response."""
    rng = np.random.default_rng(seed)
    time = DT * np.arange(round(seconds / DT))
    n = time.size
    flying = (time >= taxi) & (time <= seconds - taxi)
    airspeed = np.where(flying, 15.0, 1.0)
    roll = (time >= taxi) & (time < taxi + 4.0) if taxi else np.zeros(n, dtype=bool)
    airspeed = np.where(roll, 4.0 * (time - taxi), airspeed) + 0.2 * rng.standard_normal(n)
    rate = {name: 0.002 * rng.standard_normal(n) for name in "pqr"}
    command = np.zeros(n)
    for start, length in pulses:
        command[(time >= start) & (time < start + length)] = np.deg2rad(3.0)
        after = time >= start
        axis = "q" if surface == "de" else "p"
        rate[axis][after] += 0.4 * np.exp(-(time[after] - start)) * np.sin(9.0 * (time[after] - start))
    attitude = {name: 0.01 * np.sin(0.5 * time) for name in ("phi", "theta")}
    columns = rate | attitude | {"airspeed": airspeed, surface: command, "ax": 0.1 * rng.standard_normal(n)}
    if altitude:
        lift_off = taxi + 3.0
        columns["altitude"] = 100.0 + np.clip(time - lift_off, 0.0, 60.0) * np.where(time > seconds - taxi, 0.0, 1.0)
    return FlightData("f", DT, time, columns)


def with_gaps(data, every_s):
    columns = {name: values.copy() for name, values in data.columns.items()}
    for second in np.arange(every_s, data.time_s[-1], every_s):
        columns["q"][(data.time_s >= second) & (data.time_s < second + 0.2)] = np.nan
    return FlightData(data.name, data.interval_s, data.time_s, columns)


def test_a_short_excited_record_is_taken_whole():
    (segment,) = find_segments(flight(10.0, [(1.0, 1.0)]))
    assert (segment.start, segment.stop) == (0, 500)
    assert segment.kind == "longitudinal"


def test_excited_parts_of_a_long_flight_with_trim_before_them():
    segments = find_segments(flight(200.0, [(50.0, 1.0), (52.0, 1.0), (120.0, 1.0)]))
    assert len(segments) == 2
    first, second = segments
    assert 48.0 < first.start_s <= 49.5
    assert 55.0 < first.end_s < 62.0
    assert 118.0 < second.start_s <= 119.5
    assert second.end_s - second.start_s >= 4.0


def test_taxi_and_take_off_roll_are_no_flight():
    data = flight(120.0, [(10.0, 1.0), (60.0, 1.0)], taxi=20.0)
    airborne = data.time_s[airborne_mask(data)]
    assert 24.0 < airborne[0] < 28.0
    assert airborne[-1] < 99.0
    (segment,) = find_segments(data)
    assert 58.0 < segment.start_s < 60.0


def test_slow_flight_over_the_top_of_a_pull_up_is_no_landing():
    data = flight(20.0, [(2.0, 1.0), (12.0, 1.0)])
    slow = 15.0 - 9.5 * np.exp(-(((data.time_s - 10.0) / 2.0) ** 2))
    data.columns["airspeed"][:] = slow
    assert np.sum(slow < 7.5) * DT > 1.5
    (segment,) = find_segments(data)
    assert (segment.start, segment.stop) == (0, data.time_s.size)


def test_altitude_tells_lift_off():
    airborne = airborne_mask(flight(120.0, [(60.0, 1.0)], taxi=20.0, altitude=True))
    assert 24.0 < DT * np.argmax(airborne) < 27.0


def test_kinds():
    (segment,) = find_segments(flight(60.0, [(30.0, 1.0)], surface="da"))
    assert segment.kind == "lateral"
    both = flight(60.0, [(30.0, 1.0)])
    columns = both.columns | {"da": both["de"].copy()}
    (segment,) = find_segments(FlightData("f", DT, both.time_s, columns))
    assert segment.kind == "combined"


def test_gaps_split_a_part():
    data = flight(25.0, [(2.0, 1.0), (20.0, 1.0)])
    data.columns["ax"][600:650] = np.nan
    segments = find_segments(data)
    assert [s.stop <= 600 or s.start >= 650 for s in segments] == [True, True]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (flight(60.0), "no surface moved"),
        (FlightData("f", DT, DT * np.arange(500), {"airspeed": np.full(500, 0.5)}), "never flew"),
        (FlightData("f", DT, DT * np.arange(500), {"q": np.zeros(500)}), "no airspeed and no GPS"),
        (flight(0.6, [(0.3, 0.1)]), "no airborne part of 0.8 s"),
        (with_gaps(flight(20.0, [(1.0, 0.5)]), every_s=3.0), "no airborne part of 4 s"),
    ],
)
def test_nothing_found_is_one_clear_line(data, message):
    with pytest.raises(SegmentError, match=message) as caught:
        find_segments(data)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("seconds", [1.0, 2.0, 3.5])
def test_a_record_that_is_a_window_is_taken_whole(seconds):
    data = flight(seconds, [(0.2, 0.5)])
    (segment,) = find_segments(data)
    assert (segment.start, segment.stop) == (0, data.time_s.size)


def test_a_standing_aircraft_in_the_wind_does_not_fly():
    time = DT * np.arange(1500)
    rng = np.random.default_rng(0)
    columns = {"airspeed": 5.0 + 0.3 * rng.standard_normal(1500), "de": 0.2 * np.sin(time)}
    columns |= {name: np.zeros(1500) for name in ("p", "q", "r", "phi", "theta")}
    with pytest.raises(SegmentError, match="no airborne part"):
        find_segments(FlightData("f", DT, time, columns))


def test_without_excitation_the_airborne_part_can_be_asked_for():
    (segment,) = find_segments(flight(60.0), require_excited=False)
    assert segment.kind == "steady"
    assert segment.end_s - segment.start_s > 59.0
