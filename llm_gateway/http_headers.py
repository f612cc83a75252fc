"""What HTTP clients say of a request in headers of our own."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any

import msgspec

from llm_gateway.http_errors import HttpError

DEFAULT_DEADLINE_S = 60.0
CLIENT, FINGERPRINT, DEADLINE = (
    "X-CoAdapt-Client",
    "X-CoAdapt-Fingerprint",
    "X-CoAdapt-Deadline",
)
_PATTERNS = {CLIENT: r"[A-Za-z0-9_-]{1,32}", FINGERPRINT: r"[0-9a-f]{16,64}"}
_Seconds = Annotated[float, msgspec.Meta(ge=0.05, le=600)]
HEADERS: dict[str, Any] = {
    **{
        name: {"type": "string", "pattern": rf"^({pattern})?$"}
        for name, pattern in _PATTERNS.items()
    },
    DEADLINE: msgspec.json.schema(_Seconds) | {"default": DEFAULT_DEADLINE_S},
}
"""JSON schemas of them all."""


def word(headers: Mapping[str, str], name: str) -> str:
    """The client's name, or the fingerprint of the scene; "" where the header is not there.

    Raises HttpError that names the header and what is allowed.
    """
    value, pattern = headers.get(name, ""), _PATTERNS[name]
    if value and not re.fullmatch(pattern, value):
        raise HttpError(400, f"{name} = {value[:100]!r} is not valid; it must match {pattern}")
    return value


def deadline_s(headers: Mapping[str, str]) -> float:
    """How long the client waits, in seconds. Raises HttpError."""
    value = headers.get(DEADLINE, "")
    if not value:
        return DEFAULT_DEADLINE_S
    try:
        return msgspec.convert(float(value), _Seconds)
    except ValueError as error:
        raise HttpError(
            400, f"{DEADLINE} = {value[:100]!r} is not valid; it must be 0.05 to 600 seconds"
        ) from error
