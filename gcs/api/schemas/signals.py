"""Signals of a flight for plotting, and their spectra."""

from __future__ import annotations

from pydantic import BaseModel, Field


class Series(BaseModel):
    """One signal, decimated: of each stretch the smallest and the largest value are kept. Time in s from the start."""

    unit: str
    source: str
    time: list[float]
    value: list[float | None]


class Spectrum(BaseModel):
    """Power spectral density of one signal, one-sided, by Welch's method: value over frequency in Hz.

    Both are empty where the stretch has too few samples.
    """

    unit: str = Field(description="Of the density")
    signal_unit: str
    frequency: list[float]
    value: list[float]


class SpectraView(BaseModel):
    """Spectra of a flight's signals."""

    flight: str
    signals: dict[str, Spectrum]


class Spectrogram(BaseModel):
    """Power spectral density of one signal over time: a row of `value` for each frequency, in dB; null is no power.

    All are empty where the stretch has too few samples.
    """

    unit: str
    signal_unit: str
    time: list[float] = Field(description="Middles of the columns, s from the start of the flight, at even steps")
    frequency: list[float] = Field(description="Hz, at even steps")
    value: list[list[float | None]]


class SpectrogramsView(BaseModel):
    """Spectrograms of a flight's signals."""

    flight: str
    signals: dict[str, Spectrogram]


class SignalsView(BaseModel):
    """Signals of a flight for plotting."""

    flight: str
    signals: dict[str, Series]
