"""Controls: from servo pulse widths to deflections, and back."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim_vehicle.model.aerodynamic_terms import may_name_control
from sim_vehicle.physics.layout import MOST_CONTROLS
from sim_vehicle.vehicle.second_sensors import SECOND_SENSORS
from sim_vehicle.vehicle.strict_toml import NOT_SAID, Known, Table

Array = NDArray[np.float64]

CONTROL_NAMES = ("elevator", "aileron", "rudder", "throttle")
# Signals of these; a control of another name is a signal of that name.
DEFLECTION_SIGNALS = {"elevator": "de", "aileron": "da", "rudder": "dr", "throttle": "throttle"}
# A linkage that a protractor was held to is known better than this, 1 sigma: its travel was guessed.
GUESSED_TRAVEL_STD = 0.2
LARGEST_PWM_US = 65534.0  # 65535 is MAVLink's "not used"

# What several motors turn an aircraft by, as inputs: coefficients of roll, pitch and yaw.
MOTOR_MOMENTS = ("motor_roll", "motor_pitch", "motor_yaw")

# As alike as this a name is taken for a slip of one of the four.
_MISSPELT = 0.85
# What no control may be named as: signals, and parts and constants of exported aircraft.
_OTHER_SIGNALS = frozenset(
    (
        *[
            "V",
            "airspeed",
            "true_airspeed",
            "phi",
            "theta",
            "psi",
            "ax",
            "ay",
            "az",
            "pdot",
            "qdot",
            "rdot",
            "thrust",
            "rpm",
            "torque",
            "motor_thrust",
        ],
        *[
            "altitude",
            "height",
            "north",
            "east",
            "down",
            "vn",
            "ve",
            "vd",
            "time",
            "lat",
            "lon",
            "gps_altitude",
            "gps_east",
            "gps_north",
            "wind",
            "start",
        ],
        *["differential_pressure", "static_pressure", "temperature", "air_density", "voltage", "current"],
        *["propeller", "mass", "Ixx", "Iyy", "Izz", "Ixz", "S", "b", "c", "gravity", "max_thrust", "max_step"],
        *MOTOR_MOMENTS,
        *SECOND_SENSORS,
    )
)
_SERVO = re.compile(r"^(servo|adc)\d+$")

#: Ports of a board and the outputs of each. A servo's number counts through them: AUX 1 is 17.
PORTS, OUTPUTS = ("MAIN", "AUX", "UAVCAN"), 16


@dataclass(frozen=True)
class Control:
    """One control and the servos that move it; its deflection is the sum of mix_i times servo i's deflection.

    Without servos the log holds the deflection itself.

    name: elevator, aileron, rudder, throttle, or one of its own, as flap.
    signal: what SERVO_OUTPUT_RAW carries, "command" sent or measured "position".
    servos: output numbers, from 1, through the ports (`output_name`). mix: one weight for each servo.
    pwm: us, one strictly increasing tuple for each servo.
    deflection: rad (throttle: 0 to 1) at those pulse widths, strictly monotone.
    gain_std, bias_std: how well the linkage is known, 1 sigma: share of the deflection, and rad.
    delay, lag, backlash: of the servo and its linkage, s, s, and rad (half of the play), with their standard
    deviations; None where nothing is known of them.
    """

    name: str
    signal: str
    servos: tuple[int, ...]
    mix: tuple[float, ...]
    pwm: tuple[tuple[float, ...], ...]
    deflection: tuple[tuple[float, ...], ...]
    gain_std: float = 0.0
    bias_std: float = 0.0
    delay: Known = NOT_SAID
    lag: Known = NOT_SAID
    backlash: Known = NOT_SAID

    @property
    def microsecond(self) -> float:
        """Deflection, rad or 0 to 1, that a microsecond of pulse width is, where it is most."""
        return max(self.microseconds, default=np.inf)

    @property
    def microseconds(self) -> tuple[float, ...]:
        """The same of each servo by itself."""
        return tuple(
            abs(weight) * float(np.max(np.abs(np.diff(ys) / np.diff(xs))))
            for weight, xs, ys in zip(self.mix, self.pwm, self.deflection, strict=True)
        )

    def deflection_from_pwm(self, *pwm: ArrayLike) -> Array:
        """Deflection, rad or 0 to 1, from one array of pulse widths (us) for each servo in order.

        Linear between the points; a pulse width beyond the first or last point gives that point's deflection,
        as a linkage at its stop does. NaN stays NaN. Arrays broadcast; the result has their common shape.
        """
        if len(pwm) != len(self.servos):
            raise ValueError(f"{self.name} has {len(self.servos)} servos, {len(pwm)} arrays given")
        if not self.servos:
            raise ValueError(f"{self.name} has no servos")
        parts = [
            weight * np.interp(np.asarray(us, dtype=np.float64), xs, ys)
            for weight, us, xs, ys in zip(self.mix, pwm, self.pwm, self.deflection, strict=True)
        ]
        return np.asarray(sum(parts[1:], parts[0]), dtype=np.float64)

    def is_outside(self, *pwm: ArrayLike) -> NDArray[np.bool_]:
        """Where any servo's pulse width (us) lies beyond its points, so that the deflection is held."""
        masks = [(np.asarray(us) < xs[0]) | (np.asarray(us) > xs[-1]) for us, xs in zip(pwm, self.pwm, strict=True)]
        return np.asarray(np.logical_or.reduce(masks))

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest deflection within every servo's points, rad (throttle: 0 to 1)."""
        if not self.servos:
            return (0.0, 1.0) if self.name == "throttle" else (-np.inf, np.inf)
        low = sum(min(w * ys[0], w * ys[-1]) for w, ys in zip(self.mix, self.deflection, strict=True))
        high = sum(max(w * ys[0], w * ys[-1]) for w, ys in zip(self.mix, self.deflection, strict=True))
        return low, high


