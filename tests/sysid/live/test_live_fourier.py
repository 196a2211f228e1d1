"""Recursive transforms and rows against what numpy makes of the whole record."""

from __future__ import annotations

import numpy as np

from sysid.live.recursive.recursive_fourier import RecursiveFourier
from sysid.live.signals.row_alignment import TimeBase


def test_the_recursive_transform_is_the_discrete_one_in_whatever_pieces_samples_come() -> None:
    random = np.random.default_rng(1)
    size, dt = 500, 0.02
    samples = random.normal(size=(size, 3))
    lines = np.arange(26)
    fourier = RecursiveFourier(lines / (size * dt), dt, 3)
    for part in np.split(samples, [1, 4, 100, 101, 350]):
        fourier.add(part)
    np.testing.assert_allclose(fourier.values, np.fft.fft(samples, axis=0)[lines], atol=1e-10)


def test_differences_transform_to_the_derivative_with_its_end_terms() -> None:
    """Summed by parts: sum (h[k+1] - h[k]) e^-jwk = (e^jw - 1) H + h[N] e^-jw(N-1) - h[0] e^jw, H over h[0..N-1]."""
    random = np.random.default_rng(2)
    h = np.cumsum(random.normal(size=301))
    lines = np.linspace(0.1, 2.5, 12)
    fourier = RecursiveFourier(lines, 0.02, 2)
    fourier.add(np.column_stack([np.diff(h), h[:-1]]))
    w = 2.0 * np.pi * lines * 0.02
    expected = (np.exp(1j * w) - 1.0) * fourier.values[:, 1] + h[-1] * np.exp(-1j * w * 299) - h[0] * np.exp(1j * w)
    np.testing.assert_allclose(fourier.values[:, 0], expected, atol=1e-9)


def test_rows_survive_lost_late_and_repeated_samples() -> None:
    base = TimeBase(["az", "q", "de"])
    stamps = 0.02 * np.arange(200)
    wave = np.sin(2.0 * stamps)
    kept = np.delete(np.arange(200), [50, *range(120, 140)])  # one sample lost, then a gap of 0.4 s
    found = []
    for k in kept:
        base.add({"az": (stamps[k : k + 1], wave[k : k + 1])})
        if k % 3 == 0:  # the others come in bundles, each sample twice, the second time out of order
            late = slice(max(k - 4, 0), k + 1)
            base.add({"q": (stamps[late], wave[late]), "de": (stamps[late], 1.0 + stamps[late])})
            base.add({"q": (stamps[late], wave[late] + 9.0)})
        found += base.rows()
    assert sum(not rows.continues for rows in found) == 2
    time_s = np.concatenate([rows.time_s for rows in found])
    assert np.all(np.diff(time_s) > 0.0)
    assert np.allclose(np.diff(time_s), 0.02) is False
    assert time_s.size >= 170
    for rows in found:
        np.testing.assert_allclose(rows.columns["az"], np.sin(2.0 * rows.time_s), atol=1e-3)
        np.testing.assert_allclose(rows.columns["q"], np.sin(2.0 * rows.time_s), atol=5e-3)
        np.testing.assert_allclose(np.round((rows.columns["de"] - 1.0) / 0.02) % 1.0, 0.0, atol=1e-6)
