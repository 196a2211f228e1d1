import numpy as np
import pytest

from sysid.errors import SignalError
from sysid.signals.flight import FlightSignals, Signal
from sysid.signals.resampling import resample


def flight(**signals):
    return FlightSignals("f", {name: Signal(t, v, "1", name) for name, (t, v) in signals.items()})


def test_samples_on_the_grid_are_taken_as_they_are():
    rng = np.random.default_rng(0)
    time = 0.02 * np.arange(500) + 0.0005 * rng.uniform(-1, 1, 500)
    noise = rng.standard_normal(500)
    data = resample(flight(q=(time, noise), alpha=(time, -noise)))
    assert data.interval_s == 0.02
    assert data["q"].tolist() == noise.tolist()
    assert data["alpha"].tolist() == (-noise).tolist()


def test_a_slightly_fast_clock_keeps_every_sample():
    time = 0.0201 * np.arange(3000)
    data = resample(flight(q=(time, np.arange(3000.0))))
    assert data.interval_s == pytest.approx(0.0201)
    assert data["q"].tolist() == list(range(3000))


def test_lost_samples_are_bridged_and_gaps_are_nan():
    time = 0.02 * np.arange(200)
    keep = np.ones(200, dtype=bool)
    keep[50] = False
    keep[100:120] = False
    data = resample(flight(q=(time[keep], time[keep]), az=(time[keep], np.ones(keep.sum()))))
    assert data["q"][50] == pytest.approx(1.0)
    assert np.flatnonzero(np.isnan(data["q"])).tolist() == list(range(100, 120))
    assert any("without samples" in warning for warning in data.warnings)


def test_other_stamps_are_interpolated_without_delay():
    time = 0.02 * np.arange(1000)
    other = 0.007 + 0.02 * np.arange(999)
    data = resample(flight(q=(time, 0.0 * time), alpha=(other, np.sin(2 * np.pi * 0.5 * other))))
    inside = slice(2, -3)
    assert data["alpha"][inside] == pytest.approx(np.sin(2 * np.pi * 0.5 * time)[inside], abs=1e-3)


def test_angles_are_unwrapped_before_interpolation():
    time = 0.02 * np.arange(200)
    other = 0.01 + time[:-1]
    heading = 3.0 + other
    wrapped = np.angle(np.exp(1j * heading))
    data = resample(flight(q=(time, 0.0 * time), psi=(other, wrapped)))
    assert data["psi"][1:-2] == pytest.approx((3.0 + time)[1:-2], abs=1e-9)


def test_commands_are_held_whatever_the_jitter():
    rng = np.random.default_rng(1)
    time = 0.02 * np.arange(300)
    command = np.where(time >= 3.0 - 1e-9, 1600.0, 1500.0)
    jittered = time + 0.001 * rng.uniform(-1, 1, 300)
    data = resample(flight(q=(time, 0.0 * time), servo2=(jittered, command), de=(time + 0.012, command)))
    assert data["servo2"].tolist() == command.tolist()
    assert data["de"][151] == 1600.0
    assert data["de"][150] == pytest.approx(1540.0)  # sent 12 ms after sample 150: in force for 8 ms of 20
    assert data["de"][149] == 1500.0


@pytest.mark.parametrize("rate_hz", [10.0, 50.0, 73.0, 400.0])
def test_a_command_counts_from_its_own_stamp(rate_hz: float) -> None:
    rng = np.random.default_rng(2)
    time, fine = 0.02 * np.arange(200), 1e-5 * (np.arange(400_000) + 0.5)
    stamps = np.arange(0.0, 4.0, 1.0 / rate_hz) + 0.2 / rate_hz * rng.uniform(0.0, 1.0, int(4 * rate_hz))
    command = rng.uniform(-0.1, 0.1, stamps.size)
    data = resample(flight(q=(time, 0.0 * time), de=(stamps, command)))
    held = command[np.searchsorted(stamps, fine, side="right").clip(1) - 1]
    assert data["de"][5:-5] == pytest.approx(held.reshape(200, -1).mean(axis=1)[5:-5], abs=2e-4)


def test_gps_stays_on_its_own_samples():
    time = 0.02 * np.arange(500)
    fix = 0.2 * np.arange(50)
    data = resample(flight(q=(time, 0.0 * time), vn=(fix, fix)))
    seen = np.isfinite(data["vn"])
    assert np.count_nonzero(seen) == 50
    assert data["vn"][seen] == pytest.approx(data.time_s[seen])


def test_fast_sources_are_filtered_without_phase_or_alias():
    fast = 0.0025 * np.arange(4000)
    time = 0.02 * np.arange(500)
    slow_part = np.sin(2 * np.pi * 2.0 * fast)
    alias = np.sin(2 * np.pi * 48.0 * fast)  # would appear at 2 Hz when decimated to 50 Hz
    data = resample(flight(ax=(fast, slow_part + alias)), 0.02)
    inside = slice(20, -20)
    assert data.time_s.size == 500
    assert data["ax"][inside] == pytest.approx(np.sin(2 * np.pi * 2.0 * time)[inside], abs=0.01)


def test_repeated_and_backward_stamps_are_left_out_with_a_warning():
    time = 0.02 * np.arange(100)
    broken = time.copy()
    broken[40] = broken[39]
    broken[60] = broken[55]
    data = resample(flight(q=(time, 0.0 * time), alpha=(broken, time)))
    assert any("2 samples with a repeated or backward stamp" in warning for warning in data.warnings)
    assert data["alpha"] == pytest.approx(time, abs=1e-9)


def test_a_slow_imu_sets_a_slower_base():
    time = 0.1 * np.arange(100)
    data = resample(flight(q=(time, time)))
    assert data.interval_s == pytest.approx(0.1)
    assert data["q"].tolist() == time.tolist()
    assert any("10.0 Hz" in warning for warning in data.warnings)


@pytest.mark.parametrize(
    ("signals", "message"),
    [
        ({"q": (np.ones(50), np.arange(50.0))}, "every stamp of q"),
        ({"alpha": (np.arange(50.0), np.arange(50.0))}, "no IMU signal"),
        ({"q": (np.arange(50.0), np.full(50, np.nan))}, "0 finite samples"),
    ],
)
def test_impossible_signals_are_refused(signals, message):
    with pytest.raises(SignalError, match=message):
        resample(flight(**signals))


def test_a_missing_name_is_refused():
    time = 0.02 * np.arange(50)
    with pytest.raises(SignalError, match="no signal alpha"):
        resample(flight(q=(time, time)), names=["q", "alpha"])


def test_a_clock_that_jumps_by_hours_is_no_flight_of_hours() -> None:
    time_s = 0.02 * np.arange(2000)
    time_s[1000:] += 9000.0
    signals = {name: Signal(time_s, np.zeros(2000), "1", "TEST") for name in ("ax", "ay", "az", "p", "q", "r")}
    with pytest.raises(SignalError, match=r"span 9040 s, and its samples fill 40 s .* take a part of the flight"):
        resample(FlightSignals("jump", signals))
