"""The OpenAPI document, made from the operations and the messages themselves."""

from __future__ import annotations

import re
from typing import Any

import msgspec

from network_controller.qod.messages import StatusEvent
from network_controller.qod.operations import OPEN_PATHS, OPERATIONS, Operation
from network_controller.qod.problems import ErrorInfo

VERSION = "1.1.0"


def document() -> dict[str, Any]:
    """The whole document, OpenAPI 3.1: its schemas are JSON Schema as msgspec writes it."""
    kinds = [ErrorInfo, StatusEvent]
    for operation in OPERATIONS:
        kinds += [k for k in (operation.answer, operation.body) if k is not None]
    schemas, components = msgspec.json.schema_components(
        kinds, ref_template="#/components/schemas/{name}"
    )
    by_kind = dict(zip(map(repr, kinds), schemas, strict=True))
    paths: dict[str, dict[str, Any]] = {}
    for operation in OPERATIONS:
        paths.setdefault(operation.path, {})[operation.method.lower()] = _describe(
            operation, by_kind
        )
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
            "securitySchemes": {"token": {"type": "http", "scheme": "bearer"}},
        },
    }


def _describe(operation: Operation, by_kind: dict[str, Any]) -> dict[str, Any]:
    parameters: list[dict[str, Any]] = [
        {"name": name, "in": "path", "required": True, "schema": {"type": "string"}}
        for name in re.findall(r"\{(\w+)\}", operation.path)
    ]
    parameters.append({"name": "x-correlator", "in": "header", "schema": {"type": "string"}})
    answer: dict[str, Any] = {"description": "Done"}
    if operation.answer is not None:
        answer["content"] = _json(by_kind[repr(operation.answer)])
    responses = {str(operation.status): answer}
    for status in operation.errors:
        responses[str(status)] = {
            "description": "Refused; the body says why",
            "content": _json(by_kind[repr(ErrorInfo)]),
        }
    described: dict[str, Any] = {
        "operationId": operation.name,
        "summary": operation.summary,
        "parameters": parameters,
        "responses": responses,
        "security": [] if operation.path in OPEN_PATHS else [{"token": []}],
    }
    if operation.body is not None:
        described["requestBody"] = {
            "required": True,
            "content": _json(by_kind[repr(operation.body)]),
        }
    if operation.name == "createSession":
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
