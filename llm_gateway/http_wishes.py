"""`POST /v1/wishes`: what a wish in plain words means, for HTTP clients."""

from __future__ import annotations

import msgspec

from llm_gateway.http_errors import HttpError
from llm_gateway.wish_reading import said_at
from swarm.errors import GatewayError
from swarm.messages import WishRequest, intent_to_json
from swarm.messages.wish import WishAnswer


def read_wish(raw: bytes) -> WishRequest:
    """The request of a body: `wish`, `site` (`robots`, `places`, `classes`) and `now`.

    Raises HttpError that says what is not allowed.
    """
    try:
        asked = msgspec.json.decode(raw, type=WishRequest)
        said_at(asked.now)
        return asked
    except GatewayError as error:
        raise HttpError(400, f"the wish is not valid: {error}", param="now") from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise HttpError(400, f"the wish is not valid: {error}") from error


def write_wish(answer: WishAnswer) -> bytes:
    """The intent alone, in the form of docs/wishes.md."""
    return msgspec.json.encode(intent_to_json(answer.understood))
