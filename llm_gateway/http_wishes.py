"""`POST /v1/wishes`: what a wish in plain words means, for HTTP clients."""

from __future__ import annotations

import msgspec
from starlette.responses import Response

from llm_gateway.http_errors import HttpError
from swarm.messages import WishRequest, intent_to_json
from swarm.messages.wish import WishAnswer

PATH = "/v1/wishes"


def read_wish(raw: bytes) -> WishRequest:
    """The request of a body: `wish`, `site` (`robots`, `places`, `classes`) and `now`.

    Raises HttpError that says what is not allowed.
    """
    try:
        return msgspec.json.decode(raw, type=WishRequest)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise HttpError(400, f"the wish is not valid: {error}") from error


def write_wish(answer: WishAnswer) -> Response:
    """The intent alone, in the form of docs/wishes.md."""
    raw = msgspec.json.encode(intent_to_json(answer.understood))
    return Response(raw, media_type="application/json")
