"""The OpenAPI document, made from the operations and the messages themselves."""

from __future__ import annotations

import re
from typing import Any

import msgspec

from network_controller.qod.messages import ProfileName, StatusEvent
from network_controller.qod.operations import OPEN_PATHS, OPERATIONS, Operation
from network_controller.qod.problems import ErrorInfo

VERSION = "1.1.0"
CORRELATOR = r"^[a-zA-Z0-9\-_:;./<>{}]{0,256}$"
_PARAMETERS = {
    "sessionId": {"type": "string", "format": "uuid"},
    "name": msgspec.json.schema(ProfileName),
}
"""Of paths."""
_SCHEMES = {"token": {"type": "http", "scheme": "bearer"}}
_MARK = {"type": "string", "pattern": CORRELATOR}
_MARKED = {"x-correlator": {"description": "As it was sent, or a new one", "schema": _MARK}}


def document(*, token: bool) -> dict[str, Any]:
    """The whole document, OpenAPI 3.1: its schemas are JSON Schema as msgspec writes it.

    With `token`, it says that requests must show one.
    """
    kinds = [ErrorInfo, StatusEvent]
    for operation in OPERATIONS:
        kinds += [k for k in (operation.answer, operation.body) if k is not None]
    schemas, components = msgspec.json.schema_components(
        kinds, ref_template="#/components/schemas/{name}"
    )
    by_kind = dict(zip(map(repr, kinds), schemas, strict=True))
    paths: dict[str, dict[str, Any]] = {}
    for operation in OPERATIONS:
        described = _describe(operation, by_kind, token=token)
        paths.setdefault(operation.path, {})[operation.method.lower()] = described
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "CoAdapt Edge: Quality on Demand",
            "version": VERSION,
            "description": "Sessions as in CAMARA Quality-on-Demand 1.1 and profiles as in CAMARA "
            "QoS Profiles 1.1, for the links of one swarm.",
        },
        "paths": paths,
        "components": {
            "schemas": components,
            **({"securitySchemes": _SCHEMES} if token else {}),
        },
    }


def _describe(operation: Operation, by_kind: dict[str, Any], *, token: bool) -> dict[str, Any]:
    guarded = token and operation.path not in OPEN_PATHS
    parameters: list[dict[str, Any]] = [
        {"name": name, "in": "path", "required": True, "schema": _PARAMETERS[name]}
        for name in re.findall(r"\{(\w+)\}", operation.path)
    ]
    parameters.append({"name": "x-correlator", "in": "header", "schema": _MARK})
    answer: dict[str, Any] = {"description": "Done", "headers": _MARKED}
    if operation.answer is not None:
        answer["content"] = _json(by_kind[repr(operation.answer)])
    responses = {str(operation.status): answer}
    for status in sorted({400, *operation.errors}):
        if status == 401 and not guarded:
            continue
        responses[str(status)] = {
            "description": "Refused; the body says why",
            "headers": _MARKED,
            "content": _json(by_kind[repr(ErrorInfo)]),
        }
    described: dict[str, Any] = {
        "operationId": operation.name,
        "summary": operation.summary,
        "parameters": parameters,
        "responses": responses,
        "security": [{"token": []}] if guarded else [],
    }
    if operation.body is not None:
        described["requestBody"] = {
            "required": True,
            "content": _json(by_kind[repr(operation.body)]),
        }
    if operation.name == "createSession":
        answer["links"] = {
            name: {"operationId": name, "parameters": {"sessionId": "$response.body#/sessionId"}}
            for name in ("getSession", "deleteSession", "extendQosSessionDuration")
        }
        described["callbacks"] = {"notifications": _callback(by_kind[repr(StatusEvent)])}
    return described


def _json(schema: Any) -> dict[str, Any]:
    return {"application/json": {"schema": schema}}


def _callback(event: Any) -> dict[str, Any]:
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