def _pwm_at(deflection: float, xs: Sequence[float], ys: Sequence[float]) -> float:
    if ys[0] > ys[-1]:
        xs, ys = xs[::-1], ys[::-1]
    return float(np.interp(deflection, ys, xs))


def mixing_matrix(controls: Mapping[str, Control]) -> tuple[tuple[int, ...], Array]:
    """Servo numbers and the matrix from the controls' deflections to the servos' own.

    It is the pseudo-inverse of the mixes, so that the servos together give just the deflections asked for.

    Parameters
    ----------
    controls : Mapping[str, Control], length m
        Control name -> its servos and their mix.

    Returns
    -------
    servos : tuple[int, ...], length n
        Servo numbers, ascending.
    matrix : Array, shape (n, m)
        Deflections of the servos per deflection of each control, dimensionless.
    """
    servos = tuple(sorted({servo for control in controls.values() for servo in control.servos}))
    mixes = np.zeros((len(controls), len(servos)))
    for row, control in enumerate(controls.values()):
        for servo, weight in zip(control.servos, control.mix, strict=True):
            mixes[row, servos.index(servo)] = weight
    return servos, np.asarray(np.linalg.pinv(mixes), dtype=np.float64)


def servo_pwm(controls: Mapping[str, Control], deflections: Mapping[str, float]) -> dict[int, float]:
    """Pulse width in us of every servo for the deflections of all controls, one absent counting as zero."""
    servos, inverse = mixing_matrix(controls)
    curves = {
        servo: (xs, ys)
        for control in controls.values()
        for servo, xs, ys in zip(control.servos, control.pwm, control.deflection, strict=True)
    }
    travel = inverse @ np.array([deflections.get(name, 0.0) for name in controls])
    return {servo: _pwm_at(float(value), *curves[servo]) for servo, value in zip(servos, travel, strict=True)}


def output_name(servo: int) -> str:
    """An output's number as boards print it: 3, or AUX 1 for the first of the second port."""
    port, place = divmod(servo - 1, OUTPUTS)
    return f"{PORTS[port]} {place + 1}" if port else str(servo)


def read_controls(table: Table, warnings: list[str]) -> dict[str, Control]:
    """Every control of the table [controls]; doubts are appended to `warnings`, what is impossible raises."""
    names = [*(name for name in CONTROL_NAMES if name in table), *(name for name in table if name not in CONTROL_NAMES)]
    for name in names:
        _check_name(table, name)
    if sum(name not in CONTROL_NAMES for name in names) > MOST_CONTROLS:
        raise table.error(names[-1], f"is one too many: {MOST_CONTROLS} controls of own names are flown")
    controls = {name: _read_control(table.table(name), name, warnings) for name in names}
    table.close()
    warnings += _guessed_travel(controls)
    _check_shared(table, {name: control for name, control in controls.items() if control.servos})
    return controls


def signal_of(control: str) -> str:
    """The signal that is the deflection of a control of that name."""
    return DEFLECTION_SIGNALS.get(control, control)


def control_of(signal: str) -> str:
    """The name of the control whose deflection a signal is."""
    return next((name for name, one in DEFLECTION_SIGNALS.items() if one == signal), signal)


def _check_name(table: Table, name: str) -> None:
    if name in CONTROL_NAMES:
        return
    if near := difflib.get_close_matches(name.casefold(), CONTROL_NAMES, 1, _MISSPELT):
        raise table.error(name, f"is spelt nearly as {near[0]}: is that meant? Else give it another name")
    if not may_name_control(name) or name in _OTHER_SIGNALS or _SERVO.match(name):
        raise table.error(
            name, "is no name for a control: letters, digits and _, and neither a signal nor begun as a coefficient's"
            " regressor (alpha, p, q, de, ...), as flap, spoiler or left_motor"
        )  # fmt: skip


def _guessed_travel(controls: Mapping[str, Control]) -> list[str]:
    """One line of each size of doubt that only a guess has."""
    loose = {one.gain_std for one in controls.values() if one.gain_std >= GUESSED_TRAVEL_STD}
    return [
        f"travel of {', '.join(name for name, one in controls.items() if one.gain_std == std)} is guessed (gain_std ="
        f" {std:g}), and their derivatives are known to {100.0 * std:.0f} %; measure it and write it to [controls]"
        for std in sorted(loose)
    ]


