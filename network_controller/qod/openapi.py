"""The OpenAPI document, made from the operations and the messages themselves."""

from __future__ import annotations

from typing import Any

import msgspec

from network_controller.qod.messages import ProfileName, StatusEvent
from network_controller.qod.operations import OPERATIONS, SESSIONS
from network_controller.qod.problems import ErrorInfo
from swarm.http.openapi import Api

CORRELATOR = r"^[a-zA-Z0-9\-_:;./<>{}]{0,256}$"
_MARK = {"type": "string", "pattern": CORRELATOR}

API = Api(
    title="CoAdapt Edge: Quality on Demand",
    version="1.1.0",
    description="Sessions as in CAMARA Quality-on-Demand 1.1 and profiles as in CAMARA "
    "QoS Profiles 1.1, for the links of one swarm.",
    operations=OPERATIONS,
    error=ErrorInfo,
    refusals=(400, 401, 403),
    in_paths={
        "sessionId": {"type": "string", "format": "uuid"},
        "name": msgspec.json.schema(ProfileName),
    },
    headers={"x-correlator": _MARK},
    answer_headers={
        "x-correlator": {"description": "As it was sent, or a new one", "schema": _MARK}
    },
    beside=(StatusEvent,),
)


def document(*, token: bool) -> dict[str, Any]:
    """The whole document, OpenAPI 3.1; with `token`, it says that requests must show one."""
    made = API.document(token=token)
    create = made["paths"][SESSIONS]["post"]
    create["responses"]["201"]["links"] = {
        name: {"operationId": name, "parameters": {"sessionId": "$response.body#/sessionId"}}
        for name in ("getSession", "deleteSession", "extendQosSessionDuration")
    }
    create["callbacks"] = {"notifications": _notifications()}
    return made


def _notifications() -> dict[str, Any]:
    event = {"$ref": f"#/components/schemas/{StatusEvent.__name__}"}
    return {
        "{$request.body#/sink}": {
            "post": {
                "summary": "Tells of a change of a session's status",
                "requestBody": {
                    "required": True,
                    "content": {"application/cloudevents+json": {"schema": event}},
                },
                "responses": {"204": {"description": "Taken"}},
            }
        }
    }
