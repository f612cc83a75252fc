"""Answers held against an OpenAPI document."""

from __future__ import annotations

from typing import Any

from jsonschema import Draft202012Validator

JSON = "application/json"


def check(document: dict[str, Any], value: Any, schema: Any) -> None:
    """Raises ValidationError for a value that does not follow a schema of the document."""
    Draft202012Validator({**schema, "components": document["components"]}).validate(value)


def check_answer(
    document: dict[str, Any], method: str, path: str, status: int, body: Any, media: str = JSON
) -> None:
    """Holds an answer to what the document says of its status.

    Raises KeyError for one that it does not tell of, and ValidationError.
    """
    described = document["paths"][path][method.lower()]["responses"][str(status)]
    check(document, body, described["content"][media]["schema"])