def _read_control(table: Table, name: str, warnings: list[str]) -> Control:
    if not any(table.optional(key) for key in ("servo", "port", "pwm", "deflection", "mix")):
        return _read_logged(table, name)
    several = table.is_list("servo")
    numbers = table.numbers("servo") if several else (table.number("servo"),)
    port = PORTS.index(table.text("port", PORTS[0], PORTS))
    most = OUTPUTS if port else len(PORTS) * OUTPUTS
    if any(value != int(value) or not 1 <= value <= most for value in numbers) or len(set(numbers)) < len(numbers):
        raise table.error("servo", f"must be outputs from 1 to {most}, each once")
    signal = table.text("signal", "command", ("command", "position"))
    nested = several and (table.is_nested("pwm") or len(numbers) > 1)
    pwm = table.rows("pwm") if nested else (table.numbers("pwm"),)
    deflection = table.rows("deflection") if nested else (table.numbers("deflection"),)
    listed = len(numbers) > 1 or table.is_list("mix")
    mix = table.numbers("mix") if listed else (table.number("mix", 1.0),)
    gain_std, bias_std = table.number("gain_std", 0.0, low=0.0), table.number("bias_std", 0.0, low=0.0)
    delay, lag, backlash = (table.known(key) for key in ("delay", "lag", "backlash"))
    table.close()
    for key, rows in (("pwm", pwm), ("deflection", deflection), ("mix", mix)):
        if len(rows) != len(numbers):
            raise table.error(key, f"has {len(rows)} entries for {len(numbers)} servos; it needs one for each")
    if any(weight == 0.0 for weight in mix):
        raise table.error("mix", "holds a 0: leave that servo out")
    curves = [_check_curve(table, name, xs, ys, warnings) for xs, ys in zip(pwm, deflection, strict=True)]
    servos = tuple(OUTPUTS * port + int(value) for value in numbers)
    pulses, travels = tuple(x for x, _ in curves), tuple(y for _, y in curves)
    return Control(name, signal, servos, mix, pulses, travels, gain_std, bias_std, delay, lag, backlash)


def _read_logged(table: Table, name: str) -> Control:
    """A control whose deflection the log holds itself: no servo, no pulses."""
    signal = table.text("signal", "command", ("command", "position"))
    gain_std, bias_std = table.number("gain_std", 0.0, low=0.0), table.number("bias_std", 0.0, low=0.0)
    delay, lag, backlash = (table.known(key) for key in ("delay", "lag", "backlash"))
    table.close()
    return Control(name, signal, (), (), (), (), gain_std, bias_std, delay, lag, backlash)


def _check_curve(
    table: Table, name: str, xs: tuple[float, ...], ys: tuple[float, ...], warnings: list[str]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    if len(xs) < 2 or len(xs) != len(ys):
        raise table.error("pwm", f"has {len(xs)} points and deflection {len(ys)}; give both the same two or more")
    if xs[0] > xs[-1]:
        xs, ys = xs[::-1], ys[::-1]
    if any(b <= a for a, b in pairwise(xs)):
        raise table.error("pwm", f"is {list(xs)}; it must rise or fall from point to point")
    if xs[0] <= 0.0 or xs[-1] > LARGEST_PWM_US:
        raise table.error("pwm", f"is {list(xs)}; a pulse width lies above 0 and below 65535 us")
    rising = ys[0] < ys[-1]
    if any((b <= a) if rising else (b >= a) for a, b in pairwise(ys)):
        raise table.error("deflection", f"is {list(ys)}; it must rise or fall with every point of pwm")
    if name == "throttle" and (min(ys) < 0.0 or max(ys) > 1.0):
        raise table.error("deflection", f"is {list(ys)}; a throttle goes from 0 to 1")
    if name != "throttle" and max(abs(y) for y in ys) > np.pi / 2:
        warnings.append(f"{table.path('deflection')}: {max(map(abs, ys)):g} rad is beyond 90 deg: given in degrees?")
    if xs[0] < 300.0 or xs[-1] > 3000.0:
        warnings.append(f"{table.path('pwm')}: {xs[0]:g} to {xs[-1]:g} us is no usual servo range: given in us?")
    return xs, ys


def _check_shared(table: Table, controls: Mapping[str, Control]) -> None:
    """A servo that serves two controls has one linkage, and the controls must be separable."""
    seen: dict[int, tuple[str, tuple[tuple[float, ...], tuple[float, ...]]]] = {}
    for name, control in controls.items():
        for servo, xs, ys in zip(control.servos, control.pwm, control.deflection, strict=True):
            other = seen.setdefault(servo, (name, (xs, ys)))
            if other[1] != (xs, ys):
                raise table.error(
                    name, f"gives servo {output_name(servo)} another pwm and deflection than {other[0]} does"
                )
    servos, inverse = mixing_matrix(controls)
    if controls and np.linalg.matrix_rank(inverse) < len(controls):
        raise table.error("mix", f"over servos {servos} cannot distinguish the controls; check each control's mix")
