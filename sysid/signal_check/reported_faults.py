"""Mistakes that are reported and not corrected, since a flight does not show what is wrong.

Where an angle turns by another multiple of what the rate says, or at another time, one of both is wrong, and kinematics
do not show which. Where the specific force along z is another one than carries the aircraft, az has a wrong scale or a
bias.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from sysid.arrays import Array
from sysid.signal_check.fault import Mistake
from sysid.signal_check.kinematic_relations import Columns, Window
from sysid.signal_check.relation_misfit import Misfit
from sysid.signals.sensor_groups import group_name, joined

#: Angles and the rates that turn them.
TURNS = (("phi", "p"), ("theta", "q"), ("psi", "r"))
# Delays that are looked for, s: from the least that is reported, above what filters in sensors and free-running streams
# make, to the longest. The halves of a flight agree to the larger of a time and a share of the delay.
_LEAST_S, _LONGEST_S = 0.04, 0.4
_ALIKE_S, _ALIKE_SHARE = 0.01, 0.25
# What az may lack of the specific force that carries the aircraft, and what the halves may differ in it by, m/s^2:
# biases, and errors of the attitude, make up to 0.7.
_LEAST_FORCE, _FORCE_ALIKE = 0.8, 0.3
# Angles with delays so near to one another are one sentence, s.
_SAME_S = 0.015
# What both sides share of their motion at that delay, as squared correlation, and what it leaves of what they do not
# share without one.
_SHARED, _LEFT = 0.9, 0.5
# What is said of a sensor for all of a flight needs so much of it, s.
_LEAST_FLIGHT_S = 8.0


def uncorrected_mistakes(
    relations: Misfit, windows: Sequence[Window], columns: Sequence[Columns], as_recorded: Collection[str]
) -> list[Mistake]:
    """Gains and delays of angles against rates, and what az lacks.

    relations: the misfit of `columns` in `windows`, halves in turn.
    """
    if sum(one.size * one.interval_s for one in windows) < _LEAST_FLIGHT_S:
        return []
    turns = [one for one in TURNS if one[0] in relations.gains and not {*one} & {*as_recorded}]
    found = [_gain_mistake(*one, relations.gain(one[0])) for one in turns if relations.is_gain(one[0])]
    late = [(*one, delay) for one in turns if (delay := _delay(one[0], windows, columns)) is not None]
    while late:
        same = [one for one in late if abs(one[2] - late[0][2]) < _SAME_S]
        late = [one for one in late if one not in same]
        angles, rates, delays = zip(*same, strict=True)
        found.append(_delay_mistake(angles, rates, float(np.mean(delays))))
    return found if "az" in as_recorded else [*found, *_force_mistake(windows, columns)]


def _gain_mistake(angle: str, rate: str, gain: float) -> Mistake:
    text = (
        f"{angle} turns {gain:.2f} times as far as {rate} says, all flight long: one of them has a wrong scale, and the"
        f" coefficients may be as far off; both are taken as recorded (scale the wrong one in [signals] of the vehicle"
        " file)"
    )
    return Mistake(group_name((angle, rate)), "scale", gain, "", text, (angle, rate))


def _delay_mistake(angles: Sequence[str], rates: Sequence[str], delay_s: float) -> Mistake:
    one = len(angles) == 1
    text = (
        f"{joined(angles)} turn{'s' if one else ''} {abs(delay_s) * 1e3:.0f} ms {'after' if delay_s > 0 else 'before'}"
        f" what {joined(rates)} say{'s' if one else ''}, all flight long: the stamps of one of them are wrong, or it is"
        " filtered. Both are taken as recorded, which coefficients may suffer from (send both with the time of the"
        " measurement)"
    )
    return Mistake(group_name((*angles, *rates)), "delay", delay_s, "s", text, (*angles, *rates))


def _force_mistake(windows: Sequence[Window], columns: Sequence[Columns]) -> list[Mistake]:
    """What az lacks of the specific force that attitude and motion ask for, where both halves of the flight agree."""
    sums = np.zeros((2, 3))
    for i, (window, one) in enumerate(zip(windows, columns, strict=True)):
        missing = window.level(window.states(one))[2]
        sums[i % 2] += window.size * np.array([missing, one["az"].mean() - missing, 1.0])
    missing, asked = (sums[:, :2] / sums[:, 2:]).T
    off = float(missing.mean())
    if np.abs(missing).min() < _LEAST_FORCE or np.ptp(missing) > _FORCE_ALIKE:
        return []
    gain = 1.0 + off / float(asked.mean())
    text = (
        f"az is {abs(off):.1f} m/s^2 {'below' if off * asked.mean() < 0 else 'above'} what attitude and motion ask for,"
        f" all flight long: it reads {gain:.2f} of true, or has such a bias, and lift is as far off. It is taken as"
        " recorded (give its scale or bias in [signals] of the vehicle file)"
    )
    return [Mistake("az", "scale", gain, "", text, ("az",))]


def _delay(angle: str, windows: Sequence[Window], columns: Sequence[Columns]) -> float | None:
    """By how much an angle is later than its integrated rate, s; None for less than is reported, and in doubt."""
    interval_s = windows[0].interval_s
    most = round(_LONGEST_S / interval_s)
    if most < 1:
        return None  # of a log so slow that no such delay would show
    sums = np.zeros((2, 3, 2 * most + 1))
    for i, (window, one) in enumerate(zip(windows, columns, strict=True)):
        if window.size > 4 * most and angle in window.relations:
            states = window.states(one)
            measured = window.fast(window.measured(states, one))[angle]
            sums[i % 2] += _products(measured, measured - window.gaps(states, one)[angle], most)
    both, of_angle, of_rate = sums[:, 0], sums[:, 1], sums[:, 2]
    alike = np.maximum(both, 0.0) ** 2 / np.maximum(of_angle * of_rate, 1e-300)
    best = np.argmax(alike, axis=1)
    if np.any((best == 0) | (best == 2 * most)):
        return None
    halves = np.arange(2)
    before, there, after = (alike[halves, best + step] for step in (-1, 0, 1))
    delays = interval_s * (best - most + 0.5 * (before - after) / np.minimum(before - 2.0 * there + after, -1e-300))
    clear = np.all((there > _SHARED) & (1.0 - there < _LEFT * (1.0 - alike[:, most])))
    near = abs(delays[0] - delays[1]) < max(_ALIKE_S, _ALIKE_SHARE * np.abs(delays).min())
    if not (clear and near and delays[0] * delays[1] > 0.0 and np.abs(delays).min() > _LEAST_S):
        return None
    return float(delays.mean())


def _products(measured: Array, integrated: Array, most: int) -> Array:
    """(3, 2 `most` + 1) products of both, of the first and of the second, that so many samples earlier."""
    inner = measured[most:-most]
    sides = [integrated[most - k : integrated.size - most - k] for k in range(-most, most + 1)]
    return np.array([[inner @ one, inner @ inner, one @ one] for one in sides]).T
