"""What a shared link shows of a flight's results: nothing that names other flights."""

from __future__ import annotations

import json
import re
from typing import Any

from fastapi import Request

from gcs.text.jsontext import dumps

# As `gcs.catalogue.intake` numbers them.
_FLIGHT_ID = re.compile(r"\d{8}T\d{6}\.\d{3}Z-\d+(?:-\d+)?")


def seen_by(request: Request, data: dict[str, Any]) -> dict[str, Any]:
    """The same to who has a token of the station; over a link other flights are called `other-1`, `other-2`, …"""
    own, names = request.state.identity.flight, dict[str, str]()
    if not own:
        return data

    def renamed(found: re.Match[str]) -> str:
        name = found.group()
        return name if name == own else names.setdefault(name, f"other-{len(names) + 1}")

    return dict(json.loads(_FLIGHT_ID.sub(renamed, dumps(data))))
