"""The operations in one table, which both the router and the OpenAPI document are made from."""

from __future__ import annotations

from network_controller.qod.messages import (
    CreateSession,
    ExtendSessionDuration,
    QosProfile,
    QosProfileRequest,
    RetrieveSessionsInput,
    SessionInfo,
)
from swarm.http.openapi import Health, Operation

BASE = "/quality-on-demand/v1"
SESSIONS = f"{BASE}/sessions"
PROFILES = "/qos-profiles/v1"
HEALTH_PATH = "/health"

OPERATIONS = (
    Operation(
        "POST",
        SESSIONS,
        "createSession",
        "Asks for quality on a device's link",
        201,
        SessionInfo,
        CreateSession,
        (404, 409, 415, 422, 429, 503),
    ),
    Operation(
        "GET",
        f"{SESSIONS}/{{sessionId}}",
        "getSession",
        "A session as it stands",
        200,
        SessionInfo,
        None,
        (404,),
    ),
    Operation(
        "DELETE",
        f"{SESSIONS}/{{sessionId}}",
        "deleteSession",
        "Ends and forgets a session",
        204,
        None,
        None,
        (404,),
    ),
    Operation(
        "POST",
        f"{SESSIONS}/{{sessionId}}/extend",
        "extendQosSessionDuration",
        "Gives a session in force more time, as far as its profile allows",
        200,
        SessionInfo,
        ExtendSessionDuration,
        (404, 409, 415),
    ),
    Operation(
        "POST",
        f"{BASE}/retrieve-sessions",
        "retrieveSessionsByDevice",
        "The sessions of a device",
        200,
        list[SessionInfo],
        RetrieveSessionsInput,
        (404, 415, 422, 503),
    ),
    Operation(
        "POST",
        f"{PROFILES}/retrieve-qos-profiles",
        "retrieveQoSProfiles",
        "The profiles, with rates where a device is named",
        200,
        list[QosProfile],
        QosProfileRequest,
        (404, 415, 422, 503),
    ),
    Operation(
        "GET",
        f"{PROFILES}/qos-profiles",
        "listQosProfiles",
        "All profiles; not part of CAMARA's 1.1, which has retrieveQoSProfiles",
        200,
        list[QosProfile],
        None,
    ),
    Operation(
        "GET",
        f"{PROFILES}/qos-profiles/{{name}}",
        "getQosProfile",
        "One profile",
        200,
        QosProfile,
        None,
        (404,),
    ),
    Operation(
        "GET",
        HEALTH_PATH,
        "getHealth",
        "Whether the API answers",
        200,
        Health,
        without_token=True,
    ),
)
