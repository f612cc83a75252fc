"""OpenAPI documents: valid by OpenAPI's own schema, and complete."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import jsonschema_rs
import pytest
import schemathesis
from jsonschema import Draft202012Validator
from prometheus_client import CollectorRegistry
from starlette.routing import Route

from llm_gateway.http_app import make_app
from llm_gateway.http_operations import API as GATEWAY
from network_controller.qod.openapi import document as quality_on_demand
from options.console.operations import API as CONSOLE
from swarm.http.access import Access
from swarm.http.openapi import OPENAPI_PATH
from tests.support.llm_endpoint import LOG, Scripted

DOCUMENTS: dict[str, Callable[..., dict[str, Any]]] = {
    "console": CONSOLE.document,
    "gateway": GATEWAY.document,
    "quality on demand": quality_on_demand,
}
every_document = pytest.mark.parametrize("made", DOCUMENTS.values(), ids=DOCUMENTS)


def references(value: Any) -> set[str]:
    """What a document points to."""
    if isinstance(value, dict):
        own = {value["$ref"]} if isinstance(value.get("$ref"), str) else set()
        return own.union(*map(references, value.values()))
    return set().union(*map(references, value)) if isinstance(value, list) else set()


@every_document
@pytest.mark.parametrize("token", [False, True])
def test_a_document_is_valid_openapi(made: Callable[..., dict[str, Any]], token: bool) -> None:
    document = made(token=token)
    schemathesis.openapi.from_dict(document).validate()
    schemas = document["components"]["schemas"]
    for schema in schemas.values():
        Draft202012Validator.check_schema(schema)
    # Every type that is pointed to is there, and none is there for nothing.
    assert references(document) == {f"#/components/schemas/{name}" for name in schemas}
    names = [o["operationId"] for path in document["paths"].values() for o in path.values()]
    assert len(names) == len(set(names))


def test_the_validator_is_strict() -> None:
    document = GATEWAY.document(token=False)
    for break_it in (
        lambda made: made["paths"]["/v1/models"]["get"]["parameters"].append({"name": "x"}),
        lambda made: made["paths"]["/v1/models"]["get"]["responses"]["200"].pop("description"),
        lambda made: made["info"].pop("version"),
        lambda made: made["paths"]["/v1/models"]["get"].update(parameter=[]),
        lambda made: made["paths"].update({"v1": {}}),
    ):
        broken = copy.deepcopy(document)
        break_it(broken)
        with pytest.raises(jsonschema_rs.ValidationError):
            schemathesis.openapi.from_dict(broken).validate()


@every_document
def test_only_what_needs_a_token_says_so(made: Callable[..., dict[str, Any]]) -> None:
    open_to_all = {"/health", "/healthz"}
    for token in (False, True):
        for path, methods in made(token=token)["paths"].items():
            guarded = token and path not in open_to_all
            for described in methods.values():
                assert described["security"] == ([{"token": []}] if guarded else [])
                assert ("401" in described["responses"]) is guarded


def test_every_route_of_the_gateway_is_in_its_document() -> None:
    app = make_app(Scripted(), Access("127.0.0.1", ""), CollectorRegistry(), LOG)
    routes = vars(app)["_app"].routes
    assert all(isinstance(route, Route) for route in routes)
    answered = {
        (route.path_format, method.lower())
        for route in routes
        for method in route.methods - {"HEAD"}
    }
    paths = GATEWAY.document(token=False)["paths"]
    described = {(path, method) for path, methods in paths.items() for method in methods}
    assert answered == described | {(OPENAPI_PATH, "get")}
