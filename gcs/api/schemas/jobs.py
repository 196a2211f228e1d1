"""Jobs and the models that come of them."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from gcs.analysis.flight_part import part_problem

# Names, ids and reasons of models and jobs; and coefficients of a model.
_LONGEST_TEXT, _MOST_COEFFICIENTS = 200, 500


def _bounded(value: str | dict[str, Any]) -> str | dict[str, Any]:
    """ValueError for a model of longer texts, or of more coefficients, than any has."""
    if isinstance(value, dict):
        coefficients = value.get("coefficients")
        if isinstance(coefficients, dict) and len(coefficients) > _MOST_COEFFICIENTS:
            raise ValueError(f"a model has at most {_MOST_COEFFICIENTS} coefficients; this one has {len(coefficients)}")
    left: list[Any] = [value]
    while left:
        one = left.pop()
        if isinstance(one, str) and not _is_text(one):
            raise ValueError("half a character (a lone surrogate) is in a text of the model")
        if isinstance(one, str) and len(one) > _LONGEST_TEXT:
            raise ValueError(f"{one[:20]}… has {len(one)} characters; one of a model has at most {_LONGEST_TEXT}")
        if isinstance(one, dict):
            left += [*one, *one.values()]
        elif isinstance(one, list):
            left += one
    return value


def _is_text(value: str) -> bool:
    """Whether a text can be written: JSON may hold halves of characters."""
    try:
        value.encode()
    except UnicodeEncodeError:
        return False
    return True


_Model = Annotated[str | dict[str, Any], AfterValidator(_bounded)]
_Name = Annotated[str, Field(max_length=_LONGEST_TEXT)]


class JobView(BaseModel):
    """A job. `progress` runs from 0 to 1; `error` says in words why it failed.

    One that nobody asked for is skipped where nothing airborne and excited is found; the end of its log says so.
    """

    id: str
    flight_id: str
    kind: Literal["identify", "discrepancy", "design"]
    request: dict[str, Any]
    state: Literal["queued", "running", "done", "failed", "skipped", "cancelled"]
    progress: float
    error: str | None
    attempts: int
    created_ns: int
    started_ns: int | None
    ended_ns: int | None
    owner: str = Field(description="Who asked for it: `station`, or the address of the client; empty where unknown")
    priority: int = Field(description="0: queued by the station itself; a person's jobs (1) come first")
    cpu_s: float | None = Field(description="Processor time that it took; null before it has ended")
    peak_bytes: int | None = Field(description="The most memory that it took")
    log: list[str]
    report: str | None = Field(None, description="Once it is done: the address of the flight's newest result as a page")

    @classmethod
    def of(cls, job: dict[str, Any]) -> JobView:
        """The view of a job's own fields."""
        result = {"identify": "identification"}.get(job["kind"], job["kind"])
        address = f"/api/flights/{job['flight_id']}/report?of={result}"
        is_there = job["state"] == "done" and job["kind"] != "design"
        return cls.model_validate({**job, "report": address if is_there else None})


class JobChanges(BaseModel):
    """Settings of an estimation. A model is the id of one (GET /api/models) or the model itself as JSON."""

    model_config = ConfigDict(extra="forbid", populate_by_name=True)

    model: _Model | None = Field(None, description="The model to be judged; discrepancy needs it")
    structure: _Model | None = None
    prior: _Model | None = None
    validate_: list[_Name] = Field(
        default_factory=list, alias="validate", max_length=50, description="Ids of flights to judge the result on"
    )
    rule_out: list[_Name] = Field(
        default_factory=list, max_length=50, description="Effects that a test on the ground has shown not to be there"
    )
    as_recorded: list[_Name] = Field(
        default_factory=list, max_length=50, description="Signals that are right as recorded, whatever seems"
    )
    method: Literal["auto", "map", "ee", "oe", "fe"] = "auto"
    from_: float | None = Field(None, alias="from", ge=0, description="Seconds from the start of the flight")
    to: float | None = Field(None, ge=0)
    system: int | None = Field(None, ge=1, le=255)
    vehicle: str | None = Field(
        None, max_length=80, description="An aircraft of the station, id or id@version; without it the flight's own"
    )

    manoeuvres: list[_Name] = Field(
        default_factory=list, max_length=20, description="Of a design; without them a multisine on all surfaces, tuned"
    )
    duration: float | None = Field(None, ge=4, le=3600, description="Of a design, s")
    gusts: float = Field(0.0, ge=0, le=20, description="Turbulence that a design expects, m/s")
    limits: dict[Literal["alpha", "beta", "bank", "pitch", "surface", "airspeed"], float] = Field(
        default_factory=dict, description="Of a design: degrees from trim, airspeed in per cent"
    )

    @model_validator(mode="after")
    def _part_in_order(self) -> Self:
        if problem := part_problem(self.from_, self.to):
            raise ValueError(problem)
        return self


class JobRequest(JobChanges):
    """An estimation to run, or a flight to plan."""

    kind: Literal["identify", "discrepancy", "design"]


class ModelItem(BaseModel):
    """One identified model. `verdict` and `effects` are a discrepancy's; null and empty for an identification."""

    id: str
    flight_id: str
    flight_name: str = Field(description="The file's name of an upload, else the flight's id")
    kind: Literal["identify", "discrepancy"]
    job_id: str
    name: str
    created_ns: int
    verdict: Literal["none", "parameter_error", "missing_effect", "unexplained"] | None
    effects: list[str] = Field(description="Names of the effects that were found missing and added")
