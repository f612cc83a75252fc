"""The operations in one table, which both the router and the OpenAPI document are made from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from network_controller.qod.messages import (
    CreateSession,
    ExtendSessionDuration,
    Health,
    QosProfile,
    QosProfileRequest,
    RetrieveSessionsInput,
    SessionInfo,
)

BASE = "/quality-on-demand/v1"
SESSIONS = f"{BASE}/sessions"
PROFILES = "/qos-profiles/v1"
OPENAPI_PATH = "/openapi.json"
HEALTH_PATH = "/health"
OPEN_PATHS = frozenset({OPENAPI_PATH, HEALTH_PATH})
"""Answered without a token."""


@dataclass(frozen=True, slots=True)
class Operation:
    """One method on one path."""

    method: str
    path: str
    name: str
    """CAMARA's operationId, where it has one."""
    summary: str
    status: int
    answer: Any = None
    body: Any = None
    errors: tuple[int, ...] = ()


OPERATIONS = (
    Operation(
        "POST",
        SESSIONS,
        "createSession",
        "Asks for quality on a device's link",
        201,
        SessionInfo,
        CreateSession,
        (400, 401, 404, 409, 415, 422, 429, 503),
    ),
    Operation(
        "GET",
        f"{SESSIONS}/{{sessionId}}",
        "getSession",
        "A session as it stands",
        200,
        SessionInfo,
        None,
        (400, 401, 404),
    ),
    Operation(
        "DELETE",
        f"{SESSIONS}/{{sessionId}}",
        "deleteSession",
        "Ends and forgets a session",
        204,
        None,
        None,
        (400, 401, 404),
    ),
    Operation(
        "POST",
        f"{SESSIONS}/{{sessionId}}/extend",
        "extendQosSessionDuration",
        "Gives a session in force more time, as far as its profile allows",
        200,
        SessionInfo,
        ExtendSessionDuration,
        (400, 401, 404, 409, 415),
    ),
    Operation(
        "POST",
        f"{BASE}/retrieve-sessions",
        "retrieveSessionsByDevice",
        "The sessions of a device",
        200,
        list[SessionInfo],
        RetrieveSessionsInput,
        (400, 401, 404, 415, 422, 503),
    ),
    Operation(
        "POST",
        f"{PROFILES}/retrieve-qos-profiles",
        "retrieveQoSProfiles",
        "The profiles, with rates where a device is named",
        200,
        list[QosProfile],
        QosProfileRequest,
        (400, 401, 404, 415, 422, 503),
    ),
    Operation(
        "GET",
        f"{PROFILES}/qos-profiles",
        "listQosProfiles",
        "All profiles; not part of CAMARA's 1.1, which has retrieveQoSProfiles",
        200,
        list[QosProfile],
        None,
        (401,),
    ),
    Operation(
        "GET",
        f"{PROFILES}/qos-profiles/{{name}}",
        "getQosProfile",
        "One profile",
        200,
        QosProfile,
        None,
        (401, 404),
    ),
    Operation("GET", HEALTH_PATH, "getHealth", "Whether the API answers", 200, Health),
)
