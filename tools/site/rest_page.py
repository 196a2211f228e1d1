"""The reference of the REST interface, from the OpenAPI description that the service gives of itself."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from gcs.api import create_app
from gcs.catalogue.store import Catalogue
from gcs.jobs.runner import JobRunner
from gcs.mavlink.dialect import Dialect
from gcs.settings import Settings
from gcs.station.recorder import FlightRecorder
from gcs.station.station import RecordingStation

_METHODS = ("get", "post", "put", "patch", "delete")
_HEAD = """# REST

Generated from the service's own description ([openapi.json](openapi.json)), which a running service gives at
`/openapi.json`. How to use it: [REST with curl](../howto/rest.md). Errors are `application/problem+json` with `title`,
`status` and `detail`. With a token (`GCS_TOKEN` or `--token-file`) every address that tells of flights asks for
`Authorization: Bearer TOKEN`.
"""


def schema() -> dict[str, Any]:
    """The OpenAPI description of a service that is put together but never started."""
    with tempfile.TemporaryDirectory() as folder:
        settings = Settings(data=Path(folder))
        catalogue = Catalogue(settings.database)
        try:
            recorder = FlightRecorder(settings.flights, Dialect.load(), catalogue)
            station = RecordingStation([], recorder)
            return create_app(settings, catalogue, station, JobRunner(settings, catalogue)).openapi()
        finally:
            catalogue.close()


def text(described: dict[str, Any]) -> str:
    """The description as JSON."""
    return json.dumps(described, indent=1) + "\n"


def page(described: dict[str, Any]) -> str:
    """The page in Markdown: every address, then every object that goes over it."""
    parts = [_HEAD]
    for path, operations in described["paths"].items():
        for method in _METHODS:
            if method in operations:
                parts.append("\n".join(_operation(method, path, operations[method])))
    parts.append("## Objects\n")
    for name, entry in sorted(described["components"]["schemas"].items()):
        parts.append("\n".join(_object(name, entry)))
    return "\n".join(parts)


def _operation(method: str, path: str, operation: dict[str, Any]) -> Iterator[str]:
    yield f"## {method.upper()} {path}\n"
    yield operation.get("description", operation.get("summary", "")).strip() + "\n"
    if operation.get("parameters"):
        yield "| parameter | in | type | |\n|---|---|---|---|"
        for given in operation["parameters"]:
            needed = "required" if given.get("required") else _default(given["schema"])
            told = " ".join(filter(None, (given.get("description", ""), needed)))
            yield f"| `{given['name']}` | {given['in']} | {_type(given['schema'])} | {_cell(told)} |"
        yield ""
    for kind, content in operation.get("requestBody", {}).get("content", {}).items():
        yield f"Takes `{kind}`: {_type(content['schema'])}\n"
    yield "| answer | |\n|---|---|"
    for status, answer in operation["responses"].items():
        bodies = [f"`{kind}` {_type(body.get('schema', {}))}" for kind, body in answer.get("content", {}).items()]
        yield f"| {status} | {_cell('; '.join([answer.get('description', ''), *bodies]))} |"
    yield ""


def _object(name: str, entry: dict[str, Any]) -> Iterator[str]:
    yield f"### {name}\n"
    if entry.get("description"):
        yield entry["description"].strip() + "\n"
    if "properties" not in entry:
        yield _type(entry) + "\n"
        return
    yield "| field | type | |\n|---|---|---|"
    for key, field in entry["properties"].items():
        needed = "" if key in entry.get("required", ()) else _default(field) or "optional"
        told = " ".join(filter(None, (field.get("description", ""), needed)))
        yield f"| `{key}` | {_type(field)} | {_cell(told)} |"
    yield ""


def _default(entry: dict[str, Any]) -> str:
    value = entry.get("default")
    return "" if value is None else f"(default `{json.dumps(value)}`)"


def _type(entry: dict[str, Any]) -> str:
    """A schema in a few words, objects linked."""
    if "$ref" in entry:
        name = entry["$ref"].rsplit("/", 1)[1]
        return f"[{name}](#{name.lower()})"
    if "anyOf" in entry:
        return " or ".join(_type(one) for one in entry["anyOf"])
    if "enum" in entry:
        return ", ".join(f"`{json.dumps(value)}`" for value in entry["enum"])
    if "const" in entry:
        return f"`{json.dumps(entry['const'])}`"
    kind = str(entry.get("type", "any"))
    if kind == "array":
        return f"array of {_type(entry.get('items', {}))}"
    if kind == "object" and isinstance(entry.get("additionalProperties"), dict):
        return f"object of {_type(entry['additionalProperties'])}"
    if kind == "object" and "properties" in entry:
        return "object with " + ", ".join(f"`{key}`" for key in entry["properties"])
    return kind


def _cell(words: str) -> str:
    return " ".join(words.replace("|", "\\|").split())
