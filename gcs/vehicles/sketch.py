"""An aircraft from above, from the side and from the front, to scale, as far as its vehicle file says.

Beside it lies a sheet of paper (A4): by it a person sees that a length is in the wrong unit. What the file does not
say, as the fuselage and the tail, is drawn in broken lines as it usually is.
"""

from __future__ import annotations

import math
from html import escape

from sim_vehicle.vehicle.sensors import Sensors
from sim_vehicle.vehicle.vehicle_file import Vehicle

_PAPER_M = (0.297, 0.210)
# Of the span: a usual length of the fuselage, from the nose to the centre of gravity and on to the tail, its width, and
# the span and chord of its tail. The wing's leading edge: in mean chords before the centre of gravity.
_NOSE, _TAIL, _WIDTH = 0.22, 0.50, 0.08
_TAIL_SPAN, _TAIL_CHORD, _BEFORE = 0.36, 0.11, 0.28
_WIDTH_PX = 640.0
# Of a letter of the labels, about.
_LETTER_PX = 7.0
_STEPS = (1.0, 2.0, 5.0)
_KNOWN, _GUESSED = 'class="known"', 'class="guessed"'
_STYLE = (
    "<style>svg{font:13px sans-serif;background:#fff}.known{fill:#dbe7ff;stroke:#0b4fc4;stroke-width:1.5}"
    ".guessed{fill:none;stroke:#555;stroke-dasharray:5 4}.paper{fill:#fff;stroke:#000}"
    ".sensor{fill:#b3261e}.line{stroke:#000;fill:none}</style>"
)


class _Drawing:
    """A picture in metres: right and down on the paper, times `scale` in pixels."""

    def __init__(self, scale: float) -> None:
        self._scale = scale
        self._parts: list[str] = []

    def box(self, x: float, y: float, width: float, height: float, kind: str) -> None:
        px = [self._scale * value for value in (x, y, width, height)]
        self._parts.append('<rect x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}" '.format(*px) + f"{kind}/>")

    def disc(self, x: float, y: float, radius_x: float, radius_y: float, kind: str) -> None:
        px = [self._scale * value for value in (x, y, radius_x, radius_y)]
        self._parts.append('<ellipse cx="{:.1f}" cy="{:.1f}" rx="{:.1f}" ry="{:.1f}" '.format(*px) + f"{kind}/>")

    def dot(self, x: float, y: float, label: str) -> None:
        at = self._scale * x, self._scale * y
        self._parts.append(f'<circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="4" class="sensor"/>')
        self.words(x, y, label, 6.0, -6.0)

    def words(self, x: float, y: float, text: str, right_px: float = 0.0, down_px: float = 0.0) -> None:
        across, down = self._scale * x + right_px, self._scale * y + down_px
        anchor = ""
        if across + _LETTER_PX * len(text) > _WIDTH_PX / 2.0:
            # At the right edge it ends before its place.
            across, anchor = self._scale * x - right_px, ' text-anchor="end"'
        self._parts.append(f'<text x="{across:.1f}" y="{down:.1f}"{anchor}>{escape(text)}</text>')

    def svg(self, left: float, top: float, height: float, label: str) -> str:
        left, top, height = (self._scale * value for value in (left, top, height))
        view = f"{left:.1f} {top:.1f} {_WIDTH_PX:.0f} {height:.1f}"
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{view}" role="img" aria-label="{escape(label)}">'
            f"{_STYLE}{''.join(self._parts)}</svg>"
        )


def sketch(vehicle: Vehicle) -> str:
    """The picture as SVG, 640 pixels wide; y is right, x (forward) is up from above and left from the side."""
    b, c = vehicle.geometry.b, vehicle.geometry.S / vehicle.geometry.b
    span = max(b, 1e-3)
    margin, paper = 0.1 * span, _PAPER_M[0]
    width = span + 2.0 * margin
    scale = _WIDTH_PX / width
    drawn = _Drawing(scale)
    left, gap = -width / 2.0, 0.25 * span
    nose = max(_NOSE * span, _BEFORE * c, *(place[0] for place in _places(vehicle.sensors).values()), 0.0) + margin
    _from_above(drawn, vehicle, span, c)
    side = _TAIL * span + gap
    _from_the_front(drawn, vehicle, span, c, side)
    bottom = side + 0.25 * span
    shown = min(paper, 0.9 * width), min(_PAPER_M[1], 0.9 * width)
    if paper <= 0.9 * width:
        drawn.box(left + margin / 2.0, bottom, *shown, 'class="paper"')
        drawn.words(left + margin / 2.0, bottom, "a sheet of A4", 6.0, 16.0)
    else:
        drawn.words(left + margin / 2.0, bottom, "a sheet of A4 is wider than this picture", 0.0, 16.0)
    length = _round_length(span / 4.0)
    at = span / 2.0 - length
    drawn.box(at, bottom, length, 2.0 / scale, 'class="line"')
    drawn.words(at, bottom, f"{length:g} m", 0.0, 16.0)
    tall = bottom + max(shown[1] if paper <= 0.9 * width else 0.0, 30.0 / scale) + margin
    label = f"{vehicle.name} from above and from the front, to scale: span {b:g} m, mean chord {c:.3g} m"
    return drawn.svg(left, -nose, nose + tall, label)


def _from_above(drawn: _Drawing, vehicle: Vehicle, span: float, c: float) -> None:
    drawn.box(-_WIDTH * span / 2.0, -_NOSE * span, _WIDTH * span, (_NOSE + _TAIL) * span, _GUESSED)
    tail = _TAIL_CHORD * span
    drawn.box(-_TAIL_SPAN * span / 2.0, _TAIL * span - tail, _TAIL_SPAN * span, tail, _GUESSED)
    drawn.box(-span / 2.0, -_BEFORE * c, span, c, _KNOWN)
    drawn.words(-span / 2.0, -_BEFORE * c + c, f"span {vehicle.geometry.b:g} m, mean chord {c:.3g} m", 0.0, 16.0)
    drawn.dot(0.0, 0.0, "centre of gravity")
    for name, (x, y, _) in _places(vehicle.sensors).items():
        drawn.dot(y, -x, name)


def _from_the_front(drawn: _Drawing, vehicle: Vehicle, span: float, c: float, below: float) -> None:
    thick = max(0.1 * c, 0.005 * span)
    drawn.disc(0.0, below, _WIDTH * span / 2.0, _WIDTH * span / 2.0, _GUESSED)
    drawn.box(-span / 2.0, below - thick / 2.0, span, thick, _KNOWN)
    motor = vehicle.propulsion
    if motor is not None and motor.diameter:
        _, y, z = motor.line
        drawn.disc(y, below + z, motor.diameter / 2.0, motor.diameter / 2.0, 'class="line"')
        drawn.words(y + motor.diameter / 2.0, below + z, f"propeller {motor.diameter:g} m", 6.0, -8.0)
    for _, y, z in _places(vehicle.sensors).values():
        drawn.dot(y, below + z, "")


def _places(sensors: Sensors) -> dict[str, tuple[float, float, float]]:
    """Sensors that do not sit at the centre of gravity, by what they are called."""
    named = {name.replace("_", " "): one.position for name, one in sensors.named().items()}
    return {name: place for name, place in named.items() if any(place)}


def _round_length(most: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above `most`."""
    power = 10.0 ** math.floor(math.log10(most))
    return max(step * power for step in _STEPS if step * power <= most * (1.0 + 1e-9))
