"""Shapes of requests and answers about the station's aircraft."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from gcs.vehicles.document import NUMBER_NAMES, SENSOR_NAMES, Answers, BenchAnswer, ControlAnswer, ServoAnswer
from gcs.vehicles.shelf import LARGEST
from gcs.vehicles.trends import Change
from sim_vehicle.physics.layout import MOST_CONTROLS
from sim_vehicle.vehicle.controls import CONTROL_NAMES

_STRICT = ConfigDict(extra="forbid")
_Finite = Annotated[float, Field(allow_inf_nan=False)]
_Place = tuple[_Finite, _Finite, _Finite]
_Name = Annotated[str, Field(min_length=1, max_length=100, pattern=r"^[^\x00-\x1f\x7f]+$")]
_Word = Annotated[str, Field(min_length=1, max_length=40, pattern=r"^[A-Za-z0-9_:.-]+$")]


class ServoForm(BaseModel):
    """One servo of a control: pulses, us, and the deflections there, deg (throttle: %; a control of another name: as
    the vehicle file has them).
    """

    model_config = _STRICT

    servo: int = Field(ge=1, le=48)
    pwm_us: list[_Finite] = Field(min_length=2, max_length=50)
    travel: list[_Finite] = Field(min_length=2, max_length=50)
    mix: _Finite = 1.0


class ControlForm(BaseModel):
    """A control and its servos. signal: whether SERVO_OUTPUT_RAW carries the command or the measured position."""

    model_config = _STRICT

    servos: list[ServoForm] = Field(min_length=1, max_length=16)
    signal: Literal["command", "position"] = "command"


class BenchForm(BaseModel):
    """Bench points of an analogue channel: (reference in `unit`, reading in V) each."""

    model_config = _STRICT

    source: _Word
    form: _Word
    unit: _Word
    points: list[tuple[_Finite, _Finite]] = Field(min_length=2, max_length=2000)


class VehicleForm(BaseModel):
    """What one measures of an aircraft. What is left out is not in the vehicle file.

    numbers: by name, in the unit behind each. places: of sensors from the centre of gravity, m, forward, right, down.
    """

    model_config = _STRICT

    name: _Name
    numbers: dict[Literal[NUMBER_NAMES], _Finite] = Field(default_factory=dict)  # type: ignore[valid-type]
    controls: dict[_Word, ControlForm] = Field(default_factory=dict, max_length=len(CONTROL_NAMES) + MOST_CONTROLS)
    places: dict[Literal[SENSOR_NAMES], _Place] = Field(default_factory=dict)  # type: ignore[valid-type]
    bench: dict[_Word, BenchForm] = Field(default_factory=dict, max_length=30)

    @classmethod
    def of(cls, answers: Answers) -> VehicleForm:
        """The form that shows these answers."""
        return cls.model_validate(
            {
                "name": answers.name or "aircraft",
                "numbers": dict(answers.numbers),
                "controls": {
                    name: {"signal": one.signal, "servos": [vars(servo) for servo in one.servos]}
                    for name, one in answers.controls.items()
                },
                "places": dict(answers.places),
                "bench": {name: vars(one) for name, one in answers.bench.items()},
            }
        )

    def answers(self) -> Answers:
        """What the form says."""
        return Answers(
            self.name,
            dict(self.numbers),
            {
                name: ControlAnswer(
                    tuple(ServoAnswer(one.servo, tuple(one.pwm_us), tuple(one.travel), one.mix) for one in form.servos),
                    form.signal,
                )
                for name, form in self.controls.items()
            },
            dict(self.places),
            {
                name: BenchAnswer(form.source, form.form, form.unit, tuple(form.points))
                for name, form in self.bench.items()
            },
        )


class VehicleDraft(BaseModel):
    """An aircraft as somebody describes it: the text of a vehicle file, a form, or a form put into a text."""

    model_config = _STRICT

    toml: str | None = Field(None, max_length=LARGEST, description="The text of a vehicle file")
    form: VehicleForm | None = None

    @model_validator(mode="after")
    def _something(self) -> Self:
        if self.toml is None and self.form is None:
            raise ValueError("give toml, form, or both")
        return self


class FigureView(BaseModel):
    """A figure that follows from a vehicle file, and between what it lies for small aircraft."""

    name: str
    value: float
    unit: str
    usual: tuple[float, float]
    is_usual: bool


class VehicleReading(BaseModel):
    """What a vehicle file says. `problem` is empty where it is one; it is the only other thing that is filled else."""

    toml: str
    problem: str
    name: str
    warnings: list[str]
    figures: list[FigureView]
    sketch: str = Field(description="The aircraft from above and from the front, to scale, as SVG")
    form: VehicleForm | None = Field(description="null where the file holds what the form cannot show")


class VehicleItem(BaseModel):
    """One aircraft of the station."""

    id: str
    name: str
    version: int = Field(description="The newest")
    changed: str = Field(description="When that was made, UTC")
    editable: bool = Field(description="False for the file that the service was started with")
    mass_kg: float
    span_m: float
    warnings: list[str]


class VehicleView(VehicleItem):
    """One version of an aircraft."""

    versions: list[int]
    reading: VehicleReading


class EstimateView(BaseModel):
    """One flight's estimate."""

    flight: str
    title: str
    start: str
    value: float
    std: float


class TrendView(BaseModel):
    """A coefficient over an aircraft's flights, oldest first; mean and std weighted by their errors.

    scatter: by how much flights differ beyond their errors, 1 sigma. constant_p: how often flights of one value differ
    as much; null of a single flight. change: the most likely step, where chance shows one as large in 1 % at most.
    """

    name: str
    estimates: list[EstimateView]
    mean: float
    std: float
    scatter: float
    constant_p: float | None
    change: Change | None


class InertiaRequest(BaseModel):
    """What was measured of an aircraft that swings. Errors (`…_std`) are 1 sigma; without one a usual one is taken.

    bifilar: it turns about the vertical, hung on two wires `length_m` long and `spacing_m` apart. swing: it swings
    about an axis `length_m` above its centre of gravity. times_s: what `swings` whole swings took, each time.
    """

    model_config = _STRICT

    way: Literal["bifilar", "swing"]
    mass_kg: float = Field(gt=0, le=1e5)
    mass_std_kg: float | None = Field(None, ge=0, le=1e5)
    length_m: float = Field(gt=0, le=100)
    length_std_m: float | None = Field(None, ge=0, le=100)
    spacing_m: float | None = Field(None, gt=0, le=100)
    spacing_std_m: float | None = Field(None, ge=0, le=100)
    times_s: list[Annotated[float, Field(gt=0, lt=1e4)]] = Field(min_length=1, max_length=100)
    swings: int = Field(ge=1, le=1000)

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.way == "bifilar" and self.spacing_m is None:
            raise ValueError("spacing_m, the distance between the two wires, is missing")
        return self


class InertiaEstimate(BaseModel):
    """A moment of inertia about the centre of gravity, kg m^2, its standard error, and the period it came from."""

    value: float
    std: float
    period_s: float
    period_std_s: float
