"""An HTTP API as a table of operations, and the OpenAPI document that is made of it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import msgspec

OPENAPI_PATH = "/openapi.json"
_SCHEMES = {"token": {"type": "http", "scheme": "bearer"}}
_REFERENCE = "#/components/schemas/{name}"
_IN_PATH = re.compile(r"\{(\w+)(:\w+)?\}")


class Health(msgspec.Struct, frozen=True, kw_only=True):
    """The process answers."""

    status: Literal["ok"] = "ok"


@dataclass(frozen=True, slots=True)
class Operation:
    """One method on one path."""

    method: str
    path: str
    """As Starlette's routes have it: `/v1/models/{name:path}`."""
    name: str
    """The operationId."""
    summary: str
    status: int
    """Of the answer where all is well."""
    answer: Any = None
    """The type of its body; None: it has none."""
    body: Any = None
    """The type of the request's body."""
    errors: tuple[int, ...] = ()
    """Statuses that it may be refused with, beside those that all of the API's share."""
    headers: Mapping[str, Any] = field(default_factory=dict)
    """JSON schemas of headers that a request may have."""
    query: Mapping[str, Any] = field(default_factory=dict)
    """JSON schemas of what may stand behind the path."""
    required: frozenset[str] = frozenset()
    """Names of headers and of the query that must be there."""
    media: str = "application/json"
    """Of the answer."""
    events: tuple[Any, ...] = ()
    """Types of the events that it may be answered with in place of `answer`."""
    last_event: str = ""
    """What the last event says, where that is no JSON."""
    without_token: bool = False

    @property
    def described_path(self) -> str:
        """As OpenAPI has it."""
        return _IN_PATH.sub(r"{\1}", self.path)

    def asked(self, place: str, schemas: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Parameters as OpenAPI has them."""
        return [
            {"name": name, "in": place, "schema": schema}
            | ({"required": True} if name in self.required else {})
            for name, schema in schemas.items()
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class Api:
    """Operations with what they have in common."""

    title: str
    version: str
    description: str
    operations: tuple[Operation, ...]
    error: Any
    """The type of every refusal's body."""
    refusals: tuple[int, ...]
    """Statuses that every operation may be refused with; 401 counts where a token is needed."""
    in_paths: Mapping[str, Any] = field(default_factory=dict)
    """JSON schemas of what stands in paths."""
    headers: Mapping[str, Any] = field(default_factory=dict)
    """JSON schemas of headers that every request may have."""
    answer_headers: Mapping[str, Any] = field(default_factory=dict)
    """OpenAPI's description of headers that every answer has."""
    beside: tuple[Any, ...] = ()
    """Types that no operation takes or answers and the document shows all the same."""

    @property
    def open_paths(self) -> frozenset[str]:
        """Paths that are answered without a token: the document's, too."""
        return frozenset({OPENAPI_PATH, *(o.path for o in self.operations if o.without_token)})

    def document(self, *, token: bool) -> dict[str, Any]:
        """The whole document, OpenAPI 3.1: its schemas are JSON Schema as msgspec writes it.

        With `token`, it says that requests must show one.
        """
        kinds = [self.error, *self.beside]
        for operation in self.operations:
            kinds += [k for k in (operation.answer, operation.body) if k is not None]
            kinds += operation.events
        schemas, components = msgspec.json.schema_components(kinds, ref_template=_REFERENCE)
        by_kind = dict(zip(map(repr, kinds), schemas, strict=True))
        paths: dict[str, dict[str, Any]] = {}
        for operation in self.operations:
            described = self._describe(operation, by_kind, token=token)
            paths.setdefault(operation.described_path, {})[operation.method.lower()] = described
        return {
            "openapi": "3.1.0",
            "info": {
                "title": self.title,
                "version": self.version,
                "description": self.description,
            },
            "paths": paths,
            "components": {
                "schemas": components,
                **({"securitySchemes": _SCHEMES} if token else {}),
            },
        }

    def _describe(
        self, operation: Operation, by_kind: Mapping[str, Any], *, token: bool
    ) -> dict[str, Any]:
        guarded = token and not operation.without_token
        marks = {"headers": self.answer_headers} if self.answer_headers else {}
        content: dict[str, Any] = {}
        if operation.answer is not None:
            content[operation.media] = {"schema": by_kind[repr(operation.answer)]}
        if operation.events:
            said = [by_kind[repr(kind)] for kind in operation.events]
            content["text/event-stream"] = {"schema": _event(said, operation.last_event)}
        responses: dict[str, dict[str, Any]] = {
            str(operation.status): {
                "description": "Done",
                **marks,
                **({"content": content} if content else {}),
            }
        }
        for status in sorted({*self.refusals, *operation.errors}):
            if status == 401 and not guarded:
                continue
            responses[str(status)] = {
                "description": "Refused; the body says why",
                **marks,
                "content": _json(by_kind[repr(self.error)]),
            }
        described: dict[str, Any] = {
            "operationId": operation.name,
            "summary": operation.summary,
            "parameters": [
                *(
                    {"name": name, "in": "path", "required": True, "schema": self.in_paths[name]}
                    for name, _ in _IN_PATH.findall(operation.path)
                ),
                *operation.asked("header", {**self.headers, **operation.headers}),
                *operation.asked("query", operation.query),
            ],
            "responses": responses,
            "security": [{"token": []}] if guarded else [],
        }
        if operation.body is not None:
            content = _json(by_kind[repr(operation.body)])
            described["requestBody"] = {"required": True, "content": content}
        return described


def _json(schema: Any) -> dict[str, Any]:
    return {"application/json": {"schema": schema}}


def _event(schemas: list[Any], last: str) -> dict[str, Any]:
    """One server-sent event, in the fields that OpenAPI 3.2 gives it."""
    words = {
        "type": "string",
        "contentMediaType": "application/json",
        "contentSchema": {"anyOf": schemas},
    }
    data = {"anyOf": [{"const": last}, words]} if last else words
    return {"type": "object", "properties": {"data": data}, "required": ["data"]}
