"""The console's API for its page and for tools, as OpenAPI describes it."""

from __future__ import annotations

from typing import Any

import msgspec

from options.console.answers import Error, Event, Floor, History, Places, Recorded
from options.console.controls import CONTROLS
from options.console.past import STEPS_S
from options.console.places import PlaceChange
from swarm.http.openapi import Api, Operation
from swarm.messages import RobotId

CSRF_HEADER = "x-coadapt-csrf"
_EGO: dict[str, Any] = {"ego": {"type": "string"}}
"""Which ego it is about; the first one where none is named."""
_HEADERS: dict[str, Any] = {CSRF_HEADER: {"type": "string"}, "origin": {"type": "string"}}
_WHAT = {
    "shape": "Shapes a link",
    "ego": "Steers the ego",
    "wish": "Asks what a wish means",
    "robot": "Takes a robot off duty, or on",
}


def _control(what: str) -> Operation:
    control = CONTROLS[what]
    return Operation(
        "POST",
        f"/api/{what}/{{robot}}" if what == "robot" else f"/api/{what}",
        what,
        _WHAT[what],
        200,
        control.reply,
        control.request,
        (403, 404, 409, 413, 415, 504),
        _HEADERS,
        query=_EGO,
        required=frozenset(_HEADERS),
    )


API = Api(
    title="CoAdapt Edge: console",
    version="1.0.0",
    description="What the console's page shows, and what it steers. Controls need the page's own "
    "origin and the token that the first event of an open stream tells.",
    operations=(
        Operation(
            "GET",
            "/api/events",
            "events",
            "The whole state, then changes",
            200,
            errors=(404, 503),
            query=_EGO,
            events=(Event,),
        ),
        Operation("GET", "/api/floor", "floor", "What stands still", 200, Floor),
        Operation(
            "POST",
            "/api/place",
            "place",
            "Draws, renames or deletes a place",
            200,
            Places,
            PlaceChange,
            (403, 409, 413, 415),
            _HEADERS,
            required=frozenset(_HEADERS),
        ),
        Operation(
            "GET",
            "/api/history",
            "history",
            "The past, from Prometheus",
            200,
            History,
            errors=(404, 503),
            query={"span": {"enum": [str(span_s) for span_s in STEPS_S]}, **_EGO},
            required=frozenset({"span"}),
        ),
        Operation(
            "GET", "/api/recordings", "recordings", "Recordings, newest first", 200, list[Recorded]
        ),
        Operation(
            "GET",
            "/recordings/{name}",
            "recording",
            "One of them, as a file",
            200,
            Any,
            errors=(403, 404),
            media="application/octet-stream",
        ),
        *map(_control, CONTROLS),
    ),
    error=Error,
    refusals=(400, 401, 421),
    in_paths={"name": {"type": "string"}, "robot": msgspec.json.schema(RobotId)},
)
